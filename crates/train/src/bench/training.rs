//! Rollouts and updates together, as a run does them.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use serde::Serialize;

use super::BenchSetting;
use crate::progress::Silent;
use crate::trainer::task_of;
use crate::{Provenance, RunDirectory, TrainError, Trainer};

/// Training episodes, of which the first act at random.
const EPISODES: u64 = 60;
const WARMUP: u64 = 10;

/// Speed of a short run.
#[derive(Clone, Debug, Serialize)]
pub struct TrainingSpeed {
    /// Name of the hand.
    pub hand: String,
    /// Threads that simulate, besides the one that learns.
    pub workers: usize,
    /// Training episodes.
    pub episodes: u64,
    /// Environment steps a second of wall time.
    pub env_steps_per_s: f64,
    /// Updates a second of wall time.
    pub updates_per_s: f64,
    /// Largest resident memory of this process so far in MB, where the system tells.
    pub peak_memory_mb: Option<f64>,
}

/// Measures a run of the default configuration with each number of workers.
///
/// # Errors
/// As [`Trainer::run`].
pub fn training_speed(setting: &BenchSetting, workers: &[usize]) -> Result<Vec<TrainingSpeed>, TrainError> {
    workers.iter().map(|&workers| measure(setting, workers)).collect()
}

fn measure(setting: &BenchSetting, workers: usize) -> Result<TrainingSpeed, TrainError> {
    let (mut config, hand, library) = setting.load()?;
    config.workers = workers;
    config.episodes = EPISODES;
    config.training.warmup_episodes = WARMUP;
    config.evaluation.every = EPISODES + 1;
    config.evaluation.episodes = 1;
    config.evaluation.final_episodes = 1;
    config.training.checkpoint_every = EPISODES + 1;
    let task = task_of(&config, &hand, &library)?;
    let provenance = Provenance::collect(&hand, &library);
    let scratch = Scratch(std::env::temp_dir().join(format!("eigenhand-bench-{}-{workers}", std::process::id())));
    let run = RunDirectory::create(Some(&scratch.0), &config, &provenance)?;
    let summary = Trainer::create(config, provenance, hand, task, run)?.run(&AtomicBool::new(false), &mut Silent)?;
    Ok(TrainingSpeed {
        hand: summary.hand,
        workers,
        episodes: summary.episodes,
        env_steps_per_s: summary.env_steps as f64 / summary.wall_s,
        updates_per_s: summary.updates as f64 / summary.wall_s,
        peak_memory_mb: peak_memory_mb(),
    })
}

fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok().map(|kilobytes| kilobytes / 1024.0)
}

/// A directory that is removed when it goes out of use.
struct Scratch(PathBuf);

impl Drop for Scratch {
    fn drop(&mut self) {
        // What is left in the temporary directory does no harm.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
