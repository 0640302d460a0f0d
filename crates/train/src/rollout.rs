//! Simulation of episodes: of one, and of many on worker threads.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use crossbeam_channel::{Receiver, Sender, unbounded};
use eigenhand_mujoco::WarningCounts;
use eigenhand_rl::{ActionMap, EpisodeData, EpisodeShape, Exploration, ExplorationConfig, Policy, PolicyScratch, rng};
use eigenhand_sim::{GraspEnv, GraspTask, SimError, StepFacts};
use eigenhand_synergy::Source;
use rand::RngExt;

use crate::error::TrainError;
use crate::stress::{Disturbance, Disturbing};

/// How the actions of an episode are chosen.
#[derive(Clone)]
pub enum Behaviour {
    /// The policy alone.
    Greedy,
    /// The policy with noise; a share of the episodes has none.
    Explore(Arc<ExplorationConfig>),
    /// Random actions, each held for several steps.
    Warmup(Arc<ExplorationConfig>),
    /// A scripted grasp: the hand comes down, closes and rises.
    Attempt(Arc<ExplorationConfig>),
}

/// An episode to simulate. It is a pure function of this value and the task.
#[derive(Clone)]
pub struct EpisodeJob {
    /// Seed of the run.
    pub seed: u64,
    /// Name of the family of random streams.
    pub stream: &'static str,
    /// Number of the episode in that family.
    pub index: u64,
    /// Index of the scene; if absent, drawn at random.
    pub scene: Option<usize>,
    /// The policy.
    pub policy: Policy,
    /// How the actions are chosen.
    pub behaviour: Behaviour,
    /// Whether the policy has only the first of its numbers.
    pub fewer_numbers: bool,
    /// A further map from the policy's actions to those that are executed.
    pub confinement: Option<Confinement>,
    /// What disturbs the episode.
    pub disturbance: Option<Disturbance>,
}

impl EpisodeJob {
    /// Returns the random numbers that draw the start of the episode.
    pub(crate) fn start(&self) -> rand_chacha::ChaCha8Rng {
        rng::stream(self.seed, &format!("{}/env", self.stream), self.index)
    }
}

/// A map from actions to actions that are executed in their place.
#[derive(Clone, Debug)]
pub struct Confinement {
    /// The map.
    pub map: Arc<ActionMap>,
    /// First steps of an episode that it leaves alone.
    pub free_steps: usize,
}

/// A simulated episode.
#[derive(Clone, Debug)]
pub struct Episode {
    /// Number of the episode in its family.
    pub index: u64,
    /// Index of the scene.
    pub scene: usize,
    /// Whether the last steps all succeeded.
    pub success: bool,
    /// Whether the simulation diverged; then data, posture and distance are not usable.
    pub diverged: bool,
    /// The joint at which it did, if it is known.
    pub diverged_at: Option<String>,
    /// What chose the actions.
    pub source: Source,
    /// The data that replay stores.
    pub data: EpisodeData,
    /// Actions before they are clamped to [-1, 1], T x act_dim. Those of a confined policy can lie beyond.
    pub commands: Vec<f32>,
    /// Values of the posture's joints at the end, in rad and m.
    pub posture: Vec<f64>,
    /// Distance from object to goal at the end, in m.
    pub final_distance: f64,
    /// Steps at which the object touched the hand and not the plane.
    pub held_steps: u64,
    /// Deepest penetration between object and hand in the last steps, in m.
    pub penetration: f64,
    /// Deepest penetration between two geoms of the hand in the last steps, in m.
    pub self_penetration: f64,
    /// Counts of MuJoCo's warnings.
    pub warnings: WarningCounts,
}

/// Returns the sizes of a task's episodes.
pub fn episode_shape(task: &GraspTask) -> EpisodeShape {
    EpisodeShape {
        n_steps: task.config.steps,
        obs_dim: task.observation_len(),
        goal_dim: GraspTask::GOAL_LEN,
        act_dim: task.action_len(),
        fact_dim: StepFacts::LEN,
    }
}

/// Simulates one episode.
///
/// # Errors
/// [`TrainError::Sim`] for every failure except divergence, which the episode reports.
pub fn run_episode(env: &mut GraspEnv, scratch: &mut PolicyScratch, job: &EpisodeJob) -> Result<Episode, TrainError> {
    let task = Arc::clone(env.task());
    let shape = episode_shape(&task);
    let mut env_rng = job.start();
    let mut explore_rng = rng::stream(job.seed, &format!("{}/explore", job.stream), job.index);
    let scene = job.scene.unwrap_or_else(|| env_rng.random_range(0..task.scenes.len()));
    let n_outputs = job.policy.n_outputs();
    let (mut exploration, source) = match &job.behaviour {
        Behaviour::Greedy => (Exploration::none(), Source::Policy),
        Behaviour::Warmup(config) => (Exploration::warmup(config, n_outputs), Source::Script),
        Behaviour::Attempt(config) => (Exploration::attempt(config, &mut explore_rng), Source::Script),
        Behaviour::Explore(config) => {
            if explore_rng.random::<f32>() < config.noise_free_share {
                (Exploration::none(), if job.fewer_numbers { Source::Noise } else { Source::Policy })
            } else {
                (Exploration::noisy(config, n_outputs, &mut explore_rng), Source::Noise)
            }
        }
    };
    let mut episode = Episode {
        index: job.index,
        scene,
        success: false,
        diverged: false,
        diverged_at: None,
        source,
        data: EpisodeData::zeros(shape),
        commands: vec![0.0; shape.n_steps * shape.act_dim],
        posture: vec![0.0; task.posture_joints.len()],
        final_distance: f64::NAN,
        held_steps: 0,
        penetration: 0.0,
        self_penetration: 0.0,
        warnings: WarningCounts::default(),
    };
    let outcome = play(env, scratch, job, scene, &mut env_rng, &mut explore_rng, &mut exploration, &mut episode);
    episode.warnings = env.warnings();
    match outcome {
        Ok(()) => Ok(episode),
        Err(SimError::Diverged { joint, .. }) => {
            Ok(Episode { diverged: true, diverged_at: joint, success: false, ..episode })
        }
        Err(error) => Err(error.into()),
    }
}

#[allow(clippy::too_many_arguments)]
fn play(
    env: &mut GraspEnv,
    scratch: &mut PolicyScratch,
    job: &EpisodeJob,
    scene: usize,
    env_rng: &mut rand_chacha::ChaCha8Rng,
    explore_rng: &mut rand_chacha::ChaCha8Rng,
    exploration: &mut Exploration,
    episode: &mut Episode,
) -> Result<(), SimError> {
    let task = Arc::clone(env.task());
    let EpisodeShape { n_steps, obs_dim, goal_dim, act_dim, fact_dim } = episode.data.shape;
    let data = &mut episode.data;
    env.reset(scene, env_rng)?;
    let goal = env.desired_goal();
    data.desired_goal.copy_from_slice(&goal);
    let mut disturbing = Disturbing::begin(job, env);
    disturbing.observe(env, &mut data.observations[..obs_dim]);
    data.achieved_goals[..goal_dim].copy_from_slice(&env.achieved_goal());
    let mut succeeded_in_a_row = 0;
    for t in 0..n_steps {
        let command = &mut episode.commands[t * act_dim..(t + 1) * act_dim];
        let observation = &data.observations[t * obs_dim..(t + 1) * obs_dim];
        job.policy.act_through(observation, &goal, scratch, command, |output| exploration.apply(output, explore_rng));
        if let Some(Confinement { map, .. }) = job.confinement.as_ref().filter(|c| t >= c.free_steps) {
            let wanted = command.to_vec();
            map.apply(&wanted, command);
        }
        let action = &mut data.actions[t * act_dim..(t + 1) * act_dim];
        action.iter_mut().zip(&*command).for_each(|(a, c)| *a = c.clamp(-1.0, 1.0));
        disturbing.act(env, t, action);
        let facts = env.step(action)?;
        disturbing.observe(env, &mut data.observations[(t + 1) * obs_dim..(t + 2) * obs_dim]);
        let achieved = env.achieved_goal();
        data.achieved_goals[(t + 1) * goal_dim..(t + 2) * goal_dim].copy_from_slice(&achieved);
        data.facts[t * fact_dim..(t + 1) * fact_dim].copy_from_slice(&facts.to_array());
        episode.held_steps += u64::from(facts.touches_hand && !facts.touches_plane);
        succeeded_in_a_row = if task.reward.succeeds(&achieved, &goal, facts) { succeeded_in_a_row + 1 } else { 0 };
        if t + task.config.final_steps >= n_steps {
            episode.penetration = episode.penetration.max(facts.penetration);
            episode.self_penetration = episode.self_penetration.max(env.self_penetration());
        }
    }
    episode.success = succeeded_in_a_row >= task.config.final_steps;
    env.posture(&mut episode.posture);
    let squared: f64 = env.achieved_goal().iter().zip(goal).map(|(a, d)| f64::from(a - d).powi(2)).sum();
    episode.final_distance = squared.sqrt();
    Ok(())
}

/// What is called while episodes are collected: with the number of those that have ended, and of all.
pub type Counting = Arc<dyn Fn(usize, usize) + Send + Sync>;

/// Threads that simulate episodes, each in an environment of its own.
pub struct WorkerPool {
    jobs: Option<Sender<EpisodeJob>>,
    results: Receiver<Result<Episode, TrainError>>,
    threads: Vec<JoinHandle<()>>,
    pending: usize,
    halt: Arc<AtomicBool>,
    counting: Option<Counting>,
}

impl WorkerPool {
    /// Starts `count` threads.
    ///
    /// # Errors
    /// [`TrainError::Sim`] when an environment cannot be allocated, [`TrainError::Thread`] when a thread cannot start.
    pub fn new(task: &Arc<GraspTask>, count: usize) -> Result<WorkerPool, TrainError> {
        Self::halted_by(Arc::default(), task, count)
    }

    /// Starts `count` threads that leave out all episodes while `halt` is set.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn halted_by(halt: Arc<AtomicBool>, task: &Arc<GraspTask>, count: usize) -> Result<WorkerPool, TrainError> {
        let (jobs, inbox) = unbounded::<EpisodeJob>();
        let (outbox, results) = unbounded();
        let mut threads = Vec::with_capacity(count);
        for number in 0..count.max(1) {
            let mut env = GraspEnv::new(task)?;
            let (inbox, outbox, halt) = (inbox.clone(), outbox.clone(), Arc::clone(&halt));
            let body = move || {
                for job in inbox {
                    if halt.load(Ordering::Relaxed) {
                        if outbox.send(Err(TrainError::Stopped)).is_err() {
                            break;
                        }
                        continue;
                    }
                    // The policies of a run differ in size once they act in its synergy.
                    let mut scratch = job.policy.scratch();
                    // A panic is a defect. Without this report, `collect` would wait for ever.
                    let outcome = catch_unwind(AssertUnwindSafe(|| run_episode(&mut env, &mut scratch, &job)))
                        .unwrap_or(Err(TrainError::WorkerLost));
                    if outbox.send(outcome).is_err() {
                        break;
                    }
                }
            };
            let thread = std::thread::Builder::new()
                .name(format!("simulation-{number}"))
                .spawn(body)
                .map_err(|source| TrainError::Thread { source })?;
            threads.push(thread);
        }
        Ok(WorkerPool { jobs: Some(jobs), results, threads, pending: 0, halt, counting: None })
    }

    /// Returns the flag that makes the threads leave out their episodes; [`collect`](Self::collect) then fails.
    pub fn halt(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.halt)
    }

    /// Sets what is called while episodes are collected.
    pub fn count_with(&mut self, counting: Option<Counting>) {
        self.counting = counting;
    }

    /// Submits episodes to the threads.
    ///
    /// # Errors
    /// [`TrainError::WorkerLost`] when every thread has ended.
    pub fn submit(&mut self, jobs: impl IntoIterator<Item = EpisodeJob>) -> Result<(), TrainError> {
        for job in jobs {
            self.jobs.as_ref().and_then(|sender| sender.send(job).ok()).ok_or(TrainError::WorkerLost)?;
            self.pending += 1;
        }
        Ok(())
    }

    /// Waits for all submitted episodes, and returns them in the order of their numbers.
    ///
    /// # Errors
    /// The first error of a thread, [`TrainError::Stopped`] if episodes were left out, [`TrainError::WorkerLost`] when a thread
    /// has ended.
    pub fn collect(&mut self) -> Result<Vec<Episode>, TrainError> {
        let mut episodes = Vec::with_capacity(self.pending);
        let mut stopped = false;
        let all = self.pending;
        while self.pending > 0 {
            if let Some(counting) = &self.counting {
                counting(all - self.pending, all);
            }
            let episode = self.results.recv().map_err(|_| TrainError::WorkerLost)?;
            self.pending -= 1;
            match episode {
                // The others are waited for, so that the next collection has its own episodes.
                Err(TrainError::Stopped) => stopped = true,
                episode => episodes.push(episode?),
            }
        }
        if let Some(counting) = &self.counting {
            counting(all, all);
        }
        if stopped {
            return Err(TrainError::Stopped);
        }
        episodes.sort_by_key(|episode| episode.index);
        Ok(episodes)
    }
}

/// Threads for an evaluation.
#[derive(Clone, Default)]
pub struct Workers {
    /// Number of threads.
    pub count: usize,
    /// What is called while their episodes are collected.
    pub counting: Option<Counting>,
}

impl From<usize> for Workers {
    fn from(count: usize) -> Workers {
        Workers { count, counting: None }
    }
}

impl Workers {
    /// Starts the threads.
    ///
    /// # Errors
    /// As [`WorkerPool::new`].
    pub(crate) fn start(&self, task: &Arc<GraspTask>) -> Result<WorkerPool, TrainError> {
        let mut pool = WorkerPool::new(task, self.count)?;
        pool.count_with(self.counting.clone());
        Ok(pool)
    }
}

impl Drop for WorkerPool {
    fn drop(&mut self) {
        self.jobs = None;
        for thread in self.threads.drain(..) {
            // `collect` has reported a thread that panicked, and the thread has no more results.
            let _ = thread.join();
        }
    }
}
