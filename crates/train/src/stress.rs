//! What a run's grasps endure: the same episodes, each time with one thing changed.

use std::collections::VecDeque;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use eigenhand_files::cannot;
use eigenhand_mujoco::MuJoCo;
use eigenhand_rl::rng;
use eigenhand_sim::{Factors, GraspEnv, GraspTask, Setting};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::assessment::wilson_interval;
use crate::error::TrainError;
use crate::evaluation::{EvaluationStream, Tally, evaluation_job};
use crate::finished::FinishedRun;
use crate::json_file;
use crate::rollout::{EpisodeJob, Workers};

const FRICTIONS: [f64; 3] = [1.0, 0.7, 0.5];
const MASSES: [f64; 2] = [2.0, 5.0];
const SIZES: [f64; 2] = [0.8, 1.2];
/// Forces in N.
const PUSHES: [f64; 2] = [5.0, 8.0];
/// Duration of a push in s.
const PUSH_TIME: f64 = 0.2;
/// Standard deviations in cm and degrees.
const NOISES: [(f64, f64); 2] = [(1.0, 5.0), (2.0, 10.0)];
/// Control steps.
const DELAYS: [usize; 2] = [1, 2];
const STIFFNESSES: [f64; 2] = [0.7, 1.3];

/// Name of the file in a run directory.
const STRESS: &str = "stress.json";

/// Success of a policy in the same episodes, with one thing changed in each row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stress {
    /// Episodes of each row.
    pub episodes: u64,
    /// Seed of the episodes.
    pub seed: u64,
    /// The rows; nothing is changed in the first.
    pub rows: Vec<StressRow>,
}

/// Success with one thing changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StressRow {
    /// What is changed.
    pub group: String,
    /// To what, with its unit; empty if nothing is.
    pub change: String,
    /// Share of the episodes that succeeded.
    pub success_rate: f64,
    /// 95 % interval of that share.
    pub interval: [f64; 2],
}

impl Stress {
    /// Reads what was measured of the run in a directory; none if nothing was.
    ///
    /// # Errors
    /// [`TrainError::File`], or [`TrainError::Damaged`] for a file that is no such table.
    pub fn read(run: &Path) -> Result<Option<Stress>, TrainError> {
        json_file::read(&run.join(STRESS), &format!("write it again with: eval {} --stress", run.display()))
    }

    /// Writes the table into the directory of its run, where a report finds it.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn write(&self, run: &Path) -> Result<(), TrainError> {
        json_file::write(&run.join(STRESS), self)
    }

    /// Removes the table, because the run gets another policy.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub(crate) fn remove(run: &Path) -> Result<(), TrainError> {
        let path = run.join(STRESS);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(cannot("remove", &path)(error).into()),
            _ => Ok(()),
        }
    }
}

/// What disturbs an episode. Its random numbers come from streams of their own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Disturbance {
    /// A force pushes the object in a random horizontal direction, in the middle of the second half of the episode.
    Push {
        /// In N.
        force: f64,
        /// In whole control steps.
        steps: usize,
    },
    /// The policy observes another pose of the object than the true one, drawn anew at every step.
    Noise {
        /// Standard deviation of each coordinate of the position, in m.
        position: f64,
        /// Standard deviation of the angle about a random axis, in rad.
        angle: f64,
    },
    /// Actions are executed some control steps late. Until the first arrives, the hand keeps its start.
    Latency {
        /// In control steps.
        steps: usize,
    },
}

/// A disturbance along one episode.
pub(crate) enum Disturbing {
    Nothing,
    Push { force: [f64; 3], during: Range<usize> },
    Noise { position: f64, angle: f64, random: Box<ChaCha8Rng> },
    Latency { waiting: VecDeque<Vec<f32>> },
}

impl Disturbing {
    /// Begins an episode after the reset of its environment.
    pub fn begin(job: &EpisodeJob, env: &GraspEnv) -> Disturbing {
        let task = env.task();
        let stream = |name: &str| rng::stream(job.seed, &format!("{}/{name}", job.stream), job.index);
        match job.disturbance {
            None => Disturbing::Nothing,
            Some(Disturbance::Push { force, steps }) => {
                let direction = stream("push").random_range(0.0..std::f64::consts::TAU);
                let first = (3 * task.config.steps / 4).saturating_sub(steps / 2);
                let force = [force * direction.cos(), force * direction.sin(), 0.0];
                Disturbing::Push { force, during: first..first + steps }
            }
            Some(Disturbance::Noise { position, angle }) => {
                Disturbing::Noise { position, angle, random: Box::new(stream("noise")) }
            }
            Some(Disturbance::Latency { steps }) => {
                Disturbing::Latency { waiting: vec![task.action_of(env.simulation().ctrl()); steps].into() }
            }
        }
    }

    /// Writes the observation of the policy.
    pub fn observe(&mut self, env: &GraspEnv, observation: &mut [f32]) {
        let Disturbing::Noise { position, angle, random } = self else { return env.observe(observation) };
        let shift = normals(random).map(|number| *position * number);
        let axis = normals(random);
        let length = axis.iter().map(|a| a * a).sum::<f64>().sqrt();
        let by: f64 = StandardNormal.sample(random);
        env.observe_displaced(shift, axis.map(|a| *angle * by * a / length), observation);
    }

    /// Turns the action of a step into the one that is executed, and pushes the object.
    pub fn act(&mut self, env: &mut GraspEnv, step: usize, action: &mut [f32]) {
        match self {
            Disturbing::Push { force, during } => {
                env.push_object(if during.contains(&step) { *force } else { [0.0; 3] });
            }
            Disturbing::Latency { waiting } => {
                waiting.push_back(action.to_vec());
                if let Some(arrived) = waiting.pop_front() {
                    action.copy_from_slice(&arrived);
                }
            }
            Disturbing::Nothing | Disturbing::Noise { .. } => {}
        }
    }
}

fn normals(random: &mut impl Rng) -> [f64; 3] {
    std::array::from_fn(|_| StandardNormal.sample(random))
}

/// One row before it is measured.
struct Case {
    group: &'static str,
    change: String,
    setting: Setting,
    factors: Factors,
    disturbance: Option<Disturbance>,
}

/// Returns the rows for a setting; without those that would change nothing in it.
fn cases(own: &Setting) -> Vec<Case> {
    let unchanged =
        |group, change| Case { group, change, setting: own.clone(), factors: Factors::NONE, disturbance: None };
    let mut cases = vec![unchanged("nothing", String::new())];
    for friction in FRICTIONS.into_iter().filter(|&friction| own.physics.friction != [friction; 2]) {
        let mut case = unchanged("friction", format!("{friction:?}"));
        case.setting.physics.friction = [friction; 2];
        cases.push(case);
    }
    for mass in MASSES {
        let factors = Factors { mass, ..Factors::NONE };
        cases.push(Case { factors, ..unchanged("mass", format!("x {mass}")) });
    }
    for size in SIZES {
        let mut case = unchanged("size", format!("x {size}"));
        case.setting.task.object_scale = own.task.object_scale.map(|scale| scale * size);
        cases.push(case);
    }
    let period = own.physics.control_period();
    for force in PUSHES {
        let steps = (PUSH_TIME / period).round().max(1.0) as usize;
        let change = format!("{force} N for {:.2} s", steps as f64 * period);
        cases.push(Case { disturbance: Some(Disturbance::Push { force, steps }), ..unchanged("push", change) });
    }
    for (centimetres, degrees) in NOISES {
        let noise = Disturbance::Noise { position: centimetres / 100.0, angle: degrees.to_radians() };
        let change = format!("{centimetres} cm, {degrees} degrees");
        cases.push(Case { disturbance: Some(noise), ..unchanged("noise", change) });
    }
    for steps in DELAYS {
        let plural = if steps == 1 { "" } else { "s" };
        let change = format!("{steps} step{plural}, {:.0} ms", 1000.0 * steps as f64 * period);
        cases.push(Case { disturbance: Some(Disturbance::Latency { steps }), ..unchanged("latency", change) });
    }
    for stiffness in STIFFNESSES {
        let factors = Factors { stiffness, ..Factors::NONE };
        cases.push(Case { factors, ..unchanged("stiffness", format!("x {stiffness}")) });
    }
    cases
}

impl FinishedRun {
    /// Measures the success of the policy in the same episodes with one thing changed, for each thing.
    ///
    /// # Errors
    /// [`TrainError::Sim`], or [`TrainError::WorkerLost`].
    pub fn stress(
        &self,
        episodes: u64,
        seed: u64,
        workers: impl Into<Workers>,
        mut each: impl FnMut(&StressRow),
    ) -> Result<Stress, TrainError> {
        let (own, workers) = (self.config.setting(), workers.into());
        let mut rows = Vec::new();
        for case in cases(&own) {
            let task = self.task_in(&own, &case)?;
            let mut pool = workers.start(&task)?;
            pool.submit((0..episodes).map(|index| EpisodeJob {
                disturbance: case.disturbance,
                ..evaluation_job(&task, &self.policy, seed, EvaluationStream::Separate, index)
            }))?;
            let Tally { episodes: counted, successes } = Tally::of(pool.collect()?.iter());
            let row = StressRow {
                group: case.group.to_owned(),
                change: case.change,
                success_rate: Tally { episodes: counted, successes }.rate(),
                interval: wilson_interval(successes, counted),
            };
            each(&row);
            rows.push(row);
        }
        Ok(Stress { episodes, seed, rows })
    }

    fn task_in(&self, own: &Setting, case: &Case) -> Result<Arc<GraspTask>, TrainError> {
        if case.setting == *own && case.factors == Factors::NONE {
            return Ok(Arc::clone(&self.task));
        }
        let mut task = GraspTask::new(&MuJoCo::load()?, &self.hand, &case.setting)?;
        task.take_ids_from(&self.task);
        task.factors = case.factors;
        Ok(Arc::new(task))
    }
}

#[cfg(test)]
mod tests {
    use eigenhand_hands::Hand;
    use eigenhand_rl::{ActorChoice, Ddpg, Dimensions};

    use super::*;
    use crate::config::{Layers, Preset, RunConfig};
    use crate::rollout::{Behaviour, Episode, episode_shape, run_episode};

    const STEPS: usize = 40;

    fn config() -> RunConfig {
        let mut layers = Layers::new(Preset::Quick).expect("valid");
        layers.set("hand", "parallel", "test").expect("a known key");
        layers.set("task.steps", STEPS as i64, "test").expect("a known key");
        layers.resolve().expect("valid")
    }

    fn task_with(factors: Factors) -> Arc<GraspTask> {
        let hand = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../plugins/parallel");
        let hand = Hand::load(&hand).unwrap_or_else(|error| panic!("{error}"));
        let library = MuJoCo::load().unwrap_or_else(|error| panic!("{error}"));
        let mut task = GraspTask::new(&library, &hand, &config().setting()).expect("a sound task");
        task.factors = factors;
        Arc::new(task)
    }

    /// Returns an episode whose actions are random and do not depend on the observation.
    fn episode(task: &Arc<GraspTask>, disturbance: Option<Disturbance>) -> Episode {
        let config = config();
        let mut random = rng::stream(1, "init", 0);
        let learner =
            Ddpg::new(config.learner.clone(), Dimensions::of(episode_shape(task)), &mut random).expect("valid");
        let policy = learner.policy(ActorChoice::Online);
        let behaviour = Behaviour::Warmup(config.exploration.into());
        let job =
            EpisodeJob { behaviour, disturbance, ..evaluation_job(task, &policy, 3, EvaluationStream::Separate, 0) };
        let mut env = GraspEnv::new(task).expect("memory");
        run_episode(&mut env, &mut policy.scratch(), &job).expect("an episode")
    }

    /// Returns the entries of the object at a step: pose, and shape if there is one.
    fn object(task: &GraspTask, episode: &Episode, step: usize) -> Vec<f64> {
        let n = task.observation_len();
        let names = task.observation_layout();
        let pose = |name: &str| name.starts_with("object:") && !name.contains(":v") && !name.contains(":w");
        let entries = names.iter().enumerate().filter(|(_, entry)| pose(&entry.name));
        entries.map(|(i, _)| f64::from(episode.data.observations[step * n + i])).collect()
    }

    #[test]
    fn actions_are_executed_exactly_so_many_steps_late() {
        let task = task_with(Factors::NONE);
        let n = task.action_len();
        // The same start as that of `episode`: a hand that is more or less closed.
        let mut env = GraspEnv::new(&task).expect("memory");
        let stream = format!("{}/env", EvaluationStream::Separate.name());
        env.reset(0, &mut rng::stream(3, &stream, 0)).expect("at rest");
        let start = task.action_of(env.simulation().ctrl());
        assert_ne!(start, task.start_action());
        for steps in [0, 1, 3] {
            let late = episode(&task, Some(Disturbance::Latency { steps }));
            let start = start.repeat(steps);
            let sent = late.commands.iter().take((STEPS - steps) * n).map(|a| a.clamp(-1.0, 1.0));
            let expected: Vec<f32> = start.into_iter().chain(sent).collect();
            assert_eq!(late.data.actions, expected, "{steps} steps");
        }
        let (none, zero) = (episode(&task, None), episode(&task, Some(Disturbance::Latency { steps: 0 })));
        assert_eq!(none.data.observations, zero.data.observations);
        let late = episode(&task, Some(Disturbance::Latency { steps: 2 }));
        assert_ne!(none.data.observations, late.data.observations, "the simulation executes the late actions");
    }

    #[test]
    fn noise_changes_what_is_observed_and_not_what_happens() {
        let task = task_with(Factors::NONE);
        let angle = 5f64.to_radians();
        let noisy = episode(&task, Some(Disturbance::Noise { position: 0.01, angle }));
        let quiet = episode(&task, None);
        assert_eq!(noisy.data.actions, quiet.data.actions);
        assert_eq!(noisy.data.achieved_goals, quiet.data.achieved_goals);
        assert_eq!(noisy.data.facts, quiet.data.facts);
        assert_eq!((noisy.success, noisy.final_distance), (quiet.success, quiet.final_distance));
        let (mut shift, mut turn) = (0.0, 0.0);
        for step in 0..=STEPS {
            let (seen, real) = (object(&task, &noisy, step), object(&task, &quiet, step));
            shift += (0..3).map(|i| (seen[i] - real[i]).powi(2)).sum::<f64>() / 3.0;
            let along: f64 = (3..7).map(|i| seen[i] * real[i]).sum();
            turn += (2.0 * along.abs().min(1.0).acos()).powi(2);
            if task.config.observe_shape {
                let shape = task.scenes[0].shape_along_axes(std::array::from_fn(|i| seen[3 + i]));
                let differs = seen[seen.len() - 6..].iter().zip(shape).any(|(a, b)| (a - b).abs() > 1e-6);
                assert!(!differs, "the observed shape is turned as the observed orientation");
            }
        }
        let root = |sum: f64| (sum / (STEPS + 1) as f64).sqrt();
        assert!((0.7..1.3).contains(&(root(shift) / 0.01)), "{} m", root(shift));
        assert!((0.7..1.3).contains(&(root(turn) / angle)), "{} rad", root(turn));
        let again = episode(&task, Some(Disturbance::Noise { position: 0.01, angle }));
        assert_eq!(noisy.data.observations, again.data.observations);
    }

    #[test]
    fn a_push_comes_in_the_middle_of_the_second_half() {
        let task = task_with(Factors::NONE);
        let (quiet, pushed) = (episode(&task, None), episode(&task, Some(Disturbance::Push { force: 5.0, steps: 4 })));
        let n = GraspTask::GOAL_LEN;
        let first =
            (0..=STEPS).find(|&t| quiet.data.achieved_goals[t * n..][..n] != pushed.data.achieved_goals[t * n..][..n]);
        // The force acts from step 28, whose end is the first that differs.
        assert_eq!(first, Some(29));
        assert_eq!(quiet.data.actions, pushed.data.actions);
    }

    #[test]
    fn a_heavier_object_stays_on_the_plane_where_a_light_one_rises() {
        let rise = |mass: f64| {
            let task = task_with(Factors { mass, ..Factors::NONE });
            let mut env = GraspEnv::new(&task).expect("memory");
            let scene = &task.scenes[0];
            let own = scene.model.body_mass(scene.model.geom_body(scene.object_geom()));
            env.reset(0, &mut rng::stream(1, "test", 0)).expect("at rest");
            let before = env.achieved_goal()[2];
            env.push_object([0.0, 0.0, 1.5 * own * 9.81]);
            (0..3).for_each(|_| _ = env.step(&task.start_action()).expect("a step"));
            f64::from(env.achieved_goal()[2] - before)
        };
        assert!(rise(1.0) > 0.01 && rise(2.0).abs() < 1e-3, "{} m, {} m", rise(1.0), rise(2.0));
    }

    #[test]
    fn stiffness_changes_the_fingers_and_not_the_slide() {
        let end = |stiffness: f64| episode(&task_with(Factors { stiffness, ..Factors::NONE }), None).posture;
        let (own, soft) = (end(1.0), end(0.7));
        let slide = task_with(Factors::NONE).posture_joints.iter().position(|joint| joint.name == "slide");
        assert_ne!(own, soft);
        let slide = slide.expect("a slide");
        assert!((own[slide] - soft[slide]).abs() < 0.01, "{} m, {} m", own[slide], soft[slide]);
    }

    #[test]
    fn each_row_changes_one_thing_and_the_first_nothing() {
        let mut own = config().setting();
        own.physics.friction = [0.7, 0.7];
        let cases = cases(&own);
        let changes = |case: &Case| {
            usize::from(case.setting != own)
                + usize::from(case.factors != Factors::NONE)
                + usize::from(case.disturbance.is_some())
        };
        assert_eq!(cases.iter().map(changes).collect::<Vec<_>>(), [vec![0], vec![1; cases.len() - 1]].concat());
        let frictions = cases.iter().filter(|case| case.group == "friction").map(|case| case.change.as_str());
        assert_eq!(frictions.collect::<Vec<_>>(), ["1.0", "0.5"], "without the run's own");
    }
}
