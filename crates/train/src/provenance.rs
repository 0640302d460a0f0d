//! Provenance: the versions, the machine and the hand at the start of a run.

use std::path::Path;
use std::process::{Command, Stdio};

use eigenhand_hands::Hand;
use eigenhand_mujoco::MuJoCo;
use serde::{Deserialize, Serialize};

use crate::error::TrainError;

/// Record of versions, machine and hand, written into every run directory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Version of these keys.
    pub schema: u32,
    /// Name of the hand.
    pub hand: String,
    /// SHA-256 over the hand's files.
    pub hand_digest: String,
    /// Directory of the hand's plugin.
    pub hand_directory: String,
    /// Version of this program.
    pub eigenhand_version: String,
    /// Git revision, at the start of the run, of the checkout that the program was built from. It ends with `+` if
    /// there are uncommitted changes, and is empty without a checkout.
    pub git_revision: String,
    /// Version of MuJoCo.
    pub mujoco_version: String,
    /// File or soname that MuJoCo was loaded from.
    pub mujoco_library: String,
    /// Name of the machine.
    pub host: String,
    /// Processors that the program may use.
    pub processors: usize,
    /// Operating system and processor architecture.
    pub platform: String,
    /// Seconds since 1970-01-01 UTC at the start.
    pub started_unix_s: u64,
}

impl Provenance {
    /// Collects the record for a run that starts now.
    pub fn collect(hand: &Hand, library: &MuJoCo) -> Provenance {
        Provenance {
            schema: 1,
            hand: hand.manifest.name.clone(),
            hand_digest: hand.digest.clone(),
            hand_directory: hand.directory.display().to_string(),
            eigenhand_version: env!("CARGO_PKG_VERSION").to_owned(),
            git_revision: git_revision(),
            mujoco_version: library.version(),
            mujoco_library: library.origin().to_owned(),
            host: std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default().trim().to_owned(),
            processors: std::thread::available_parallelism().map_or(1, |n| n.get()),
            platform: format!("{}-{}", std::env::consts::OS, std::env::consts::ARCH),
            started_unix_s: std::time::SystemTime::now()
                .duration_since(std::time::UNIX_EPOCH)
                .map_or(0, |elapsed| elapsed.as_secs()),
        }
    }

    pub(crate) fn to_toml(&self, path: &Path) -> Result<String, TrainError> {
        toml::to_string(self).map_err(|error| TrainError::Format { path: path.to_owned(), reason: error.to_string() })
    }

    pub(crate) fn read(path: &Path) -> Result<Provenance, TrainError> {
        let damaged = |reason: String| TrainError::Damaged {
            path: path.to_owned(),
            reason,
            mend: "the run itself is not affected: restore this file, or start a new run".to_owned(),
        };
        let text = std::fs::read_to_string(path).map_err(|error| damaged(error.to_string()))?;
        toml::from_str(&text).map_err(|error| damaged(error.to_string()))
    }
}

fn git_revision() -> String {
    let git = |arguments: &[&str]| {
        let source = env!("CARGO_MANIFEST_DIR");
        let output = Command::new("git").args(["-C", source]).args(arguments).stderr(Stdio::null()).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let Some(revision) = git(&["rev-parse", "HEAD"]) else { return String::new() };
    let changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|text| !text.is_empty());
    format!("{revision}{}", if changed { "+" } else { "" })
}
