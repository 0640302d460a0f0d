//! Constants of the learner.

use serde::{Deserialize, Serialize};

use crate::gemm::LEAST_ROWS;
use crate::{NormalizerConfig, RlError};

/// Number of actions of the hand for which OpenAI baselines chose the factor on their mean square.
pub const ACTION_L2_DIMENSIONS: f32 = 20.0;

/// Most hidden layers, most units of one, and most transitions of a minibatch. Beyond these, a network or a batch takes memory
/// that no task here needs.
const MOST_LAYERS: usize = 8;
const WIDEST: usize = 4096;
const LARGEST_BATCH: usize = 65_536;

/// Constants of [`Ddpg`](crate::Ddpg).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DdpgConfig {
    /// Widths of the hidden layers of actor and critic (Higashi et al., section 2.1).
    pub hidden: Vec<usize>,
    /// Learning rate of the actor (OpenAI baselines HER, `pi_lr`).
    pub actor_lr: f32,
    /// Learning rate of the critic (OpenAI baselines HER, `Q_lr`).
    pub critic_lr: f32,
    /// Discount factor (measured; OpenAI baselines HER has 1 - 1/T for episodes of T steps).
    pub gamma: f32,
    /// Share of the way that a target moves towards its network at each of its updates (measured).
    pub tau: f32,
    /// Number of updates between two updates of the targets (measured).
    pub target_update_every: u64,
    /// Number of updates over which the averaged actor averages. Its weights are the exponential moving average of the
    /// actor's weights with this time constant (measured; averaging as in Polyak and Juditsky 1992).
    pub average_updates: u64,
    /// Transitions in a minibatch (OpenAI baselines HER).
    pub batch_size: usize,
    /// Factor on the mean square of the actor's actions in its loss (OpenAI baselines HER). With fewer than
    /// [`ACTION_L2_DIMENSIONS`] actions, the sum of their squares is divided by that number instead of theirs.
    pub action_l2: f32,
    /// Whether targets are clipped to [-1 / (1 - gamma), 0], the range of the values of rewards in [-1, 0] (OpenAI
    /// baselines HER).
    pub clip_targets: bool,
    /// Whether the critic's hidden layers are normalised (Hiraoka et al. 2022, Ball et al. 2023).
    pub critic_layer_norm: bool,
    /// Scaling of observations and goals.
    pub normalizer: NormalizerConfig,
}

impl DdpgConfig {
    /// Returns the largest number of threads that can share an update.
    pub fn most_threads(&self) -> usize {
        (self.batch_size / LEAST_ROWS).max(1)
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RlError::Config`] names the first field that is out of range.
    pub fn validate(&self) -> Result<(), RlError> {
        let check = |field, ok: bool, expected, got: String| {
            if ok { Ok(()) } else { Err(RlError::Config { field, expected, got }) }
        };
        let number = |field, x: f32, least: f32, below: f32, expected| {
            check(field, x.is_finite() && x >= least && x < below, expected, x.to_string())
        };
        let count = |field, n: u64| check(field, n > 0, "at least 1", n.to_string());
        let widths = self.hidden.len() <= MOST_LAYERS && self.hidden.iter().all(|n| (1..=WIDEST).contains(n));
        check("hidden", widths, "at most 8 widths from 1 to 4096", format!("{:?}", self.hidden))?;
        number("actor_lr", self.actor_lr, 0.0, f32::INFINITY, "a number of at least 0")?;
        number("critic_lr", self.critic_lr, 0.0, f32::INFINITY, "a number of at least 0")?;
        number("gamma", self.gamma, 0.0, 1.0, "a number from 0 to below 1")?;
        check("tau", self.tau > 0.0 && self.tau <= 1.0, "a number above 0 and at most 1", self.tau.to_string())?;
        number("action_l2", self.action_l2, 0.0, f32::INFINITY, "a number of at least 0")?;
        count("target_update_every", self.target_update_every)?;
        count("average_updates", self.average_updates)?;
        let size = (1..=LARGEST_BATCH).contains(&self.batch_size);
        check("batch_size", size, "a whole number from 1 to 65536", self.batch_size.to_string())?;
        self.normalizer.validate()
    }

    /// Returns the share of the way that the averaged actor moves towards the actor at an update, counted from 1. Until
    /// there are `average_updates`, the average is the mean of all actors.
    pub(crate) fn average_share(&self, n_updates: u64) -> f32 {
        1.0 / self.average_updates.min(n_updates).max(1) as f32
    }

    /// Returns the least value that a clipped target can have.
    pub(crate) fn least_target(&self) -> f32 {
        -1.0 / (1.0 - self.gamma)
    }
}
