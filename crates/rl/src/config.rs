//! Constants of the learner.

use serde::{Deserialize, Serialize};

use crate::gemm::LEAST_ROWS;
use crate::{NormalizerConfig, RlError};

/// Number of actions of the hand for which OpenAI baselines chose the factor on their mean square.
pub const ACTION_L2_DIMENSIONS: f32 = 20.0;

/// Constants of [`Ddpg`](crate::Ddpg).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DdpgConfig {
    /// Widths of the hidden layers of actor and critic. Default three of 256 (Higashi et al., section 2.1).
    pub hidden: Vec<usize>,
    /// Learning rate of the actor. Default 1e-3 (OpenAI baselines HER, `pi_lr`).
    pub actor_lr: f32,
    /// Learning rate of the critic. Default 1e-3 (OpenAI baselines HER, `Q_lr`).
    pub critic_lr: f32,
    /// Discount factor. Default 0.995 (measured; OpenAI baselines HER has 1 - 1/T for episodes of T steps).
    pub gamma: f32,
    /// Share of the way that the targets go towards the networks at each target update. Default 0.005 (measured).
    pub tau: f32,
    /// Updates from one target update to the next. Default 1 (measured: once in a cycle of 40 does not learn).
    pub target_update_every: u64,
    /// Number of updates over which the averaged actor averages: its weights are the exponential moving average of the
    /// actor's with this time constant. Default 2000 (measured; averaging as in Polyak and Juditsky 1992).
    pub average_updates: u64,
    /// Transitions in a minibatch. Default 256 (OpenAI baselines HER).
    pub batch_size: usize,
    /// Factor on the mean square of the actor's actions in its loss; with fewer than [`ACTION_L2_DIMENSIONS`] of them, on
    /// the sum of the squares over that number. Default 1 (OpenAI baselines HER).
    pub action_l2: f32,
    /// Whether targets are clipped to [-1 / (1 - gamma), 0], which is right for rewards in [-1, 0]. Default true (OpenAI
    /// baselines HER).
    pub clip_targets: bool,
    /// Whether the critics' hidden layers are normalised. Default true (Hiraoka et al. 2022, Ball et al. 2023).
    pub critic_layer_norm: bool,
    /// Whether targets are the lesser of two critics' values. Default false (true: Fujimoto et al. 2018, section 4.2).
    pub twin_critics: bool,
    /// Critic updates for each actor update. Default 1 (2 in Fujimoto et al. 2018, section 5.2).
    pub actor_delay: u64,
    /// Standard deviation of the noise on the target's actions. Default 0 (0.2 in Fujimoto et al. 2018, section 5.3).
    pub target_smoothing: f32,
    /// That noise is clipped at plus and minus this. Default 0.5 (Fujimoto et al. 2018, section 5.3).
    pub target_smoothing_clip: f32,
    /// Scaling of observations and goals.
    pub normalizer: NormalizerConfig,
}

impl Default for DdpgConfig {
    fn default() -> Self {
        Self {
            hidden: vec![256, 256, 256],
            actor_lr: 1e-3,
            critic_lr: 1e-3,
            gamma: 0.995,
            tau: 0.005,
            target_update_every: 1,
            average_updates: 2000,
            batch_size: 256,
            action_l2: 1.0,
            clip_targets: true,
            critic_layer_norm: true,
            twin_critics: false,
            actor_delay: 1,
            target_smoothing: 0.0,
            target_smoothing_clip: 0.5,
            normalizer: NormalizerConfig::default(),
        }
    }
}

impl DdpgConfig {
    /// Returns the largest number of threads that can share an update.
    pub fn most_threads(&self) -> usize {
        (self.batch_size / LEAST_ROWS).max(1)
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RlError::Config`] with the first field that is wrong.
    pub fn validate(&self) -> Result<(), RlError> {
        let check = |field, ok: bool, expected, got: String| {
            if ok { Ok(()) } else { Err(RlError::Config { field, expected, got }) }
        };
        let number = |field, x: f32, least: f32, below: f32, expected| {
            check(field, x.is_finite() && x >= least && x < below, expected, x.to_string())
        };
        let count = |field, n: u64| check(field, n > 0, "at least 1", n.to_string());
        let widths = self.hidden.iter().all(|&n| n > 0);
        check("hidden", widths, "widths of at least 1", format!("{:?}", self.hidden))?;
        number("actor_lr", self.actor_lr, 0.0, f32::INFINITY, "a number of at least 0")?;
        number("critic_lr", self.critic_lr, 0.0, f32::INFINITY, "a number of at least 0")?;
        number("gamma", self.gamma, 0.0, 1.0, "a number from 0 to below 1")?;
        check("tau", self.tau > 0.0 && self.tau <= 1.0, "a number above 0, at most 1", self.tau.to_string())?;
        number("action_l2", self.action_l2, 0.0, f32::INFINITY, "a number of at least 0")?;
        number("target_smoothing", self.target_smoothing, 0.0, f32::INFINITY, "a number of at least 0")?;
        number("target_smoothing_clip", self.target_smoothing_clip, 0.0, f32::INFINITY, "a number of at least 0")?;
        count("target_update_every", self.target_update_every)?;
        count("average_updates", self.average_updates)?;
        count("batch_size", self.batch_size as u64)?;
        count("actor_delay", self.actor_delay)?;
        self.normalizer.validate()
    }

    /// Returns the share of the way that the averaged actor goes towards the actor at the update of that number: the mean
    /// of all before there are `average_updates`.
    pub(crate) fn average_share(&self, n_updates: u64) -> f32 {
        1.0 / self.average_updates.min(n_updates).max(1) as f32
    }

    /// Returns the least value that a target can have when it is clipped.
    pub fn least_target(&self) -> f32 {
        -1.0 / (1.0 - self.gamma)
    }
}
