//! Numbers of a URDF that must be finite.

use std::path::Path;

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use crate::error::HandError;

/// Largest number that is accepted: no length or angle of a hand comes near it.
pub(super) const HUGE: f64 = 1e6;

/// Reads an `<origin>`; `place` names its owner in errors.
pub(super) fn pose(origin: &urdf_rs::Pose, place: &str, file: &Path) -> Result<Isometry3<f64>, HandError> {
    let [x, y, z] = finite(&origin.xyz.0, &format!("{place} <origin xyz>"), file)?;
    let [roll, pitch, yaw] = finite(&origin.rpy.0, &format!("{place} <origin rpy>"), file)?;
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

/// Checks that numbers are finite and at most [`HUGE`]; `place` names their owner in errors.
pub(super) fn finite<const N: usize>(values: &[f64; N], place: &str, file: &Path) -> Result<[f64; N], HandError> {
    match values.iter().find(|x| x.is_nan() || x.abs() > HUGE) {
        None => Ok(*values),
        Some(x) => Err(HandError::model(file, place, &format!("finite numbers of at most {HUGE}"), x)),
    }
}
