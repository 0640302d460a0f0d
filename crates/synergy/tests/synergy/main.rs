//! The crate's tests through its public interface.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
mod content;
mod database;
mod export;
mod pca;
