//! `cargo xtask ci`

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, anyhow, bail};
use eigenhand_cli::output::{Outcome, duration};
use eigenhand_cli::{say, search_path, setup};
use eigenhand_hands::Registry;

use crate::cargo::{PROFILE, cargo};
use crate::{python, wheel};

/// Episodes of the smoke run before and after it is resumed.
const SMOKE_EPISODES: [&str; 2] = ["12", "20"];
/// Settings that make the smoke run pass through every stage in seconds.
const SMOKE_SETTINGS: [&str; 6] = [
    "training.warmup_episodes=6",
    "training.checkpoint_every=4",
    "evaluation.every=8",
    "evaluation.episodes=4",
    "evaluation.final_episodes=6",
    "evaluation.selection_episodes=6",
];

/// Runs the steps of continuous integration: format, lints, tests, documentation, hands, and a short training
#[derive(clap::Args)]
#[command(after_help = "Stops at the first step that fails.\n\nExample:\n  cargo xtask ci")]
pub struct Args {
    #[command(flatten)]
    install: setup::InstallArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    // Found before the tests are built, because the build can replace the file.
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    setup::ensure_mujoco(&args.install)?;
    // Packages come from the network while the processor looks for lints.
    let packages = std::thread::spawn(python::install);
    let lints = ["clippy", "--workspace", "--all-targets", PROFILE, "--quiet", "--", "-D", "warnings"];
    let style = step("format", &mut cargo(&["fmt", "--all", "--check"]))
        .and_then(|()| dependencies())
        .and_then(|()| step("lints", &mut cargo(&lints)));
    // The installation ends in any case, so that it leaves no half-written environment.
    let installed = packages.join().map_err(|_| anyhow!("the installation of the Python packages stopped"))?;
    style.and(installed)?;
    let mut test = cargo(&["test", "--workspace", PROFILE, "--quiet"]);
    python::require_in(&mut test);
    step("tests", &mut test)?;
    let mut doc = cargo(&["doc", "--workspace", "--no-deps", PROFILE, "--quiet"]);
    step("documentation", doc.env("RUSTDOCFLAGS", "-D warnings"))?;
    let registry = Registry::discover(&search_path(&[]))?;
    if registry.list().is_empty() {
        bail!("no hands were found: run this in a checkout of the repository");
    }
    for entry in registry.list() {
        let name = format!("hand {}", entry.name);
        step(&name, Command::new(&program).args(["hands", "check"]).arg(&entry.directory))?;
    }
    if let Some(entry) = registry.list().first() {
        smoke(&program, &entry.directory)?;
    }
    wheel()?;
    say!("ci: all steps passed in {}", duration(started.elapsed().as_secs_f64()));
    Ok(Outcome::Done)
}

/// Checks licences and sources of the packages, where `cargo deny` is installed.
fn dependencies() -> anyhow::Result<()> {
    let mut version = cargo(&["deny", "--version"]);
    if !version.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success()) {
        say!("ci: dependencies skipped: cargo deny is not installed (cargo install cargo-deny)");
        return Ok(());
    }
    step("dependencies", &mut cargo(&["deny", "check", "bans", "licenses", "sources"]))
}

/// Trains for a few episodes, resumes, evaluates and exports, in a directory that is removed afterwards.
fn smoke(program: &Path, hand: &Path) -> anyhow::Result<()> {
    let scratch = tempfile::tempdir().context("cannot make a temporary directory")?;
    let (run, out) = (scratch.path().join("run"), scratch.path().join("export"));
    let mut train = Command::new(program);
    train.args(["train", "--quiet", "--preset", "quick", "--episodes", SMOKE_EPISODES[0], "--hand"]).arg(hand);
    SMOKE_SETTINGS.iter().for_each(|setting| _ = train.args(["--set", setting]));
    step("train", train.arg("--out").arg(&run))?;
    let mut resume = Command::new(program);
    step("resume", resume.args(["train", "--quiet", "--episodes", SMOKE_EPISODES[1], "--resume"]).arg(&run))?;
    step("eval", Command::new(program).args(["eval", "--episodes", "4"]).arg(&run))?;
    step("export", Command::new(program).arg("export").arg(&run).arg("--out").arg(&out))
}

/// Builds the wheel, installs it in an empty environment, and trains and reads a synergy with what it brings. Then does the
/// last with the package alone, which runs the policy.
fn wheel() -> anyhow::Result<()> {
    let scratch = tempfile::tempdir().context("cannot make a temporary directory")?;
    let run = scratch.path().join("run");
    let wheel = wheel::build(scratch.path())?;
    let environment = scratch.path().join("venv");
    let python = environment_with("wheel", &environment, &wheel)?;
    let mut train = Command::new(environment.join("bin/eigenhand"));
    train.args(["train", "--quiet", "--hand", "shadow", "--preset", "quick", "--episodes", SMOKE_EPISODES[0]]);
    SMOKE_SETTINGS.iter().for_each(|setting| _ = train.args(["--set", setting]));
    step("wheel trains", train.arg("--out").arg(&run).current_dir(scratch.path()))?;
    const SCRIPT: &str = "import eigenhand, sys\n\
        synergy, policy = eigenhand.Synergy.load('shadow'), eigenhand.Policy.load(sys.argv[1])\n\
        assert len(synergy.command([0.1])) == len(policy.actuators) - 1";
    step("wheel's package", Command::new(&python).args(["-c", SCRIPT]).arg(&run).current_dir(scratch.path()))?;
    const POLICY: &str = "import eigenhand, numpy, sys\n\
        synergy, policy = eigenhand.Synergy.load('shadow'), eigenhand.Policy.load(sys.argv[1])\n\
        action = policy.act(numpy.zeros(len(policy.observation)), numpy.zeros(3))\n\
        command = policy.command(action)\n\
        assert len(command) == len(policy.actuators) == len(synergy.command([0.1])) + 1";
    let python = environment_with("package", &scratch.path().join("package"), Path::new("./python"))?;
    step("package runs a policy", Command::new(&python).args(["-c", POLICY]).arg(&run).current_dir(scratch.path()))
}

/// Makes an empty environment, installs one thing in it, and returns its Python.
fn environment_with(what: &str, environment: &Path, installed: &Path) -> anyhow::Result<PathBuf> {
    step(&format!("{what}'s environment"), Command::new("python3").args(["-m", "venv"]).arg(environment))?;
    let python = environment.join("bin/python");
    let mut install = Command::new(&python);
    step(&format!("{what} installed"), install.args(["-m", "pip", "install", "--quiet"]).arg(installed))?;
    Ok(python)
}

/// Runs one step; prints its name before and its time after.
fn step(name: &str, command: &mut Command) -> anyhow::Result<()> {
    say!("ci: {name}");
    let started = Instant::now();
    let status = command.status().with_context(|| format!("cannot run {:?}", command.get_program()))?;
    let seconds = started.elapsed().as_secs_f64();
    if !status.success() {
        let arguments: Vec<_> = command.get_args().map(|argument| argument.to_string_lossy().into_owned()).collect();
        let program = Path::new(command.get_program()).file_name().unwrap_or_default().to_string_lossy().into_owned();
        bail!("step {name:?} failed after {} ({status}): {program} {}", duration(seconds), arguments.join(" "));
    }
    say!("ci: {name} passed in {}", duration(seconds));
    Ok(())
}
