//! Evaluation: episodes without exploration, in which nothing is learned or stored.

use std::collections::BTreeMap;

use eigenhand_rl::Policy;
use eigenhand_sim::GraspTask;
use eigenhand_sim::ffi::WarningCounts;
use serde::Serialize;

use crate::TrainError;
use crate::rollout::{Behaviour, Episode, EpisodeJob, WorkerPool};

/// Which random streams an evaluation draws its episodes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EvaluationStream {
    /// The same episodes at every evaluation during training.
    Periodic,
    /// Episodes by which the finalists are compared.
    Selection,
    /// Fresh episodes, seen by nothing before.
    Final,
    /// Episodes of an evaluation of its own, other than those of any training.
    Separate,
}

impl EvaluationStream {
    fn name(self) -> &'static str {
        match self {
            EvaluationStream::Periodic => "evaluate",
            EvaluationStream::Selection => "select",
            EvaluationStream::Final => "final",
            EvaluationStream::Separate => "separate",
        }
    }
}

/// Result of an evaluation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Episodes that were asked for; one that diverged counts as a failure.
    pub episodes: u64,
    /// Share of episodes that succeeded.
    pub success_rate: f64,
    /// The same for each object.
    pub success_rate_per_object: BTreeMap<String, f64>,
    /// Episodes with each object.
    pub episodes_per_object: BTreeMap<String, u64>,
    /// Mean distance from object to goal at the end, in m.
    pub mean_final_distance: f64,
    /// Mean over the successes of the deepest penetration between object and hand in the last steps, in m.
    pub mean_penetration: f64,
    /// Episodes whose simulation diverged.
    pub diverged: u64,
    /// What MuJoCo warned of.
    pub warnings: WarningCounts,
    /// Postures of the successes, in rad and m.
    #[serde(skip)]
    pub postures: Vec<Vec<f64>>,
}

/// Runs `episodes` episodes, the objects in turn.
///
/// # Errors
/// As [`WorkerPool::collect`].
pub fn evaluate(
    pool: &mut WorkerPool,
    task: &GraspTask,
    policy: &Policy,
    seed: u64,
    stream: EvaluationStream,
    episodes: u64,
) -> Result<Evaluation, TrainError> {
    pool.submit((0..episodes).map(|index| EpisodeJob {
        seed,
        stream: stream.name(),
        index,
        scene: Some((index % task.scenes.len() as u64) as usize),
        goal_height: task.config.goal_height,
        policy: policy.clone(),
        behaviour: Behaviour::Greedy,
    }))?;
    Ok(summarise(task, &pool.collect()?))
}

fn summarise(task: &GraspTask, episodes: &[Episode]) -> Evaluation {
    let rate = |chosen: &mut dyn Iterator<Item = &Episode>| {
        let (all, good) = chosen.fold((0u64, 0u64), |(all, good), e| (all + 1, good + u64::from(e.success)));
        good as f64 / all.max(1) as f64
    };
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (count, sum) = values.fold((0u64, 0.0), |(count, sum), value| (count + 1, sum + value));
        sum / count.max(1) as f64
    };
    let mut warnings = WarningCounts::default();
    episodes.iter().for_each(|e| warnings += e.warnings);
    Evaluation {
        episodes: episodes.len() as u64,
        success_rate: rate(&mut episodes.iter()),
        success_rate_per_object: task
            .scenes
            .iter()
            .enumerate()
            .filter(|(i, _)| episodes.iter().any(|e| e.scene == *i))
            .map(|(i, scene)| (scene.object.name.to_owned(), rate(&mut episodes.iter().filter(|e| e.scene == i))))
            .collect(),
        episodes_per_object: task
            .scenes
            .iter()
            .enumerate()
            .map(|(i, scene)| (scene.object.name.to_owned(), episodes.iter().filter(|e| e.scene == i).count() as u64))
            .collect(),
        mean_final_distance: mean(&mut episodes.iter().filter(|e| !e.diverged).map(|e| e.final_distance)),
        mean_penetration: mean(&mut episodes.iter().filter(|e| e.success).map(|e| e.penetration)),
        diverged: episodes.iter().filter(|e| e.diverged).count() as u64,
        warnings,
        postures: episodes.iter().filter(|e| e.success).map(|e| e.posture.clone()).collect(),
    }
}
