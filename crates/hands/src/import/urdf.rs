//! URDF to MJCF.

use std::path::Path;

use super::{ImportOptions, Imported};
use crate::error::HandError;

/// Converts the URDF in `file`.
pub(super) fn convert(file: &Path, _options: &ImportOptions, _notes: &mut Vec<String>) -> Result<Imported, HandError> {
    Err(HandError::model(file, "<robot>", "a URDF", "nothing"))
}
