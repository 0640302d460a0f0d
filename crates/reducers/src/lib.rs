//! Ways to express postures or commands by a few numbers, and how well each reconstructs samples that it has not seen.
//!
//! A [`Reducer`] fits a [`Reduction`] to samples. [`Pca`] is what synergies are made of everywhere else; [`Ppca`] adds a model
//! of the noise, and [`Autoencoder`] bends the space. [`cross_validate`] compares them at equal numbers.
//!
//! ```
//! use eigenhand_reducers::{Pca, Reducer};
//!
//! let samples: Vec<[f64; 2]> = (0..10).map(|i| [f64::from(i), 2.0 * f64::from(i) + 1.0]).collect();
//! let rows: Vec<&[f64]> = samples.iter().map(|row| row.as_slice()).collect();
//! let line = Pca.fit(&rows, 1)?;
//! let back = line.decode(&line.encode(&[20.0, 41.0]));
//! assert!((back[0] - 20.0).abs() < 1e-9 && (back[1] - 41.0).abs() < 1e-9);
//! # Ok::<(), eigenhand_synergy::SynergyError>(())
//! ```
#![forbid(unsafe_code)]

mod autoencoder;
mod cross_validation;
mod linear;

pub use autoencoder::Autoencoder;
pub use cross_validation::{Reconstruction, Sample, cross_validate};
use eigenhand_synergy::SynergyError;
pub use linear::{Pca, Ppca};

/// A way to express samples by a few numbers.
pub trait Reducer {
    /// Returns its name, in lower case.
    fn name(&self) -> &'static str;

    /// Fits a space of `k` numbers to samples of `n` coordinates each; `k` is clamped to `n`.
    ///
    /// # Errors
    /// Fewer than two samples, samples of unequal lengths or with a number that is not finite, `k == 0`, or a
    /// decomposition that does not converge.
    fn fit(&self, samples: &[&[f64]], k: usize) -> Result<Box<dyn Reduction>, SynergyError>;
}

/// A space of few numbers, fitted to samples.
pub trait Reduction {
    /// `(sample: n) => numbers: k`
    fn encode(&self, sample: &[f64]) -> Vec<f64>;

    /// `(numbers: k) => sample: n`
    fn decode(&self, numbers: &[f64]) -> Vec<f64>;

    /// Returns the natural logarithm of the probability density of a sample; none for a reduction that models no density.
    fn log_density(&self, _sample: &[f64]) -> Option<f64> {
        None
    }
}

/// Returns the reducer with a name.
pub fn named(name: &str) -> Option<Box<dyn Reducer>> {
    match name {
        "pca" => Some(Box::new(Pca)),
        "ppca" => Some(Box::new(Ppca)),
        "autoencoder" => Some(Box::new(Autoencoder::default())),
        _ => None,
    }
}

/// Names of all reducers.
pub const NAMES: [&str; 3] = ["pca", "ppca", "autoencoder"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reducer_is_found_by_its_name() {
        assert!(NAMES.iter().all(|name| named(name).is_some_and(|reducer| reducer.name() == *name)));
        assert!(named("magic").is_none());
    }
}
