//! Integration tests that need several crates of the workspace.
#![forbid(unsafe_code)]
// A panic in a helper function fails the test, as intended.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod bundle;
mod choice;
mod confinement;
mod contract;
mod damage;
mod defaults;
mod divergence;
mod docs;
mod edges;
mod examples;
mod explorer;
mod fuzz;
mod gripper;
#[path = "../../fuzz/src/inputs.rs"]
mod inputs;
mod new_hand;
mod published;
mod python;
mod report;
mod reproduce;
mod reward;
mod schedules;
mod simulation;
mod source;
mod start;
mod support;
mod symptoms;
mod training;
