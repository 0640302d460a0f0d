//! Debian's package of MuJoCo.

use std::io::IsTerminal;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use eigenhand_train::say;

use super::PREVENTION;

/// Debian's package of the library.
const PACKAGE: &str = "libmujoco2.2.2";

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

/// Returns the command that installs the package, as a person would type it.
pub(super) fn install_line() -> String {
    format!("apt-get install -y --no-install-recommends {PACKAGE}")
}

/// Installs the package if the system offers it and this process may. Returns whether it was installed.
///
/// # Errors
/// A failure of apt-get.
pub(super) fn install() -> anyhow::Result<bool> {
    let system = std::fs::read_to_string("/etc/os-release").unwrap_or_default();
    let known = has_candidate();
    // Debian itself may offer the package once its lists are there. Systems derived from it seldom do.
    if !Path::new("/usr/bin/apt-get").exists() || !(known || is_debian(&system)) {
        return Ok(false);
    }
    let Some(privilege) = privilege() else { return Ok(false) };
    let prefix = match privilege {
        Privilege::Root => "",
        Privilege::Sudo | Privilege::SudoAsking => "sudo ",
    };
    say!("MuJoCo is missing. Installing Debian's package {PACKAGE} with:");
    if !known {
        say!("  {prefix}apt-get update");
    }
    say!("  {prefix}{}", install_line());
    say!("{PREVENTION}");
    if !known {
        apt(privilege, &["update"])?;
        if !has_candidate() {
            say!("apt does not offer the package: it is part of Debian 12 (bookworm), section main");
            return Ok(false);
        }
    }
    let install = ["install", "-y", "--no-install-recommends", PACKAGE];
    match apt(privilege, &install) {
        Err(_) if known => {
            // Old package lists name files that no longer exist.
            say!("this failed; trying again with new package lists:");
            apt(privilege, &["update"])?;
            apt(privilege, &install)
        }
        outcome => outcome,
    }?;
    Ok(true)
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
pub(super) fn has_candidate() -> bool {
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

/// Tells whether the text of `/etc/os-release` is that of Debian.
fn is_debian(os_release: &str) -> bool {
    os_release.lines().filter_map(|line| line.strip_prefix("ID=")).any(|id| id.trim_matches('"') == "debian")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn debian_is_told_from_others() {
        assert!(is_debian("PRETTY_NAME=\"Debian GNU/Linux 12\"\nID=debian\n"));
        assert!(!is_debian("ID=ubuntu\nID_LIKE=debian\n"));
        assert!(!is_debian("ID=fedora\nID_LIKE=\"rhel centos\"\n"));
    }

    #[test]
    fn an_offer_is_told_from_none() {
        assert!(offers_candidate("libmujoco2.2.2:\n  Installed: (none)\n  Candidate: 2.2.2-3\n"));
        assert!(!offers_candidate("libmujoco2.2.2:\n  Installed: (none)\n  Candidate: (none)\n"));
        assert!(!offers_candidate(""));
    }
}
