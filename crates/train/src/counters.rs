//! Counters of a run, which every checkpoint records.

use std::collections::VecDeque;

use eigenhand_mujoco::WarningCounts;
use eigenhand_rl::UpdateStats;
use eigenhand_synergy::Source;
use serde::{Deserialize, Serialize};

use crate::config::HELD_WINDOW;
use crate::progress::Status;
use crate::rollout::Episode;

/// Number of noise-free training episodes that the recent success rate covers.
const RECENT: usize = 50;

/// Counters of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counters {
    /// Training episodes simulated, including those that diverged.
    pub episodes: u64,
    /// Control steps simulated in training.
    pub env_steps: u64,
    /// Updates of the learner, one for each minibatch.
    pub updates: u64,
    /// Updates still to be made for the episodes so far; can have a fraction.
    pub updates_owed: f64,
    /// Training episodes that diverged.
    pub diverged: u64,
    /// Training steps at which MuJoCo warned of a full contact or constraint buffer, or of a bad inertia.
    pub buffer_warnings: u64,
    /// Postures in the database.
    pub postures: u64,
    /// SHA-256 of the database's rows at the checkpoint; empty in a checkpoint of an earlier version.
    #[serde(default)]
    pub postures_sha256: String,
    /// Rows of `metrics.csv`; 0 in a checkpoint of an earlier version.
    #[serde(default)]
    pub metrics_rows: u64,
    /// Seconds of wall time so far.
    pub wall_s: f64,
    /// Success rate of the last evaluation.
    pub last_evaluation: Option<f64>,
    /// Control steps at which an object was held off the plane in each of the last training episodes, oldest first.
    pub held_steps: VecDeque<u64>,
    /// Whether the last noise-free training episodes succeeded, oldest first.
    pub recent: VecDeque<bool>,
    /// Whether the evaluation after these episodes is still to be made, because the run was stopped in it.
    #[serde(default)]
    pub evaluation_due: bool,
    /// Training episodes before the control synergy was settled; none while it is not.
    pub settled_at: Option<u64>,
    /// Sums over the updates since the last evaluation.
    pub sums: UpdateSums,
}

/// Sums over the updates since the last evaluation; `metrics.csv` holds their means.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UpdateSums {
    /// Number of updates.
    pub count: u64,
    /// Losses of the critic.
    pub critic_loss: f64,
    /// Losses of the actor.
    pub actor_loss: f64,
    /// Mean value (Q) of the actions in each minibatch.
    pub q: f64,
    /// Mean target of each minibatch.
    pub target: f64,
    /// Share of clipped targets in each minibatch.
    #[serde(default)]
    pub clipped: f64,
}

impl UpdateSums {
    /// (one of the sums) => its mean over the updates; none before the first update
    pub fn mean(&self, sum: f64) -> Option<f64> {
        (self.count > 0).then(|| sum / self.count as f64)
    }

    /// Adds one update.
    pub fn add(&mut self, stats: &UpdateStats) {
        self.count += 1;
        self.critic_loss += f64::from(stats.critic_loss);
        self.actor_loss += f64::from(stats.actor_loss);
        self.q += f64::from(stats.q_mean);
        self.target += f64::from(stats.target_mean);
        self.clipped += f64::from(stats.clipped_share);
    }
}

impl Counters {
    /// Returns the mean of `held_steps`; 0 before the first episode.
    pub fn mean_held_steps(&self) -> f64 {
        self.held_steps.iter().sum::<u64>() as f64 / self.held_steps.len().max(1) as f64
    }

    /// Returns the state of a run of `total` episodes, as progress shows it.
    pub fn status(&self, total: u64, contribution_sum: Option<f64>, steps_per_s: f64) -> Status {
        Status {
            episodes: self.episodes,
            total,
            recent_success: self.recent_success(),
            evaluated: self.last_evaluation,
            postures: self.postures,
            contribution_sum,
            steps_per_s,
            diverged: self.diverged,
        }
    }

    /// Returns the success rate of the last noise-free training episodes; none before the first of them.
    pub fn recent_success(&self) -> Option<f64> {
        let good = self.recent.iter().filter(|success| **success).count();
        (!self.recent.is_empty()).then(|| good as f64 / self.recent.len() as f64)
    }

    /// Counts a training episode, and adds the updates to be made for it.
    pub fn count(&mut self, episode: &Episode, updates_per_episode: f64) {
        self.episodes += 1;
        let WarningCounts { contacts_full, constraints_full, inertia, .. } = episode.warnings;
        self.buffer_warnings += contacts_full + constraints_full + inertia;
        if episode.diverged {
            self.diverged += 1;
            return;
        }
        self.env_steps += episode.data.shape.n_steps as u64;
        self.updates_owed += updates_per_episode;
        push_newest(&mut self.held_steps, episode.held_steps, HELD_WINDOW);
        if episode.source == Source::Policy {
            push_newest(&mut self.recent, episode.success, RECENT);
        }
    }
}

/// Appends a value and keeps only the newest `length`.
fn push_newest<T>(values: &mut VecDeque<T>, value: T, length: usize) {
    values.push_back(value);
    while values.len() > length {
        values.pop_front();
    }
}
