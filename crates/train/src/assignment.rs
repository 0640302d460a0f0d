//! Everything that a run is trained with.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_sim::GraspTask;

use crate::config::RunConfig;
use crate::provenance::Provenance;
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
    /// Its directory.
    pub run: RunDirectory,
}

impl Assignment {
    /// Returns the lengths of an observation, a goal and an action.
    pub(crate) fn dimensions(&self) -> [usize; 3] {
        [self.task.observation_len(), GraspTask::GOAL_LEN, self.task.action_len()]
    }
}
