//! Everything that a run is trained with.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_rl::Dimensions;
use eigenhand_sim::GraspTask;

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
    /// Its directory.
    pub run: RunDirectory,
}

impl Assignment {
    /// Returns the sizes of the learner.
    pub(crate) fn dimensions(&self) -> Dimensions {
        Dimensions::of(episode_shape(&self.task))
    }
}
