//! One scripted grasp, and many of them on all cores.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use eigenhand_sim::{GraspEnv, GraspTask, SimError};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Durations in s of the phases: come down, close, hold closed, rise.
const PHASES: [f64; 4] = [0.7, 0.6, 0.3, 1.4];
/// An object counts as lifted when it is higher than this above its start, in m.
const LIFTED: f64 = 0.05;
/// Time in s after which a rising hand that has lost the object gives up.
const LOST: f64 = 0.4;
/// First seed for what is random of an object. Every place of the hand is tried with the same seeds.
const SEED: u64 = 40;

/// A grasp to try.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Job {
    /// Index of the object.
    pub(super) scene: usize,
    /// Steps by which the object is moved along x and y.
    pub(super) place: [i32; 2],
    /// Number of the object's random place, orientation and friction.
    pub(super) draw: u64,
}

/// What became of a grasp.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Grasp {
    pub(super) lifted: bool,
    pub(super) reached: bool,
    /// Whether the closed hand does not touch the object.
    pub(super) missed: bool,
    /// Distance in m by which the object was moved aside.
    pub(super) drag: f64,
    /// Height in m above rest to which the top of the slide would have lifted the object.
    pub(super) height: f64,
}

/// The actions of a scripted grasp.
struct Script<'a> {
    task: &'a Arc<GraspTask>,
    open: Vec<f32>,
    closed: Vec<f32>,
    slide: usize,
    /// Length in m of a step from place to place.
    step: f64,
}

/// A script, and the simulations that carry it out: one for each core.
pub(super) struct Scripts<'a> {
    script: Script<'a>,
    environments: Vec<GraspEnv>,
}

/// An object that a scripted grasp has lifted.
pub struct Lifted {
    /// Index of the object.
    pub scene: usize,
    /// The simulation at the end of the grasp.
    pub env: GraspEnv,
}

/// Carries out a scripted grasp of one object after another where they are, until one is lifted. None is lifted by a hand
/// that cannot grasp. `closing` is as in [`best_place`](super::best_place).
///
/// # Errors
/// As [`GraspEnv::new`].
pub fn lift(task: &Arc<GraspTask>, closing: &BTreeMap<String, f64>) -> Result<Option<Lifted>, SimError> {
    let script = Script::new(task, closing, 0.0);
    let mut env = GraspEnv::new(task)?;
    env.start_open();
    for scene in 0..task.scenes.len() {
        let job = Job { scene, place: [0, 0], draw: scene as u64 };
        // A grasp whose simulation diverges lifts nothing.
        if script.grasp(&mut env, &job).is_ok_and(|grasp| grasp.lifted) {
            return Ok(Some(Lifted { scene, env }));
        }
    }
    Ok(None)
}

impl<'a> Scripts<'a> {
    pub(super) fn new(task: &'a Arc<GraspTask>, closing: &BTreeMap<String, f64>, step: f64) -> Result<Self, SimError> {
        let n_threads = thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let environments = (0..n_threads)
            .map(|_| {
                let mut env = GraspEnv::new(task)?;
                env.start_open();
                Ok(env)
            })
            .collect::<Result<Vec<_>, SimError>>()?;
        Ok(Scripts { script: Script::new(task, closing, step), environments })
    }

    /// Carries out the grasps; `on_grasp` receives how many are done.
    pub(super) fn run(&mut self, jobs: &[Job], on_grasp: &(dyn Fn(usize) + Sync)) -> Vec<Grasp> {
        let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let grasps = Mutex::new(vec![Grasp::default(); jobs.len()]);
        let (script, next, done, results) = (&self.script, &next, &done, &grasps);
        thread::scope(|scope| {
            for env in &mut self.environments {
                scope.spawn(move || {
                    loop {
                        let i = next.fetch_add(1, Ordering::Relaxed);
                        let Some(job) = jobs.get(i) else { break };
                        // A grasp whose simulation diverges lifts nothing.
                        let grasp = script.grasp(env, job).unwrap_or_default();
                        results.lock().unwrap_or_else(PoisonError::into_inner)[i] = grasp;
                        on_grasp(done.fetch_add(1, Ordering::Relaxed) + 1);
                    }
                });
            }
        });
        grasps.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<'a> Script<'a> {
    fn new(task: &'a Arc<GraspTask>, closing: &BTreeMap<String, f64>, step: f64) -> Script<'a> {
        let open = task.start_action();
        let closed =
            task.actuators.iter().zip(&open).map(|(name, &o)| closing.get(name).map_or(o, |&c| c as f32)).collect();
        Script { task, open, closed, slide: task.slide_action(), step }
    }

    /// Comes down, closes, and raises the object to its goal.
    fn grasp(&self, env: &mut GraspEnv, job: &Job) -> Result<Grasp, SimError> {
        let mut random = ChaCha8Rng::seed_from_u64(SEED + job.draw);
        env.reset(job.scene, &mut random)?;
        env.shift_object(job.place.map(|i| f64::from(i) * self.step));
        let start = env.achieved_goal();
        let goal = [start[0], start[1], env.desired_goal()[2]];
        let period = self.task.physics.control_period();
        let steps_of = |seconds: f64| (seconds / period).round() as usize;
        let mut action = self.open.clone();
        let mut touched = false;
        for (phase, seconds) in PHASES[..3].iter().enumerate() {
            let steps = steps_of(*seconds);
            for step in 1..=steps {
                if phase == 1 {
                    let share = step as f32 / steps as f32;
                    for ((action, open), closed) in action.iter_mut().zip(&self.open).zip(&self.closed) {
                        *action = open + share * (closed - open);
                    }
                }
                action[self.slide] = -1.0;
                touched = env.step(&action)?.touches_hand || (phase == 2 && touched);
            }
        }
        let (low, high) = self.task.control_ranges[self.slide];
        let target = self.slide_position(env)? + f64::from(goal[2] - env.achieved_goal()[2]);
        action[self.slide] = (2.0 * (target - low) / (high - low) - 1.0).clamp(-1.0, 1.0) as f32;
        let mut held_at_goal = 0;
        for step in 1..=steps_of(PHASES[3]) {
            let facts = env.step(&action)?;
            // A slow hand closes while it rises.
            touched |= facts.touches_hand;
            if step >= steps_of(LOST) && facts.touches_plane && !facts.touches_hand {
                return Ok(Grasp { missed: !touched, ..Grasp::default() });
            }
            let success = self.task.reward.succeeds(&env.achieved_goal(), &goal, facts);
            held_at_goal = if success { held_at_goal + 1 } else { 0 };
        }
        let (facts, end) = (env.facts(), env.achieved_goal());
        let rise = f64::from(end[2] - start[2]);
        Ok(Grasp {
            lifted: facts.touches_hand && !facts.touches_plane && rise > LIFTED,
            reached: held_at_goal >= self.task.config.final_steps,
            missed: !touched,
            drag: f64::from((end[0] - start[0]).hypot(end[1] - start[1])),
            height: rise + high - self.slide_position(env)?,
        })
    }

    /// Returns the slide's position in m. Its joint has the name of its actuator.
    fn slide_position(&self, env: &GraspEnv) -> Result<f64, SimError> {
        let model = env.simulation().model();
        let joint = model.joint(&self.task.actuators[self.slide])?;
        Ok(env.simulation().qpos()[model.qpos_address(joint)])
    }
}
