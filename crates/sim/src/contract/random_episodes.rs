//! Random episodes: what the hand reaches, and what the observation shows of it.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_mujoco::Data;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Finding, SEED};
use crate::task::tells_objects_apart;
use crate::{GraspEnv, GraspTask, Object, SimError, fingertip_positions};

/// Number of episodes with each object.
const ROUNDS: usize = 3;
/// Least number of episodes in all before the hand is faulted. Fewer do not show how far it reaches.
const BEFORE_A_FAULT: usize = 20;
/// Number of control steps that a random command is held, so that the hand has time to move.
const HOLD_STEPS: usize = 8;
/// An entry of the observation that varies by less than this, in its own unit, is constant.
const LEAST_VARIATION: f32 = 1e-6;

/// Results of random episodes with held commands.
pub(super) struct RandomEpisodes {
    episodes: usize,
    steps: usize,
    lowest: Vec<f32>,
    highest: Vec<f32>,
    /// Name of the first entry that was not finite.
    not_finite: Option<String>,
    /// Lowest height in m of a fingertip, and its name.
    lowest_tip: Option<(f64, String)>,
    /// Episodes in which the hand touched the object.
    touched: usize,
}

/// Runs equally many random episodes with each object. With few objects, there are more episodes while they show a fault.
pub(super) fn run(hand: &Hand, task: &Arc<GraspTask>) -> Result<RandomEpisodes, SimError> {
    let n = task.observation_len();
    let mut found = RandomEpisodes {
        episodes: 0,
        steps: 0,
        lowest: vec![f32::INFINITY; n],
        highest: vec![f32::NEG_INFINITY; n],
        not_finite: None,
        lowest_tip: None,
        touched: 0,
    };
    let mut env = GraspEnv::new(task)?;
    let mut random = ChaCha8Rng::seed_from_u64(SEED + 1);
    let mut round = 0;
    while round < ROUNDS || (found.episodes < BEFORE_A_FAULT && found.shows_a_fault(task)) {
        for scene in 0..task.scenes.len() {
            found.add_episode(hand, &mut env, scene, &mut random)?;
        }
        round += 1;
    }
    Ok(found)
}

impl RandomEpisodes {
    fn shows_a_fault(&self, task: &GraspTask) -> bool {
        self.varied(task).is_err() || self.reach(task).is_err()
    }

    fn add_episode(
        &mut self,
        hand: &Hand,
        env: &mut GraspEnv,
        scene: usize,
        random: &mut ChaCha8Rng,
    ) -> Result<(), SimError> {
        env.reset(scene, random)?;
        self.episodes += 1;
        let mut action = vec![0.0; env.task().action_len()];
        let mut observation = vec![0.0; self.lowest.len()];
        let mut touched = false;
        for step in 0..env.task().config.steps {
            if step % HOLD_STEPS == 0 {
                action.iter_mut().for_each(|a| *a = random.random_range(-1.0..=1.0));
            }
            touched |= env.step(&action)?.touches_hand;
            env.observe(&mut observation);
            self.steps += 1;
            for (i, &value) in observation.iter().enumerate() {
                self.lowest[i] = self.lowest[i].min(value);
                self.highest[i] = self.highest[i].max(value);
                if !value.is_finite() && self.not_finite.is_none() {
                    self.not_finite = Some(env.task().observation_layout()[i].name.clone());
                }
            }
            self.see_tips(hand, env.simulation())?;
        }
        self.touched += usize::from(touched);
        Ok(())
    }

    fn see_tips(&mut self, hand: &Hand, data: &Data) -> Result<(), SimError> {
        for (tip, at) in hand.fingertips.iter().zip(fingertip_positions(hand, data)?) {
            if self.lowest_tip.as_ref().is_none_or(|(lowest, _)| at.z < *lowest) {
                self.lowest_tip = Some((at.z, tip.name.clone()));
            }
        }
        Ok(())
    }

    pub(super) fn finite(&self) -> Finding {
        match &self.not_finite {
            Some(name) => Err(format!("{name} is not finite in at least one of {} random episodes", self.episodes)),
            None => Ok(format!("{} numbers at each of {} steps", self.lowest.len(), self.steps)),
        }
    }

    pub(super) fn varied(&self, task: &GraspTask) -> Finding {
        let constant: Vec<String> = task
            .observation_layout()
            .into_iter()
            .zip(self.lowest.iter().zip(&self.highest))
            .filter(|(_, (low, high))| *high - *low < LEAST_VARIATION)
            .map(|(entry, _)| entry.name)
            // With one object, these are the same in every episode.
            .filter(|name| task.scenes.len() > 1 || !tells_objects_apart(name))
            .collect();
        if constant.is_empty() {
            Ok(format!("no constant entry in {} random episodes", self.episodes))
        } else {
            Err(format!(
                "constant in {} random episodes: {}; leave joints that cannot move out of posture_joints",
                self.episodes,
                constant.join(", ")
            ))
        }
    }

    pub(super) fn reach(&self, task: &GraspTask) -> Finding {
        let top = |object: &Object| 2.0 * object.shape.depth_below_centre(&nalgebra::UnitQuaternion::identity());
        let shortest = task.scenes.iter().map(|scene| top(&scene.object)).fold(f64::INFINITY, f64::min);
        let Some((height, tip)) = &self.lowest_tip else {
            return Err("the hand names no fingertip: list its fingertips in hand.toml".to_owned());
        };
        let advice = "lower mount.position or slide.range, or move the mount above the object";
        if *height > shortest {
            return Err(format!(
                "the lowest fingertip ({tip}) comes down to {height:.3} m, but the shortest object is {shortest:.3} m \
                 tall: {advice}"
            ));
        }
        if self.touched == 0 {
            return Err(format!("no object was touched in {} random episodes: {advice}", self.episodes));
        }
        Ok(format!(
            "fingertip {tip} comes down to {height:.3} m; {} of {} random episodes touch the object",
            self.touched, self.episodes
        ))
    }
}
