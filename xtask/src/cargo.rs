//! Calling Cargo.

use std::process::Command;

/// The only profile in use, so that the crates below `cargo xtask` are built only once.
pub const PROFILE: &str = "--release";

/// Returns a command of the cargo that runs this program.
pub fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments);
    command
}
