//! `summary.json`: the results of a run.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_mujoco::WarningCounts;
use eigenhand_synergy::Content;
use serde::{Deserialize, Serialize};

use crate::error::TrainError;
use crate::json_file;

/// Name of the file in a run directory.
pub const SUMMARY: &str = "summary.json";

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StoppedBy {
    /// All its episodes were trained.
    Episodes,
    /// The user interrupted it; it can be resumed.
    Interrupt,
}

impl StoppedBy {
    /// Returns the name in the file.
    pub fn name(self) -> &'static str {
        match self {
            StoppedBy::Episodes => "episodes",
            StoppedBy::Interrupt => "interrupt",
        }
    }
}

/// Results of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Version of these keys.
    pub schema: u32,
    /// Name of the hand.
    pub hand: String,
    /// Preset.
    pub preset: String,
    /// How far the policy is confined to its synergy.
    pub lambda: f64,
    /// Seed.
    pub seed: u64,
    /// Training episodes.
    pub episodes: u64,
    /// Control steps in training.
    pub env_steps: u64,
    /// Updates of the learner, one for each minibatch.
    pub updates: u64,
    /// Wall time in s, evaluations included.
    pub wall_s: f64,
    /// Share of the final evaluation's episodes that succeeded; null if the run was interrupted before.
    pub success_rate: Option<f64>,
    /// Success rate with each object in the final evaluation.
    pub success_rate_per_object: BTreeMap<String, f64>,
    /// Episodes of the final evaluation.
    pub eval_episodes: u64,
    /// Successful episodes of the final evaluation.
    pub eval_successes: Option<u64>,
    /// Components of the synergies, as configured.
    pub components: usize,
    /// Share of the final evaluation's episodes that succeed when the hand is commanded with 0, 1, 2... numbers: at every
    /// step, the commands are projected on the mean and so many components of the control synergy.
    pub success_with_components: Vec<f64>,
    /// The fewest numbers whose success is within 5 points of `success_rate`.
    pub k_for_95: Option<usize>,
    /// Success with the objects of `evaluation.other_objects`, on which the policy was not trained.
    pub other_objects: Option<OtherObjects>,
    /// Deepest penetration between object and hand, averaged over the final evaluation's successes, in m.
    pub mean_penetration_m: Option<f64>,
    /// The same between two geoms of the hand; none without `physics.self_collision`.
    pub mean_self_penetration_m: Option<f64>,
    /// Training episodes before the run's policy.
    pub policy_episode: u64,
    /// Success rate at the last evaluation during training.
    pub last_evaluation: Option<f64>,
    /// Postures in the database.
    pub n_postures: u64,
    /// Contribution rate of each component.
    pub contribution: Vec<f64>,
    /// Sum of the contribution rates.
    pub contribution_sum: Option<f64>,
    /// Mean approximation error over the postures that the synergy covers, in joint space.
    pub mean_error_rad: Option<f64>,
    /// What the final evaluation's grasps hold; none for a policy of little success.
    pub content: Option<Content>,
    /// Training episodes whose simulation diverged; they were discarded.
    pub diverged_episodes: u64,
    /// Training steps at which MuJoCo warned of a full contact or constraint buffer, or of a bad inertia.
    pub buffer_warnings: u64,
    /// Counts of MuJoCo's warnings in the final evaluation.
    pub eval_warnings: WarningCounts,
    /// Version of MuJoCo.
    pub mujoco_version: String,
    /// Why the run ended.
    pub stopped_by: StoppedBy,
}

/// Success with objects that no training episode had.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OtherObjects {
    /// Episodes; the objects take turns.
    pub episodes: u64,
    /// Share of them that succeeded.
    pub success_rate: f64,
    /// Success rate with each object.
    pub success_rate_per_object: BTreeMap<String, f64>,
    /// Success rate of the same episodes when as many numbers as configured command the hand.
    pub success_with_components: Option<f64>,
}

impl Summary {
    /// Reads the file of a run directory; a run that has not ended yet has none.
    ///
    /// # Errors
    /// [`TrainError::File`], or [`TrainError::Damaged`] when the file is not a summary.
    pub fn read(run: &Path) -> Result<Option<Summary>, TrainError> {
        let mend = "move the file away, then continue the run with --resume to write it again";
        json_file::read(&run.join(SUMMARY), mend)
    }

    /// Tells whether the run was trained and evaluated to its end.
    pub fn is_complete(&self) -> bool {
        self.stopped_by == StoppedBy::Episodes && self.success_rate.is_some()
    }

    /// Writes the file into a run directory.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn write(&self, run: &Path) -> Result<(), TrainError> {
        json_file::write(&run.join(SUMMARY), self)
    }
}
