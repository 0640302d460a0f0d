//! The grasp task of a configuration, and the map from its postures to commands.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_mujoco::MuJoCo;
use eigenhand_sim::GraspTask;
use eigenhand_synergy::ActuationMap;

use crate::config::RunConfig;
use crate::error::TrainError;

/// Builds the grasp task that a configuration describes.
///
/// # Errors
/// [`TrainError::Sim`].
pub fn task_of(config: &RunConfig, hand: &Hand, library: &Arc<MuJoCo>) -> Result<Arc<GraspTask>, TrainError> {
    Ok(Arc::new(GraspTask::new(library, hand, &config.setting())?))
}

/// Returns the map from a posture to the commands of a task's actuators, with the limits of the task's actions.
pub fn actuation_map(hand: &Hand, task: &GraspTask) -> ActuationMap {
    let (control_min, control_max) = task.control_ranges.iter().copied().unzip();
    ActuationMap { actuators: task.actuators.clone(), control_min, control_max, ..hand.actuation() }
}
