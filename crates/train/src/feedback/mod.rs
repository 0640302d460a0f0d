//! The feedback of the postures' synergy into learning: a penalty on the reward.

use eigenhand_synergy::Synergy;
use serde::{Deserialize, Serialize};

mod reward;

pub use reward::GraspReward;

/// The penalty on the reward of a success with a posture outside the synergy space.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Penalty {
    /// No penalty on the reward.
    None,
    /// `lambda e`, without a bound, where `e` is the posture's distance from the synergy space.
    ///
    /// # Source
    /// Paper, section 2.2.
    Literal,
}

/// The current synergy, and how it feeds back.
#[derive(Debug, Clone)]
pub struct Feedback {
    /// The newest analysis; none before the first.
    synergy: Option<Synergy>,
    lambda: f64,
    penalty: Penalty,
    start_after: usize,
}

impl Feedback {
    /// Returns the feedback before the first analysis; it does nothing yet.
    ///
    /// `lambda` scales the penalty. The feedback starts when an analysis covers more than `start_after` postures.
    pub fn new(lambda: f64, penalty: Penalty, start_after: usize) -> Self {
        Feedback { synergy: None, lambda, penalty, start_after }
    }

    /// Replaces the analysis with the newest one.
    pub fn follow(&mut self, synergy: Option<Synergy>) {
        self.synergy = synergy;
    }

    /// Returns the newest analysis, even if the feedback has not started.
    pub fn synergy(&self) -> Option<&Synergy> {
        self.synergy.as_ref()
    }

    /// Returns the synergy if the feedback is active: the synergy covers enough postures, and `lambda` is not 0.
    fn active(&self) -> Option<&Synergy> {
        self.synergy().filter(|synergy| self.lambda != 0.0 && synergy.n_postures() > self.start_after)
    }

    /// (posture: one number for each joint) => the penalty to subtract from the reward of a success with this posture
    ///
    /// # Panics
    /// When the penalty is active and the posture has another length.
    ///
    /// # Source
    /// Paper, section 2.2, and section 4 for its start.
    pub fn penalty(&self, posture: &[f32]) -> f32 {
        match (self.penalty, self.active()) {
            (Penalty::Literal, Some(synergy)) => (self.lambda * f64::from(synergy.error_f32(posture))) as f32,
            (Penalty::None, _) | (_, None) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use eigenhand_synergy::{JointInfo, Unit};

    use super::*;

    fn synergy(n_postures: i32) -> Option<Synergy> {
        let joints =
            ["a", "b"].map(|name| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 });
        let postures: Vec<[f64; 2]> = (0..n_postures).map(|i| [f64::from(i) / 50.0 - 1.0, 0.0]).collect();
        Some(Synergy::fit(&joints, &postures, 1).expect("enough postures"))
    }

    #[test]
    fn the_penalty_starts_after_enough_postures() {
        let mut feedback = Feedback::new(1.0, Penalty::Literal, 100);
        assert_eq!(feedback.penalty(&[0.5, 0.25]), 0.0);
        feedback.follow(synergy(100));
        assert_eq!(feedback.penalty(&[0.5, 0.25]), 0.0);
        feedback.follow(synergy(101));
        assert!((feedback.penalty(&[0.5, 0.25]) - 0.25).abs() < 1e-6);
    }

    #[test]
    fn lambda_scales_the_penalty_and_the_form_turns_it_off() {
        for (lambda, penalty, expected) in
            [(2.0, Penalty::Literal, 0.5), (0.0, Penalty::Literal, 0.0), (2.0, Penalty::None, 0.0)]
        {
            let mut feedback = Feedback::new(lambda, penalty, 100);
            feedback.follow(synergy(101));
            assert!((feedback.penalty(&[0.5, 0.25]) - expected).abs() < 1e-6, "{lambda} {penalty:?}");
        }
    }
}
