//! Training, evaluation and export: the crate that brings hands, simulator, learner and synergy together.
//!
//! [`request`] makes a new or a resumed run from a user's request, [`Trainer`] trains it, and [`FinishedRun`] evaluates
//! and exports it. [`config`] holds every setting, [`feedback`] is the effect of the synergy on reward and actor, and
//! [`reproduce`] trains several runs, each in its own process.
#![forbid(unsafe_code)]
// `say!` is for this: `eprintln!` panics if nobody reads standard error.
#![deny(clippy::print_stderr)]

mod action_space;
mod actuators;
mod assessment;
mod assignment;
mod checkpoint;
mod conclude;
pub mod config;
mod control;
mod control_product;
mod counters;
mod digests;
mod divergence;
mod drive;
mod error;
mod evaluation;
mod exploration;
pub mod feedback;
mod finalists;
mod finished;
mod halt;
mod hands;
mod journal;
mod json_file;
mod logging;
mod metrics;
mod motion;
mod periodic;
mod postures;
mod products;
mod progress;
mod provenance;
pub mod reproduce;
pub mod request;
mod rollout;
mod run_dir;
pub mod runs;
mod schedule;
mod speed;
mod start;
mod status;
mod stress;
mod summary;
pub mod sweep;
mod task;
mod tensorboard;
mod threads;
mod trainer;

pub use action_space::ActionSpace;
pub use assessment::{Assessment, ObjectScore, wilson_interval};
pub use assignment::Assignment;
pub use checkpoint::newest_learner;
pub use counters::Counters;
pub use drive::{Drive, Driven, Freedom, MOST_COMPONENTS};
pub use error::TrainError;
pub use evaluation::{Evaluation, EvaluationStream, Grasp, Tally, evaluate};
pub use finished::FinishedRun;
pub use hands::hand_named;
pub use metrics::{MetricsRow, read_metrics};
pub use products::{PICTURES, POSTURE_SYNERGY, SYNERGY};
pub use progress::{Bar, Lines, Progress, Quiet, Silent, Status, write_line};
pub use provenance::Provenance;
pub use rollout::{Behaviour, Counting, Episode, EpisodeJob, WorkerPool, Workers, episode_shape, run_episode};
pub use run_dir::{DATABASE, RunDirectory, is_run, read_config, read_provenance, read_settings};
pub use start::Start;
pub use status::{STATUS, read_status};
pub use stress::{Disturbance, Stress, StressRow};
pub use summary::{OtherObjects, StoppedBy, Summary};
pub use task::{actuation_map, task_of};
pub use tensorboard::add_pictures;
pub use threads::learning_threads;
pub use trainer::Trainer;
