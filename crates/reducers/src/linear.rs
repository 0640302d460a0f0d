//! Principal component analysis, and its probabilistic form.

use std::f64::consts::TAU;

use eigenhand_synergy::{JointInfo, Synergy, SynergyError, Unit};

use crate::{Reducer, Reduction};

/// Principal component analysis: the mean and the orthonormal directions in which the samples vary most.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pca;

/// Probabilistic principal component analysis: the samples are `mean + W z + noise`, with `z` and the noise normal, and the
/// noise alike in all coordinates.
///
/// Its space is that of [`Pca`]. Its numbers are the means of `z` for a sample, which the noise draws towards 0, so it
/// reconstructs a little worse; but it has a density, which tells how many numbers the samples are worth.
///
/// # Source
/// Tipping and Bishop, *Probabilistic principal component analysis*, J. R. Statist. Soc. B 61 (1999): `W` by equation 7 with
/// `R = I`, the noise by equation 8.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ppca;

/// (number of coordinates) => coordinates without names and limits
fn unlimited(n: usize) -> Vec<JointInfo> {
    let coordinate = |i: usize| JointInfo {
        name: format!("coordinate_{i}"),
        unit: Unit::Radian,
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
    };
    (0..n).map(coordinate).collect()
}

pub(crate) fn principal_space(samples: &[&[f64]], k: usize) -> Result<Synergy, SynergyError> {
    Synergy::fit(&unlimited(samples.first().map_or(0, |sample| sample.len())), samples, k)
}

impl Reducer for Pca {
    fn name(&self) -> &'static str {
        "pca"
    }

    fn fit(&self, samples: &[&[f64]], k: usize) -> Result<Box<dyn Reduction>, SynergyError> {
        Ok(Box::new(principal_space(samples, k)?))
    }
}

impl Reduction for Synergy {
    fn encode(&self, sample: &[f64]) -> Vec<f64> {
        Synergy::encode(self, sample)
    }

    fn decode(&self, numbers: &[f64]) -> Vec<f64> {
        self.decode_unclamped(numbers)
    }
}

impl Reducer for Ppca {
    fn name(&self) -> &'static str {
        "ppca"
    }

    fn fit(&self, samples: &[&[f64]], k: usize) -> Result<Box<dyn Reduction>, SynergyError> {
        let space = principal_space(samples, k)?;
        let (k, n) = (space.n_components(), space.n_joints());
        let left = &space.eigenvalues()[k..];
        let noise = left.iter().map(|value| value.max(0.0)).sum::<f64>() / (n - k).max(1) as f64;
        let scale = space.explained_variance().iter().map(|value| (value - noise).max(0.0).sqrt()).collect();
        Ok(Box::new(WithNoise { space, scale, noise }))
    }
}

/// A principal space with the variances of its numbers and of the noise.
struct WithNoise {
    space: Synergy,
    /// Length of each column of `W`.
    scale: Vec<f64>,
    /// Variance of the noise, in each coordinate.
    noise: f64,
}

impl Reduction for WithNoise {
    fn encode(&self, sample: &[f64]) -> Vec<f64> {
        let along = self.space.encode(sample);
        let mean = |(z, scale): (&f64, &f64)| {
            let variance = scale * scale + self.noise;
            if variance > 0.0 { z * scale / variance } else { 0.0 }
        };
        along.iter().zip(&self.scale).map(mean).collect()
    }

    fn decode(&self, numbers: &[f64]) -> Vec<f64> {
        let along: Vec<f64> = numbers.iter().zip(&self.scale).map(|(z, scale)| z * scale).collect();
        self.space.decode_unclamped(&along)
    }

    fn log_density(&self, sample: &[f64]) -> Option<f64> {
        // Without noise, all samples lie in the space, and there is no density outside of it.
        if self.noise <= 0.0 {
            return None;
        }
        let outside = self.space.n_joints() - self.space.n_components();
        let mut sum = self.space.error(sample).powi(2) / self.noise + outside as f64 * (TAU * self.noise).ln();
        for (z, scale) in self.space.encode(sample).iter().zip(&self.scale) {
            let variance = scale * scale + self.noise;
            sum += z * z / variance + (TAU * variance).ln();
        }
        Some(-0.5 * sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eigenhand_rl::rng;
    use rand::RngExt;

    /// Samples of two coordinates that vary together, and one that only has noise.
    fn samples() -> Vec<Vec<f64>> {
        let mut rng = rng::stream(3, "reducers", 0);
        let mut noise = move || 0.1 * (rng.random::<f64>() + rng.random::<f64>() - 1.0);
        (0..200)
            .map(|i| {
                let z = (f64::from(i) * 0.37).sin();
                vec![z + noise(), 1.0 - z + noise(), noise()]
            })
            .collect()
    }

    fn rows(samples: &[Vec<f64>]) -> Vec<&[f64]> {
        samples.iter().map(Vec::as_slice).collect()
    }

    #[test]
    fn the_noise_draws_numbers_towards_the_mean() -> Result<(), SynergyError> {
        let samples = samples();
        let rows = rows(&samples);
        let (pca, ppca) = (Pca.fit(&rows, 1)?, Ppca.fit(&rows, 1)?);
        let space = principal_space(&rows, 1)?;
        let shrunk = 1.0 - space.eigenvalues()[1..].iter().sum::<f64>() / 2.0 / space.eigenvalues()[0];
        assert!(shrunk > 0.9 && shrunk < 1.0, "{shrunk}");
        let (a, b) = (pca.decode(&pca.encode(rows[5])), ppca.decode(&ppca.encode(rows[5])));
        for ((a, b), mean) in a.iter().zip(&b).zip(space.mean()) {
            assert!(((b - mean) - shrunk * (a - mean)).abs() < 1e-12);
        }
        Ok(())
    }

    #[test]
    fn the_density_is_that_of_the_model_covariance() -> Result<(), SynergyError> {
        let samples = samples();
        let rows = rows(&samples);
        let space = principal_space(&rows, 1)?;
        let noise = space.eigenvalues()[1..].iter().sum::<f64>() / 2.0;
        let first = space.eigenvalues()[0];
        let x = rows[7];
        let z = space.encode(x)[0];
        let squared: f64 = x.iter().zip(space.mean()).map(|(x, mean)| (x - mean).powi(2)).sum();
        let exponent = z * z / first + (squared - z * z) / noise;
        let expected = -0.5 * (exponent + (TAU.powi(3) * first * noise * noise).ln());
        let found = Ppca.fit(&rows, 1)?.log_density(x);
        assert!(found.is_some_and(|found| (found - expected).abs() < 1e-9), "{found:?} and {expected}");
        Ok(())
    }

    #[test]
    fn all_numbers_leave_no_noise_and_no_density() -> Result<(), SynergyError> {
        let samples = samples();
        let whole = Ppca.fit(&rows(&samples), 3)?;
        assert_eq!(whole.log_density(&samples[0]), None);
        let back = whole.decode(&whole.encode(&samples[0]));
        assert!(back.iter().zip(&samples[0]).all(|(a, b)| (a - b).abs() < 1e-9));
        Ok(())
    }
}
