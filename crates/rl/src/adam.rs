//! The Adam optimiser over one flat parameter vector.

use crate::aligned::Aligned;
use crate::elementwise::{self, AdamCoefficients};

/// Constants of [`Adam`] other than the learning rate; double, because what matters is how far the decays are from 1.
///
/// # Source
/// Kingma and Ba 2015, algorithm 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamConfig {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the corrected second moment.
    pub epsilon: f64,
}

impl Default for AdamConfig {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
    }
}

/// Optimiser state: two moments for each parameter and the number of steps taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    config: AdamConfig,
    learning_rate: f32,
    pub(crate) first_moment: Aligned,
    pub(crate) second_moment: Aligned,
    pub(crate) n_steps: u64,
}

/// A target network that follows the parameters during a step.
#[derive(Debug)]
pub struct Follow<'a> {
    /// Parameters of the target.
    pub target: &'a mut [f32],
    /// Share of the way that the target goes towards the new parameters.
    pub tau: f32,
}

impl Adam {
    /// Starts with zero moments for `n_parameters` parameters.
    pub fn new(config: AdamConfig, learning_rate: f32, n_parameters: usize) -> Self {
        Self {
            config,
            learning_rate,
            first_moment: Aligned::zeros(n_parameters),
            second_moment: Aligned::zeros(n_parameters),
            n_steps: 0,
        }
    }

    /// Sets the learning rate of the steps to come.
    pub fn set_learning_rate(&mut self, learning_rate: f32) {
        self.learning_rate = learning_rate;
    }

    /// Returns the learning rate.
    pub fn learning_rate(&self) -> f32 {
        self.learning_rate
    }

    /// Returns the number of steps taken.
    pub fn n_steps(&self) -> u64 {
        self.n_steps
    }

    /// Descends once along `gradient`; with `follow`, a target network moves towards the new parameters in the same pass.
    ///
    /// # Panics
    /// When the slices are not as long as the optimiser's moments.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], follow: Option<Follow<'_>>) {
        let n = self.first_moment.len();
        assert_eq!(parameters.len(), n, "parameters and moments differ in length");
        assert_eq!(gradient.len(), n, "gradient and moments differ in length");
        self.n_steps += 1;
        let coefficients = self.coefficients();
        let (m, v) = (&mut self.first_moment, &mut self.second_moment);
        match follow {
            None => elementwise::adam(coefficients, parameters, gradient, m, v),
            Some(Follow { target, tau }) => {
                assert_eq!(target.len(), n, "target and moments differ in length");
                elementwise::adam_polyak(coefficients, tau, parameters, gradient, m, v, target);
            }
        }
    }

    // Both bias corrections are folded into the step size and epsilon, which is algorithm 1 exactly.
    fn coefficients(&self) -> AdamCoefficients {
        let AdamConfig { beta1, beta2, epsilon } = self.config;
        let n = self.n_steps as f64;
        let correction1 = 1.0 - beta1.powf(n);
        let correction2 = (1.0 - beta2.powf(n)).sqrt();
        AdamCoefficients {
            keep1: beta1 as f32,
            take1: (1.0 - beta1) as f32,
            keep2: beta2 as f32,
            take2: (1.0 - beta2) as f32,
            step: (f64::from(self.learning_rate) * correction2 / correction1) as f32,
            epsilon: (epsilon * correction2) as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_without_gradients_become_zero_rather_than_subnormal() {
        let mut adam = Adam::new(AdamConfig::default(), 1e-3, 3);
        let mut parameters = [1.0, 1.0, 1.0];
        adam.step(&mut parameters, &[1.0, 1e-6, 0.0], None);
        assert!(adam.first_moment[1] > 0.0 && adam.second_moment[1] > 0.0);
        for _ in 0..1000 {
            adam.step(&mut parameters, &[0.0, 0.0, 1e-30], None);
        }
        assert_eq!(adam.first_moment[..], [0.0; 3]);
        assert!(adam.second_moment[..2].iter().all(|v| v.is_normal()), "{:?}", adam.second_moment);
        assert_eq!(adam.second_moment[2], 0.0);
        adam.step(&mut parameters, &[f32::NAN; 3], None);
        assert!(parameters.iter().all(|p| p.is_nan()));
    }
}
