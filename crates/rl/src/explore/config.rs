//! Constants of exploration, and the caller's knowledge of the action.

use serde::{Deserialize, Serialize};

use crate::RlError;

/// Largest distance of a dimension from the value that its group shares, or from the one that an attempt gives it.
pub(super) const SPREAD: f32 = 0.15;

/// Noise and random actions, for actions in [-1, 1].
///
/// In a noisy episode each dimension gets Gaussian noise that is correlated in time (a first-order autoregressive process
/// of constant variance). At times a random action replaces that of the policy and is held for some steps. Dimensions of
/// equal [`hold_scale`](ActionDimension::hold_scale) are replaced together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExplorationConfig {
    /// Share of training episodes without noise, which the caller draws (measured: noisy episodes seldom succeed).
    pub noise_free_share: f32,
    /// Standard deviation of the noise (measured; OpenAI baselines HER has larger, independent noise).
    pub noise_sigma: f32,
    /// Correlation of the noise between two steps, 0 for independent noise (measured).
    pub noise_correlation: f32,
    /// Probability that a random action starts at a step where none is held (measured; OpenAI baselines HER has more, of one
    /// step each).
    pub random_probability: f32,
    /// Mean number of steps for which a random action is held, at least 1. The lengths are geometric (measured).
    pub random_hold_steps: f32,
    /// Probability that a random action is coordinated, if a dimension has a [`Coordination`] (measured).
    pub coordinated_probability: f32,
    /// Factor on the mean hold of a coordinated action that moves dimensions together, at least 1 (measured).
    pub coordinated_hold: f32,
    /// The caller's knowledge of each dimension of the action. If it is empty, all dimensions have the
    /// [default](ActionDimension::default).
    #[serde(skip)]
    pub dimensions: Vec<ActionDimension>,
}

/// The caller's knowledge of one dimension of the action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActionDimension {
    /// Factor on the mean hold of its random actions, at least 1. They start more seldom in the same proportion.
    pub hold_scale: f32,
    /// Its part in a coordinated random action.
    pub coordination: Coordination,
    /// Its action with the open hand at the start.
    pub start: f32,
}

/// The part of a dimension in a coordinated random action.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Coordination {
    /// It has a random value of its own, as in every other random action.
    #[default]
    Free,
    /// It follows a value that its group shares, times this sign.
    Together(f32),
    /// It goes to one end of its range. Such a dimension carries the hand, which is down at -1.
    Ends,
}

impl Default for ActionDimension {
    /// Returns a dimension of which nothing is known: it is free, held as long as the others, and starts at 0.
    fn default() -> Self {
        Self { hold_scale: 1.0, coordination: Coordination::Free, start: 0.0 }
    }
}

impl ExplorationConfig {
    /// Multiplies the noise's standard deviation and the probability of random actions.
    pub fn scale_noise(&mut self, factor: f32) {
        self.noise_sigma *= factor;
        self.random_probability *= factor;
    }

    /// Returns whether a dimension has a part in coordinated actions.
    pub fn is_coordinated(&self) -> bool {
        self.dimensions.iter().any(|dimension| dimension.coordination != Coordination::Free)
    }

    /// Checks the ranges. `act_dim` is the length that `dimensions` must have if it is not empty.
    ///
    /// # Errors
    /// [`RlError::Config`] or [`RlError::Length`].
    pub fn validate(&self, act_dim: usize) -> Result<(), RlError> {
        let check = |field, value: f32, ok: bool, expected| {
            if ok { Ok(()) } else { Err(RlError::Config { field, expected, got: value.to_string() }) }
        };
        let probability = |field, p: f32| check(field, p, (0.0..=1.0).contains(&p), "a number from 0 to 1");
        let factor = |field, n: f32| check(field, n, n.is_finite() && n >= 1.0, "a number of at least 1");
        probability("noise_free_share", self.noise_free_share)?;
        probability("random_probability", self.random_probability)?;
        probability("coordinated_probability", self.coordinated_probability)?;
        factor("random_hold_steps", self.random_hold_steps)?;
        factor("coordinated_hold", self.coordinated_hold)?;
        let (sigma, correlation) = (self.noise_sigma, self.noise_correlation);
        check("noise_sigma", sigma, sigma.is_finite() && sigma >= 0.0, "a number of at least 0")?;
        check("noise_correlation", correlation, (0.0..1.0).contains(&correlation), "a number from 0 to below 1")?;
        for dimension in &self.dimensions {
            factor("hold_scale", dimension.hold_scale)?;
        }
        if !self.dimensions.is_empty() && self.dimensions.len() != act_dim {
            return Err(RlError::Length { name: "dimensions", expected: act_dim, got: self.dimensions.len() });
        }
        Ok(())
    }
}
