//! URDF to MJCF: every link becomes a body, every joint that moves a joint, and nothing is fused.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::{ImportOptions, Imported};
use crate::error::HandError;

mod geometry;
mod inertia;
mod joints;
mod meshes;
mod mimic;
mod source;
mod tree;
mod write;

/// Length or angle that no hand reaches, beyond which arithmetic would lose itself.
const HUGE: f64 = 1e6;

/// Converts the URDF in `file`, whose meshes all have to lie in `within` where that is given.
pub(super) fn convert(
    file: &Path,
    options: &ImportOptions,
    within: Option<&Path>,
    notes: &mut Vec<String>,
) -> Result<Imported, HandError> {
    let source = source::read(file, notes)?;
    let robot = &source.robot;
    let tree = tree::Tree::of(robot, file)?;
    let joints = joints::read(&source, file, notes)?;
    let mimics = mimic::resolve(robot, &joints, file, notes)?;
    let groups = joints::groups(&tree, &joints);
    let (geoms, assets) = geometry::read(robot, file, meshes::Meshes::new(file, options, within), notes)?;
    let inertials = inertia::read(&source, &geoms, &groups, notes);
    let parts = write::Parts { robot, tree: &tree, joints: &joints, geoms: &geoms, inertials: &inertials };
    let model = parts.model(&groups, &mimics, &assets, notes);
    let efforts: BTreeMap<String, f64> = robot
        .joints
        .iter()
        .zip(&joints)
        .filter(|(_, joint)| joint.motion != joints::Motion::Fixed)
        .filter_map(|(joint, read)| Some((joint.name.clone(), read.effort?)))
        .collect();
    Ok(Imported { model, assets, efforts })
}

/// Reads an `<origin>`; `place` names its owner in errors.
fn pose(origin: &urdf_rs::Pose, place: &str, file: &Path) -> Result<Isometry3<f64>, HandError> {
    let [x, y, z] = finite(&origin.xyz.0, &format!("{place} <origin xyz>"), file)?;
    let [roll, pitch, yaw] = finite(&origin.rpy.0, &format!("{place} <origin rpy>"), file)?;
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

fn finite<const N: usize>(values: &[f64; N], place: &str, file: &Path) -> Result<[f64; N], HandError> {
    match values.iter().find(|x| x.is_nan() || x.abs() > HUGE) {
        None => Ok(*values),
        Some(x) => Err(HandError::model(file, place, &format!("finite numbers of at most {HUGE}"), x)),
    }
}
