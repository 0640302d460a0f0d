//! Scripted grasps, which find the best place of a hand above the object.
//!
//! In training, a hand moves only up and down, so its place limits the grasps that it can learn. Nothing is learned
//! here: the hand comes down, closes, and rises.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread;

use eigenhand_sim::{GraspEnv, GraspTask, SimError};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Distance in m between two places that are tried, for objects of scale 1.
const STEP: f64 = 0.02;
/// First and last place that is tried along the fingers (x) and across them (y), in steps from the hand's present
/// place.
const ALONG: [i32; 2] = [-6, 2];
const ACROSS: [i32; 2] = [-2, 2];
/// Number of grasps of each object at each place.
const TRIALS: u64 = 2;
/// Durations in s of the phases: come down, close, hold closed, rise.
const PHASES: [f64; 4] = [0.7, 0.6, 0.3, 1.4];
/// An object counts as lifted when it is higher than this above its start, in m.
const LIFTED: f64 = 0.08;
/// First seed for an object's random place and orientation. Every place of the hand is tried with the same seeds.
const SEED: u64 = 40;

/// The place at which the hand lifts most objects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Distance in m by which the hand must be moved along x and y.
    pub shift: [f64; 2],
    /// Number of grasps at this place that lifted the object.
    pub lifted: u32,
    /// Number of grasps at this place.
    pub tried: u32,
}

/// Tries grasps along the fingers, then across them at the best place, and returns the best place of all.
///
/// The grasps at neighbouring places count too, because objects do not lie exactly where the hand expects them.
/// `closing` is 1 for an actuator that closes the hand at the upper end of its range, and -1 for one that closes it at
/// the lower end. `scale` is the factor on the objects' lengths.
///
/// # Errors
/// As [`GraspEnv::new`].
pub fn best_place(task: &Arc<GraspTask>, closing: &BTreeMap<String, f64>, scale: f64) -> Result<Place, SimError> {
    let script = Script::new(task, closing);
    let step = STEP * scale;
    let mut place = [0, 0];
    for (axis, [from, to]) in [ALONG, ACROSS].into_iter().enumerate() {
        let places: Vec<[i32; 2]> = (from - 1..=to + 1)
            .map(|i| {
                let mut there = place;
                there[axis] = i;
                there
            })
            .collect();
        let lifted = script.lifted(&places, step)?;
        let with_neighbours = |i: usize| i64::from(lifted[i - 1] + 2 * lifted[i] + lifted[i + 1]);
        // One more grasp must not outweigh one more step.
        let merit = |i: usize| with_neighbours(i) - i64::from(places[i][axis].abs());
        let best = (1..places.len() - 1).max_by_key(|&i| (merit(i), -places[i][axis].abs()));
        place = best.map_or(place, |i| places[i]);
    }
    let tried = (task.scenes.len() * TRIALS as usize) as u32;
    let lifted = script.lifted(&[place], step)?[0];
    // The trials moved the objects; the hand must be moved the opposite way.
    Ok(Place { shift: place.map(|i| -f64::from(i) * step), lifted, tried })
}

/// The actions of a scripted grasp.
struct Script<'a> {
    task: &'a Arc<GraspTask>,
    open: Vec<f32>,
    closed: Vec<f32>,
    slide: usize,
}

impl<'a> Script<'a> {
    fn new(task: &'a Arc<GraspTask>, closing: &BTreeMap<String, f64>) -> Self {
        let open = task.start_action();
        let closed =
            task.actuators.iter().zip(&open).map(|(name, &o)| closing.get(name).map_or(o, |&c| c as f32)).collect();
        let slide = task.slide_action();
        Script { task, open, closed, slide }
    }

    /// Returns for each place of the objects (in steps) how many were lifted.
    fn lifted(&self, places: &[[i32; 2]], step: f64) -> Result<Vec<u32>, SimError> {
        let n_threads = thread::available_parallelism().map_or(1, std::num::NonZero::get).min(places.len());
        let mut lifted = vec![0_u32; places.len()];
        let share = places.len().div_ceil(n_threads.max(1));
        thread::scope(|scope| {
            let parts = places.chunks(share).zip(lifted.chunks_mut(share));
            let threads: Vec<_> = parts
                .map(|(places, lifted)| {
                    scope.spawn(move || {
                        let mut env = GraspEnv::new(self.task)?;
                        env.start_open();
                        for (place, lifted) in places.iter().zip(lifted) {
                            let place = place.map(|i| f64::from(i) * step);
                            for scene in 0..self.task.scenes.len() {
                                *lifted +=
                                    (0..TRIALS).map(|t| u32::from(self.lifts(&mut env, scene, place, t))).sum::<u32>();
                            }
                        }
                        Ok::<(), SimError>(())
                    })
                })
                .collect();
            threads
                .into_iter()
                .try_for_each(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        })?;
        Ok(lifted)
    }

    /// Tells whether one grasp lifts the object. A grasp whose simulation diverges does not.
    fn lifts(&self, env: &mut GraspEnv, scene: usize, place: [f64; 2], trial: u64) -> bool {
        let mut random = ChaCha8Rng::seed_from_u64(SEED + trial);
        let mut grasp = || -> Result<bool, SimError> {
            env.reset(scene, &mut random)?;
            env.shift_object(place);
            let start = env.achieved_goal()[2];
            let period = self.task.physics.control_period();
            let mut action = self.open.clone();
            for (phase, seconds) in PHASES.into_iter().enumerate() {
                let steps = (seconds / period).round() as usize;
                for step in 1..=steps {
                    if phase == 1 {
                        let share = step as f32 / steps as f32;
                        for ((action, open), closed) in action.iter_mut().zip(&self.open).zip(&self.closed) {
                            *action = open + share * (closed - open);
                        }
                    }
                    action[self.slide] = if phase == 3 { 1.0 } else { -1.0 };
                    env.step(&action)?;
                }
            }
            let facts = env.facts();
            let rise = f64::from(env.achieved_goal()[2] - start);
            Ok(facts.touches_hand && !facts.touches_plane && rise > LIFTED)
        };
        grasp().unwrap_or(false)
    }
}
