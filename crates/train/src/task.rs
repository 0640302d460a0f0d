//! The grasp task of a configuration, with its joints and commands as the synergy names them.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_mujoco::MuJoCo;
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{ActuationMap, JointInfo, Unit};

use crate::config::RunConfig;
use crate::error::TrainError;

/// Builds the grasp task that a configuration describes.
///
/// # Errors
/// [`TrainError::Sim`].
pub fn task_of(config: &RunConfig, hand: &Hand, library: &Arc<MuJoCo>) -> Result<Arc<GraspTask>, TrainError> {
    Ok(Arc::new(GraspTask::new(library, hand, &config.setting())?))
}

/// Returns the posture's joints as the synergy names them.
///
/// # Errors
/// [`TrainError::JointUnit`] for a joint that is neither in rad nor in m.
pub fn joint_infos(task: &GraspTask) -> Result<Vec<JointInfo>, TrainError> {
    let joints = task.posture_joints.iter().map(|joint| {
        let (lower, upper) = joint.range.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        let unit = Unit::from_symbol(joint.unit)
            .ok_or_else(|| TrainError::JointUnit { joint: joint.name.clone(), unit: joint.unit.to_owned() })?;
        Ok(JointInfo { name: joint.name.clone(), unit, lower, upper })
    });
    joints.collect()
}

/// Returns the map from a posture to the commands of a task's actuators.
pub fn actuation_map(hand: &Hand, task: &GraspTask) -> ActuationMap {
    let actuation = hand.actuation();
    let (control_min, control_max) = task.control_ranges.iter().copied().unzip();
    ActuationMap {
        actuators: task.actuators.clone(),
        control_min,
        control_max,
        matrix: actuation.matrix,
        offset: actuation.offset,
    }
}
