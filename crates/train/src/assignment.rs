//! Everything that a run is trained with.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_rl::{Dimensions, Numbers};
use eigenhand_sim::GraspTask;

use crate::action_space::SynergySpace;
use crate::config::RunConfig;
use crate::provenance::Provenance;
use crate::rollout::episode_shape;
use crate::run_dir::RunDirectory;

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
    /// Its directory.
    pub run: RunDirectory,
}

impl Assignment {
    /// Returns the sizes of the learner.
    pub(crate) fn dimensions(&self) -> Dimensions {
        let dimensions = Dimensions::of(episode_shape(&self.task));
        let n_outputs = self.space.as_ref().map_or(dimensions.n_outputs, |space| space.map.n_outputs());
        // Of a single number there are no fewer.
        let numbers = self.config.synergy.components.min(self.hand.actuators.len());
        Dimensions { n_outputs, told_numbers: self.config.confines() && numbers > 1, ..dimensions }
    }

    /// Returns the numbers in which the policy acts from its first episode on; none if it commands every actuator.
    pub(crate) fn numbers(&self) -> Vec<Numbers> {
        self.space.iter().map(|space| Numbers { map: space.map.clone(), fewer: None }).collect()
    }
}
