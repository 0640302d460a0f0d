//! Training, evaluation and export: the crate that brings hands, simulator, learner and synergy together.
#![forbid(unsafe_code)]

mod assess;
pub mod bench;
mod catalogue;
mod checkpoint;
mod command_cost;
pub mod config;
mod error;
mod evaluation;
mod export;
pub mod files;
pub mod launch;
mod logging;
mod metrics;
mod new_hand;
mod progress;
mod provenance;
pub mod reproduce;
mod reward;
mod rollout;
mod run_dir;
mod settings;
mod summary;
mod tensorboard;
mod trainer;

pub use assess::{Assessment, ObjectScore, assess, wilson_interval};
pub use catalogue::{HandCheck, check_hand, default_picture, hand_named, registry};
pub use eigenhand_hands::{Hand, HandSummary, ImportOptions, PLUGINS_VARIABLE, Registry, RegistryEntry, Transmission};
pub use eigenhand_sim::contract::{Check, ContractReport};
pub use eigenhand_sim::ffi::{LIBRARY_VARIABLE, MuJoCo};
pub use eigenhand_sim::survey::Hints;
pub use error::TrainError;
pub use evaluation::{Evaluation, EvaluationStream, evaluate};
pub use export::LoadedRun;
pub use metrics::MetricsTable;
pub use new_hand::{NewHand, NewHandReport, describe_new_hand, new_hand};
pub use progress::{Bar, Lines, Progress, Silent, Status};
pub use provenance::Provenance;
pub use reward::GraspReward;
pub use rollout::{Behaviour, Episode, EpisodeJob, WorkerPool, episode_shape, run_episode};
pub use run_dir::{RunDirectory, is_run, read_config, read_provenance};
pub use settings::{Settings, differences, read_settings};
pub use summary::{StoppedBy, Summary};
pub use trainer::{DATABASE, Trainer, task_of};
