//! Exploration: changes of the policy's actions while training episodes are collected.

mod attempt;
mod config;
mod held;
mod noise;

use rand::Rng;

use attempt::Attempt;
pub use config::{ActionDimension, Coordination, ExplorationConfig};
use held::HeldActions;
use noise::CorrelatedNoise;

/// The exploration of one episode.
#[derive(Clone, Debug)]
pub struct Exploration(Kind);

#[derive(Clone, Debug)]
enum Kind {
    None,
    Noisy(CorrelatedNoise, HeldActions),
    Warmup(HeldActions),
    Attempt(Attempt),
}

impl Exploration {
    /// Begins an episode that keeps every action of the policy.
    pub fn none() -> Self {
        Self(Kind::None)
    }

    /// Begins a noisy episode.
    ///
    /// # Panics
    /// If the configuration's `dimensions` are neither empty nor `act_dim` long. [`ExplorationConfig::validate`] reports
    /// that as an error.
    pub fn noisy(config: &ExplorationConfig, act_dim: usize, rng: &mut impl Rng) -> Self {
        let noise = CorrelatedNoise::new(config, act_dim, rng);
        Self(Kind::Noisy(noise, HeldActions::now_and_then(config, act_dim)))
    }

    /// Begins an episode of random actions, each held for some steps. It ignores the policy.
    ///
    /// # Panics
    /// As [`noisy`](Self::noisy).
    pub fn warmup(config: &ExplorationConfig, act_dim: usize) -> Self {
        Self(Kind::Warmup(HeldActions::always(config, act_dim)))
    }

    /// Begins an episode that tries to grasp: the hand opens, comes down, closes as its dimensions'
    /// [coordination](ActionDimension::coordination) tells, and rises. It ignores the policy.
    pub fn attempt(config: &ExplorationConfig, rng: &mut impl Rng) -> Self {
        Self(Kind::Attempt(Attempt::new(&config.dimensions, rng)))
    }

    /// Turns the policy's action of the next step into the one to execute, in [-1, 1].
    ///
    /// # Panics
    /// If the action is shorter than the `act_dim` given at the start.
    pub fn apply(&mut self, action: &mut [f32], rng: &mut impl Rng) {
        match &mut self.0 {
            Kind::None => {}
            Kind::Noisy(noise, held) => {
                noise.add(action, rng);
                held.replace(action, rng);
            }
            Kind::Warmup(held) => held.replace(action, rng),
            Kind::Attempt(attempt) => attempt.act(action),
        }
    }
}
