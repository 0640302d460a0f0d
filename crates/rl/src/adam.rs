//! The Adam optimiser over one flat parameter vector.

use crate::elementwise::{self, AdamCoefficients};
use crate::matrix::{Aligned, zeros};

/// Decay of the first moment.
// Double precision, because it is the small distance of a decay from 1 that acts.
const BETA1: f64 = 0.9;
/// Decay of the second moment.
const BETA2: f64 = 0.999;
/// Added to the root of the corrected second moment.
const EPSILON: f64 = 1e-8;

/// State of the optimiser: two moments for each parameter and the number of steps taken.
///
/// # Source
/// Kingma and Ba 2015, algorithm 1, with its constants.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
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
    /// Share of the way that the target moves towards the new parameters.
    pub tau: f32,
}

impl Adam {
    /// Starts with zero moments for `n_parameters` parameters.
    pub fn new(learning_rate: f32, n_parameters: usize) -> Self {
        Self { learning_rate, first_moment: zeros(n_parameters), second_moment: zeros(n_parameters), n_steps: 0 }
    }

    /// Sets the learning rate of the following steps.
    pub fn set_learning_rate(&mut self, learning_rate: f32) {
        self.learning_rate = learning_rate;
    }

    /// Returns the learning rate.
    pub fn learning_rate(&self) -> f32 {
        self.learning_rate
    }

    /// Descends once along `gradient`. With `follow`, a target network moves towards the new parameters in the same pass.
    ///
    /// # Panics
    /// If the slices are not as long as the optimiser's moments.
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

    // The step size and epsilon include both bias corrections. The result is exactly that of algorithm 1.
    fn coefficients(&self) -> AdamCoefficients {
        let n = self.n_steps as f64;
        let correction1 = 1.0 - BETA1.powf(n);
        let correction2 = (1.0 - BETA2.powf(n)).sqrt();
        AdamCoefficients {
            keep1: BETA1 as f32,
            take1: (1.0 - BETA1) as f32,
            keep2: BETA2 as f32,
            take2: (1.0 - BETA2) as f32,
            step: (f64::from(self.learning_rate) * correction2 / correction1) as f32,
            epsilon: (EPSILON * correction2) as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_without_gradients_become_zero_rather_than_subnormal() {
        let mut adam = Adam::new(1e-3, 3);
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
