//! The Python for the tests of the examples.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail};
use eigenhand_cli::say;

/// Environment variable that names the Python.
const PYTHON: &str = "EIGENHAND_PYTHON";
/// Environment variable that makes a test fail, instead of being skipped, if its Python packages are missing.
const REQUIRED: &str = "EIGENHAND_PYTHON_REQUIRED";
/// Directory of the virtual environment that set-up makes.
const ENVIRONMENT: &str = "target/python";
/// The project's own package, so that its source is what the tests import, and the packages that the tests compare with. They
/// know how far this version of MuJoCo differs from the one that training uses.
const PACKAGES: [&str; 7] = [
    "--editable=./python[gymnasium]",
    "numpy>=2,<3",
    "mujoco==4.0.0",
    "onnxruntime==1.32.0",
    "pyyaml>=6,<7",
    "scipy>=1.15,<2",
    "tensorboard==2.21.0",
];

/// Makes a virtual environment with the packages, unless it exists.
///
/// # Errors
/// The command that failed, and the package to install.
pub fn install() -> anyhow::Result<()> {
    if has_packages(&interpreter()) {
        return Ok(());
    }
    let run = |program: &Path, arguments: &[&str]| -> anyhow::Result<()> {
        let line = format!("{} {}", program.display(), arguments.join(" "));
        say!("  {line}");
        let status = Command::new(program).args(arguments).stdout(std::io::stderr()).status();
        match status.with_context(|| format!("cannot run {line}"))? {
            status if status.success() => Ok(()),
            status => bail!("{line} failed ({status}); on Debian: apt-get install -y python3-venv"),
        }
    };
    say!("Installing the Python packages of the tests in {ENVIRONMENT} with:");
    run(Path::new("python3"), &["-m", "venv", ENVIRONMENT])?;
    run(&interpreter(), &[&["-m", "pip", "install", "--quiet"], PACKAGES.as_slice()].concat())
}

/// Lets a command's tests use this environment, if it is installed and `EIGENHAND_PYTHON` is not set.
pub fn name_in(command: &mut Command) {
    let interpreter = interpreter();
    if std::env::var_os(PYTHON).is_none() && interpreter.is_file() {
        command.env(PYTHON, interpreter);
    }
}

/// Lets a command's tests fail, instead of being skipped, if their Python packages are missing.
pub fn require_in(command: &mut Command) {
    name_in(command);
    command.env(REQUIRED, "1");
}

/// Returns the Python of this environment.
pub fn interpreter() -> PathBuf {
    std::env::current_dir().unwrap_or_default().join(ENVIRONMENT).join("bin/python")
}

fn has_packages(python: &Path) -> bool {
    let probe = Command::new(python)
        .args(["-c", "import eigenhand, gymnasium, mujoco, onnxruntime, scipy, tensorboard, yaml"])
        .output();
    probe.is_ok_and(|output| output.status.success())
}
