//! Success and reward as pure functions, so that hindsight relabelling can recompute them.

use serde::{Deserialize, Serialize};

use crate::SimError;

/// The contacts at the end of a step: with the positions, they determine the reward.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepFacts {
    /// Whether the object touches the hand.
    pub touches_hand: bool,
    /// Whether the object touches the plane.
    pub touches_plane: bool,
    /// Deepest penetration between object and hand, in m.
    pub penetration: f64,
}

impl StepFacts {
    /// Number of values in the array form.
    pub const LEN: usize = 3;

    /// Returns the facts as replay stores them.
    pub fn to_array(self) -> [f32; Self::LEN] {
        [f32::from(u8::from(self.touches_hand)), f32::from(u8::from(self.touches_plane)), self.penetration as f32]
    }

    /// Reads the array form; entries that are missing count as no contact.
    pub fn from_slice(values: &[f32]) -> StepFacts {
        let at = |i: usize| values.get(i).copied().unwrap_or(0.0);
        StepFacts { touches_hand: at(0) > 0.5, touches_plane: at(1) > 0.5, penetration: f64::from(at(2)) }
    }
}

/// Settings of success.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RewardConfig {
    /// Largest distance in m between object and goal at a success (OpenAI baselines' and the authors' code).
    pub success_distance: f64,
}

/// Reward of a step that succeeds, before the penalty (the authors' code).
pub const SUCCESS: f32 = 0.0;
/// Reward of a step that fails (the authors' code). The learner's clip of the targets assumes rewards between the two.
pub const FAILURE: f32 = -1.0;

impl RewardConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`SimError::Setting`] names the first key that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        if !(self.success_distance > 0.0 && self.success_distance.is_finite()) {
            return Err(SimError::Setting {
                name: "reward.success_distance",
                expected: "a positive number of metres",
                got: self.success_distance.to_string(),
            });
        }
        Ok(())
    }

    /// (achieved goal, desired goal, facts) => whether the step succeeds.
    ///
    /// The object's centre is near the goal, and the object is held: it touches the hand and not the plane.
    ///
    /// # Units
    /// m.
    pub fn succeeds(&self, achieved_goal: &[f32], desired_goal: &[f32], facts: StepFacts) -> bool {
        let squared: f64 = achieved_goal.iter().zip(desired_goal).map(|(a, d)| f64::from(a - d).powi(2)).sum();
        facts.touches_hand && !facts.touches_plane && squared < self.success_distance * self.success_distance
    }

    /// (achieved goal, desired goal, facts, penalty) => reward.
    ///
    /// # Source
    /// Paper, section 2.2: a failure earns [`FAILURE`], a success [`SUCCESS`] minus the penalty.
    pub fn reward(
        &self,
        achieved_goal: &[f32],
        desired_goal: &[f32],
        facts: StepFacts,
        penalty: impl FnOnce() -> f32,
    ) -> f32 {
        if self.succeeds(achieved_goal, desired_goal, facts) { SUCCESS - penalty() } else { FAILURE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REWARD: RewardConfig = RewardConfig { success_distance: 0.05 };
    const HELD: StepFacts = StepFacts { touches_hand: true, touches_plane: false, penetration: 0.0 };

    #[test]
    fn success_needs_nearness_and_a_hold_off_the_plane() {
        let (near, goal) = ([0.0, 0.0, 0.16], [0.0, 0.03, 0.19]);
        assert!(REWARD.succeeds(&near, &goal, HELD));
        assert!(!REWARD.succeeds(&[0.0, 0.0, 0.1], &goal, HELD));
        assert!(!REWARD.succeeds(&near, &goal, StepFacts { touches_hand: false, ..HELD }));
        assert!(!REWARD.succeeds(&near, &goal, StepFacts { touches_plane: true, ..HELD }));
    }

    #[test]
    fn only_a_success_pays_the_penalty() {
        let goal = [0.0, 0.0, 0.2];
        assert_eq!(REWARD.reward(&goal, &goal, HELD, || 0.25), -0.25);
        assert_eq!(REWARD.reward(&[0.0; 3], &goal, HELD, || 0.25), -1.0);
    }

    #[test]
    fn a_goal_relabelled_on_a_resting_object_earns_nothing() {
        let resting = StepFacts { touches_hand: false, touches_plane: true, penetration: 0.0 };
        let touched = StepFacts { touches_hand: true, ..resting };
        let place = [0.01, 0.0, 0.03];
        assert_eq!(REWARD.reward(&place, &place, resting, || 0.0), -1.0);
        assert_eq!(REWARD.reward(&place, &place, touched, || 0.0), -1.0);
    }

    #[test]
    fn facts_survive_their_array_form() {
        let facts = StepFacts { touches_hand: true, touches_plane: false, penetration: 0.5 };
        assert_eq!(StepFacts::from_slice(&facts.to_array()), facts);
    }
}
