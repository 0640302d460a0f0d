//! `cargo xtask bindings`

use std::process::Command;

use anyhow::Context;
use eigenhand_cli::output::Outcome;

/// The script that calls bindgen.
const SCRIPT: &str = "crates/mujoco/src/regenerate.sh";

/// Generates the bindings to MuJoCo again from its headers
#[derive(clap::Args)]
#[command(
    after_help = "Needs bindgen and the headers of MuJoCo 2.2.2; the script crates/mujoco/src/regenerate.sh says how to \
    install both.\n\nExample:\n  cargo xtask bindings"
)]
pub struct Args {}

/// Runs the command.
pub fn run(_: &Args) -> anyhow::Result<Outcome> {
    let status = Command::new("sh").arg(SCRIPT).status().with_context(|| format!("cannot run {SCRIPT}"))?;
    Ok(if status.success() { Outcome::Done } else { Outcome::Failed })
}
