//! Errors of a measurement.

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
    /// The configuration is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The hand is wrong or unknown.
    #[error(transparent)]
    Hand(#[from] HandError),
    /// MuJoCo is missing or does not work.
    #[error(transparent)]
    MuJoCo(#[from] MuJoCoError),
    /// The scene or the task is wrong, or a simulation failed.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The learner refused its settings or data.
    #[error(transparent)]
    Rl(#[from] RlError),
    /// The synergy could not be computed.
    #[error(transparent)]
    Synergy(#[from] SynergyError),
    /// Training failed.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// Another implementation failed.
    #[error("{script} failed: {reason}")]
    Peer {
        /// The script that was run.
        script: String,
        /// Its error message.
        reason: String,
    },
}
