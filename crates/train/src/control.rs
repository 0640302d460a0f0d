//! The control synergy: the space of the commands along whole grasps, and the map that confines a policy to it.
//!
//! A posture at the end of an episode does not tell how the hand opens and closes. So this space is fitted to the
//! commands of the hand's actuators along successful episodes, from the start to the goal. Once it is settled, the
//! policy begins anew and acts in it, so that a few numbers command the hand.

use eigenhand_hands::Hand;
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{JointInfo, MotionRecord, Synergy};

use crate::action_space::{Outputs, Roles};
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

/// The control synergy of a run. It follows the newest motions until it is settled; then the policy acts in it.
pub(crate) struct Control {
    pub actuators: HandActuators,
    config: SynergyConfig,
    /// Share of the commands outside the space that is left to a policy that acts in it.
    rest: f64,
    /// Training episodes between which the space can be settled; none if the policy stays in joint space.
    between: Option<[f64; 2]>,
    /// Steps of all motions so far, in the order of their episodes.
    motions: Vec<MotionRecord>,
    /// Index in `motions` of the first step of each motion.
    starts: Vec<usize>,
    settled: Option<Settled>,
}

/// The space that no longer changes.
struct Settled {
    /// Training episodes before.
    at: u64,
    space: Synergy,
    /// The motions to which it is fitted.
    motions: Vec<MotionRecord>,
}

impl Control {
    pub fn new(config: &RunConfig, actuators: HandActuators) -> Control {
        let [settle, total] = [config.synergy.settle, config.episodes as f64];
        // Later, too little of the training is left for a policy that begins anew.
        let between = [settle * total, (settle + 0.75 * (1.0 - settle)) * total];
        Control {
            actuators,
            config: config.synergy.clone(),
            rest: (1.0 - config.lambda).max(0.0),
            between: config.confines().then_some(between),
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

    /// (training episodes so far) => whether it is time to settle the space
    pub fn is_due(&self, episode: u64) -> bool {
        let now = episode as f64;
        let in_time = self.between.is_some_and(|[from, to]| from <= now && now < to);
        in_time && self.settled.is_none() && self.starts.len() >= self.config.motions
    }

    /// (training episodes before the last cycle, and so far) => whether the time in which the space can be settled has just
    /// passed without it
    pub fn is_too_late(&self, previous: u64, episode: u64) -> bool {
        let passed = |[_, to]: [f64; 2]| (previous as f64) < to && to <= episode as f64;
        self.settled.is_none() && self.between.is_some_and(passed)
    }

    /// (training episodes before) => settles the space of the newest motions, unless there are too few
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn settle(&mut self, at: u64) -> Result<(), TrainError> {
        self.settle_on(at, self.newest(at).to_vec())
    }

    /// (training episodes before, motions) => settles the space of these motions, unless there are too few
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn settle_on(&mut self, at: u64, motions: Vec<MotionRecord>) -> Result<(), TrainError> {
        let space = control_space(&self.actuators.coordinates, &motions, self.config.components)?;
        self.settled = space.map(|space| Settled { at, space, motions });
        Ok(())
    }

    /// Returns the motions to which the settled space is fitted; none if it is not settled.
    pub fn settled_motions(&self) -> Option<&[MotionRecord]> {
        self.settled.as_ref().map(|settled| settled.motions.as_slice())
    }

    /// Returns the training episodes before the space was settled; none if it is not.
    pub fn settled_at(&self) -> Option<u64> {
        self.settled.as_ref().map(|settled| settled.at)
    }

    /// Tells whether the policy commands nothing outside the settled space.
    pub fn is_confined(&self) -> bool {
        self.rest <= 0.0 && self.settled.is_some()
    }

    /// Returns the steps of the newest motions before a training episode.
    pub fn newest(&self, episode: u64) -> &[MotionRecord] {
        let known = self.starts.partition_point(|&start| self.motions[start].episode < episode);
        let first = known.saturating_sub(self.config.motions);
        let at = |motion: usize| self.starts.get(motion).copied().unwrap_or(self.motions.len());
        &self.motions[at(first)..at(known)]
    }

    /// (training episodes so far) => the space; none while there are too few motions
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn space(&self, episode: u64) -> Result<Option<Synergy>, TrainError> {
        match &self.settled {
            Some(settled) => Ok(Some(settled.space.clone())),
            None => control_space(&self.actuators.coordinates, self.newest(episode), self.config.components),
        }
    }

    /// (hand, its task) => the outputs of a policy that acts in the settled space; none while it is not settled
    ///
    /// # Errors
    /// [`TrainError::Rl`] for numbers that are not finite.
    pub fn outputs(&self, config: &RunConfig, hand: &Hand, task: &GraspTask) -> Result<Option<Outputs>, TrainError> {
        let Some(Settled { space, .. }) = &self.settled else { return Ok(None) };
        let roles = Roles::of(config, hand, task, &self.actuators);
        Outputs::of(space, space.n_components(), self.rest, true, &roles).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuators::tests::actuators;

    /// A motion of two steps whose commands no other episode has.
    fn motion(episode: u64) -> [MotionRecord; 2] {
        [0, 1].map(|step| MotionRecord {
            episode,
            object: "cube".to_owned(),
            step,
            held: step == 1,
            posture: vec![0.0, 0.0],
            command: vec![episode as f64, f64::from(step), 2.0 + (episode as f64).sin()],
        })
    }

    /// Returns the control of a training of so many episodes, with motions of the first of them.
    fn control(episodes: u64, known: u64) -> Control {
        let mut config = RunConfig::default_preset().unwrap();
        config.episodes = episodes;
        (config.synergy.settle, config.synergy.motions, config.synergy.components) = (0.2, 3, 2);
        let mut control = Control::new(&config, actuators());
        control.add((0..known).flat_map(motion));
        control
    }

    #[test]
    fn the_space_is_settled_once_in_its_time() {
        let mut ready = control(100, 10);
        assert_eq!([19, 20, 79, 80].map(|episode| ready.is_due(episode)), [false, true, true, false]);
        ready.settle(8).unwrap();
        assert!(!ready.is_due(20) && !ready.is_too_late(78, 80) && ready.is_confined());
        // The newest motions before episode 8, whatever comes after.
        let samples: Vec<Vec<f64>> = (5..8).flat_map(motion).map(|step| step.command).collect();
        let expected = Synergy::fit(&ready.actuators.coordinates, &samples, 2).unwrap();
        ready.add(motion(10));
        assert_eq!(ready.space(100).unwrap(), Some(expected.clone()));
        // A run that is resumed with more episodes has the space of before.
        let mut longer = control(1000, 11);
        longer.settle(8).unwrap();
        assert_eq!(longer.space(100).unwrap(), Some(expected));
        assert_eq!((longer.settled_at(), longer.is_due(200)), (Some(8), false));
    }

    #[test]
    fn too_few_motions_leave_all_joints() {
        let few = control(100, 2);
        assert!((0..=100).all(|episode| !few.is_due(episode)));
        assert_eq!([(76, 78), (78, 80), (80, 82)].map(|(from, to)| few.is_too_late(from, to)), [false, true, false]);
        assert!(!few.is_confined());
    }
}
