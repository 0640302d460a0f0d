//! Running mean and standard deviation of the networks' inputs.

use serde::{Deserialize, Serialize};

use crate::RlError;

/// Constants of the clipping and scaling of inputs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NormalizerConfig {
    /// Least standard deviation. It keeps the noise of a constant input small (OpenAI baselines HER, `norm_eps`).
    pub epsilon: f32,
    /// Limit, plus and minus, at which normalised values are clipped (OpenAI baselines HER, `norm_clip`).
    pub norm_clip: f32,
    /// Limit, plus and minus, at which values are clipped before they are normalised (OpenAI baselines HER, `clip_obs`).
    pub raw_clip: f32,
}

impl NormalizerConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RlError::Config`] for a value that is not a positive number.
    pub fn validate(&self) -> Result<(), RlError> {
        let positive = [("epsilon", self.epsilon), ("norm_clip", self.norm_clip), ("raw_clip", self.raw_clip)];
        for (field, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(RlError::Config { field, expected: "a positive number", got: value.to_string() });
            }
        }
        Ok(())
    }
}

/// Statistics of each dimension over all rows so far, and the scaling that follows from them.
///
/// Before the first [`update`](Self::update) the mean is 0 and the standard deviation 1.
#[derive(Clone, Debug, PartialEq)]
pub struct RunningNormalizer {
    config: NormalizerConfig,
    pub(crate) count: u64,
    pub(crate) sum: Vec<f64>,
    pub(crate) sum_of_squares: Vec<f64>,
    mean: Vec<f32>,
    std: Vec<f32>,
}

impl RunningNormalizer {
    /// Makes a normaliser without statistics for rows of `dim` values.
    pub fn new(config: NormalizerConfig, dim: usize) -> Self {
        Self {
            config,
            count: 0,
            sum: vec![0.0; dim],
            sum_of_squares: vec![0.0; dim],
            mean: vec![0.0; dim],
            std: vec![1.0; dim],
        }
    }

    /// Restores a normaliser from its saved statistics.
    pub(crate) fn from_sums(config: NormalizerConfig, count: u64, sum: Vec<f64>, sum_of_squares: Vec<f64>) -> Self {
        let mut normalizer = Self::new(config, sum.len());
        normalizer.count = count;
        normalizer.sum = sum;
        normalizer.sum_of_squares = sum_of_squares;
        normalizer.refresh();
        normalizer
    }

    /// Restores a normaliser from its mean and standard deviation alone. It has no statistics and must not be updated.
    pub(crate) fn frozen(config: NormalizerConfig, mean: Vec<f32>, std: Vec<f32>) -> Self {
        let mut normalizer = Self::new(config, mean.len());
        normalizer.mean = mean;
        normalizer.std = std;
        normalizer
    }

    /// Adds rows to the statistics.
    ///
    /// # Shapes
    /// `rows`: any number of rows of [`dim`](Self::dim) values, one after another.
    ///
    /// # Panics
    /// If `rows` does not hold whole rows.
    pub fn update(&mut self, rows: &[f32]) {
        let dim = self.dim();
        assert!(dim > 0 && rows.len().is_multiple_of(dim), "{} values are not whole rows of {dim}", rows.len());
        let clip = self.config.raw_clip;
        for row in rows.chunks_exact(dim) {
            for ((x, sum), squares) in row.iter().zip(&mut self.sum).zip(&mut self.sum_of_squares) {
                let x = f64::from(x.clamp(-clip, clip));
                *sum += x;
                *squares += x * x;
            }
        }
        self.count += (rows.len() / dim) as u64;
        self.refresh();
    }

    /// `(row: dim) => out: dim`: clips the row, subtracts the mean, divides by the standard deviation, and clips again.
    ///
    /// # Panics
    /// If a length is not [`dim`](Self::dim).
    pub fn normalize(&self, row: &[f32], out: &mut [f32]) {
        let dim = self.dim();
        let (row, out, mean, std) = (&row[..dim], &mut out[..dim], &self.mean[..dim], &self.std[..dim]);
        let NormalizerConfig { norm_clip, raw_clip, .. } = self.config;
        for (((out, x), mean), std) in out.iter_mut().zip(row).zip(mean).zip(std) {
            *out = ((x.clamp(-raw_clip, raw_clip) - mean) / std).clamp(-norm_clip, norm_clip);
        }
    }

    /// Returns the number of values in a row.
    pub fn dim(&self) -> usize {
        self.mean.len()
    }

    /// Returns the number of rows so far.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the mean of each dimension.
    pub fn mean(&self) -> &[f32] {
        &self.mean
    }

    /// Returns the standard deviation of each dimension, at least the configured epsilon.
    pub fn std(&self) -> &[f32] {
        &self.std
    }

    fn refresh(&mut self) {
        if self.count == 0 {
            return;
        }
        let n = self.count as f64;
        let floor = f64::from(self.config.epsilon);
        for (i, (sum, squares)) in self.sum.iter().zip(&self.sum_of_squares).enumerate() {
            let mean = sum / n;
            self.mean[i] = mean as f32;
            self.std[i] = (squares / n - mean * mean).max(floor * floor).sqrt() as f32;
        }
    }
}
