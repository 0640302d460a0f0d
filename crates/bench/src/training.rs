//! Speed and memory of training: rollouts and updates together, as in a run.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use eigenhand_rl::{EpisodeData, rng};
use rand::RngExt;
use serde::Serialize;

use crate::error::BenchError;
use crate::peers::{Peer, PeerSpeed, Turns};
use crate::setting::{BenchSetting, median};
use eigenhand_train::episode_shape;
use eigenhand_train::{Assignment, Progress, Provenance, RunDirectory, Status, Trainer, task_of};

/// First training episodes, with random actions.
const WARMUP: u64 = 10;
/// Episodes with updates before the clock starts; the first of them also makes the updates for the warm-up.
const UNTIMED: u64 = 4;
/// Turns of each alternative.
const ROUNDS: u32 = 3;

/// Speed of the default configuration's training.
#[derive(Clone, Debug, Serialize)]
pub struct TrainingSpeed {
    /// Name of the hand.
    pub hand: String,
    /// Updates for each episode.
    pub updates_per_episode: f64,
    /// Speed with each number of workers.
    pub workers: Vec<WorkersSpeed>,
    /// Other implementations, measured by turns with the last number of workers.
    pub peers: Vec<PeerSpeed>,
    /// Reasons why other implementations could not be measured.
    pub peers_failed: Vec<String>,
}

/// Speed with a number of workers.
#[derive(Clone, Debug, Serialize)]
pub struct WorkersSpeed {
    /// Threads that simulate, besides the one that learns.
    pub workers: usize,
    /// Environment steps a second of wall time, learning included.
    pub env_steps_per_s: f64,
    /// Updates a second of wall time, simulation included.
    pub updates_per_s: f64,
    /// Speed over the speed with the first number of workers, median over the turns.
    pub scaling: f64,
    /// Seconds from reading the configuration to the end of the first episodes.
    pub first_rollout_s: f64,
}

/// Memory of training with a full replay.
#[derive(Clone, Debug, Serialize)]
pub struct TrainingMemory {
    /// Episodes in replay.
    pub replay_episodes: usize,
    /// Largest resident memory of this process so far in MB, if the system reports it.
    pub peak_mb: Option<f64>,
}

/// One turn.
struct Turn {
    env_steps_per_s: f64,
    updates_per_s: f64,
    first_rollout_s: f64,
}

/// Measures the default configuration with each number of workers, and other implementations, all by turns.
///
/// # Errors
/// As [`Trainer::run`].
pub fn training_speed(setting: &BenchSetting, workers: &[usize], peers: &[Peer]) -> Result<TrainingSpeed, BenchError> {
    let (config, hand, _) = setting.load()?;
    let each = setting.duration / ROUNDS;
    let mut ours: Vec<Vec<Turn>> = workers.iter().map(|_| Vec::new()).collect();
    let mut theirs: Vec<Result<Turns, BenchError>> = peers.iter().map(|_| Ok(Turns::default())).collect();
    for _ in 0..ROUNDS {
        let mut last = None;
        for (turns, &workers) in ours.iter_mut().zip(workers) {
            let run = Scratch::new();
            turns.push(train(setting, workers, each, &run.0, |_| Ok(()))?);
            last = Some(run);
        }
        let (Some(run), Some(turn)) = (last, ours.last().and_then(|turns| turns.last())) else { continue };
        let options = [
            ("run", run.0.display().to_string()),
            ("seconds", each.as_secs_f64().ceil().to_string()),
            ("batch", config.learner.batch_size.to_string()),
            ("hidden", config.learner.hidden.iter().map(usize::to_string).collect::<Vec<_>>().join(" ")),
            ("updates", config.training.updates_per_episode.round().to_string()),
            ("warmup", WARMUP.to_string()),
        ];
        for (peer, turns) in peers.iter().zip(&mut theirs) {
            let Ok(found) = turns else { continue };
            match peer.updates_per_s(&options) {
                Ok(rate) => found.push(turn.updates_per_s, rate),
                Err(error) => *turns = Err(error),
            }
        }
    }
    let mut speed = TrainingSpeed {
        hand: hand.manifest.name,
        updates_per_episode: config.training.updates_per_episode,
        workers: workers.iter().zip(&ours).map(|(&workers, turns)| summarise(workers, turns, &ours[0])).collect(),
        peers: Vec::new(),
        peers_failed: Vec::new(),
    };
    for (peer, turns) in peers.iter().zip(theirs) {
        match turns {
            Ok(turns) => speed.peers.push(turns.compare(&peer.name)),
            Err(error) => speed.peers_failed.push(error.to_string()),
        }
    }
    Ok(speed)
}

fn summarise(workers: usize, turns: &[Turn], first: &[Turn]) -> WorkersSpeed {
    let over = |value: fn(&Turn) -> f64| median(&mut turns.iter().map(value).collect::<Vec<_>>());
    let mut ratios: Vec<f64> = turns.iter().zip(first).map(|(a, b)| a.env_steps_per_s / b.env_steps_per_s).collect();
    WorkersSpeed {
        workers,
        env_steps_per_s: over(|turn| turn.env_steps_per_s),
        updates_per_s: over(|turn| turn.updates_per_s),
        scaling: median(&mut ratios),
        first_rollout_s: over(|turn| turn.first_rollout_s),
    }
}

/// Measures memory while the default configuration trains with a full replay. Earlier work of this process counts too,
/// so this measurement must come first.
///
/// # Errors
/// As [`Trainer::run`].
pub fn training_memory(setting: &BenchSetting) -> Result<TrainingMemory, BenchError> {
    let (config, ..) = setting.load()?;
    let replay_episodes = config.training.replay_episodes;
    let run = Scratch::new();
    train(setting, config.workers, Duration::ZERO, &run.0, |trainer| {
        let mut random = rng::stream(0, "bench", 0);
        let mut episode = EpisodeData::zeros(episode_shape(trainer.task()));
        let EpisodeData { observations, achieved_goals, desired_goal, actions, .. } = &mut episode;
        let arrays = [observations, achieved_goals, desired_goal, actions];
        arrays.into_iter().flatten().for_each(|x| *x = random.random_range(-1.0..1.0));
        (0..replay_episodes).try_for_each(|_| Ok(trainer.replay_mut().push(episode.clone())?))
    })?;
    Ok(TrainingMemory { replay_episodes, peak_mb: peak_memory_mb() })
}

/// Trains for `duration` after the first updates, in a new directory.
fn train(
    setting: &BenchSetting,
    workers: usize,
    duration: Duration,
    directory: &Path,
    prepare: impl FnOnce(&mut Trainer) -> Result<(), BenchError>,
) -> Result<Turn, BenchError> {
    let started = Instant::now();
    let (mut config, hand, library) = setting.load()?;
    config.workers = workers;
    // The clock stops the run. Until then it only trains, without evaluations and checkpoints.
    let never = i64::MAX as u64;
    config.episodes = never;
    config.evaluation.every = never;
    config.training.checkpoint_every = never;
    config.training.warmup_episodes = WARMUP;
    let task = task_of(&config, &hand, &library)?;
    let provenance = Provenance::collect(&hand, &library);
    let run = RunDirectory::create(Some(directory), &config, &provenance)?;
    let (steps, updates) = (task.config.steps as f64, config.training.updates_per_episode);
    let mut trainer = Trainer::create(Assignment {
        config,
        provenance,
        hand,
        task,
        other_task: None,
        space: None,
        start: None,
        run,
    })?;
    prepare(&mut trainer)?;
    let stop = AtomicBool::new(false);
    let mut clock = Clock { stop: &stop, started, duration, first: None, begin: None, end: None };
    trainer.run(&stop, &mut clock)?;
    let rate = match (clock.begin, clock.end) {
        (Some((begin, before)), Some((end, after))) => (after - before) as f64 / (end - begin).as_secs_f64(),
        _ => f64::NAN,
    };
    Ok(Turn {
        env_steps_per_s: rate * steps,
        updates_per_s: rate * updates,
        first_rollout_s: clock.first.map_or(f64::NAN, |first| first.as_secs_f64()),
    })
}

/// Counts episodes from the end of one cycle to the end of another, and then stops the run.
struct Clock<'a> {
    stop: &'a AtomicBool,
    started: Instant,
    duration: Duration,
    first: Option<Duration>,
    begin: Option<(Instant, u64)>,
    end: Option<(Instant, u64)>,
}

impl Progress for Clock<'_> {
    fn update(&mut self, status: &Status) {
        let now = Instant::now();
        if status.episodes > 0 {
            self.first.get_or_insert(now - self.started);
        }
        if status.episodes < WARMUP + UNTIMED {
            return;
        }
        let done = (now, status.episodes - status.diverged);
        match self.begin {
            None => self.begin = Some(done),
            Some((begin, _)) if self.end.is_none() && now - begin >= self.duration => {
                self.end = Some(done);
                self.stop.store(true, Ordering::Relaxed);
            }
            Some(_) => {}
        }
    }

    fn note(&mut self, _line: &str) {}
}

fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok().map(|kilobytes| kilobytes / 1024.0)
}

/// A directory that is removed when it goes out of use.
struct Scratch(PathBuf);

impl Scratch {
    /// Chooses an unused name.
    fn new() -> Scratch {
        static NUMBER: AtomicU64 = AtomicU64::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        Scratch(std::env::temp_dir().join(format!("eigenhand-bench-{}-{number}", std::process::id())))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // A directory that remains among the temporary files does no harm.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
