//! The errors of this crate.

use eigenhand_files::FileError;
use eigenhand_rl::RlError;
use eigenhand_synergy::SynergyError;

/// Errors of bundles.
#[derive(Debug, thiserror::Error)]
pub enum BundleError {
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A synergy or a file of motors.
    #[error(transparent)]
    Synergy(#[from] SynergyError),
    /// A policy whose tensors do not fit together.
    #[error(transparent)]
    Policy(#[from] RlError),
    /// The archive for NumPy cannot be written.
    #[error("cannot write the archive for NumPy: {0}")]
    Archive(#[from] zip::result::ZipError),
    /// An array cannot be written.
    #[error("cannot write an array: {0}")]
    Array(#[from] std::io::Error),
    /// A text that JSON cannot hold.
    #[error("cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
}
