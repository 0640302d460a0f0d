//! Hindsight experience replay: a goal that was achieved later in the episode replaces the desired goal.

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::{EpisodeShape, Replay, RlError};

/// Constants of hindsight experience replay.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HerConfig {
    /// Mean number of relabelled transitions for each transition that keeps its goal. With 0, none is relabelled
    /// (Andrychowicz et al. 2017, section 4.5; Higashi et al., section 2.1).
    pub relabel_per_real: f32,
}

impl HerConfig {
    /// Checks the range.
    ///
    /// # Errors
    /// [`RlError::Config`] if the number is negative or not finite.
    pub fn validate(&self) -> Result<(), RlError> {
        if self.relabel_per_real.is_finite() && self.relabel_per_real >= 0.0 {
            return Ok(());
        }
        let got = self.relabel_per_real.to_string();
        Err(RlError::Config { field: "relabel_per_real", expected: "a number of at least 0", got })
    }

    /// Returns the probability that a transition is relabelled.
    fn relabel_probability(&self) -> f32 {
        self.relabel_per_real / (1.0 + self.relabel_per_real)
    }
}

/// The reward as a function of a transition and its goal.
pub trait RewardFn {
    /// Returns the reward of one transition.
    ///
    /// `achieved_goal` and `next_observation` are those after the step. `desired_goal` is the episode's own goal or the one
    /// that replaced it. `facts` are those of the step.
    fn reward(&self, achieved_goal: &[f32], desired_goal: &[f32], next_observation: &[f32], facts: &[f32]) -> f32;
}

/// The goal of a transition in a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GoalChoice {
    /// The episode's own goal.
    Original,
    /// The goal that was achieved at this index of the episode, from 0 (before the first step) to T.
    Achieved(usize),
}

/// Chooses the goal for step `t` of an episode of `n_steps`. With `relabel_probability` it is a goal that was achieved after
/// the step. Its index is drawn uniformly from `t + 1` to `n_steps`.
///
/// # Source
/// Andrychowicz et al. 2017, section 4.5, strategy *future*.
///
/// # Panics
/// If `t >= n_steps`.
pub fn choose_goal(n_steps: usize, t: usize, relabel_probability: f32, rng: &mut impl Rng) -> GoalChoice {
    assert!(t < n_steps, "step {t} of an episode of {n_steps}");
    if rng.random::<f32>() < relabel_probability {
        GoalChoice::Achieved(rng.random_range(t + 1..=n_steps))
    } else {
        GoalChoice::Original
    }
}

/// The origin of a transition of a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Index in [`Replay::episodes`].
    pub episode: usize,
    /// Step within the episode.
    pub t: usize,
    /// Goal of the transition.
    pub goal: GoalChoice,
}

/// A minibatch of transitions as flat arrays. It is allocated once and filled again for each update.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Number of transitions.
    pub len: usize,
    /// Observations before the step, len x obs_dim.
    pub observations: Vec<f32>,
    /// Goals, len x goal_dim. A goal is the same before and after the step.
    pub goals: Vec<f32>,
    /// Actions, len x act_dim.
    pub actions: Vec<f32>,
    /// Rewards for the goals above, len.
    pub rewards: Vec<f32>,
    /// Observations after the step, len x obs_dim.
    pub next_observations: Vec<f32>,
    /// Origins of the transitions, len.
    pub origins: Vec<Origin>,
}

impl Batch {
    /// Allocates a batch of `len` transitions of episodes of a shape.
    pub fn new(len: usize, shape: EpisodeShape) -> Self {
        Self {
            len,
            observations: vec![0.0; len * shape.obs_dim],
            goals: vec![0.0; len * shape.goal_dim],
            actions: vec![0.0; len * shape.act_dim],
            rewards: vec![0.0; len],
            next_observations: vec![0.0; len * shape.obs_dim],
            origins: vec![Origin { episode: 0, t: 0, goal: GoalChoice::Original }; len],
        }
    }
}

/// Fills a batch. Episodes and steps are drawn uniformly, [`choose_goal`] chooses the goals, and `reward` computes the reward
/// of every transition.
///
/// # Errors
/// [`RlError::EmptyReplay`] if there is no episode.
///
/// # Panics
/// If the batch was made for another episode shape.
pub fn sample_batch(
    replay: &Replay,
    config: &HerConfig,
    rng: &mut impl Rng,
    reward: &dyn RewardFn,
    batch: &mut Batch,
) -> Result<(), RlError> {
    if replay.is_empty() {
        return Err(RlError::EmptyReplay);
    }
    let EpisodeShape { n_steps, obs_dim, goal_dim, act_dim, .. } = replay.shape();
    let probability = config.relabel_probability();
    for i in 0..batch.len {
        let index = rng.random_range(0..replay.len());
        let t = rng.random_range(0..n_steps);
        let choice = choose_goal(n_steps, t, probability, rng);
        let episode = &replay.episodes()[index];
        let goal = match choice {
            GoalChoice::Original => &episode.desired_goal,
            GoalChoice::Achieved(future) => episode.achieved_goal(future),
        };
        let next_observation = episode.observation(t + 1);
        batch.origins[i] = Origin { episode: index, t, goal: choice };
        batch.rewards[i] = reward.reward(episode.achieved_goal(t + 1), goal, next_observation, episode.facts_at(t));
        batch.observations[i * obs_dim..][..obs_dim].copy_from_slice(episode.observation(t));
        batch.next_observations[i * obs_dim..][..obs_dim].copy_from_slice(next_observation);
        batch.goals[i * goal_dim..][..goal_dim].copy_from_slice(goal);
        batch.actions[i * act_dim..][..act_dim].copy_from_slice(episode.action(t));
    }
    Ok(())
}
