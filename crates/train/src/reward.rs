//! The reward that replay recomputes: success from the task, penalty from the current synergy.

use eigenhand_rl::{EpisodeData, RewardFn};
use eigenhand_sim::{RewardConfig, StepFacts};
use eigenhand_synergy::Feedback;

/// Reward of a transition; a pure function of its arguments and of the current synergy.
pub struct GraspReward {
    /// Constants of success.
    pub config: RewardConfig,
    /// Number of leading observation entries that are the posture.
    pub n_joints: usize,
    /// The current synergy and the form of the penalty.
    pub feedback: Feedback,
}

impl RewardFn for GraspReward {
    fn reward(&self, achieved_goal: &[f32], desired_goal: &[f32], next_observation: &[f32], facts: &[f32]) -> f32 {
        let penalty = || f64::from(self.feedback.penalty(&next_observation[..self.n_joints]));
        self.config.reward(achieved_goal, desired_goal, StepFacts::from_slice(facts), penalty)
    }
}

impl GraspReward {
    /// Fills in what every step of an episode earned with its own goal.
    pub fn judge(&self, episode: &mut EpisodeData) {
        for t in 0..episode.shape.n_steps {
            episode.rewards[t] = self.reward(
                episode.achieved_goal(t + 1),
                &episode.desired_goal,
                episode.observation(t + 1),
                episode.facts_at(t),
            );
        }
    }
}
