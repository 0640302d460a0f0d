//! Off-policy reinforcement learning with a continuous action: DDPG with hindsight experience replay, on faer's matrices.
//!
//! The data path, in the order in which a training loop meets it: [`Exploration`] perturbs the actions of a [`Policy`];
//! the episode that results is an [`EpisodeData`]; [`Replay`] keeps episodes; [`sample_batch`] draws transitions,
//! replaces goals in hindsight and recomputes every reward; [`Ddpg::update`] learns from the [`Batch`] and gives the next
//! [`Policy`]. [`RunningNormalizer`] scales what the networks see, [`rng::stream`] is the source of every random number,
//! and [`TensorMap`] carries the learner's state to and from bytes.
//!
//! Everything is `f32` and does no IO. Matrices are row-major: one row is one sample. The threads of the caller's pool
//! (rayon's) share an update, which is the same with one; everything else runs on the calling thread.
#![forbid(unsafe_code)]

mod action_cost;
mod adam;
mod aligned;
mod attempt;
mod checkpoint;
mod config;
mod ddpg;
mod elementwise;
mod epilogue;
mod episode;
mod error;
mod explore;
mod gemm;
mod her;
mod matrix;
mod net;
mod normalizer;
mod policy;
mod replay;
pub mod rng;
#[cfg(target_arch = "x86_64")]
mod sparse;
mod tensors;

pub use action_cost::ActionCost;
pub use adam::{Adam, AdamConfig};
pub use config::{ACTION_L2_DIMENSIONS, DdpgConfig};
pub use ddpg::{Ddpg, UpdateStats};
pub use episode::{EpisodeData, EpisodeShape};
pub use error::RlError;
pub use explore::{Coordination, Exploration, ExplorationConfig};
pub use her::{Batch, GoalChoice, HerConfig, Origin, RewardFn, choose_goal, sample_batch};
pub use net::{InputGradient, LayerShape, Mlp, MlpScratch, OutputActivation, Rows};
pub use normalizer::{NormalizerConfig, RunningNormalizer};
pub use policy::{Policy, PolicyScratch, Which};
pub use replay::Replay;
pub use tensors::{Tensor, TensorData, TensorMap};
