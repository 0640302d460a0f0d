//! `cargo xtask wheel`

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail};
use eigenhand_cli::output::Outcome;
use eigenhand_files::create_directory;

use crate::cargo::{PROFILE, cargo};
use crate::python;

/// The Python package.
const PACKAGE: &str = "./python";
/// The program that goes with it; it is built beside this one.
const PROGRAM: &str = "eigenhand";

/// Builds a Python wheel that carries the program, the hands and the ready synergies
#[derive(clap::Args)]
#[command(
    after_help = "With it, `pip install eigenhand-*.whl` gives the command `eigenhand` and the Python package, without Rust.\n\
    The wheel is for this kind of machine: its system, its processor, and a C library no older than this one's.\n\n\
    Example:\n  cargo xtask wheel"
)]
pub struct Args {
    /// Directory for the wheel
    #[arg(long, value_name = "DIR", default_value = "target/wheel")]
    out: PathBuf,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    python::install()?;
    execute(&mut cargo(&["build", "--workspace", PROFILE, "--quiet"]))?;
    println!("{}", build(&args.out)?.display());
    Ok(Outcome::Done)
}

/// Builds the wheel from the package and the built program, and returns its path.
pub fn build(out: &Path) -> anyhow::Result<PathBuf> {
    let scratch = tempfile::tempdir().context("cannot make a temporary directory")?;
    let interpreter = python::interpreter();
    let run = |arguments: &[&str]| execute(Command::new(&interpreter).arg("-m").args(arguments));
    let (pure, open) = (scratch.path().join("pure"), scratch.path().join("open"));
    let text = |path: &Path| path.display().to_string();
    run(&["pip", "install", "--quiet", "wheel"])?;
    run(&["pip", "wheel", "--quiet", "--no-deps", PACKAGE, "--wheel-dir", &text(&pure)])?;
    run(&["wheel", "unpack", "--dest", &text(&open), &text(&only_entry(&pure)?)])?;
    let contents = only_entry(&open)?;
    let name = contents.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let scripts = contents.join(format!("{name}.data/scripts"));
    create_directory(&scripts)?;
    let program = std::env::current_exe().context("cannot find this program's own file")?.with_file_name(PROGRAM);
    fs::copy(&program, scripts.join(PROGRAM)).with_context(|| format!("cannot copy {}", program.display()))?;
    let about = contents.join(format!("{name}.dist-info/WHEEL"));
    let written = fs::read_to_string(&about).with_context(|| format!("cannot read {}", about.display()))?;
    let tagged = written
        .replace("py3-none-any", &format!("py3-none-{}", platform(&interpreter)?))
        .replace("Root-Is-Purelib: true", "Root-Is-Purelib: false");
    if tagged == written {
        bail!("{} is not that of a pure wheel: {written}", about.display());
    }
    fs::write(&about, tagged).with_context(|| format!("cannot write {}", about.display()))?;
    let packed = scratch.path().join("packed");
    create_directory(&packed)?;
    run(&["wheel", "pack", "--dest-dir", &text(&packed), &text(&contents)])?;
    create_directory(out)?;
    let wheel = only_entry(&packed)?;
    let target = out.join(wheel.file_name().unwrap_or_default());
    fs::copy(&wheel, &target).with_context(|| format!("cannot write {}", target.display()))?;
    Ok(target)
}

/// Returns the name of this platform in wheels, such as `linux_x86_64`.
fn platform(interpreter: &Path) -> anyhow::Result<String> {
    const SCRIPT: &str = "import sysconfig; print(sysconfig.get_platform().replace('-', '_').replace('.', '_'))";
    let output = Command::new(interpreter).args(["-c", SCRIPT]).output().context("cannot run Python")?;
    Ok(String::from_utf8(output.stdout)?.trim().to_owned())
}

fn only_entry(directory: &Path) -> anyhow::Result<PathBuf> {
    let entries = fs::read_dir(directory).with_context(|| format!("cannot list {}", directory.display()))?;
    let paths: Vec<PathBuf> = entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>()?;
    match paths.as_slice() {
        [path] => Ok(path.clone()),
        _ => bail!("expected one entry in {}, found {paths:?}", directory.display()),
    }
}

fn execute(command: &mut Command) -> anyhow::Result<()> {
    let line = format!("{command:?}");
    let status = command.stdout(std::io::stderr()).status().with_context(|| format!("cannot run {line}"))?;
    if status.success() { Ok(()) } else { bail!("{line} failed ({status})") }
}
