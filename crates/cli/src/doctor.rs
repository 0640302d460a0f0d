//! `eigenhand doctor`

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use eigenhand_hands::Registry;
use eigenhand_mujoco::{LIBRARY_VARIABLE, MuJoCo};
use eigenhand_report::counted;
use serde::Serialize;

use crate::output::{Outcome, print, print_json};
use crate::{program, search_path, setup};

/// Directory into which `train` writes runs by default.
const RUNS: &str = "runs";

/// Checks this machine, and names the command that installs a missing part
#[derive(clap::Args)]
#[command(after_help = "Exit status 1 if a required part is missing.\n\nExample:\n  eigenhand doctor")]
pub struct Args {
    /// Additional directory of hands; can be given several times
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
    /// Prints one JSON document on standard output
    #[arg(long)]
    json: bool,
}

/// One part that the machine has or lacks.
#[derive(Serialize)]
struct Finding {
    name: &'static str,
    ok: bool,
    required: bool,
    detail: String,
    /// The command to type or the thing to change, if the part is missing.
    mend: Option<String>,
}

#[derive(Serialize)]
struct Diagnosis {
    ok: bool,
    findings: Vec<Finding>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let findings = vec![mujoco(), compiler(), cores(), runs(), hands(&args.plugins), python()];
    let ok = findings.iter().all(|finding| finding.ok || !finding.required);
    let diagnosis = Diagnosis { ok, findings };
    if args.json {
        print_json(&diagnosis)?
    } else {
        print(&describe(&diagnosis))?
    }
    Ok(if ok { Outcome::Done } else { Outcome::Failed })
}

fn describe(diagnosis: &Diagnosis) -> String {
    let width = diagnosis.findings.iter().map(|finding| finding.name.len()).max().unwrap_or(0);
    let mut text = String::new();
    for finding in &diagnosis.findings {
        let mark = match (finding.ok, finding.required) {
            (true, _) => "ok      ",
            (false, true) => "MISSING ",
            (false, false) => "optional",
        };
        let indent = " ".repeat(mark.len() + width + 4);
        let detail = finding.detail.replace('\n', &format!("\n{indent}"));
        text.push_str(&format!("{mark}  {:<width$}  {detail}\n", finding.name));
        if let Some(mend) = &finding.mend {
            text.push_str(&format!("{indent}-> {mend}\n"));
        }
    }
    let missing = diagnosis.findings.iter().filter(|finding| finding.required && !finding.ok).count();
    text.push_str(&match missing {
        0 => "all required parts are present\n".to_owned(),
        n => format!("{n} required {} missing\n", if n == 1 { "part is" } else { "parts are" }),
    });
    text
}

fn mujoco() -> Finding {
    let (ok, detail, mend) = match MuJoCo::load() {
        Ok(library) => (true, format!("{} from {}", library.version(), library.origin()), None),
        Err(error) => {
            let mend = if std::env::var_os(LIBRARY_VARIABLE).is_some_and(|value| !value.is_empty()) {
                format!("unset {LIBRARY_VARIABLE}")
            } else {
                setup::how_to_install()
            };
            (false, error.to_string(), Some(mend))
        }
    };
    Finding { name: "MuJoCo", ok, required: true, detail, mend }
}

fn compiler() -> Finding {
    let found = ["cc", "gcc", "clang"].into_iter().find_map(|name| Some((name, first_line(name, &["--version"])?)));
    let mend = found.is_none().then(|| "sudo apt-get install -y build-essential".to_owned());
    let detail = match found {
        Some((_, version)) => version,
        None => "cc, gcc or clang not found; Rust needs one of them to link programs and to build SQLite".to_owned(),
    };
    Finding { name: "C compiler", ok: mend.is_none(), required: true, detail, mend }
}

fn cores() -> Finding {
    let n = eigenhand_train::config::worker_count(0) as u64;
    Finding { name: "cores", ok: true, required: false, detail: counted(n, "core"), mend: None }
}

fn runs() -> Finding {
    let path = Path::new(RUNS);
    let place = if path.is_dir() { path } else { Path::new(".") };
    let probe = place.join(format!(".eigenhand-doctor-{}", std::process::id()));
    let shown = std::env::current_dir().unwrap_or_default().join(path);
    let (detail, mend) = match std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe)) {
        Ok(()) => (format!("{} can be written", shown.display()), None),
        Err(error) => (
            format!("{} cannot be written: {error}", shown.display()),
            Some(format!("choose a directory that you can write to: {}", program::line("train --hand NAME --out DIR"))),
        ),
    };
    Finding { name: "runs", ok: mend.is_none(), required: true, detail, mend }
}

fn hands(plugins: &[PathBuf]) -> Finding {
    let finding = |ok, detail, mend| Finding { name: "hands", ok, required: true, detail, mend };
    let registry = match Registry::discover(&search_path(plugins)) {
        Ok(registry) => registry,
        Err(error) => {
            let mend = "correct or remove this entry of --plugins or EIGENHAND_PLUGINS".to_owned();
            return finding(false, error.to_string(), Some(mend));
        }
    };
    let broken: Vec<String> = registry
        .list()
        .iter()
        .filter_map(|entry| entry.hand.as_ref().err().map(|error| format!("{}: {error}", entry.name)))
        .collect();
    let sound: Vec<&str> =
        registry.list().iter().filter(|entry| entry.hand.is_ok()).map(|entry| entry.name.as_str()).collect();
    if sound.is_empty() && broken.is_empty() {
        let mend = "run this in a checkout of the repository, or name a directory of hands with --plugins".to_owned();
        return finding(false, "no hands were found".to_owned(), Some(mend));
    }
    let mut detail = sound.join(", ");
    if !broken.is_empty() {
        detail =
            format!("{}\nbroken: {}", if sound.is_empty() { "none is usable" } else { &detail }, broken.join("\n"));
        let mend = "correct the file in the message, or move the hand's directory away".to_owned();
        return finding(false, detail, Some(mend));
    }
    finding(true, detail, None)
}

fn python() -> Finding {
    let script = "import mujoco, numpy; print('mujoco', mujoco.__version__ + ', numpy', numpy.__version__)";
    let (detail, mend) = match (first_line("python3", &["--version"]), first_line("python3", &["-c", script])) {
        (Some(version), Some(packages)) => (format!("{version}, {packages}"), None),
        (Some(version), None) => (
            format!("{version} without the packages mujoco and numpy; examples/python needs them"),
            Some("python3 -m venv .venv && .venv/bin/pip install mujoco numpy".to_owned()),
        ),
        (None, _) => (
            "python3 not found; examples/python needs it".to_owned(),
            Some("sudo apt-get install -y python3 python3-venv".to_owned()),
        ),
    };
    Finding { name: "Python", ok: mend.is_none(), required: false, detail, mend }
}

/// Runs a program and returns the first line it prints, if it succeeds.
fn first_line(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).stdin(Stdio::null()).stderr(Stdio::null()).output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout).lines().next().map(str::to_owned);
    text.filter(|_| output.status.success())
}
