//! The result of an import.

use std::collections::BTreeMap;
use std::path::PathBuf;

use xmltree::Element;

/// Settings of an import.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// Directories of ROS packages by name, for `package://name/...`.
    pub packages: BTreeMap<String, PathBuf>,
}

/// Contents of files, each with the name that the model uses.
pub type Assets = Vec<(String, Vec<u8>)>;

/// A model after import: mended MJCF, or converted URDF.
#[derive(Debug)]
pub struct Imported {
    /// Root `<mujoco>` element; it names files as `assets` does, without directories.
    pub model: Element,
    /// The model's files.
    pub assets: Assets,
    /// How many of these files, the last ones, only pictures show.
    pub looks: usize,
    /// Effort limit in the file (N m or N), by joint.
    pub efforts: BTreeMap<String, f64>,
    /// Velocity limit in the file (rad/s or m/s), by joint.
    pub velocities: BTreeMap<String, f64>,
    /// Joints that are no part of a posture, although something moves them: the hinges of a ball joint.
    pub passive: Vec<String>,
}
