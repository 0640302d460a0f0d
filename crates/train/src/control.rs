//! The control synergy: the space of the commands along whole grasps, and the map that confines a policy to it.
//!
//! A posture at the end of an episode does not tell how the hand opens and closes. So this space is fitted to the
//! commands of the hand's actuators along successful episodes, from the start to the goal. During training the policy
//! is confined to it step by step, so that at the end a few numbers command the hand.

use eigenhand_rl::{Numbers, Policy};
use eigenhand_synergy::{JointInfo, MotionRecord, Synergy};

use crate::actuators::HandActuators;
use crate::config::{RunConfig, SynergyConfig};
use crate::error::TrainError;

/// (steps of motions) => the space of their commands with `k` components; none while there are too few
///
/// # Errors
/// [`TrainError::Synergy`].
pub(crate) fn control_space(
    actuators: &[JointInfo],
    motions: &[MotionRecord],
    k: usize,
) -> Result<Option<Synergy>, TrainError> {
    let commands: Vec<&[f64]> = motions.iter().map(|step| step.command.as_slice()).collect();
    Ok(Synergy::fit_newest(actuators, &commands, k.min(actuators.len()), 0)?)
}

/// The confinement of a run's policy to the control synergy.
pub(crate) struct Control {
    pub actuators: HandActuators,
    config: SynergyConfig,
    /// Share of the commands outside the space that remains at the end.
    last_rest: f64,
    /// Episodes of the run.
    total: u64,
    /// Steps of all motions so far, in the order of their episodes.
    motions: Vec<MotionRecord>,
    /// Index in `motions` of the first step of each motion.
    starts: Vec<usize>,
    /// The space, once it no longer changes.
    settled: Option<Synergy>,
}

impl Control {
    pub fn new(config: &RunConfig, actuators: HandActuators) -> Control {
        Control {
            actuators,
            config: config.synergy.clone(),
            last_rest: if config.confines() { (1.0 - config.lambda).max(0.0) } else { 1.0 },
            total: config.episodes,
            motions: Vec::new(),
            starts: Vec::new(),
            settled: None,
        }
    }

    /// Adds the steps of further motions.
    pub fn add(&mut self, motions: impl IntoIterator<Item = MotionRecord>) {
        for step in motions {
            if self.motions.last().is_none_or(|last| last.episode != step.episode) {
                self.starts.push(self.motions.len());
            }
            self.motions.push(step);
        }
    }

    /// Returns the training episodes between which the policy is confined to the space; none while there are too few
    /// motions, or if it stays free.
    fn span(&self) -> Option<[f64; 2]> {
        let [from, to] = self.config.anneal.map(|share| share * self.total as f64);
        let last_needed = *self.starts.get(self.config.motions.checked_sub(1)?)?;
        let start = from.max(self.motions[last_needed].episode as f64 + 1.0);
        // A hand that learns late is confined within half of what is left.
        let length = (to - from).min((self.total as f64 - start).max(0.0) / 2.0);
        (self.last_rest < 1.0).then_some([start, start + length])
    }

    /// (training episodes so far) => whether the policy is as confined as it will be
    pub fn is_settled(&self, episode: u64) -> bool {
        self.last_rest >= 1.0 || self.span().is_some_and(|[_, end]| episode as f64 >= end)
    }

    /// (training episodes so far) => whether the policy commands nothing outside the space
    pub fn is_confined(&self, episode: u64) -> bool {
        self.last_rest <= 0.0 && self.span().is_some_and(|[_, end]| episode as f64 >= end)
    }

    /// Returns the steps of the newest motions before a training episode.
    pub fn newest(&self, episode: u64) -> &[MotionRecord] {
        let known = self.starts.partition_point(|&start| self.motions[start].episode < episode);
        let first = known.saturating_sub(self.config.motions);
        let at = |motion: usize| self.starts.get(motion).copied().unwrap_or(self.motions.len());
        &self.motions[at(first)..at(known)]
    }

    /// (training episodes so far) => the motions to which the space is fitted, or was when it was frozen
    pub fn fitted(&self, episode: u64) -> &[MotionRecord] {
        match self.span() {
            Some([_, end]) if episode as f64 >= end => self.newest(end.ceil() as u64),
            _ => self.newest(episode),
        }
    }

    /// (training episodes so far, a policy) => whether the policy acts through the frozen space
    ///
    /// Such a policy has learned what the first numbers of this space do alone.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn is_frozen_for(&mut self, episode: u64, policy: &Policy) -> Result<bool, TrainError> {
        let frozen = self.span().is_some_and(|[_, end]| episode as f64 >= end);
        Ok(frozen && self.numbers(episode)?.first().map(|numbers| &numbers.map) == policy.map())
    }

    /// (training episodes so far) => the space; none while there are too few motions
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn space(&mut self, episode: u64) -> Result<Option<Synergy>, TrainError> {
        if self.settled.is_some() {
            return Ok(self.settled.clone());
        }
        let space = control_space(&self.actuators.coordinates, self.fitted(episode), self.config.components)?;
        if self.span().is_some_and(|[_, end]| episode as f64 >= end) {
            self.settled = space.clone();
        }
        Ok(space)
    }

    /// (training episodes so far) => the maps that confine the policy, in the order of their turns: every other one is that of
    /// the whole space, the others are those of its first component, its first two, and so on. None while the policy is
    /// free.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn numbers(&mut self, episode: u64) -> Result<Vec<Numbers>, TrainError> {
        let now = episode as f64;
        let Some([start, end]) = self.span().filter(|[start, _]| now >= *start) else { return Ok(Vec::new()) };
        let done = if end > start { ((now - start) / (end - start)).min(1.0) } else { 1.0 };
        let rest = 1.0 - (1.0 - self.last_rest) * done;
        let Some(space) = self.space(episode)? else { return Ok(Vec::new()) };
        let k = space.n_components();
        let first = |fewer: Option<usize>| -> Result<Numbers, TrainError> {
            Ok(Numbers { map: self.actuators.confine(&space, fewer.unwrap_or(k), rest)?, fewer })
        };
        let turns = (1..k).flat_map(|fewer| [None, Some(fewer)]);
        if k == 1 { Ok(vec![first(None)?]) } else { turns.map(first).collect() }
    }
}
