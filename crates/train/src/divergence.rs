//! Episodes whose simulation diverges: now and then one is discarded, but a run of which most diverge learns nothing.

use std::collections::{BTreeMap, VecDeque};

use eigenhand_hands::{HandActuator, Transmission};

use crate::assignment::Assignment;
use crate::error::TrainError;
use crate::rollout::Episode;

/// So many episodes in a row that diverge end a run.
const IN_A_ROW: usize = 20;
/// More than half of so many end it too.
const WINDOW: usize = 100;

/// The last training episodes: those that diverged with their object and joint.
#[derive(Debug, Default)]
pub(crate) struct Divergence {
    newest: VecDeque<Option<(String, Option<String>)>>,
}

impl Divergence {
    /// Adds an episode.
    ///
    /// # Errors
    /// [`TrainError::EpisodesDiverge`] when too many have diverged.
    pub fn add(&mut self, episode: &Episode, assignment: &Assignment) -> Result<(), TrainError> {
        let object = || assignment.task.scenes[episode.scene].object.name.clone();
        self.newest.push_back(episode.diverged.then(|| (object(), episode.diverged_at.clone())));
        if self.newest.len() > WINDOW {
            self.newest.pop_front();
        }
        let diverged = self.newest.iter().flatten().count();
        if !is_too_many(self.newest.iter().map(Option::is_some)) {
            return Ok(());
        }
        let joint = most(self.newest.iter().flatten().filter_map(|(_, joint)| joint.clone()));
        let object = most(self.newest.iter().flatten().map(|(object, _)| object.clone()));
        Err(TrainError::EpisodesDiverge {
            diverged,
            of: self.newest.len(),
            object: object.unwrap_or_default(),
            place: joint.map_or_else(|| "at joints without a name".to_owned(), |joint| place(&joint, assignment)),
            hand: assignment.config.hand.clone(),
            timestep: assignment.task.physics.timestep / 2.0,
        })
    }
}

/// (whether each of the last episodes diverged, oldest first) => whether that ends a run
fn is_too_many(diverged: impl DoubleEndedIterator<Item = bool> + Clone) -> bool {
    let in_a_row = diverged.clone().rev().take_while(|one| *one).count();
    in_a_row >= IN_A_ROW || 2 * diverged.filter(|one| *one).count() > WINDOW
}

/// `at the joint spin, which the actuator motor moves`
fn place(joint: &str, assignment: &Assignment) -> String {
    let Assignment { hand, .. } = assignment;
    if !hand.joints.iter().any(|known| known.name == joint) && joint != hand.manifest.slide.name {
        return "at the object".to_owned();
    }
    let moves = |actuator: &&HandActuator| match &actuator.transmission {
        Transmission::Joint(name) => name == joint,
        Transmission::FixedTendon { terms, .. } => terms.iter().any(|(name, _)| name == joint),
        Transmission::Other(_) => false,
    };
    match hand.actuators.iter().find(moves) {
        Some(actuator) => format!("at the joint {joint}, which the actuator {} moves", actuator.name),
        None => format!("at the joint {joint}, which no actuator moves"),
    }
}

fn most(names: impl Iterator<Item = String>) -> Option<String> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    names.for_each(|name| *counts.entry(name).or_default() += 1);
    counts.into_iter().max_by_key(|(_, count)| *count).map(|(name, _)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_in_a_row_or_most_of_the_last_are_too_many() {
        let of = |pattern: &[bool], n: usize| {
            is_too_many(pattern.iter().copied().cycle().take(n).collect::<Vec<_>>().into_iter())
        };
        assert!(!of(&[true], IN_A_ROW - 1) && of(&[true], IN_A_ROW));
        assert!(!of(&[true, false], WINDOW), "half of them");
        assert!(of(&[true, true, false], WINDOW), "two thirds, never more than two in a row");
        assert!(!of(&[false], WINDOW));
    }
}
