//! Reads hands from directories, sound and broken.
#![forbid(unsafe_code)]
// A helper function of a test fails the test, which is what a panic means here.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod actuation;
mod additions;
mod broken;
mod compiled;
mod faults;
mod fixture;
mod import;
mod model;
mod mutation;
mod registry;
mod shadow;
mod urdf;
