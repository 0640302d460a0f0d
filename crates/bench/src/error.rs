//! What can go wrong in a measurement.

use eigenhand_hands::HandError;
use eigenhand_mujoco::MuJoCoError;
use eigenhand_rl::RlError;
use eigenhand_sim::SimError;
use eigenhand_synergy::SynergyError;
use eigenhand_train::TrainError;
use eigenhand_train::config::ConfigError;

/// Errors of measurements.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The hand.
    #[error(transparent)]
    Hand(#[from] HandError),
    /// The simulator.
    #[error(transparent)]
    MuJoCo(#[from] MuJoCoError),
    /// The scene or the task.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The learner.
    #[error(transparent)]
    Rl(#[from] RlError),
    /// The synergy.
    #[error(transparent)]
    Synergy(#[from] SynergyError),
    /// Training.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// Another implementation.
    #[error("{script} failed: {reason}")]
    Peer {
        /// What was run.
        script: String,
        /// What it said.
        reason: String,
    },
}
