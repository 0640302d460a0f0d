//! What a run trains, and where.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_sim::GraspTask;

use crate::config::RunConfig;
use crate::provenance::Provenance;
use crate::run_dir::RunDirectory;

/// What a run trains, and where.
pub struct Assignment {
    /// Its settings.
    pub config: RunConfig,
    /// What it is made with.
    pub provenance: Provenance,
    /// Its hand.
    pub hand: Hand,
    /// Its task.
    pub task: Arc<GraspTask>,
    /// Its directory.
    pub run: RunDirectory,
}
