//! `cargo xtask test` and `cargo xtask ci`

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, bail};
use eigenhand_train::registry;

use crate::output::{Outcome, duration};
use crate::setup;

/// The one profile of everything here, so that what `cargo xtask` itself is built from is built once.
const PROFILE: &str = "--release";
/// Episodes of the smoke run before and after it is resumed.
const SMOKE_EPISODES: [&str; 2] = ["12", "20"];
/// Settings that make the smoke run pass through every stage in seconds.
const SMOKE_SETTINGS: [&str; 5] = [
    "training.warmup_episodes=6",
    "training.checkpoint_every=4",
    "evaluation.every=8",
    "evaluation.episodes=4",
    "evaluation.final_episodes=6",
];

/// Runs all tests of the workspace
#[derive(clap::Args)]
#[command(after_help = "Arguments are passed on to `cargo test`.\n\n\
    Examples:\n  cargo xtask test\n  cargo xtask test -p eigenhand-synergy pca")]
pub struct TestArgs {
    /// Never installs a system package [also: EIGENHAND_NO_INSTALL=1]
    #[arg(long)]
    no_install: bool,
    /// Arguments for `cargo test`
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGS")]
    args: Vec<String>,
}

/// Runs all that continuous integration runs: format, lints, tests, documentation, hands, and a short training
#[derive(clap::Args)]
#[command(after_help = "Stops at the first step that fails.\n\nExample:\n  cargo xtask ci")]
pub struct CiArgs {
    #[command(flatten)]
    install: setup::InstallArgs,
}

/// Runs `cargo xtask test`.
pub fn test(args: &TestArgs) -> anyhow::Result<Outcome> {
    setup::ensure_mujoco(&setup::InstallArgs { no_install: args.no_install })?;
    let whole =
        !args.args.iter().any(|arg| ["-p", "--package"].contains(&arg.as_str()) || arg.starts_with("--package="));
    let mut command = cargo(&["test", PROFILE]);
    if whole {
        command.arg("--workspace");
    }
    let status = command.args(&args.args).status().context("cannot run cargo")?;
    Ok(if status.success() { Outcome::Done } else { Outcome::Failed })
}

/// Runs `cargo xtask ci`.
pub fn ci(args: &CiArgs) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    // Asked before the tests are built, which may put another file in its place.
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    setup::ensure_mujoco(&args.install)?;
    step("format", &mut cargo(&["fmt", "--all", "--check"]))?;
    step("lints", &mut cargo(&["clippy", "--workspace", "--all-targets", PROFILE, "--quiet", "--", "-D", "warnings"]))?;
    step("tests", &mut cargo(&["test", "--workspace", PROFILE, "--quiet"]))?;
    let mut doc = cargo(&["doc", "--workspace", "--no-deps", PROFILE, "--quiet"]);
    step("documentation", doc.env("RUSTDOCFLAGS", "-D warnings"))?;
    let registry = registry(&[])?;
    if registry.list().is_empty() {
        bail!("no hands were found: run this in the workspace");
    }
    for entry in registry.list() {
        let name = format!("hand {}", entry.name);
        step(&name, Command::new(&program).args(["hands", "check"]).arg(&entry.directory))?;
    }
    if let Some(entry) = registry.list().first() {
        smoke(&program, &entry.directory)?;
    }
    eprintln!("ci: all steps passed in {}", duration(started.elapsed().as_secs_f64()));
    Ok(Outcome::Done)
}

/// Trains for a few episodes, resumes, evaluates and exports, in a directory that is removed afterwards.
fn smoke(program: &Path, hand: &Path) -> anyhow::Result<()> {
    let scratch = Scratch::new()?;
    let (run, out) = (scratch.0.join("run"), scratch.0.join("export"));
    let mut train = Command::new(program);
    train.args(["train", "--quiet", "--preset", "quick", "--episodes", SMOKE_EPISODES[0], "--hand"]).arg(hand);
    SMOKE_SETTINGS.iter().for_each(|setting| _ = train.args(["--set", setting]));
    step("train", train.arg("--out").arg(&run))?;
    let mut resume = Command::new(program);
    step("resume", resume.args(["train", "--quiet", "--episodes", SMOKE_EPISODES[1], "--resume"]).arg(&run))?;
    step("eval", Command::new(program).args(["eval", "--episodes", "4"]).arg(&run))?;
    step("export", Command::new(program).arg("export").arg(&run).arg("--out").arg(&out))
}

/// Runs one step; says its name before and its time after.
fn step(name: &str, command: &mut Command) -> anyhow::Result<()> {
    eprintln!("ci: {name}");
    let started = Instant::now();
    let status = command.status().with_context(|| format!("cannot run {:?}", command.get_program()))?;
    let seconds = started.elapsed().as_secs_f64();
    if !status.success() {
        let arguments: Vec<_> = command.get_args().map(|argument| argument.to_string_lossy().into_owned()).collect();
        let program = Path::new(command.get_program()).file_name().unwrap_or_default().to_string_lossy().into_owned();
        bail!("step {name:?} failed after {} ({status}): {program} {}", duration(seconds), arguments.join(" "));
    }
    eprintln!("ci: {name} passed in {}", duration(seconds));
    Ok(())
}

/// Returns a command of the cargo that runs this program.
pub fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments);
    command
}

/// A directory that is removed when it goes out of use.
struct Scratch(PathBuf);

impl Scratch {
    fn new() -> anyhow::Result<Scratch> {
        let path = std::env::temp_dir().join(format!("eigenhand-ci-{}", std::process::id()));
        std::fs::create_dir_all(&path).with_context(|| format!("cannot create {}", path.display()))?;
        Ok(Scratch(path))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What is left in the temporary directory does no harm.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
