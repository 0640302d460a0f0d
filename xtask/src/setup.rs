//! `cargo xtask setup`

use eigenhand_cli::output::Outcome;
use eigenhand_cli::setup;

use crate::python;

/// Installs what the tests need: MuJoCo, and Python packages in a virtual environment below `target`
#[derive(clap::Args)]
#[command(after_help = "Prints each command before running it.\n\nExample:\n  cargo xtask setup")]
pub struct Args {
    #[command(flatten)]
    install: setup::InstallArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    setup::ensure_mujoco(&args.install)?;
    python::install()?;
    Ok(Outcome::Done)
}
