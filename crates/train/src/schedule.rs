//! Schedules of training: learning rates, exploration noise, and which episodes are scripted grasps.

use eigenhand_rl::DdpgConfig;

use crate::config::TrainingConfig;

impl TrainingConfig {
    /// (episode, mean number of steps that held an object in the last episodes) => whether the episode is a scripted grasp
    ///
    /// After warm-up, every other episode is a scripted grasp while objects are seldom held.
    pub fn attempts(&self, episode: u64, held_steps: f64) -> bool {
        episode >= self.warmup_episodes && self.has_attempts(held_steps) && episode % 2 == 1
    }

    /// (mean number of steps that held an object in the last episodes) => whether some episodes are scripted grasps
    pub fn has_attempts(&self, held_steps: f64) -> bool {
        held_steps < self.least_held_steps
    }

    /// (share of training that is done, settings of the learner) => the learning rates of actor and critic
    pub fn learning_rates(&self, done: f64, learner: &DdpgConfig) -> [f32; 2] {
        let factor = self.learning_rate_factor(done) as f32;
        [learner.actor_lr, learner.critic_lr].map(|rate| factor * rate)
    }

    /// (share of training that is done) => the factor on the learning rates
    pub fn learning_rate_factor(&self, done: f64) -> f64 {
        fall(done, [self.decay_start, 1.0], self.final_learning_rate)
    }

    /// (share of training that is done) => the factor on the exploration noise
    pub fn noise_factor(&self, done: f64) -> f64 {
        fall(done, self.noise_decay, self.final_noise)
    }
}

/// (episode, whether every other one is a scripted grasp, number of turns) => the episode's turn
///
/// All turns come round among the episodes that are no scripted grasps.
pub(crate) fn turn(episode: u64, has_attempts: bool, turns: usize) -> usize {
    (if has_attempts { episode / 2 } else { episode }) as usize % turns
}

/// Falls linearly from 1 to `last` between two shares of training.
fn fall(done: f64, [from, to]: [f64; 2], last: f64) -> f64 {
    if done >= to { last } else { 1.0 - (1.0 - last) * ((done - from) / (to - from)).max(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Layers, Preset};

    fn training(preset: Preset) -> TrainingConfig {
        Layers::new(preset).and_then(|layers| layers.resolve()).expect("compiled in").training
    }

    #[test]
    fn every_second_episode_after_warmup_is_an_attempt_while_little_is_held() {
        let training = TrainingConfig { warmup_episodes: 10, least_held_steps: 5.0, ..training(Preset::Default) };
        assert!((0..10).all(|episode| !training.attempts(episode, 0.0)));
        assert!((10..20).all(|episode| !training.attempts(episode, 5.0)));
        assert_eq!((10..20).filter(|&episode| training.attempts(episode, 4.0)).count(), 5);
        assert_eq!(self::training(Preset::Paper).least_held_steps, 0.0);
    }

    #[test]
    fn every_turn_comes_round_beside_scripted_grasps_too() {
        let training = TrainingConfig { warmup_episodes: 0, least_held_steps: 5.0, ..training(Preset::Default) };
        for held_steps in [0.0, 9.0] {
            let acting = (0..16).filter(|&episode| !training.attempts(episode, held_steps));
            let mut turns: Vec<usize> = acting.map(|e| turn(e, training.has_attempts(held_steps), 8)).collect();
            turns.sort_unstable();
            turns.dedup();
            assert_eq!(turns, (0..8).collect::<Vec<_>>(), "{held_steps} steps held");
        }
    }

    #[test]
    fn rates_and_noise_fall_between_two_shares_of_training() {
        for (done, expected) in [(0.0, 1.0), (0.6, 1.0), (0.75, 0.6), (0.9, 0.2), (1.0, 0.2)] {
            assert!((fall(done, [0.6, 0.9], 0.2) - expected).abs() < 1e-12, "{done}");
        }
        assert_eq!([0.0, 0.999, 1.0].map(|done| fall(done, [1.0, 1.0], 0.2)), [1.0, 1.0, 0.2]);
        let training = self::training(Preset::Default);
        assert_eq!(training.noise_factor(1.0), training.final_noise);
        assert_eq!(training.learning_rate_factor(training.decay_start), 1.0);
    }
}
