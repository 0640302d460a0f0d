//! Installing MuJoCo's system package, on systems that have it.

use std::io::IsTerminal;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use eigenhand_bench::BenchError;
use eigenhand_mujoco::{LIBRARY_VARIABLE, MuJoCo, MuJoCoError};
use eigenhand_sim::SimError;
use eigenhand_train::TrainError;

/// Debian's package of the library.
pub const PACKAGE: &str = "libmujoco2.2.2";
/// Environment variable that forbids installing anything.
pub const NO_INSTALL_VARIABLE: &str = "EIGENHAND_NO_INSTALL";

/// Whether a missing system package may be installed.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct InstallArgs {
    /// Installs no system package [also: EIGENHAND_NO_INSTALL=1]
    #[arg(long)]
    pub no_install: bool,
}

/// How this process can run a command as root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Privilege {
    /// This process is root.
    Root,
    /// `sudo` works without a password.
    Sudo,
    /// `sudo` asks for the password on the terminal.
    SudoAsking,
}

/// Runs `work`. If it fails because MuJoCo is missing, installs Debian's package, if possible and allowed, and runs
/// `work` again. So every other fault of a command is reported before anything is installed.
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
                true => error.context(format!("{PACKAGE} was installed, but MuJoCo does not load")),
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

/// Tells whether libmujoco is missing, so that installing the package helps.
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

/// Installs the package, or returns the reason against it.
fn mend(args: &InstallArgs, missing: anyhow::Error) -> anyhow::Result<()> {
    if args.no_install || is_set(NO_INSTALL_VARIABLE) || is_set(LIBRARY_VARIABLE) || !is_debian() {
        return Err(missing);
    }
    match privilege() {
        Some(privilege) => install(privilege),
        None => bail!(
            "MuJoCo is missing, and only root can install it: run `{}` as root, then this command again (or set \
             {LIBRARY_VARIABLE} to the path of a libmujoco.so.2.2.2)",
            install_line()
        ),
    }
}

/// Returns the command that installs the package, as a person would type it.
pub fn install_line() -> String {
    format!("apt-get install -y --no-install-recommends {PACKAGE}")
}

fn install(privilege: Privilege) -> anyhow::Result<()> {
    let prefix = match privilege {
        Privilege::Root => "",
        Privilege::Sudo | Privilege::SudoAsking => "sudo ",
    };
    eprintln!("MuJoCo is missing. Installing Debian's package {PACKAGE} with:");
    let known = has_candidate();
    if !known {
        eprintln!("  {prefix}apt-get update");
    }
    eprintln!("  {prefix}{}", install_line());
    eprintln!(
        "(to prevent this, use --no-install or set {NO_INSTALL_VARIABLE}=1; to use another library, set {LIBRARY_VARIABLE})"
    );
    if !known {
        apt(privilege, &["update"])?;
        if !has_candidate() {
            bail!(
                "apt does not offer the package {PACKAGE}: it is part of Debian 12 (bookworm), section main; on another \
                 system, set {LIBRARY_VARIABLE} to the path of a libmujoco.so.2.2.2"
            );
        }
    }
    let install = ["install", "-y", "--no-install-recommends", PACKAGE];
    match apt(privilege, &install) {
        Err(_) if known => {
            // Old package lists name files that no longer exist.
            eprintln!("this failed; trying again with new package lists:");
            apt(privilege, &["update"])?;
            apt(privilege, &install)
        }
        outcome => outcome,
    }
}

/// Runs apt-get with its output on standard error, because standard output may be for JSON.
fn apt(privilege: Privilege, arguments: &[&str]) -> anyhow::Result<()> {
    let mut command = match privilege {
        Privilege::Root => Command::new("apt-get"),
        Privilege::Sudo => sudo(&["-n"]),
        Privilege::SudoAsking => sudo(&[]),
    };
    let line = format!("apt-get {}", arguments.join(" "));
    let status = command
        .args(arguments)
        .env("DEBIAN_FRONTEND", "noninteractive")
        .stdout(std::io::stderr())
        .status()
        .with_context(|| format!("cannot run {line}"))?;
    if !status.success() {
        bail!("{line} failed ({status})");
    }
    Ok(())
}

fn sudo(options: &[&str]) -> Command {
    let mut command = Command::new("sudo");
    command.args(options).args(["env", "DEBIAN_FRONTEND=noninteractive", "apt-get"]);
    command
}

/// Tells whether apt knows a version of the package that it could install.
fn has_candidate() -> bool {
    let output = Command::new("apt-cache").args(["policy", PACKAGE]).env("LC_ALL", "C").stderr(Stdio::null()).output();
    output.is_ok_and(|output| offers_candidate(&String::from_utf8_lossy(&output.stdout)))
}

fn offers_candidate(policy: &str) -> bool {
    policy.lines().filter_map(|line| line.trim().strip_prefix("Candidate:")).any(|version| version.trim() != "(none)")
}

fn privilege() -> Option<Privilege> {
    let output = |program: &str, arguments: &[&str]| {
        Command::new(program).args(arguments).stdin(Stdio::null()).stderr(Stdio::null()).output().ok()
    };
    let user = output("id", &["-u"]).map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    if user.as_deref() == Some("0") {
        return Some(Privilege::Root);
    }
    if output("sudo", &["-n", "true"]).is_some_and(|output| output.status.success()) {
        return Some(Privilege::Sudo);
    }
    let has_sudo = output("sudo", &["--version"]).is_some_and(|output| output.status.success());
    (has_sudo && std::io::stdin().is_terminal()).then_some(Privilege::SudoAsking)
}

/// Tells whether the system is Debian or derived from it.
pub fn is_debian() -> bool {
    Path::new("/usr/bin/apt-get").exists()
        && std::fs::read_to_string("/etc/os-release").is_ok_and(|text| names_debian(&text))
}

fn names_debian(os_release: &str) -> bool {
    os_release
        .lines()
        .filter_map(|line| line.strip_prefix("ID=").or_else(|| line.strip_prefix("ID_LIKE=")))
        .any(|value| value.trim_matches('"').split_whitespace().any(|id| id == "debian"))
}

fn is_set(variable: &str) -> bool {
    std::env::var_os(variable).is_some_and(|value| !value.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn debian_is_told_from_others() {
        assert!(names_debian("PRETTY_NAME=\"Debian GNU/Linux 12\"\nID=debian\n"));
        assert!(names_debian("ID=linuxmint\nID_LIKE=\"ubuntu debian\"\n"));
        assert!(!names_debian("ID=fedora\nID_LIKE=\"rhel centos\"\n"));
    }

    #[test]
    fn an_offer_is_told_from_none() {
        assert!(offers_candidate("libmujoco2.2.2:\n  Installed: (none)\n  Candidate: 2.2.2-3\n"));
        assert!(!offers_candidate("libmujoco2.2.2:\n  Installed: (none)\n  Candidate: (none)\n"));
        assert!(!offers_candidate(""));
    }
}
