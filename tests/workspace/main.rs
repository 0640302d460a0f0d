//! Integration tests of the workspace: what no crate can test alone.
#![forbid(unsafe_code)]
// A helper function of a test fails the test, which is what a panic means here.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod choice;
mod contract;
mod defaults;
mod divergence;
mod docs;
mod edges;
mod gripper;
mod new_hand;
mod python;
mod report;
mod reproduce;
mod reward;
mod schedules;
mod simulation;
mod source;
mod support;
mod training;
