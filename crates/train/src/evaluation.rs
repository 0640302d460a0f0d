//! Evaluation: episodes without exploration. Nothing is learned from them, and none is stored.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

use eigenhand_mujoco::WarningCounts;
use eigenhand_rl::Policy;
use eigenhand_sim::GraspTask;

use crate::error::TrainError;
use crate::rollout::{Behaviour, Confinement, Episode, EpisodeJob, WorkerPool};

/// Family of random streams for the episodes of an evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EvaluationStream {
    /// The same episodes at every evaluation during training.
    Periodic,
    /// Episodes for the comparison of the finalists.
    Selection,
    /// Episodes whose motions the exported grasps describe.
    Motion,
    /// Episodes that no training and no other evaluation uses.
    Final,
    /// Episodes of an evaluation after training; no training uses them.
    Separate,
}

impl EvaluationStream {
    pub(crate) fn name(self) -> &'static str {
        match self {
            EvaluationStream::Periodic => "evaluate",
            EvaluationStream::Selection => "select",
            EvaluationStream::Motion => "motion",
            EvaluationStream::Final => "final",
            EvaluationStream::Separate => "separate",
        }
    }
}

/// Number of episodes, and of successes among them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Episodes; an episode that diverged counts as a failure.
    pub episodes: u64,
    /// Episodes that succeeded.
    pub successes: u64,
}

impl Tally {
    pub(crate) fn of<'a>(episodes: impl Iterator<Item = &'a Episode>) -> Tally {
        episodes.fold(Tally::default(), |tally, episode| Tally {
            episodes: tally.episodes + 1,
            successes: tally.successes + u64::from(episode.success),
        })
    }

    /// Returns the share of episodes that succeeded; 0 without episodes.
    pub fn rate(self) -> f64 {
        self.successes as f64 / self.episodes.max(1) as f64
    }
}

/// The posture at the end of a success.
#[derive(Clone, Debug, PartialEq)]
pub struct Grasp {
    /// Name of the object.
    pub object: String,
    /// Values of the posture's joints, in rad and m.
    pub posture: Vec<f64>,
}

/// Result of an evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// All episodes.
    pub all: Tally,
    /// Episodes and successes with each object, in the order of the task's scenes; without objects that had no episode.
    pub objects: Vec<(String, Tally)>,
    /// Mean distance from object to goal at the end, in m.
    pub mean_final_distance: f64,
    /// Deepest penetration between object and hand in the last steps of an episode, averaged over the successes, in m.
    pub mean_penetration: f64,
    /// The same between two geoms of the hand; none without `physics.self_collision`, when links pass through each other.
    pub mean_self_penetration: Option<f64>,
    /// Episodes whose simulation diverged.
    pub diverged: u64,
    /// Counts of MuJoCo's warnings.
    pub warnings: WarningCounts,
    /// The successes' postures.
    pub grasps: Vec<Grasp>,
}

impl Evaluation {
    /// Returns the share of episodes that succeeded.
    pub fn success_rate(&self) -> f64 {
        self.all.rate()
    }

    /// Returns the success rate with each object.
    pub fn success_rate_per_object(&self) -> BTreeMap<String, f64> {
        self.objects.iter().map(|(object, tally)| (object.clone(), tally.rate())).collect()
    }
}

impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |(object, rate): (String, f64)| format!("{object} {:.0} %", 100.0 * rate);
        let objects: Vec<String> = self.success_rate_per_object().into_iter().map(percent).collect();
        write!(f, "evaluated success {:.1} % ({})", 100.0 * self.success_rate(), objects.join(", "))
    }
}

/// Runs the episodes of these numbers; the objects take turns.
///
/// # Errors
/// As [`WorkerPool::collect`].
pub fn evaluate(
    pool: &mut WorkerPool,
    task: &GraspTask,
    policy: &Policy,
    seed: u64,
    stream: EvaluationStream,
    episodes: Range<u64>,
) -> Result<Evaluation, TrainError> {
    Ok(summarise(task, &simulate(pool, task, policy, seed, stream, episodes, None)?))
}

/// Simulates the same episodes, with a further map on the policy's actions.
///
/// # Errors
/// As [`WorkerPool::collect`].
pub(crate) fn simulate(
    pool: &mut WorkerPool,
    task: &GraspTask,
    policy: &Policy,
    seed: u64,
    stream: EvaluationStream,
    episodes: Range<u64>,
    confinement: Option<Confinement>,
) -> Result<Vec<Episode>, TrainError> {
    pool.submit(episodes.map(|index| EpisodeJob {
        confinement: confinement.clone(),
        ..evaluation_job(task, policy, seed, stream, index)
    }))?;
    pool.collect()
}

/// Returns an episode of an evaluation: the policy alone, and the objects take turns.
pub(crate) fn evaluation_job(
    task: &GraspTask,
    policy: &Policy,
    seed: u64,
    stream: EvaluationStream,
    index: u64,
) -> EpisodeJob {
    EpisodeJob {
        seed,
        stream: stream.name(),
        index,
        scene: Some((index % task.scenes.len() as u64) as usize),
        policy: policy.clone(),
        behaviour: Behaviour::Greedy,
        fewer_numbers: false,
        confinement: None,
        disturbance: None,
    }
}

/// Returns the result of evaluation episodes.
pub(crate) fn summarise(task: &GraspTask, episodes: &[Episode]) -> Evaluation {
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (count, sum) = values.fold((0u64, 0.0), |(count, sum), value| (count + 1, sum + value));
        sum / count.max(1) as f64
    };
    let mut warnings = WarningCounts::default();
    episodes.iter().for_each(|e| warnings += e.warnings);
    let grasp = |episode: &Episode| Grasp {
        object: task.scenes[episode.scene].object.name.clone(),
        posture: episode.posture.clone(),
    };
    let of_object = |i: usize| Tally::of(episodes.iter().filter(|e| e.scene == i));
    let scenes = task.scenes.iter().enumerate();
    Evaluation {
        all: Tally::of(episodes.iter()),
        objects: scenes
            .map(|(i, scene)| (scene.object.name.to_owned(), of_object(i)))
            .filter(|(_, tally)| tally.episodes > 0)
            .collect(),
        mean_final_distance: mean(&mut episodes.iter().filter(|e| !e.diverged).map(|e| e.final_distance)),
        mean_penetration: mean(&mut episodes.iter().filter(|e| e.success).map(|e| e.penetration)),
        mean_self_penetration: (task.physics.self_collision)
            .then(|| mean(&mut episodes.iter().filter(|e| e.success).map(|e| e.self_penetration))),
        diverged: episodes.iter().filter(|e| e.diverged).count() as u64,
        warnings,
        grasps: episodes.iter().filter(|e| e.success).map(grasp).collect(),
    }
}
