//! `cargo xtask test`

use anyhow::Context;
use eigenhand_cli::output::Outcome;
use eigenhand_cli::setup;

use crate::cargo::{PROFILE, cargo};
use crate::python;

/// Runs all tests of the workspace
#[derive(clap::Args)]
#[command(
    after_help = "Passes its arguments on to `cargo test`. Tests of the Python examples need the packages that\n\
    `cargo xtask setup` installs, or a Python in EIGENHAND_PYTHON that has these packages; else they are skipped.\n\n\
    Examples:\n  cargo xtask test\n  cargo xtask test -p eigenhand-synergy pca"
)]
pub struct Args {
    /// Installs no system package [also: EIGENHAND_NO_INSTALL=1]
    #[arg(long)]
    no_install: bool,
    /// Arguments for `cargo test`
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGS")]
    args: Vec<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    setup::ensure_mujoco(&setup::InstallArgs { no_install: args.no_install })?;
    let whole =
        !args.args.iter().any(|arg| ["-p", "--package"].contains(&arg.as_str()) || arg.starts_with("--package="));
    let mut command = cargo(&["test", PROFILE]);
    if whole {
        command.arg("--workspace");
    }
    python::name_in(&mut command);
    let status = command.args(&args.args).status().context("cannot run cargo")?;
    Ok(if status.success() { Outcome::Done } else { Outcome::Failed })
}
