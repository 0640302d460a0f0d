//! The digests of what a run leaves, so that a file that changed afterwards is not taken for a result.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_files::{cannot, sha256, write_atomically};

use crate::error::TrainError;
use crate::products::{POLICY, POLICY_TEXT, POSTURE_SYNERGY, SYNERGY};

/// Name of the file in a run directory.
pub(crate) const DIGESTS: &str = "digests.toml";
const HEADER: &str =
    "# SHA-256 of the results that the training wrote last. A result that has changed since is refused.\n";
/// Files of a synergy that are read again.
const OF_SYNERGY: [(&str, [&str; 2]); 2] =
    [(SYNERGY, ["synergy.toml", "commands.npy"]), (POSTURE_SYNERGY, ["synergy.toml", "postures.npy"])];

/// Writes the digests of the results in a run directory.
pub(crate) fn write(run: &Path) -> Result<(), TrainError> {
    let of_synergies =
        OF_SYNERGY.iter().flat_map(|(place, files)| files.iter().map(move |file| format!("{place}/{file}")));
    let mut digests = BTreeMap::new();
    for name in [POLICY, POLICY_TEXT].map(str::to_owned).into_iter().chain(of_synergies) {
        let path = run.join(&name);
        if path.is_file() {
            digests.insert(name, sha256(&std::fs::read(&path).map_err(cannot("read", &path))?));
        }
    }
    let path = run.join(DIGESTS);
    let text = toml::to_string(&digests)
        .map_err(|error| TrainError::Format { path: path.clone(), reason: error.to_string() })?;
    Ok(write_atomically(&path, format!("{HEADER}{text}").as_bytes())?)
}

/// Removes the digests, before the results are written again.
pub(crate) fn remove(run: &Path) -> Result<(), TrainError> {
    let path = run.join(DIGESTS);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(cannot("remove", &path)(error).into()),
        _ => Ok(()),
    }
}

/// Checks the results in a run directory; those of a run that is not finished have no digests.
///
/// # Errors
/// [`TrainError::Damaged`] names the first file that has changed.
pub(crate) fn check(run: &Path) -> Result<(), TrainError> {
    let path = run.join(DIGESTS);
    let text = match std::fs::read_to_string(&path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        read => read.map_err(cannot("read", &path))?,
    };
    let damaged = |path: &Path, reason: String| TrainError::Damaged {
        path: path.to_owned(),
        reason,
        mend: format!("restore it, or write it again with: train --resume {}", run.display()),
    };
    let digests: BTreeMap<String, String> = toml::from_str(&text).map_err(|error| damaged(&path, error.to_string()))?;
    for (name, expected) in digests {
        let path = run.join(name);
        let found = match std::fs::read(&path) {
            Ok(bytes) => sha256(&bytes),
            Err(error) => return Err(damaged(&path, error.to_string())),
        };
        if found != expected {
            let reason =
                format!("it has changed since the training wrote it: its SHA-256 was {expected}, and is now {found}");
            return Err(damaged(&path, reason));
        }
    }
    Ok(())
}
