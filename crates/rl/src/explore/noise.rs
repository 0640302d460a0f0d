//! Noise that is correlated in time.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::config::ExplorationConfig;

/// A first-order autoregressive process of constant variance for each dimension.
#[derive(Clone, Debug)]
pub(super) struct CorrelatedNoise {
    sigma: f32,
    correlation: f32,
    values: Vec<f32>,
}

impl CorrelatedNoise {
    pub fn new(config: &ExplorationConfig, act_dim: usize, rng: &mut impl Rng) -> Self {
        let sigma = config.noise_sigma;
        let values = (0..act_dim).map(|_| sigma * rng.sample::<f32, _>(StandardNormal)).collect();
        Self { sigma, correlation: config.noise_correlation, values }
    }

    /// Adds the noise of one step to an action and clips it to [-1, 1].
    pub fn add(&mut self, action: &mut [f32], rng: &mut impl Rng) {
        // With this factor the variance of the process stays constant.
        let innovation = self.sigma * (1.0 - self.correlation * self.correlation).sqrt();
        for (a, value) in action.iter_mut().zip(&mut self.values) {
            *a = (*a + *value).clamp(-1.0, 1.0);
            *value = self.correlation * *value + innovation * rng.sample::<f32, _>(StandardNormal);
        }
    }
}
