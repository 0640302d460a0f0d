//! Installing MuJoCo: Debian's package, or its library from PyPI.

use eigenhand_bench::BenchError;
use eigenhand_mujoco::{LIBRARY_VARIABLE, MuJoCo, MuJoCoError};
use eigenhand_sim::SimError;
use eigenhand_train::TrainError;

use crate::program;

mod debian;
mod wheel;

/// Environment variable that forbids installing anything.
pub const NO_INSTALL_VARIABLE: &str = "EIGENHAND_NO_INSTALL";

/// How to prevent an installation, in words.
const PREVENTION: &str = "(to prevent this, use --no-install or set EIGENHAND_NO_INSTALL=1; to use another library, set \
                          EIGENHAND_MUJOCO_LIB)";

/// Whether MuJoCo may be installed if it is missing.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct InstallArgs {
    /// Installs nothing if MuJoCo is missing [also: EIGENHAND_NO_INSTALL=1]
    #[arg(long)]
    pub no_install: bool,
}

/// Runs `work`. If it fails because MuJoCo is missing, installs it, if possible and allowed, and runs `work` again. So
/// every other fault of a command is reported before anything is installed.
///
/// # Errors
/// The errors of `work`, or of the installation.
pub fn with_mujoco<T, E>(args: &InstallArgs, work: impl Fn() -> Result<T, E>) -> anyhow::Result<T>
where
    anyhow::Error: From<E>,
{
    let work = || work().map_err(anyhow::Error::from);
    match work() {
        Err(missing) if is_missing_library(&missing) => {
            mend(args, missing)?;
            work().map_err(|error| match is_missing_library(&error) {
                true => error.context("MuJoCo was installed, but does not load"),
                false => error,
            })
        }
        outcome => outcome,
    }
}

/// Makes sure that MuJoCo loads.
///
/// # Errors
/// As [`with_mujoco`].
pub fn ensure_mujoco(args: &InstallArgs) -> anyhow::Result<()> {
    with_mujoco(args, || MuJoCo::load().map(|_| ()))
}

/// Tells whether libmujoco is missing, so that installing it helps.
pub fn is_missing_library(error: &anyhow::Error) -> bool {
    let found = |error: &MuJoCoError| matches!(error, MuJoCoError::LibraryMissing { .. });
    let within_train = |error: &TrainError| match error {
        TrainError::MuJoCo(error) | TrainError::Sim(SimError::MuJoCo(error)) => found(error),
        _ => false,
    };
    let within_bench = |error: &BenchError| match error {
        BenchError::MuJoCo(error) => found(error),
        BenchError::Train(error) => within_train(error),
        _ => false,
    };
    error.downcast_ref::<MuJoCoError>().is_some_and(found)
        || error.downcast_ref::<TrainError>().is_some_and(within_train)
        || error.downcast_ref::<BenchError>().is_some_and(within_bench)
}

/// Installs MuJoCo, or returns the reason against it.
fn mend(args: &InstallArgs, missing: anyhow::Error) -> anyhow::Result<()> {
    if args.no_install || is_set(NO_INSTALL_VARIABLE) || is_set(LIBRARY_VARIABLE) {
        return Err(missing);
    }
    if debian::install()? || wheel::fetch()? {
        return Ok(());
    }
    Err(missing)
}

/// Returns what a person types to install MuJoCo on this system.
pub fn how_to_install() -> String {
    let train = program::line("train");
    if debian::has_candidate() {
        format!("sudo {}    ({train} installs it too)", debian::install_line())
    } else {
        format!("{train}    (it fetches the library from PyPI)")
    }
}

fn is_set(variable: &str) -> bool {
    std::env::var_os(variable).is_some_and(|value| !value.is_empty())
}
