//! Allocations in the inner loops of training.
//!
//! The caller passes the function that counts, because counting needs a special allocator: `benches/allocations.rs` has
//! one.

use eigenhand_hands::Hand;
use eigenhand_mujoco::MuJoCo;
use eigenhand_rl::{
    ActionMap, ActorChoice, Batch, Ddpg, Dimensions, ExplorationConfig, Numbers, RlError, rng, sample_batch,
};
use eigenhand_sim::{GraspEnv, GraspTask, RewardConfig};
use eigenhand_synergy::Synergy;
use eigenhand_train::config::RunConfig;
use eigenhand_train::feedback::{Feedback, GraspReward, Penalty};
use eigenhand_train::{Behaviour, EpisodeJob, episode_shape, run_episode, task_of};
use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::error::BenchError;
use crate::learner::Bench;
use crate::setting::BenchSetting;

/// Number of updates, and of samplings, to average over.
const UPDATES: u64 = 20;
/// Number of episodes to average over.
const EPISODES: u64 = 4;
/// Postures of the synergy in the reward.
const POSTURES: usize = 200;

/// Work whose allocations are counted.
pub type Work<'a> = &'a mut dyn FnMut();
/// Does work, and returns the number of allocations that its thread made during it.
pub type Counter<'a> = &'a (dyn Fn(Work) -> u64 + Sync);

/// Allocations of the default configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AllocationCounts {
    /// Of an update of the networks, with a synergy's cost of commands in the actor's loss.
    pub per_update: f64,
    /// Of drawing and relabelling a minibatch, with a synergy's penalty in the rewards.
    pub per_sampling: f64,
    /// Of a step of an episode: policy, exploration, simulation, observation and facts.
    pub per_env_step: f64,
    /// Of an episode, without its steps.
    pub per_episode: f64,
}

/// Counts the allocations of the default configuration.
///
/// # Errors
/// As [`GraspTask::new`].
pub fn allocations(setting: &BenchSetting, count: Counter) -> Result<AllocationCounts, BenchError> {
    let (config, hand, library) = setting.load()?;
    let task = task_of(&config, &hand, &library)?;
    let (per_update, per_sampling) = of_learner(&config, &task, count)?;
    let steps = config.task.steps;
    let whole = of_episodes(&config, steps, &hand, &library, count)?;
    let half = of_episodes(&config, steps / 2, &hand, &library, count)?;
    let per_env_step = (whole - half) / (steps - steps / 2).max(1) as f64;
    Ok(AllocationCounts { per_update, per_sampling, per_env_step, per_episode: whole - per_env_step * steps as f64 })
}

/// Returns the allocations of an update, and of drawing its minibatch.
fn of_learner(config: &RunConfig, task: &GraspTask, count: Counter) -> Result<(f64, f64), BenchError> {
    let shape = episode_shape(task);
    let joints = &task.posture_joints;
    let mut random = rng::stream(0, "bench", 0);
    let mut posture = || joints.iter().map(|_| random.random_range(-1.0..1.0)).collect();
    let postures: Vec<Vec<f64>> = (0..POSTURES).map(|_| posture()).collect();
    let synergy = Synergy::fit(joints, &postures, config.synergy.components)?;
    // The literal penalty, because the default has none.
    let mut feedback = Feedback::new(1.0, Penalty::Literal, 0);
    feedback.follow(Some(synergy));
    // The object is always held in the learner's benchmark. So every step succeeds, and has a penalty.
    let config_of_success = RewardConfig { success_distance: f64::MAX };
    let reward = GraspReward { config: config_of_success, n_joints: joints.len(), feedback };
    let Bench { mut learner, replay, threads, .. } = Bench::new(config.learner.clone(), config.her, shape, 1)?;
    let mut batch = Batch::new(config.learner.batch_size, shape);
    let mut number = 0;
    let mut outcome = Ok(());
    let mut sample = || {
        number += 1;
        let mut random = rng::stream(config.seed, "replay", number);
        let drawn = sample_batch(&replay, &config.her, &mut random, &reward, &mut batch);
        if outcome.is_ok() {
            outcome = drawn;
        }
    };
    sample();
    let samplings = count(&mut || (0..UPDATES).for_each(|_| sample()));
    outcome?;
    learner.set_numbers(vec![Numbers { map: confined(shape.act_dim)?, fewer: None }]);
    let updates = threads.install(|| {
        learner.update(&batch);
        count(&mut || (0..UPDATES).for_each(|_| _ = learner.update(&batch)))
    });
    Ok((updates as f64 / UPDATES as f64, samplings as f64 / UPDATES as f64))
}

/// Returns a map of actions like that of a policy that is half confined.
fn confined(n: usize) -> Result<ActionMap, RlError> {
    let matrix = (0..n * n).map(|i| if i % (n + 1) == 0 { 0.5 } else { 0.01 }).collect();
    ActionMap::new(matrix, vec![0.0; n], n)
}

/// Returns the allocations of an episode with a number of steps.
fn of_episodes(
    config: &RunConfig,
    steps: usize,
    hand: &Hand,
    library: &std::sync::Arc<MuJoCo>,
    count: Counter,
) -> Result<f64, BenchError> {
    let mut config = config.clone();
    config.task.steps = steps.max(config.task.final_steps);
    let task = task_of(&config, hand, library)?;
    let mut env = GraspEnv::new(&task)?;
    let mut random = rng::stream(config.seed, "init", 0);
    let sizes = Dimensions::of(episode_shape(&task));
    let learner = Ddpg::new(config.learner.clone(), sizes, &mut random)?;
    let noisy = ExplorationConfig { noise_free_share: 0.0, ..config.exploration.clone() };
    let mut job = EpisodeJob {
        seed: config.seed,
        stream: "bench",
        index: 0,
        scene: Some(0),
        policy: learner.policy(ActorChoice::Online),
        behaviour: Behaviour::Explore(noisy.into()),
        fewer_numbers: false,
        confinement: None,
        disturbance: None,
    };
    let mut scratch = job.policy.scratch();
    run_episode(&mut env, &mut scratch, &job)?;
    let mut outcome = Ok(());
    let total = count(&mut || {
        for index in 0..EPISODES {
            job.index = index;
            if let Err(error) = run_episode(&mut env, &mut scratch, &job) {
                outcome = Err(error);
            }
        }
    });
    outcome?;
    Ok(total as f64 / EPISODES as f64)
}
