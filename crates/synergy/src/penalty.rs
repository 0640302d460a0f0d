//! The penalty on the reward of a success whose posture the synergy space does not express.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::{Synergy, SynergyError};

/// How the penalty grows with the approximation error `e` of a posture and its distance `|d|` from the mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind", deny_unknown_fields)]
pub enum PenaltyForm {
    /// No penalty on the reward.
    None {},
    /// `lambda e`, without a bound.
    ///
    /// # Source
    /// Section 2.2.
    Literal {},
    /// `cap (1 - exp(-lambda e / cap))`: slope `lambda` at `e = 0`, and never above `cap`, so that a success stays
    /// above a failure whatever its posture.
    Saturating {
        /// The least upper bound of the penalty, in units of reward.
        cap: f64,
    },
    /// `cap min(1, lambda e / |d|)`: the part of the posture's deviation that the space does not express.
    Fraction {
        /// The largest penalty, in units of reward.
        cap: f64,
    },
    /// `cap min(1, lambda e^2 / |d|^2)`: the share of the squared deviation that the space does not express.
    Share {
        /// The largest penalty, in units of reward.
        cap: f64,
    },
}

impl PenaltyForm {
    /// Returns the penalty of an error in a posture at a distance from the mean.
    ///
    /// (lambda >= 0, e >= 0, |d| >= e) => penalty
    pub fn penalty(self, lambda: f64, error: f64, deviation: f64) -> f64 {
        if lambda == 0.0 || error == 0.0 {
            return 0.0;
        }
        let literal = lambda * error;
        match self {
            PenaltyForm::None {} => 0.0,
            PenaltyForm::Literal {} => literal,
            PenaltyForm::Saturating { cap } => -cap * (-literal / cap).exp_m1(),
            PenaltyForm::Fraction { cap } => cap * (literal / deviation).min(1.0),
            PenaltyForm::Share { cap } => cap * (literal * error / (deviation * deviation)).min(1.0),
        }
    }

    /// Returns the greatest penalty, where there is one.
    fn cap(self) -> Option<f64> {
        match self {
            PenaltyForm::None {} | PenaltyForm::Literal {} => None,
            PenaltyForm::Saturating { cap } | PenaltyForm::Fraction { cap } | PenaltyForm::Share { cap } => Some(cap),
        }
    }
}

/// The settings of the penalty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PenaltyConfig {
    /// The coefficient of the approximation error; default 1 (section 4).
    pub lambda: f64,
    /// How the penalty grows; default saturating at 0.9, for rewards of 0 and -1.
    pub form: PenaltyForm,
    /// There is no feedback until the space is of more postures than this; default 100 (section 4).
    pub start_after: usize,
}

impl Default for PenaltyConfig {
    fn default() -> Self {
        PenaltyConfig { lambda: 1.0, form: PenaltyForm::Saturating { cap: 0.9 }, start_after: 100 }
    }
}

impl PenaltyConfig {
    /// Checks the settings against the two rewards.
    ///
    /// # Errors
    /// [`SynergyError::Penalty`] when `lambda` is negative or not finite, or when a penalty with a cap could bring a
    /// success down to a failure in single precision.
    pub fn validate(&self, r_success: f64, r_failure: f64) -> Result<(), SynergyError> {
        let fail = |name, expected: &str, got| Err(SynergyError::Penalty { name, expected: expected.to_owned(), got });
        if !(self.lambda >= 0.0 && self.lambda.is_finite()) {
            return fail("lambda", "a finite number of 0 or more", self.lambda);
        }
        if let Some(cap) = self.form.cap() {
            let worst_success = r_success as f32 - cap as f32;
            let above_failure = worst_success > r_failure as f32;
            if !(cap > 0.0 && above_failure) {
                let expected = format!("a number above 0 and below r_success - r_failure = {}", r_success - r_failure);
                return fail("cap", &expected, cap);
            }
        }
        Ok(())
    }
}

/// The feedback of the current synergy space into what is learned.
#[derive(Debug, Clone)]
pub struct Feedback {
    /// The space; none before the first analysis.
    pub synergy: Option<Arc<Synergy>>,
    /// The coefficient of the approximation error.
    pub lambda: f64,
    /// How the penalty grows.
    pub form: PenaltyForm,
    /// There is no feedback unless the space was fitted to more postures than this.
    pub start_after: usize,
}

impl Feedback {
    /// Returns the feedback before the first analysis: no penalty yet.
    pub fn new(config: &PenaltyConfig) -> Self {
        let PenaltyConfig { lambda, form, start_after } = *config;
        Feedback { synergy: None, lambda, form, start_after }
    }

    /// Returns the space if it feeds back now: there is one, of enough postures, and `lambda` is not 0.
    pub fn active(&self) -> Option<&Synergy> {
        self.synergy.as_deref().filter(|synergy| self.lambda != 0.0 && synergy.n_postures() > self.start_after)
    }

    /// Returns what to subtract from the reward of a success in `posture`.
    ///
    /// # Panics
    /// When the penalty is active and `posture` has not one number for each joint.
    ///
    /// # Source
    /// Section 2.2, and section 4 for its start.
    pub fn penalty(&self, posture: &[f32]) -> f32 {
        match self.active() {
            Some(_) if self.form == PenaltyForm::None {} => 0.0,
            Some(synergy) => {
                let (error, deviation) = synergy.error_and_deviation_f32(posture);
                self.form.penalty(self.lambda, f64::from(error), f64::from(deviation)) as f32
            }
            None => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{JointInfo, Unit};

    proptest! {
        #[test]
        fn a_success_stays_above_a_failure(
            r_failure in -100.0..100.0f64,
            gap in 1e-3..50.0f64,
            share in 1e-3..1.2f64,
            form in 0..3usize,
            lambda in 0.0..1e6f64,
            error in prop_oneof![0.0..10.0f64, 0.0..1e30f64],
            within in 0.0..10.0f64,
        ) {
            let r_success = r_failure + gap;
            let cap = share * gap;
            let form = [PenaltyForm::Saturating { cap }, PenaltyForm::Fraction { cap }, PenaltyForm::Share { cap }][form];
            let config = PenaltyConfig { lambda, form, ..PenaltyConfig::default() };
            let accepted = config.validate(r_success, r_failure).is_ok();
            if share < 0.99 {
                prop_assert!(accepted);
            }
            if accepted {
                let penalty = config.form.penalty(lambda, error, error.hypot(within));
                let reward = r_success as f32 - penalty as f32;
                prop_assert!(reward > r_failure as f32, "{reward} {r_failure}");
                prop_assert!(reward <= r_success as f32);
            } else {
                prop_assert!(share > 0.99);
            }
        }

        #[test]
        fn saturating_is_below_literal_and_rises(
            lambda in 1e-3..10.0f64, cap in 0.1..5.0f64, error in 0.0..5.0f64, step in 1e-3..1.0f64,
        ) {
            let form = PenaltyForm::Saturating { cap };
            let (near, far) = (form.penalty(lambda, error, error), form.penalty(lambda, error + step, error + step));
            prop_assert!(near <= far);
            let literal = PenaltyForm::Literal {}.penalty(lambda, error, error);
            prop_assert!(near <= literal * (1.0 + 1e-12));
            let small = 1e-7;
            prop_assert!((form.penalty(lambda, small, small) / small / lambda - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn the_relative_forms_are_those_of_the_unexpressed_part() {
        let (fraction, share) = (PenaltyForm::Fraction { cap: 0.5 }, PenaltyForm::Share { cap: 0.5 });
        assert_eq!((fraction.penalty(1.0, 0.3, 0.5), share.penalty(1.0, 0.3, 0.5)), (0.3, 0.5 * 0.36));
        assert_eq!((fraction.penalty(2.0, 0.5, 0.5), share.penalty(2.0, 0.5, 0.5)), (0.5, 0.5));
        assert_eq!((fraction.penalty(1.0, 0.0, 0.0), share.penalty(1.0, 0.0, 0.0)), (0.0, 0.0));
        let none = PenaltyForm::None {};
        assert_eq!(none.penalty(1.0, 0.3, 0.5), 0.0);
    }

    #[test]
    fn bad_settings_are_refused() {
        let valid = PenaltyConfig::default();
        valid.validate(0.0, -1.0).unwrap();
        let cap = |cap| PenaltyConfig { form: PenaltyForm::Saturating { cap }, ..valid };
        for config in [cap(1.0), cap(1.5), cap(0.0), cap(-0.1), cap(f64::NAN), cap(1.0 - 1e-12)] {
            let message = config.validate(0.0, -1.0).unwrap_err().to_string();
            assert!(message.contains("cap") && message.contains("r_success - r_failure = 1"), "{message}");
        }
        for lambda in [-1.0, f64::NAN, f64::INFINITY] {
            let config = PenaltyConfig { lambda, form: PenaltyForm::Literal {}, ..valid };
            assert!(config.validate(0.0, -1.0).unwrap_err().to_string().contains("lambda"));
        }
    }

    #[test]
    fn settings_are_read_from_toml() {
        let config: PenaltyConfig = toml::from_str("lambda = 2\nform = { kind = \"saturating\", cap = 0.5 }").unwrap();
        assert_eq!((config.lambda, config.form), (2.0, PenaltyForm::Saturating { cap: 0.5 }));
        assert_eq!(config.start_after, 100);
        let config: PenaltyConfig = toml::from_str("form.kind = \"literal\"").unwrap();
        assert_eq!(config.form, PenaltyForm::Literal {});
        let text = toml::to_string(&PenaltyConfig::default()).unwrap();
        assert_eq!(toml::from_str::<PenaltyConfig>(&text).unwrap(), PenaltyConfig::default());
        for kind in ["none", "literal"] {
            toml::from_str::<PenaltyConfig>(&format!("form = {{ kind = \"{kind}\", cap = 0.5 }}")).unwrap_err();
        }
        for bad in ["lamda = 1.0", "form = { kind = \"cubic\" }", "form = { kind = \"saturating\" }"] {
            toml::from_str::<PenaltyConfig>(bad).unwrap_err();
        }
    }

    #[test]
    fn the_penalty_starts_after_enough_postures() {
        let joints =
            ["a", "b"].map(|name| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 });
        let postures: Vec<[f64; 2]> = (0..101).map(|i| [f64::from(i) / 50.0 - 1.0, 0.0]).collect();
        let mut feedback = Feedback::new(&PenaltyConfig { form: PenaltyForm::Literal {}, ..PenaltyConfig::default() });
        assert_eq!(feedback.penalty(&[0.5, 0.25]), 0.0);
        feedback.synergy = Some(Arc::new(Synergy::fit(&joints, &postures[..100], 1).unwrap()));
        assert_eq!(feedback.penalty(&[0.5, 0.25]), 0.0);
        feedback.synergy = Some(Arc::new(Synergy::fit(&joints, &postures, 1).unwrap()));
        assert!((feedback.penalty(&[0.5, 0.25]) - 0.25).abs() < 1e-6);
        feedback.lambda = 2.0;
        assert!((feedback.penalty(&[0.5, 0.25]) - 0.5).abs() < 1e-6);
        feedback.lambda = 0.0;
        assert_eq!(feedback.penalty(&[0.5, 0.25]), 0.0);
    }
}
