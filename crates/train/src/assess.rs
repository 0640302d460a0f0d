//! Evaluation of a finished run, on episodes that its training never drew.

use std::path::{Path, PathBuf};

use eigenhand_sim::ffi::WarningCounts;
use serde::Serialize;

use crate::evaluation::{EvaluationStream, evaluate};
use crate::rollout::WorkerPool;
use crate::{LoadedRun, TrainError};

/// What an evaluation of a run found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Assessment {
    /// The run's directory.
    pub run: PathBuf,
    /// Name of the hand.
    pub hand: String,
    /// Weight of the synergy's feedback in training.
    pub lambda: f64,
    /// Seed of the evaluation's episodes.
    pub seed: u64,
    /// Settings, as `key=value`, in which the scene was not that of training.
    pub changed: Vec<String>,
    /// Episodes; one that diverged counts as a failure.
    pub episodes: u64,
    /// Episodes that succeeded.
    pub successes: u64,
    /// Share of episodes that succeeded.
    pub success_rate: f64,
    /// 95 % interval of that share.
    pub interval: [f64; 2],
    /// The same for each object.
    pub objects: Vec<ObjectScore>,
    /// Mean distance from object to goal at the end, in m.
    pub mean_final_distance_m: f64,
    /// Mean over the successes of the deepest penetration between object and hand in the last steps, in m.
    pub mean_penetration_m: f64,
    /// Episodes whose simulation diverged.
    pub diverged: u64,
    /// What MuJoCo warned of.
    pub warnings: WarningCounts,
}

/// Success with one object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectScore {
    /// Name of the object.
    pub object: String,
    /// Episodes with it.
    pub episodes: u64,
    /// Episodes that succeeded.
    pub successes: u64,
    /// Share of episodes that succeeded.
    pub success_rate: f64,
    /// 95 % interval of that share.
    pub interval: [f64; 2],
}

/// Runs `episodes` episodes of a run's policy without exploration, in the scene that it was [loaded](crate::launch::load)
/// with.
///
/// The episodes depend on `seed` alone, and come from a random stream that no training uses.
///
/// # Errors
/// [`TrainError::Sim`], or [`TrainError::WorkerLost`].
pub fn assess(
    run: &LoadedRun,
    directory: &Path,
    changed: &[String],
    episodes: u64,
    seed: u64,
    workers: usize,
) -> Result<Assessment, TrainError> {
    let mut pool = WorkerPool::new(&run.task, workers)?;
    let found = evaluate(&mut pool, &run.task, &run.policy, seed, EvaluationStream::Separate, episodes)?;
    let count = |rate: f64, episodes: u64| (rate * episodes as f64).round() as u64;
    let successes = count(found.success_rate, found.episodes);
    let objects = run.task.scenes.iter().filter_map(|scene| {
        let object = scene.object.name;
        let episodes = *found.episodes_per_object.get(object)?;
        let success_rate = *found.success_rate_per_object.get(object)?;
        let successes = count(success_rate, episodes);
        let interval = wilson_interval(successes, episodes);
        Some(ObjectScore { object: object.to_owned(), episodes, successes, success_rate, interval })
    });
    Ok(Assessment {
        run: directory.to_owned(),
        hand: run.hand.manifest.name.clone(),
        lambda: run.config.lambda,
        seed,
        changed: changed.to_vec(),
        episodes: found.episodes,
        successes,
        success_rate: found.success_rate,
        interval: wilson_interval(successes, found.episodes),
        objects: objects.collect(),
        mean_final_distance_m: found.mean_final_distance,
        mean_penetration_m: found.mean_penetration,
        diverged: found.diverged,
        warnings: found.warnings,
    })
}

/// (successes, trials) => the 95 % interval of the share of successes.
///
/// # Source
/// Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22 (1927).
pub fn wilson_interval(successes: u64, trials: u64) -> [f64; 2] {
    /// Two-sided 95 % quantile of the normal distribution.
    const Z: f64 = 1.959_963_984_540_054;
    if trials == 0 {
        return [0.0, 1.0];
    }
    let n = trials as f64;
    let p = successes as f64 / n;
    let scale = 1.0 + Z * Z / n;
    let centre = p + Z * Z / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    [((centre - half) / scale).max(0.0), ((centre + half) / scale).min(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_has_the_values_of_statsmodels() {
        // statsmodels.stats.proportion.proportion_confint(count, nobs, method="wilson")
        let near = |got: [f64; 2], want: [f64; 2]| got.iter().zip(want).all(|(g, w)| (g - w).abs() < 1e-12);
        assert!(near(wilson_interval(8, 10), [0.4901624715366103, 0.9433178485456247]), "{:?}", wilson_interval(8, 10));
        assert_eq!(wilson_interval(0, 0), [0.0, 1.0]);
        assert_eq!(wilson_interval(5, 5)[1], 1.0);
        assert_eq!(wilson_interval(0, 5)[0], 0.0);
    }
}
