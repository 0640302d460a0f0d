//! Off-policy reinforcement learning of continuous actions: DDPG with hindsight experience replay.
//!
//! A training loop uses these types in this order:
//!
//! 1. [`Exploration`] changes the actions of a [`Policy`] while an episode is simulated.
//! 2. [`EpisodeData`] stores the episode, and [`Replay`] the episodes.
//! 3. [`sample_batch`] draws transitions, replaces goals in hindsight and computes the rewards of a [`Batch`].
//! 4. [`Ddpg::update`] learns from the batch, and [`Ddpg::policy`] returns the next [`Policy`].
//!
//! [`RunningNormalizer`] scales the networks' inputs, [`rng::stream`] gives every random number, and [`TensorMap`] converts
//! the learner's state to bytes and back.
//!
//! Numbers are `f32`, and nothing does IO. Matrices are row-major, and one row is one sample. The threads of the caller's
//! rayon pool share an update, and their number does not change its result. Everything else runs on the calling thread.
#![forbid(unsafe_code)]

mod action_map;
mod adam;
mod checkpoint;
mod config;
mod ddpg;
mod elementwise;
mod episode;
mod error;
mod explore;
mod gemm;
mod her;
mod matrix;
mod net;
mod normalizer;
mod numbers;
mod policy;
mod replay;
pub mod rng;
#[cfg(target_arch = "x86_64")]
mod sparse;
mod tensors;

pub use action_map::ActionMap;
pub use adam::{Adam, Follow};
pub use config::{ACTION_L2_DIMENSIONS, DdpgConfig};
pub use ddpg::{Ddpg, Dimensions, UpdateStats};
pub use episode::{EpisodeData, EpisodeShape};
pub use error::RlError;
pub use explore::{ActionDimension, Coordination, Exploration, ExplorationConfig};
pub use her::{Batch, GoalChoice, HerConfig, Origin, RewardFn, choose_goal, sample_batch};
pub use net::{InputGradient, LayerShape, Mlp, MlpScratch, OutputActivation, Rows};
pub use normalizer::{NormalizerConfig, RunningNormalizer};
pub use numbers::Numbers;
pub use policy::{ActorChoice, Policy, PolicyScratch};
pub use replay::Replay;
pub use tensors::{Tensor, TensorData, TensorMap};
