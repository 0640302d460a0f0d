//! Prints the learner's updates per second on one thread, and what a single-row policy call costs.
//!
//! `cargo run --release -p eigenhand-rl --example learner_speed -- [OBS GOAL ACT BATCH SECONDS]`

use std::time::{Duration, Instant};

use eigenhand_rl::{
    Batch, Ddpg, DdpgConfig, EpisodeData, EpisodeShape, HerConfig, Mlp, Replay, RewardFn, Which, rng, sample_batch,
};
use rand::RngExt;

const DEFAULTS: [usize; 5] = [64, 3, 21, 256, 10];
const N_EPISODES: usize = 100;
const N_STEPS: usize = 100;

struct Near;

impl RewardFn for Near {
    fn reward(&self, achieved: &[f32], desired: &[f32], _: &[f32], _: &[f32]) -> f32 {
        let square: f32 = achieved.iter().zip(desired).map(|(a, d)| (a - d) * (a - d)).sum();
        if square < 0.25 { 0.0 } else { -1.0 }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut sizes = DEFAULTS;
    for (size, argument) in sizes.iter_mut().zip(std::env::args().skip(1)) {
        *size = argument.parse()?;
    }
    let [obs_dim, goal_dim, act_dim, batch_size, seconds] = sizes;
    let shape = EpisodeShape { n_steps: N_STEPS, obs_dim, goal_dim, act_dim, fact_dim: 0 };
    let replay = random_replay(shape)?;
    let config = DdpgConfig { batch_size, ..DdpgConfig::default() };
    let mut learner = Ddpg::new(config, obs_dim, goal_dim, act_dim, &mut rng::stream(0, "init", 0))?;
    for episode in replay.episodes() {
        learner.update_normalizers(&episode.observations, &episode.achieved_goals);
    }

    let her = HerConfig::default();
    let mut batch = Batch::new(batch_size, shape);
    let mut draws = rng::stream(0, "replay", 0);
    let sampling = best_time(Duration::from_secs(1), || {
        // The replay is not empty.
        let _ = sample_batch(&replay, &her, &mut draws, &Near, &mut batch);
    });
    let update = best_time(Duration::from_secs(seconds as u64), || {
        learner.update(&batch, &mut draws);
    });
    let policy = learner.policy(Which::Online);
    let (mut scratch, mut action) = (policy.scratch(), vec![0.0; act_dim]);
    let episode = &replay.episodes()[0];
    let act = best_time(Duration::from_secs(1), || {
        policy.act(episode.observation(0), &episode.desired_goal, &mut scratch, &mut action);
    });

    let flop = matrix_flop(learner.config(), obs_dim + goal_dim, act_dim, batch_size);
    println!("observation {obs_dim}, goal {goal_dim}, action {act_dim}, batch {batch_size}");
    report("update", update);
    println!("  matrix products: {:.0} MFLOP, {:.1} GFLOP/s", flop / 1e6, flop / update.mean.as_secs_f64() / 1e9);
    report("batch from the replay", sampling);
    report("policy call", act);
    Ok(())
}

/// Mean over all calls and the least mean of a block of calls.
#[derive(Clone, Copy)]
struct Timing {
    mean: Duration,
    best: Duration,
}

fn report(what: &str, timing: Timing) {
    let rate = |d: Duration| 1.0 / d.as_secs_f64();
    println!(
        "{what}: {:?} ({:.1} /s), best {:?} ({:.1} /s)",
        timing.mean,
        rate(timing.mean),
        timing.best,
        rate(timing.best)
    );
}

fn best_time(total: Duration, mut call: impl FnMut()) -> Timing {
    const BLOCK: u32 = 20;
    for _ in 0..BLOCK {
        call();
    }
    let start = Instant::now();
    let (mut best, mut n_calls) = (Duration::MAX, 0);
    while start.elapsed() < total {
        let block = Instant::now();
        for _ in 0..BLOCK {
            call();
        }
        best = best.min(block.elapsed() / BLOCK);
        n_calls += BLOCK;
    }
    Timing { mean: start.elapsed() / n_calls.max(1), best }
}

/// Operations of the matrix products of one update with one critic.
fn matrix_flop(config: &DdpgConfig, state: usize, act_dim: usize, batch: usize) -> f64 {
    let weights = |inputs: usize, outputs: usize| {
        let sizes: Vec<usize> = std::iter::once(inputs).chain(config.hidden.iter().copied()).chain([outputs]).collect();
        let net = Mlp::zeros(&sizes, eigenhand_rl::OutputActivation::Linear);
        let per_layer: Vec<usize> = net.layers().iter().map(|l| l.inputs * l.outputs).collect();
        (per_layer.iter().sum::<usize>(), per_layer[0])
    };
    let (actor, actor_first) = weights(state, act_dim);
    let (critic, critic_first) = weights(state + act_dim, 1);
    let targets = actor + critic;
    let critic_update = critic + critic + (critic - critic_first);
    let through_critic = critic + (critic - critic_first) + config.hidden.first().map_or(0, |h| h * act_dim);
    let actor_update = actor + actor + (actor - actor_first);
    2.0 * batch as f64 * (targets + critic_update + through_critic + actor_update) as f64
}

fn random_replay(shape: EpisodeShape) -> Result<Replay, Box<dyn std::error::Error>> {
    let mut replay = Replay::new(N_EPISODES, shape)?;
    let mut draws = rng::stream(0, "episodes", 0);
    for _ in 0..N_EPISODES {
        let mut episode = EpisodeData::zeros(shape);
        let EpisodeData { observations, achieved_goals, desired_goal, actions, .. } = &mut episode;
        for x in observations.iter_mut().chain(achieved_goals).chain(desired_goal).chain(actions) {
            *x = draws.random_range(-1.0..1.0);
        }
        replay.push(episode)?;
    }
    Ok(replay)
}
