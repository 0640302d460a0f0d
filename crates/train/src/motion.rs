//! The motion of a successful episode: commands and postures at some of its steps.

use eigenhand_sim::{GraspTask, StepFacts};
use eigenhand_synergy::{MotionRecord, Source};

use crate::actuators::HandActuators;
use crate::rollout::Episode;

/// Steps of each half of a motion: of the hand that approaches and closes, and of the hand that holds. Both halves count
/// alike in the analysis, although holding takes most of an episode.
const STEPS: usize = 10;

/// Returns steps of a successful episode in their order, evenly spread over either half; none if the hand never
/// approached or never held.
pub(crate) fn motion(episode: &Episode, actuators: &HandActuators, task: &GraspTask) -> Vec<MotionRecord> {
    let data = &episode.data;
    let held = |t: usize| {
        let facts = StepFacts::from_slice(data.facts_at(t));
        facts.touches_hand && !facts.touches_plane
    };
    let (n_steps, act_dim, n_joints) = (data.shape.n_steps, data.shape.act_dim, task.posture_joints.len());
    let hold = (0..n_steps).rev().find(|&t| !held(t)).map_or(0, |t| t + 1);
    if hold == 0 || hold == n_steps {
        return Vec::new();
    }
    let spread = |from: usize, to: usize| (0..STEPS).map(move |i| from + (2 * i + 1) * (to - from) / (2 * STEPS));
    let record = |t: usize| MotionRecord {
        episode: episode.index,
        object: task.scenes[episode.scene].object.name.to_string(),
        step: t as u32,
        held: t >= hold,
        posture: data.observation(t + 1)[..n_joints].iter().map(|q| f64::from(*q)).collect(),
        command: actuators.commands(&episode.commands[t * act_dim..][..act_dim]),
    };
    spread(0, hold).chain(spread(hold, n_steps)).map(record).collect()
}

/// Returns the motions of the episodes that succeeded with the policy alone.
pub(crate) fn motions(episodes: &[Episode], actuators: &HandActuators, task: &GraspTask) -> Vec<MotionRecord> {
    let good = |episode: &&Episode| episode.success && !episode.diverged && episode.source == Source::Policy;
    episodes.iter().filter(good).flat_map(|episode| motion(episode, actuators, task)).collect()
}
