//! Reading of model files as their makers publish them: mended, or converted, to a model that MuJoCo 2.2.2 loads.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use xmltree::Element;

use crate::error::HandError;

mod mesh;
mod urdf;

/// What the reader of a file has to be told.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// Directories of ROS packages by name, for `package://name/...`.
    pub packages: BTreeMap<String, PathBuf>,
}

/// A model that was read, mended and, where it was URDF, converted.
#[derive(Debug)]
pub struct Imported {
    /// Root `<mujoco>` element. Angles are radians; files are named as in `assets`, without directories.
    pub model: Element,
    /// The files that the model names, by the names it uses.
    pub assets: Vec<(String, Vec<u8>)>,
    /// What was changed, left out or assumed, one line each.
    pub notes: Vec<String>,
    /// Largest effort that the file states for a joint (N m or N), by joint.
    pub efforts: BTreeMap<String, f64>,
}

/// Reads the model in `file`, MJCF or URDF. `notes` holds what was changed until then even where reading fails.
///
/// # Errors
/// Names the file, the place in it and the way out: see [`HandError`].
pub fn import(file: &Path, options: &ImportOptions, notes: &mut Vec<String>) -> Result<Imported, HandError> {
    urdf::convert(file, options, notes)
}
