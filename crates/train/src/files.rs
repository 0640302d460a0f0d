//! Writing without half-written files, and digests.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::TrainError;
use crate::error::io_error;

/// Writes a file under a temporary name beside its own and renames it, so that it is whole or absent.
///
/// # Errors
/// [`TrainError::Io`].
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".partial");
    let partial = path.with_file_name(name);
    let write = || -> std::io::Result<()> {
        let mut file = File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&partial, path)
    };
    write().map_err(io_error("write", path))
}

/// Creates a directory with its parents.
///
/// # Errors
/// [`TrainError::Io`].
pub fn create_directory(path: &Path) -> Result<(), TrainError> {
    fs::create_dir_all(path).map_err(io_error("create the directory", path))
}

/// Returns the SHA-256 of bytes in hexadecimal.
pub(crate) fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
