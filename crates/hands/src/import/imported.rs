//! A model as an importer hands it on.

use std::collections::BTreeMap;
use std::path::PathBuf;

use xmltree::Element;

/// What the reader of a file has to be told.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// Directories of ROS packages by name, for `package://name/...`.
    pub packages: BTreeMap<String, PathBuf>,
}

/// Files by the names that a model uses.
pub type Assets = Vec<(String, Vec<u8>)>;

/// A model that was read, mended and, where it was URDF, converted.
#[derive(Debug)]
pub struct Imported {
    /// Root `<mujoco>` element; files are named as in `assets`, without directories.
    pub model: Element,
    /// The files that the model names, by the names it uses.
    pub assets: Assets,
    /// Largest effort that the file states for a joint (N m or N), by joint.
    pub efforts: BTreeMap<String, f64>,
}
