//! Speed of the learner's updates, compared with matrix products on the same core and with other implementations.

use std::time::{Duration, Instant};

use eigenhand_rl::{
    Batch, Ddpg, DdpgConfig, Dimensions, EpisodeData, EpisodeShape, HerConfig, Mlp, OutputActivation, Replay, RewardFn,
    rng, sample_batch,
};
use eigenhand_sim::StepFacts;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rand::RngExt;
use rayon::ThreadPool;
use serde::Serialize;

use crate::error::BenchError;
use crate::peak::peak;
use crate::peers::{Peer, PeerSpeed, Turns};
use crate::setting::{BenchSetting, median};
use eigenhand_train::episode_shape;
use eigenhand_train::{learning_threads, task_of};

/// Episodes in the replay.
const N_EPISODES: usize = 200;
/// Number of updates, and of samplings, in one turn.
const CHUNK: u32 = 10;
/// Updates before a turn is timed, as in the peers' scripts.
const WARM_UP: u32 = 20;
/// Rows and columns of the large matrices; their product measures the speed of the core.
const SQUARE: usize = 1024;
/// Turns of each of two implementations.
const PEER_ROUNDS: usize = 5;

/// Speed of updates, on one thread unless stated otherwise.
#[derive(Clone, Debug, Serialize)]
pub struct LearnerSpeed {
    /// Numbers in an observation.
    pub obs_dim: usize,
    /// Numbers in a goal.
    pub goal_dim: usize,
    /// Numbers in an action.
    pub act_dim: usize,
    /// Transitions in a minibatch.
    pub batch: usize,
    /// Updates a second, without drawing the minibatch.
    pub updates_per_s: f64,
    /// Updates a second, with drawing and relabelling the minibatch.
    pub updates_with_sampling_per_s: f64,
    /// Updates a second if two threads share each update, without drawing the minibatch.
    pub updates_on_two_threads_per_s: f64,
    /// Minibatches drawn and relabelled a second.
    pub samplings_per_s: f64,
    /// Floating-point operations of the matrix products in an update, in 1e9 a second. Operations with zeros count,
    /// even if the learner skips them.
    pub gflops: f64,
    /// Operations of faer's product of two large matrices on the same core, in 1e9 a second.
    pub sgemm_gflops: f64,
    /// `gflops` over `sgemm_gflops`, median over the pieces.
    pub share_of_sgemm: f64,
    /// Largest number of operations that the core can do in registers, without memory, in 1e9 a second.
    pub peak_gflops: f64,
    /// `gflops` over `peak_gflops`, median over the pieces; above 1 if the learner skips enough zeros.
    pub share_of_peak: f64,
    /// Other implementations, measured by turns with this one.
    pub peers: Vec<PeerSpeed>,
    /// Reasons why other implementations could not be measured.
    pub peers_failed: Vec<String>,
}

struct Near;

impl RewardFn for Near {
    fn reward(&self, achieved: &[f32], desired: &[f32], _: &[f32], _: &[f32]) -> f32 {
        let square: f32 = achieved.iter().zip(desired).map(|(a, d)| (a - d) * (a - d)).sum();
        if square < 0.25 { 0.0 } else { -1.0 }
    }
}

/// Everything that an update needs.
pub(crate) struct Bench {
    pub learner: Ddpg,
    pub replay: Replay,
    batch: Batch,
    her: HerConfig,
    random: rand_chacha::ChaCha8Rng,
    pub threads: ThreadPool,
}

impl Bench {
    pub fn new(config: DdpgConfig, her: HerConfig, shape: EpisodeShape, n_threads: usize) -> Result<Bench, BenchError> {
        let mut random = rng::stream(0, "bench", 0);
        let mut replay = Replay::new(N_EPISODES, shape)?;
        for _ in 0..N_EPISODES {
            let mut episode = EpisodeData::zeros(shape);
            let held = StepFacts { touches_hand: true, touches_plane: false, penetration: 0.0 }.to_array();
            let EpisodeData { observations, achieved_goals, desired_goal, actions, facts, .. } = &mut episode;
            facts.chunks_exact_mut(held.len()).for_each(|step| step.copy_from_slice(&held));
            for x in observations.iter_mut().chain(achieved_goals).chain(desired_goal).chain(actions) {
                *x = random.random_range(-1.0..1.0);
            }
            replay.push(episode)?;
        }
        let batch = Batch::new(config.batch_size, shape);
        let mut learner = Ddpg::new(config, Dimensions::of(shape), &mut random)?;
        for episode in replay.episodes() {
            learner.update_normalizers(&episode.observations, &episode.achieved_goals);
        }
        Ok(Bench { learner, replay, batch, her, random, threads: learning_threads(n_threads)? })
    }

    fn sample(&mut self) -> Result<(), BenchError> {
        Ok(sample_batch(&self.replay, &self.her, &mut self.random, &Near, &mut self.batch)?)
    }

    fn update(&mut self) {
        let Self { learner, batch, threads, .. } = self;
        threads.install(|| learner.update(batch));
    }

    fn learn(&mut self, updates: u32) -> Result<(), BenchError> {
        for _ in 0..updates {
            self.sample()?;
            self.update();
        }
        Ok(())
    }

    /// Returns updates a second, including drawing the minibatches.
    fn rate(&mut self, duration: Duration) -> Result<f64, BenchError> {
        self.learn(WARM_UP)?;
        let start = Instant::now();
        let mut updates = 0u32;
        while start.elapsed() < duration {
            self.learn(CHUNK)?;
            updates += CHUNK;
        }
        Ok(f64::from(updates) / start.elapsed().as_secs_f64())
    }
}

/// Measures the default learner with each size of minibatch.
///
/// # Errors
/// As [`GraspTask::new`](eigenhand_sim::GraspTask::new); the task determines the sizes of the networks.
pub fn learner_speed(
    setting: &BenchSetting,
    batches: &[usize],
    peers: &[Peer],
) -> Result<Vec<LearnerSpeed>, BenchError> {
    let (config, hand, library) = setting.load()?;
    let shape = episode_shape(task_of(&config, &hand, &library)?.as_ref());
    batches
        .iter()
        .map(|&batch_size| {
            let learner = DdpgConfig { batch_size, ..config.learner.clone() };
            measure(learner, config.her, shape, setting.duration, peers)
        })
        .collect()
}

fn measure(
    config: DdpgConfig,
    her: HerConfig,
    shape: EpisodeShape,
    duration: Duration,
    peers: &[Peer],
) -> Result<LearnerSpeed, BenchError> {
    let flop = matrix_flop(&config, shape);
    let batch = config.batch_size;
    // The peers' networks have no layer normalisation.
    let like_peers = DdpgConfig { critic_layer_norm: false, ..config.clone() };
    let mut bench = Bench::new(config.clone(), her, shape, 1)?;
    let mut shared = Bench::new(config, her, shape, 2)?;
    let (a, b) = (Mat::<f32>::full(SQUARE, SQUARE, 0.5), Mat::full(SQUARE, SQUARE, 0.25));
    let mut c = Mat::zeros(SQUARE, SQUARE);
    bench.learn(1)?;
    shared.learn(1)?;
    let mut shared_updates = vec![];
    let (mut updates, mut samplings, mut products, mut shares) = (vec![], vec![], vec![], vec![]);
    let (mut peaks, mut shares_of_peak) = (vec![], vec![]);
    let start = Instant::now();
    while start.elapsed() < duration {
        let sampling = timed(|| (0..CHUNK).try_for_each(|_| bench.sample()))?;
        let update = timed(|| {
            (0..CHUNK).for_each(|_| bench.update());
            Ok(())
        })?;
        let shared_update = timed(|| {
            (0..CHUNK).for_each(|_| shared.update());
            Ok(())
        })?;
        shared_updates.push(shared_update / f64::from(CHUNK));
        let product = timed(|| {
            matmul(&mut c, Accum::Replace, &a, &b, 1.0, Par::Seq);
            Ok(())
        })?;
        std::hint::black_box(&c);
        let (update, sampling) = (update / f64::from(CHUNK), sampling / f64::from(CHUNK));
        let sgemm = 2.0 * (SQUARE * SQUARE * SQUARE) as f64 / product;
        updates.push(update);
        samplings.push(sampling);
        products.push(sgemm);
        shares.push(flop / update / sgemm);
        let peak = peak();
        peaks.push(peak);
        shares_of_peak.push(flop / update / peak);
    }
    let (update, sampling) = (median(&mut updates), median(&mut samplings));
    let mut speed = LearnerSpeed {
        obs_dim: shape.obs_dim,
        goal_dim: shape.goal_dim,
        act_dim: shape.act_dim,
        batch,
        updates_per_s: 1.0 / update,
        updates_with_sampling_per_s: 1.0 / (update + sampling),
        updates_on_two_threads_per_s: 1.0 / median(&mut shared_updates),
        samplings_per_s: 1.0 / sampling,
        gflops: flop / update / 1e9,
        sgemm_gflops: median(&mut products) / 1e9,
        share_of_sgemm: median(&mut shares),
        peak_gflops: median(&mut peaks) / 1e9,
        share_of_peak: median(&mut shares_of_peak),
        peers: Vec::new(),
        peers_failed: Vec::new(),
    };
    for peer in peers {
        match compare(peer, &like_peers, her, shape, duration) {
            Ok(compared) => speed.peers.push(compared),
            Err(error) => speed.peers_failed.push(error.to_string()),
        }
    }
    Ok(speed)
}

/// Runs this implementation and another by turns. Every turn starts with new networks, because more activations become
/// zero the longer a network learns.
fn compare(
    peer: &Peer,
    config: &DdpgConfig,
    her: HerConfig,
    shape: EpisodeShape,
    duration: Duration,
) -> Result<PeerSpeed, BenchError> {
    let each = duration.div_f64(PEER_ROUNDS as f64);
    let (batch, seconds) = (config.batch_size, each.as_secs_f64().ceil() as u64);
    let sizes = [("batch", batch), ("obs", shape.obs_dim), ("goal", shape.goal_dim), ("act", shape.act_dim)];
    let mut options = vec![("seconds", seconds.to_string())];
    options.extend(sizes.map(|(name, size)| (name, size.to_string())));
    let mut turns = Turns::default();
    for _ in 0..PEER_ROUNDS {
        turns.push(Bench::new(config.clone(), her, shape, 1)?.rate(each)?, peer.updates_per_s(&options)?);
    }
    Ok(turns.compare(&peer.name))
}

fn timed(work: impl FnOnce() -> Result<(), BenchError>) -> Result<f64, BenchError> {
    let start = Instant::now();
    work()?;
    Ok(start.elapsed().as_secs_f64())
}

/// Counts the floating-point operations of the matrix products in one update.
fn matrix_flop(config: &DdpgConfig, shape: EpisodeShape) -> f64 {
    let weights = |inputs: usize, outputs: usize| {
        let sizes: Vec<usize> = std::iter::once(inputs).chain(config.hidden.iter().copied()).chain([outputs]).collect();
        let net = Mlp::zeros(&sizes, OutputActivation::Linear);
        let per_layer: Vec<usize> = net.layers().iter().map(|l| l.inputs * l.outputs).collect();
        (per_layer.iter().sum::<usize>(), per_layer[0])
    };
    let state = shape.obs_dim + shape.goal_dim;
    let (actor, actor_first) = weights(state, shape.act_dim);
    let (critic, critic_first) = weights(state + shape.act_dim, 1);
    let targets = actor + critic;
    let critic_update = critic + critic + (critic - critic_first);
    let through_critic = critic + (critic - critic_first) + config.hidden.first().map_or(0, |h| h * shape.act_dim);
    let actor_update = actor + actor + (actor - actor_first);
    2.0 * config.batch_size as f64 * (targets + critic_update + through_critic + actor_update) as f64
}
