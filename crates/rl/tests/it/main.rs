//! Tests of the learner through its public functions.
#![allow(clippy::unwrap_used, reason = "a helper of a test fails as the test does")]

mod checkpoint;
mod episodes;
mod exploration;
mod gradients;
mod hindsight;
mod inputs;
mod policies;
mod reference;
mod streams;
mod threads;

use eigenhand_rl::{
    Batch, DdpgConfig, EpisodeData, EpisodeShape, ExplorationConfig, HerConfig, NormalizerConfig, Tensor, TensorMap,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Sizes of most episodes in these tests.
pub const SHAPE: EpisodeShape = EpisodeShape { n_steps: 10, obs_dim: 5, goal_dim: 2, act_dim: 3, fact_dim: 1 };

/// Scaling of inputs in most tests.
pub const NORMALIZER: NormalizerConfig = NormalizerConfig { epsilon: 0.01, norm_clip: 5.0, raw_clip: 200.0 };

/// Four relabelled transitions for each other one.
pub const HER: HerConfig = HerConfig { relabel_per_real: 4.0 };

/// A learner that most tests change in a few constants.
pub fn learner_config() -> DdpgConfig {
    DdpgConfig {
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
        normalizer: NORMALIZER,
    }
}

/// Correlated noise, and random actions that are held.
pub fn exploration_config() -> ExplorationConfig {
    ExplorationConfig {
        noise_free_share: 0.5,
        noise_sigma: 0.1,
        noise_correlation: 0.8,
        random_probability: 0.1,
        random_hold_steps: 5.0,
        coordinated_probability: 0.8,
        coordinated_hold: 3.0,
        dimensions: Vec::new(),
    }
}

/// The tensors without the one of this name.
pub fn without(tensors: &TensorMap, name: &str) -> TensorMap {
    let mut rest = TensorMap::default();
    for (other, tensor) in tensors.iter().filter(|(other, _)| *other != name) {
        rest.insert(other, Tensor::clone(tensor));
    }
    rest
}

/// An episode of random numbers in [-1, 1).
pub fn random_episode(shape: EpisodeShape, rng: &mut ChaCha8Rng) -> EpisodeData {
    let mut episode = EpisodeData::zeros(shape);
    let EpisodeData { observations, achieved_goals, desired_goal, actions, facts, .. } = &mut episode;
    for array in [observations, achieved_goals, desired_goal, actions, facts] {
        array.iter_mut().for_each(|x| *x = rng.random_range(-1.0..1.0));
    }
    episode
}

/// A batch of random numbers, rewards in [-1, 0).
pub fn random_batch(len: usize, shape: EpisodeShape, rng: &mut ChaCha8Rng) -> Batch {
    let mut batch = Batch::new(len, shape);
    let Batch { observations, goals, actions, rewards, next_observations, .. } = &mut batch;
    for array in [observations, goals, actions, next_observations] {
        array.iter_mut().for_each(|x| *x = rng.random_range(-1.0..1.0));
    }
    rewards.iter_mut().for_each(|x| *x = rng.random_range(-1.0..0.0));
    batch
}

/// Asserts that two numbers agree relative to the larger of 1 and their size.
#[track_caller]
pub fn assert_close(what: &str, got: f64, expected: f64, tolerance: f64) {
    let scale = expected.abs().max(1.0);
    assert!((got - expected).abs() <= tolerance * scale, "{what}: got {got}, expected {expected}");
}
