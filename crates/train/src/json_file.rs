//! JSON files of a run directory.

use std::path::Path;

use eigenhand_files::{cannot, write_atomically};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::TrainError;

/// Reads a file; none if there is none. `mend` says how to write it again.
///
/// # Errors
/// [`TrainError::File`], or [`TrainError::Damaged`] for a file with other content.
pub(crate) fn read<T: DeserializeOwned>(path: &Path, mend: &str) -> Result<Option<T>, TrainError> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(cannot("read", path)(error).into()),
    };
    serde_json::from_str(&text).map(Some).map_err(|error| TrainError::Damaged {
        path: path.to_owned(),
        reason: error.to_string(),
        mend: mend.to_owned(),
    })
}

/// Writes a file that people can read.
///
/// # Errors
/// [`TrainError::Format`] for a value without a JSON form, [`TrainError::File`].
pub(crate) fn write(path: &Path, value: &impl Serialize) -> Result<(), TrainError> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|error| TrainError::Format { path: path.to_owned(), reason: error.to_string() })?;
    Ok(write_atomically(path, format!("{text}\n").as_bytes())?)
}
