//! Other implementations of the same work, which run in Python and are not part of this workspace.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde::{Deserialize, Serialize};

use crate::error::BenchError;
use crate::setting::median;

/// Environment variable with the path of a Python that has the peers' packages.
pub const PYTHON_VARIABLE: &str = "EIGENHAND_PEERS_PYTHON";
/// Folder of the peers' scripts, in the workspace.
const FOLDER: &str = "bench/peers";
/// Python of a virtual environment in this folder.
const PYTHON: &str = ".venv/bin/python";
/// Variables that keep numeric libraries on one thread.
const ONE_THREAD: [&str; 4] = ["OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS"];

/// The measurement of a script.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PeerKind {
    /// Updates on one thread.
    Update,
    /// Rollouts and updates together, on every core.
    Training,
}

impl PeerKind {
    /// Returns the end of the name of such a script.
    fn suffix(self) -> &'static str {
        match self {
            PeerKind::Update => "_update.py",
            PeerKind::Training => "_training.py",
        }
    }
}

/// A script that measures another implementation.
#[derive(Clone, Debug)]
pub struct Peer {
    /// Name of the implementation.
    pub name: String,
    kind: PeerKind,
    python: PathBuf,
    script: PathBuf,
}

/// Speed of another implementation, and of this one, measured by turns.
#[derive(Clone, Debug, Serialize)]
pub struct PeerSpeed {
    /// Name of the implementation.
    pub name: String,
    /// Its updates a second, including drawing the minibatches, and rollouts if they are part of the work.
    pub updates_per_s: f64,
    /// Updates a second of this implementation, in the same measurement.
    pub ours_per_s: f64,
    /// `ours_per_s` over `updates_per_s`, median over the turns.
    pub ratio: f64,
}

#[derive(Deserialize)]
struct PeerRecord {
    updates_per_s: f64,
}

/// Rates of this implementation and another, for each turn.
#[derive(Default)]
pub(crate) struct Turns {
    ours: Vec<f64>,
    theirs: Vec<f64>,
}

impl Turns {
    /// Adds a turn of each.
    pub fn push(&mut self, ours: f64, theirs: f64) {
        self.ours.push(ours);
        self.theirs.push(theirs);
    }

    /// Returns the medians.
    pub fn compare(mut self, name: &str) -> PeerSpeed {
        let mut ratios: Vec<f64> = self.ours.iter().zip(&self.theirs).map(|(ours, theirs)| ours / theirs).collect();
        PeerSpeed {
            name: name.to_owned(),
            updates_per_s: median(&mut self.theirs),
            ours_per_s: median(&mut self.ours),
            ratio: median(&mut ratios),
        }
    }
}

/// Finds the peers of the workspace, and a Python that can run them; returns no peer if either is missing.
pub fn find_peers(kind: PeerKind) -> Vec<Peer> {
    let Ok(current) = std::env::current_dir() else { return Vec::new() };
    let Some(folder) = current.ancestors().map(|d| d.join(FOLDER)).find(|folder| folder.is_dir()) else {
        return Vec::new();
    };
    let python = std::env::var_os(PYTHON_VARIABLE)
        .filter(|value| !value.is_empty())
        .map_or_else(|| folder.join(PYTHON), PathBuf::from);
    if !runs(&python) {
        return Vec::new();
    }
    let scripts = folder.read_dir().into_iter().flatten().flatten().filter_map(|entry| {
        let script = entry.path();
        let name = script.file_name()?.to_str()?.strip_suffix(kind.suffix())?.to_owned();
        Some(Peer { name, kind, python: python.clone(), script })
    });
    let mut peers: Vec<Peer> = scripts.collect();
    peers.sort_by(|a, b| a.name.cmp(&b.name));
    peers
}

fn runs(python: &Path) -> bool {
    let status = Command::new(python).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

impl Peer {
    /// Runs the script with options and their values, and returns its updates a second.
    ///
    /// # Errors
    /// [`BenchError::Peer`] with the script's error message.
    pub(crate) fn updates_per_s(&self, options: &[(&str, String)]) -> Result<f64, BenchError> {
        let failed = |reason: String| BenchError::Peer { script: self.script.display().to_string(), reason };
        let mut command = Command::new(&self.python);
        command.arg(&self.script);
        for (name, value) in options {
            command.arg(format!("--{name}")).args(value.split(' '));
        }
        if self.kind == PeerKind::Update {
            ONE_THREAD.iter().for_each(|name| _ = command.env(name, "1"));
        }
        let output = command.stdin(Stdio::null()).output().map_err(|error| failed(error.to_string()))?;
        if !output.status.success() {
            let text = String::from_utf8_lossy(&output.stderr);
            let last = text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it printed no error");
            return Err(failed(format!("{}: {last}", output.status)));
        }
        let text = String::from_utf8_lossy(&output.stdout);
        let last = text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or_default();
        let record: PeerRecord =
            serde_json::from_str(last).map_err(|error| failed(format!("its last line is {last:?}: {error}")))?;
        Ok(record.updates_per_s)
    }
}
