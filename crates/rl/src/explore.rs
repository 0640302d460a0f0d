//! Exploration: what is done to the policy's actions while training episodes are collected.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use crate::RlError;
use crate::attempt::Attempt;

/// Noise and random actions, for actions in [-1, 1].
///
/// In noisy episodes each dimension gets Gaussian noise that is correlated in time (a first-order autoregressive process
/// of constant variance), and now and then a random action replaces the policy's and is held for some steps.
/// Dimensions of equal `hold_scale` are replaced together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExplorationConfig {
    /// Share of training episodes without any noise; the caller decides by it which episodes these are. Default 0.5
    /// (measured: noisy episodes seldom succeed).
    pub noise_free_share: f32,
    /// Standard deviation of the noise. Default 0.1 (measured; OpenAI baselines HER has 0.2, independent).
    pub noise_sigma: f32,
    /// Correlation of the noise from one step to the next, 0 for independent noise. Default 0.8 (measured).
    pub noise_correlation: f32,
    /// Probability that a step which continues no held action starts a random one. Default 0.1 (measured; OpenAI
    /// baselines HER has 0.3, not held).
    pub random_probability: f32,
    /// Mean number of steps a random action is held, at least 1; lengths are geometric. Default 5 (measured).
    pub random_hold_steps: f32,
    /// As `random_hold_steps`, in warm-up episodes. Default 5 (measured).
    pub warmup_hold_steps: f32,
    /// Factor on the mean hold of each action dimension; empty means 1 for all. A dimension that is held longer starts its
    /// random actions more seldom in the same proportion. Default empty.
    pub hold_scale: Vec<f32>,
    /// Probability that a random action is a coordinated one, where dimensions have a [`Coordination`]. Default 0.8
    /// (measured).
    pub coordinated_probability: f32,
    /// Factor on the mean hold of what moves together in a coordinated action, at least 1. Default 3 (measured).
    pub coordinated_hold: f32,
    /// What each dimension does in a coordinated action; empty: there are none. The caller knows what dimensions mean.
    #[serde(skip)]
    pub coordination: Vec<Coordination>,
    /// The action at which episodes start, as long as `coordination`.
    #[serde(skip)]
    pub start: Vec<f32>,
}

/// What a dimension does in a coordinated random action.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Coordination {
    /// It draws for itself, as in every other random action.
    #[default]
    Free,
    /// It follows a value that its group shares, times this sign.
    Together(f32),
    /// It goes to one end of its range. What does so carries the hand, which is down at -1.
    Ends,
}

impl Default for ExplorationConfig {
    fn default() -> Self {
        Self {
            noise_free_share: 0.5,
            noise_sigma: 0.1,
            noise_correlation: 0.8,
            random_probability: 0.1,
            random_hold_steps: 5.0,
            warmup_hold_steps: 5.0,
            hold_scale: Vec::new(),
            coordinated_probability: 0.8,
            coordinated_hold: 3.0,
            coordination: Vec::new(),
            start: Vec::new(),
        }
    }
}

impl ExplorationConfig {
    /// Multiplies the noise's standard deviation and the probability of random actions.
    pub fn scale_noise(&mut self, factor: f32) {
        self.noise_sigma *= factor;
        self.random_probability *= factor;
    }

    /// Independent Gaussian noise and single random steps in every episode.
    ///
    /// # Source
    /// OpenAI baselines HER: `noise_eps` 0.2, `random_eps` 0.3.
    pub fn baselines() -> Self {
        Self {
            noise_free_share: 0.0,
            noise_sigma: 0.2,
            noise_correlation: 0.0,
            random_probability: 0.3,
            random_hold_steps: 1.0,
            ..Self::default()
        }
    }

    /// Checks the ranges; `act_dim` is the length that a non-empty `hold_scale` must have.
    ///
    /// # Errors
    /// [`RlError::Config`] or [`RlError::Length`].
    pub fn validate(&self, act_dim: usize) -> Result<(), RlError> {
        let check = |field, value: f32, ok: bool, expected| {
            if ok { Ok(()) } else { Err(RlError::Config { field, expected, got: value.to_string() }) }
        };
        let probability = |field, p: f32| check(field, p, (0.0..=1.0).contains(&p), "a number from 0 to 1");
        let steps = |field, n: f32| check(field, n, n.is_finite() && n >= 1.0, "a number of at least 1");
        probability("noise_free_share", self.noise_free_share)?;
        probability("random_probability", self.random_probability)?;
        probability("coordinated_probability", self.coordinated_probability)?;
        steps("random_hold_steps", self.random_hold_steps)?;
        steps("warmup_hold_steps", self.warmup_hold_steps)?;
        let hold = self.coordinated_hold;
        check("coordinated_hold", hold, hold.is_finite() && hold >= 1.0, "a number of at least 1")?;
        let (sigma, correlation) = (self.noise_sigma, self.noise_correlation);
        check("noise_sigma", sigma, sigma.is_finite() && sigma >= 0.0, "a number of at least 0")?;
        check("noise_correlation", correlation, (0.0..1.0).contains(&correlation), "a number from 0 to below 1")?;
        for &scale in &self.hold_scale {
            check("hold_scale", scale, scale.is_finite() && scale >= 1.0, "numbers of at least 1")?;
        }
        if !self.hold_scale.is_empty() && self.hold_scale.len() != act_dim {
            return Err(RlError::Length { name: "hold_scale", expected: act_dim, got: self.hold_scale.len() });
        }
        if !self.coordination.is_empty() && self.coordination.len() != act_dim {
            return Err(RlError::Length { name: "coordination", expected: act_dim, got: self.coordination.len() });
        }
        if self.start.len() != self.coordination.len() {
            let (expected, got) = (self.coordination.len(), self.start.len());
            return Err(RlError::Length { name: "start", expected, got });
        }
        Ok(())
    }
}

/// How far a dimension may be from the value that its group shares, or from where an attempt has it.
pub(crate) const SPREAD: f32 = 0.15;

/// Dimensions whose random actions begin and end together.
#[derive(Clone, Debug)]
struct HoldGroup {
    dimensions: Vec<usize>,
    start_probability: f32,
    end_probability: f32,
    holding: bool,
    /// True while the action that is held moves dimensions together.
    together: bool,
}

/// The exploration of one episode.
#[derive(Clone, Debug)]
pub struct Exploration {
    sigma: f32,
    correlation: f32,
    noise: Vec<f32>,
    held: Vec<f32>,
    groups: Vec<HoldGroup>,
    coordinated_probability: f32,
    coordinated_hold: f32,
    coordination: Vec<Coordination>,
    attempt: Option<Attempt>,
}

impl Exploration {
    /// Leaves every action as it is.
    pub fn none() -> Self {
        Self {
            sigma: 0.0,
            correlation: 0.0,
            noise: Vec::new(),
            held: Vec::new(),
            groups: Vec::new(),
            coordinated_probability: 0.0,
            coordinated_hold: 1.0,
            coordination: Vec::new(),
            attempt: None,
        }
    }

    /// Begins a noisy episode.
    ///
    /// # Panics
    /// When `hold_scale` is neither empty nor `act_dim` long; [`ExplorationConfig::validate`] reports that as an error.
    pub fn noisy(config: &ExplorationConfig, act_dim: usize, rng: &mut impl Rng) -> Self {
        let sigma = config.noise_sigma;
        Self {
            sigma,
            correlation: config.noise_correlation,
            noise: (0..act_dim).map(|_| sigma * rng.sample::<f32, _>(StandardNormal)).collect(),
            held: vec![0.0; act_dim],
            groups: groups(config, act_dim, config.random_probability, config.random_hold_steps),
            coordinated_probability: config.coordinated_probability,
            coordinated_hold: config.coordinated_hold,
            coordination: config.coordination.clone(),
            attempt: None,
        }
    }

    /// Begins an episode of random actions, each held for some steps; the policy has no say.
    ///
    /// # Panics
    /// As [`noisy`](Self::noisy).
    pub fn warmup(config: &ExplorationConfig, act_dim: usize, _rng: &mut impl Rng) -> Self {
        let mut groups = groups(config, act_dim, 1.0, config.warmup_hold_steps);
        for group in &mut groups {
            group.start_probability = 1.0;
        }
        Self {
            held: vec![0.0; act_dim],
            groups,
            coordinated_probability: config.coordinated_probability,
            coordinated_hold: config.coordinated_hold,
            coordination: config.coordination.clone(),
            ..Self::none()
        }
    }

    /// Begins an episode that tries to grasp, as far as the [coordination](ExplorationConfig::coordination) says what closes
    /// the hand; the policy has no say.
    pub fn attempt(config: &ExplorationConfig, rng: &mut impl Rng) -> Self {
        Self { attempt: Some(Attempt::new(config, rng)), ..Self::none() }
    }

    /// Turns the policy's action of the next step into the one to execute, in [-1, 1].
    ///
    /// # Panics
    /// When the action is shorter than the `act_dim` given at the start.
    pub fn apply(&mut self, action: &mut [f32], rng: &mut impl Rng) {
        if let Some(attempt) = &mut self.attempt {
            attempt.act(action);
            return;
        }
        self.add_noise(action, rng);
        for group in &mut self.groups {
            let longer = if group.together { self.coordinated_hold } else { 1.0 };
            group.holding = group.holding && rng.random::<f32>() >= group.end_probability / longer;
            if !group.holding && rng.random::<f32>() < group.start_probability {
                group.holding = true;
                for &d in &group.dimensions {
                    self.held[d] = rng.random_range(-1.0..=1.0);
                }
                if !self.coordination.is_empty() {
                    let probability = self.coordinated_probability;
                    group.together = coordinate(group, &self.coordination, probability, &mut self.held, rng);
                }
            }
            if group.holding {
                for &d in &group.dimensions {
                    action[d] = self.held[d];
                }
            }
        }
    }

    // The factor on the innovation keeps the variance of the process constant.
    fn add_noise(&mut self, action: &mut [f32], rng: &mut impl Rng) {
        if self.noise.is_empty() {
            return;
        }
        let innovation = self.sigma * (1.0 - self.correlation * self.correlation).sqrt();
        for (a, noise) in action.iter_mut().zip(&mut self.noise) {
            *a = (*a + *noise).clamp(-1.0, 1.0);
            *noise = self.correlation * *noise + innovation * rng.sample::<f32, _>(StandardNormal);
        }
    }
}

/// Makes the random action of a group a coordinated one, with some probability. Returns whether any of it moves together.
fn coordinate(
    group: &HoldGroup,
    coordination: &[Coordination],
    probability: f32,
    held: &mut [f32],
    rng: &mut impl Rng,
) -> bool {
    let coordinated = rng.random::<f32>() < probability;
    let shared: f32 = rng.random_range(-1.0..=1.0);
    for &d in group.dimensions.iter().filter(|_| coordinated) {
        held[d] = match coordination[d] {
            Coordination::Free => held[d],
            Coordination::Together(sign) => (sign * shared + SPREAD * held[d]).clamp(-1.0, 1.0),
            Coordination::Ends => 1.0_f32.copysign(held[d]),
        };
    }
    coordinated && group.dimensions.iter().any(|&d| matches!(coordination[d], Coordination::Together(_)))
}

fn groups(config: &ExplorationConfig, act_dim: usize, start: f32, hold_steps: f32) -> Vec<HoldGroup> {
    let scales = &config.hold_scale;
    assert!(scales.is_empty() || scales.len() == act_dim, "{} hold scales for {act_dim} actions", scales.len());
    let mut groups: Vec<(f32, HoldGroup)> = Vec::new();
    for d in 0..act_dim {
        let scale = scales.get(d).copied().unwrap_or(1.0);
        if let Some((_, group)) = groups.iter_mut().find(|(s, _)| *s == scale) {
            group.dimensions.push(d);
            continue;
        }
        let group = HoldGroup {
            dimensions: vec![d],
            start_probability: start / scale,
            end_probability: 1.0 / (hold_steps * scale),
            holding: false,
            together: false,
        };
        groups.push((scale, group));
    }
    groups.into_iter().map(|(_, group)| group).collect()
}
