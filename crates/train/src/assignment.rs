//! Everything that a run is trained with.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_rl::Dimensions;
use eigenhand_sim::GraspTask;

use crate::action_space::{Outputs, SynergySpace};
use crate::config::RunConfig;
use crate::provenance::Provenance;
use crate::rollout::episode_shape;
use crate::run_dir::RunDirectory;
use crate::start::Start;

/// Everything that a run is trained with.
pub struct Assignment {
    /// Its settings.
    pub config: RunConfig,
    /// Versions, machine and hand at its start.
    pub provenance: Provenance,
    /// Its hand.
    pub hand: Hand,
    /// Its task.
    pub task: Arc<GraspTask>,
    /// The same with the objects that only its final evaluation sees, if there are any.
    pub other_task: Option<Arc<GraspTask>>,
    /// The synergy in which its policy acts; none if the policy commands every actuator.
    pub space: Option<SynergySpace>,
    /// What it starts with; none if its networks are fresh.
    pub start: Option<Start>,
    /// Its directory.
    pub run: RunDirectory,
}

/// (task, outputs of a policy that acts in a synergy; none if it commands every actuator) => the sizes of the learner
pub(crate) fn dimensions(task: &GraspTask, outputs: Option<&Outputs>) -> Dimensions {
    let dimensions = Dimensions::of(episode_shape(task));
    match outputs {
        None => dimensions,
        Some(Outputs { numbers, dimensions: outputs }) => {
            let told_numbers = numbers.iter().any(|numbers| numbers.fewer.is_some());
            Dimensions { n_outputs: outputs.len(), told_numbers, ..dimensions }
        }
    }
}
