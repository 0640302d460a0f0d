//! The grasp task of a configuration, and the map from its postures to commands.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_mujoco::MuJoCo;
use eigenhand_sim::{GraspTask, Setting};
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

/// Builds the task of a trained policy with other objects. It observes only numbers of objects that its training had.
///
/// # Errors
/// [`TrainError::Sim`].
pub fn task_with_objects(
    objects: &[String],
    config: &RunConfig,
    hand: &Hand,
    library: &Arc<MuJoCo>,
    trained: &GraspTask,
) -> Result<Arc<GraspTask>, TrainError> {
    let setting = Setting { objects: objects.to_vec(), ..config.setting() };
    let mut task = GraspTask::new(library, hand, &setting)?;
    task.take_ids_from(trained);
    Ok(Arc::new(task))
}

/// Builds the task of `evaluation.other_objects`, if there are any.
///
/// # Errors
/// [`TrainError::Sim`].
pub fn other_task_of(
    config: &RunConfig,
    hand: &Hand,
    library: &Arc<MuJoCo>,
    trained: &GraspTask,
) -> Result<Option<Arc<GraspTask>>, TrainError> {
    let objects = &config.evaluation.other_objects;
    if objects.is_empty() {
        return Ok(None);
    }
    task_with_objects(objects, config, hand, library, trained).map(Some)
}

/// Returns the map from a posture to the commands of a task's actuators, with the limits of the task's actions.
pub fn actuation_map(hand: &Hand, task: &GraspTask) -> ActuationMap {
    let (control_min, control_max) = task.control_ranges.iter().copied().unzip();
    ActuationMap { actuators: task.actuators.clone(), control_min, control_max, ..hand.actuation() }
}
