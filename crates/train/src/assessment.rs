//! The result of evaluating a finished run.

use std::path::PathBuf;

use eigenhand_mujoco::WarningCounts;
use serde::Serialize;

use crate::evaluation::Tally;

/// Result of evaluating a finished run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Assessment {
    /// The run's directory.
    pub run: PathBuf,
    /// Name of the hand.
    pub hand: String,
    /// How far training confined the policy to its synergy.
    pub lambda: f64,
    /// Seed of the evaluation's episodes.
    pub seed: u64,
    /// Settings, as `key=value`, in which the scene differed from training.
    pub changed: Vec<String>,
    /// Episodes; an episode that diverged counts as a failure.
    pub episodes: u64,
    /// Episodes that succeeded.
    pub successes: u64,
    /// Share of episodes that succeeded.
    pub success_rate: f64,
    /// 95 % interval of that share.
    pub interval: [f64; 2],
    /// Success with each object.
    pub objects: Vec<ObjectScore>,
    /// Mean distance from object to goal at the end, in m.
    pub mean_final_distance_m: f64,
    /// Deepest penetration between object and hand in the last steps of an episode, averaged over the successes, in m.
    pub mean_penetration_m: f64,
    /// The same between two geoms of the hand; none without `physics.self_collision`.
    pub mean_self_penetration_m: Option<f64>,
    /// Episodes whose simulation diverged.
    pub diverged: u64,
    /// Counts of MuJoCo's warnings.
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

impl ObjectScore {
    pub(crate) fn of(object: &str, tally: Tally) -> ObjectScore {
        let Tally { episodes, successes } = tally;
        let interval = wilson_interval(successes, episodes);
        ObjectScore { object: object.to_owned(), episodes, successes, success_rate: tally.rate(), interval }
    }
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
