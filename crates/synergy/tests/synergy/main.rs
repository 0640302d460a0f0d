//! The crate's tests that need its public interface only.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
mod database;
mod export;
mod pca;
