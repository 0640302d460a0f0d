//! Cargo, as this program's commands call it.

use std::process::Command;

/// The one profile of everything here, so that what `cargo xtask` itself is built from is built once.
pub const PROFILE: &str = "--release";

/// Returns a command of the cargo that runs this program.
pub fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments);
    command
}
