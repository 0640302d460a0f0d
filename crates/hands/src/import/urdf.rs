//! Converts URDF to MJCF: every link becomes a body, every movable joint a joint, and no links are fused.

use std::collections::BTreeMap;
use std::path::Path;

use super::imported::{ImportOptions, Imported};
use crate::error::HandError;

mod finite;
mod geometry;
mod inertia;
mod joints;
mod meshes;
mod mimic;
mod source;
mod tree;
mod write;

/// Converts the URDF that `file` holds as `bytes`. If `within` is given, all meshes must lie in it.
pub(super) fn convert(
    file: &Path,
    bytes: &[u8],
    options: &ImportOptions,
    within: Option<&Path>,
    notes: &mut Vec<String>,
) -> Result<Imported, HandError> {
    let source = source::read(file, bytes, notes)?;
    let robot = &source.robot;
    let tree = tree::Tree::of(robot, file)?;
    let joints = joints::read(&source, file, notes)?;
    let mimics = mimic::resolve(robot, &joints, file, notes)?;
    let groups = joints::groups(&tree, &joints);
    let geoms = geometry::read(robot, file, meshes::Meshes::new(file, options, within), notes)?;
    let inertials = inertia::read(&source, &geoms.solid, &groups, notes);
    let parts = write::Parts { robot, tree: &tree, joints: &joints, geoms: &geoms, inertials: &inertials };
    let model = parts.model(&groups, &mimics, notes);
    let by_joint = |of: fn(&joints::Joint) -> Option<f64>| -> BTreeMap<String, f64> {
        let moving = robot.joints.iter().zip(&joints).filter(|(_, joint)| joint.motion != joints::Motion::Fixed);
        moving.filter_map(|(joint, read)| Some((joint.name.clone(), of(read)?))).collect()
    };
    let (efforts, velocities) = (by_joint(|joint| joint.effort), by_joint(|joint| joint.velocity));
    Ok(Imported { model, assets: geoms.assets, looks: geoms.looks, efforts, velocities, passive: Vec::new() })
}
