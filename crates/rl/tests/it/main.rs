//! Tests of the learner as its users see it.
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

use eigenhand_rl::{Batch, EpisodeData, EpisodeShape};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Sizes of most episodes in these tests.
pub const SHAPE: EpisodeShape = EpisodeShape { n_steps: 10, obs_dim: 5, goal_dim: 2, act_dim: 3, fact_dim: 1 };

/// An episode of random numbers in [-1, 1).
pub fn random_episode(shape: EpisodeShape, rng: &mut ChaCha8Rng) -> EpisodeData {
    let mut episode = EpisodeData::zeros(shape);
    let EpisodeData { observations, achieved_goals, desired_goal, actions, facts, rewards, .. } = &mut episode;
    for array in [observations, achieved_goals, desired_goal, actions, facts, rewards] {
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
