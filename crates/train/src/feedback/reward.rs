//! The reward that replay recomputes: success from the task, penalty from the current synergy.

use eigenhand_rl::RewardFn;
use eigenhand_sim::{RewardConfig, StepFacts};

use super::Feedback;

/// Reward of a transition; a pure function of its arguments and of the current synergy.
pub struct GraspReward {
    /// Settings of success.
    pub config: RewardConfig,
    /// Number of leading observation entries that are the posture.
    pub n_joints: usize,
    /// The current synergy and how it feeds back.
    pub feedback: Feedback,
}

impl RewardFn for GraspReward {
    fn reward(&self, achieved_goal: &[f32], desired_goal: &[f32], next_observation: &[f32], facts: &[f32]) -> f32 {
        let penalty = || self.feedback.penalty(&next_observation[..self.n_joints]);
        self.config.reward(achieved_goal, desired_goal, StepFacts::from_slice(facts), penalty)
    }
}
