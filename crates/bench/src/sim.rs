//! The cost of the environment on top of the simulator's own steps.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eigenhand_mujoco::Data;
use eigenhand_rl::rng;
use eigenhand_sim::{GraspEnv, GraspTask};
use rand::RngExt;
use serde::Serialize;

use crate::error::BenchError;
use crate::setting::{BenchSetting, median};
use eigenhand_train::TrainError;
use eigenhand_train::task_of;

/// Control steps in one turn.
const CHUNK: usize = 10;
/// Control steps for which a random command is held.
const HOLD: usize = 8;
/// Turns of each number of threads.
const ROUNDS: u32 = 5;

/// Speed of the environment, compared with bare calls of `mj_step` with the same commands from the same state.
#[derive(Clone, Debug, Serialize)]
pub struct SimSpeed {
    /// Name of the hand.
    pub hand: String,
    /// Threads, each with an environment of its own.
    pub threads: usize,
    /// `mj_step` calls in an environment step.
    pub substeps: usize,
    /// Environment steps a second, of all threads together, with observations and without resets.
    pub env_steps_per_s: f64,
    /// The same number of `mj_step` calls without the environment, in environment steps a second.
    pub raw_steps_per_s: f64,
    /// `mj_step` calls a second without the environment, of all threads together.
    pub mj_steps_per_s: f64,
    /// Environment steps a second, over the same with the first number of threads, median over the turns.
    pub scaling: f64,
    /// The same ratio without the environment.
    pub raw_scaling: f64,
    /// Time of an environment step over that of its `mj_step` calls, median over the pieces.
    pub ratio: f64,
    /// Number of pieces.
    pub chunks: usize,
    /// Time of a reset, which lets the object settle, in ms.
    pub reset_ms: f64,
    /// Whether both sides ended every episode in the same state.
    pub identical: bool,
}

/// Measured pieces of one thread.
#[derive(Default)]
struct Pieces {
    ratios: Vec<f64>,
    env: Duration,
    raw: Duration,
    resets: Vec<f64>,
    steps: usize,
    differ: bool,
}

/// Measured pieces of all threads, and rates for each turn.
#[derive(Default)]
struct Turns {
    env_rates: Vec<f64>,
    raw_rates: Vec<f64>,
    ratios: Vec<f64>,
    resets: Vec<f64>,
    differ: bool,
}

/// Measures with each number of threads, by turns.
///
/// # Errors
/// [`BenchError::Sim`].
pub fn sim_speed(setting: &BenchSetting, threads: &[usize]) -> Result<Vec<SimSpeed>, BenchError> {
    let (config, hand, library) = setting.load()?;
    let task = task_of(&config, &hand, &library)?;
    let mut all: Vec<Turns> = threads.iter().map(|_| Turns::default()).collect();
    for _ in 0..ROUNDS {
        for (turns, &n) in all.iter_mut().zip(threads) {
            measure(&task, n, setting.duration / ROUNDS, turns)?;
        }
    }
    let substeps = task.physics.substeps;
    let over =
        |rates: &[f64], first: &[f64]| median(&mut rates.iter().zip(first).map(|(a, b)| a / b).collect::<Vec<_>>());
    Ok(threads
        .iter()
        .zip(&all)
        .map(|(&threads, turns)| {
            let raw_rate = median(&mut turns.raw_rates.clone());
            SimSpeed {
                hand: hand.manifest.name.clone(),
                threads,
                substeps,
                env_steps_per_s: median(&mut turns.env_rates.clone()),
                raw_steps_per_s: raw_rate,
                mj_steps_per_s: raw_rate * substeps as f64,
                scaling: over(&turns.env_rates, &all[0].env_rates),
                raw_scaling: over(&turns.raw_rates, &all[0].raw_rates),
                ratio: median(&mut turns.ratios.clone()),
                chunks: turns.ratios.len(),
                reset_ms: 1000.0 * median(&mut turns.resets.clone()),
                identical: !turns.differ,
            }
        })
        .collect())
}

/// Runs some threads for a time, and adds their results to `turns`.
fn measure(task: &Arc<GraspTask>, threads: usize, duration: Duration, turns: &mut Turns) -> Result<(), BenchError> {
    let outcomes: Vec<Result<Pieces, BenchError>> = std::thread::scope(|scope| {
        let running: Vec<_> = (0..threads).map(|n| scope.spawn(move || run(task, n as u64, duration))).collect();
        running
            .into_iter()
            .map(|thread| thread.join().unwrap_or(Err(BenchError::Train(TrainError::WorkerLost))))
            .collect()
    });
    let (mut env_rate, mut raw_rate) = (0.0, 0.0);
    for pieces in outcomes {
        let pieces = pieces?;
        env_rate += pieces.steps as f64 / pieces.env.as_secs_f64();
        raw_rate += pieces.steps as f64 / pieces.raw.as_secs_f64();
        turns.ratios.extend(pieces.ratios);
        turns.resets.extend(pieces.resets);
        turns.differ |= pieces.differ;
    }
    turns.env_rates.push(env_rate);
    turns.raw_rates.push(raw_rate);
    Ok(())
}

/// Runs episodes with random held commands, each piece once in the environment and once without it.
fn run(task: &Arc<GraspTask>, stream: u64, duration: Duration) -> Result<Pieces, BenchError> {
    let mut env = GraspEnv::new(task)?;
    let mut random = rng::stream(0, "bench", stream);
    let (n_actions, n_controls) = (task.action_len(), task.actuators.len());
    let mut actions = vec![0.0f32; n_actions * task.config.steps];
    let mut controls = vec![0.0; n_controls * task.config.steps];
    let mut observation = vec![0.0; task.observation_len()];
    let mut pieces = Pieces::default();
    let started = Instant::now();
    for episode in 0.. {
        if episode > 0 && started.elapsed() >= duration {
            break;
        }
        let scene = episode % task.scenes.len();
        for step in 0..task.config.steps {
            let (before, now) = actions.split_at_mut(step * n_actions);
            let now = &mut now[..n_actions];
            if step % HOLD == 0 {
                now.iter_mut().for_each(|a| *a = random.random_range(-1.0..=1.0));
            } else {
                now.copy_from_slice(&before[(step - 1) * n_actions..]);
            }
            task.scale_action(now, &mut controls[step * n_controls..(step + 1) * n_controls]);
        }
        let reset = Instant::now();
        env.reset(scene, &mut random)?;
        pieces.resets.push(reset.elapsed().as_secs_f64());
        // It shares the model of the environment, which may change at the next reset.
        let mut bare = Data::new(env.simulation().model())?;
        bare.copy_from(env.simulation())?;
        for (index, first) in (0..task.config.steps).step_by(CHUNK).enumerate() {
            let steps = first..(first + CHUNK).min(task.config.steps);
            let mut in_env = || -> Result<Duration, BenchError> {
                let start = Instant::now();
                for step in steps.clone() {
                    black_box(env.step(&actions[step * n_actions..(step + 1) * n_actions])?);
                    env.observe(&mut observation);
                    black_box(env.achieved_goal());
                }
                Ok(start.elapsed())
            };
            let mut without = || {
                let start = Instant::now();
                for step in steps.clone() {
                    bare.ctrl_mut().copy_from_slice(&controls[step * n_controls..(step + 1) * n_controls]);
                    (0..task.physics.substeps).for_each(|_| bare.step());
                }
                start.elapsed()
            };
            // The two sides alternate in coming first, so that neither always finds the caches warm.
            let (env_time, raw_time) = if index % 2 == 0 {
                let env_time = in_env()?;
                (env_time, without())
            } else {
                let raw_time = without();
                (in_env()?, raw_time)
            };
            pieces.env += env_time;
            pieces.raw += raw_time;
            pieces.ratios.push(env_time.as_secs_f64() / raw_time.as_secs_f64());
            pieces.steps += steps.len();
        }
        pieces.differ |= env.simulation().qpos() != bare.qpos();
    }
    Ok(pieces)
}
