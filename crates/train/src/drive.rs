//! Driving the hand with few numbers: the success of a policy whose commands are projected on a space.

use std::fmt;
use std::sync::Arc;

use eigenhand_rl::{Policy, rng};
use eigenhand_sim::GraspTask;
use eigenhand_synergy::Synergy;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

use crate::actuators::HandActuators;
use crate::assessment::wilson_interval;
use crate::error::TrainError;
use crate::evaluation::{EvaluationStream, Tally, simulate};
use crate::rollout::{Confinement, WorkerPool};

/// Random spaces in whose mean success a baseline consists.
const RANDOM_SPACES: u64 = 5;

/// Commands do not vary in a component whose share of their variance is below this.
const STILL: f64 = 1e-9;

/// Success of a policy with few numbers, beside that with all joints.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drive {
    /// Episodes of each row.
    pub episodes: u64,
    /// Seed of the episodes.
    pub seed: u64,
    /// What the numbers did not command.
    pub free: Freedom,
    /// One row for each number of components.
    pub rows: Vec<Driven>,
    /// Share of the episodes that succeeded with all joints.
    pub success_rate: f64,
    /// 95 % interval of that share.
    pub interval: [f64; 2],
    /// The fewest components, at least one, within 5 points of all joints; none if no row is.
    pub k_for_95: Option<usize>,
}

/// What the policy commands by itself while numbers command the hand, besides the slide.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Freedom {
    /// First steps of an episode in which all actuators are free.
    pub steps: usize,
    /// Actuators that are always free, such as those of a wrist.
    pub actuators: Vec<String>,
}

/// Success with one number of components.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Driven {
    /// Number of components; with 0 the command is constant.
    pub components: usize,
    /// Share of the episodes that succeeded.
    pub success_rate: f64,
    /// 95 % interval of that share.
    pub interval: [f64; 2],
    /// Share of the episodes that succeeded with random directions instead of the components: the mean over several draws.
    /// None without components, with all of them, or when not measured.
    pub random_success_rate: Option<f64>,
    /// Share of the variance of the commands in the components.
    pub variance_share: f64,
}

impl fmt::Display for Driven {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = if self.components == 1 { "" } else { "s" };
        write!(f, "with {} number{plural}: {:.1} %", self.components, 100.0 * self.success_rate)
    }
}

/// A policy whose commands can be projected.
pub(crate) struct Driver<'a> {
    pub task: &'a GraspTask,
    pub policy: &'a Policy,
    pub actuators: &'a HandActuators,
    pub space: &'a Synergy,
    /// Numbers of the space that the policy knows from its training. It is told if it has fewer.
    pub numbers: usize,
    /// First steps of an episode in which the policy is free.
    pub free_steps: usize,
}

/// Components up to which a run's summary holds the success, if fewer are configured.
pub const MOST_COMPONENTS: usize = 8;

/// Success may be this much below that of all joints where few numbers are said to be enough.
const NEARLY: f64 = 0.05;

/// Tells whether success with few numbers is nearly that with all joints.
pub(crate) fn is_nearly(success: f64, all_joints: f64) -> bool {
    // Rates are quotients of counts, and a difference of 5 points may come out a rounding error below.
    success >= all_joints - NEARLY - 1e-9
}

/// (success with 0, 1, 2... components, success with all joints) => the fewest components that are nearly as good
pub(crate) fn fewest_components(success: &[f64], all_joints: f64) -> Option<usize> {
    (1..success.len()).find(|&k| is_nearly(success[k], all_joints))
}

impl Driver<'_> {
    /// Measures the success with 0, 1, 2... components, up to all of the space. Components in which the policy's
    /// commands do not vary change nothing, and are not measured: if it is `confined`, those beyond its numbers. `each`
    /// receives what is measured.
    ///
    /// # Errors
    /// As [`WorkerPool::collect`].
    pub fn measure_each(
        &self,
        pool: &mut WorkerPool,
        seed: u64,
        stream: EvaluationStream,
        episodes: u64,
        confined: bool,
        mut each: impl FnMut(&Driven),
    ) -> Result<Vec<f64>, TrainError> {
        let mut rates: Vec<f64> = Vec::new();
        for k in 0..=self.space.n_components() {
            let last = k.checked_sub(1).map(|i| self.space.contribution()[i]);
            let rate = match (last, rates.last()) {
                (Some(share), Some(&rate)) if share < STILL || (confined && k > self.numbers) => rate,
                _ => {
                    let driven = self.measure(pool, k, seed, stream, episodes, false)?;
                    each(&driven);
                    driven.success_rate
                }
            };
            rates.push(rate);
        }
        Ok(rates)
    }

    /// Measures the success when the commands are projected on the first `k` components at every step.
    ///
    /// # Errors
    /// As [`WorkerPool::collect`].
    pub fn measure(
        &self,
        pool: &mut WorkerPool,
        k: usize,
        seed: u64,
        stream: EvaluationStream,
        episodes: u64,
        with_random: bool,
    ) -> Result<Driven, TrainError> {
        let n = self.space.n_joints();
        let k = k.min(self.space.n_components());
        let policy = if k < self.numbers.min(n) { &self.policy.with_fewer_numbers(k) } else { self.policy };
        let mut run = |rows: &[f64], range| -> Result<Tally, TrainError> {
            let map = self.actuators.project(self.space.mean(), rows)?;
            let confinement = Confinement { map: Arc::new(map), free_steps: self.free_steps };
            let found = simulate(pool, self.task, policy, seed, stream, range, Some(confinement))?;
            Ok(Tally::of(found.iter()))
        };
        let Tally { episodes: counted, successes } = run(&self.space.components()[..k * n], 0..episodes)?;
        let random = if with_random && k > 0 && k < n {
            let mut all = Tally::default();
            for draw in 0..RANDOM_SPACES {
                let rows = random_rows(k, n, &mut rng::stream(seed, "random-space", draw));
                let found = run(&rows, draw * episodes / RANDOM_SPACES..(draw + 1) * episodes / RANDOM_SPACES)?;
                all = Tally { episodes: all.episodes + found.episodes, successes: all.successes + found.successes };
            }
            Some(all.rate())
        } else {
            None
        };
        Ok(Driven {
            components: k,
            success_rate: Tally { episodes: counted, successes }.rate(),
            interval: wilson_interval(successes, counted),
            random_success_rate: random,
            variance_share: self.space.contribution()[..k].iter().sum(),
        })
    }
}

/// Returns `k` orthonormal rows of `n` numbers, uniformly distributed over all directions.
pub(crate) fn random_rows(k: usize, n: usize, random: &mut impl Rng) -> Vec<f64> {
    let mut rows: Vec<f64> = Vec::with_capacity(k * n);
    while rows.len() < k * n {
        let mut row: Vec<f64> = (0..n).map(|_| StandardNormal.sample(random)).collect();
        for known in rows.chunks_exact(n) {
            let along: f64 = known.iter().zip(&row).map(|(a, b)| a * b).sum();
            row.iter_mut().zip(known).for_each(|(r, k)| *r -= along * k);
        }
        let length = row.iter().map(|r| r * r).sum::<f64>().sqrt();
        rows.extend(row.into_iter().map(|r| r / length));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_rows_are_orthonormal_and_differ_between_draws() {
        let rows = |draw| random_rows(3, 7, &mut rng::stream(1, "random-space", draw));
        let first = rows(0);
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..7).map(|n| first[7 * i + n] * first[7 * j + n]).sum();
                assert!((product - f64::from(u8::from(i == j))).abs() < 1e-12, "{i} {j}: {product}");
            }
        }
        assert_eq!(first, rows(0));
        assert_ne!(first, rows(1));
    }

    #[test]
    fn the_fewest_numbers_within_five_points_are_at_least_one() {
        assert_eq!(fewest_components(&[0.99, 0.91, 0.92, 0.97], 0.97), Some(2));
        assert_eq!(fewest_components(&[0.2, 0.91, 0.9], 0.97), None);
        // 0.95 - 0.05 is not 0.9 in binary.
        assert_eq!(fewest_components(&[0.0, 0.9], 0.95), Some(1));
        assert_eq!(fewest_components(&[], 0.5), None);
    }
}
