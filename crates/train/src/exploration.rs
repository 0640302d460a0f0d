//! The exploration of a hand: what the learner cannot know about the dimensions of an action.

use eigenhand_hands::Hand;
use eigenhand_rl::{Coordination, ExplorationConfig};
use eigenhand_sim::GraspTask;

use crate::config::RunConfig;
use crate::error::TrainError;

/// Returns the exploration that a configuration describes for a hand.
///
/// Random actions hold the slide longer than the fingers (`training.slide_hold`). Where the hand says what closes it, they
/// also close or open it as a whole, and take the slide to one of its ends.
///
/// # Errors
/// [`TrainError::Rl`] when a setting is out of range.
pub(crate) fn exploration_of(
    config: &RunConfig,
    hand: &Hand,
    task: &GraspTask,
) -> Result<ExplorationConfig, TrainError> {
    let mut exploration = config.exploration.clone();
    let slide_hold = config.training.slide_hold;
    if slide_hold != 1.0 {
        let is_slide = |name: &String| *name == hand.manifest.slide.name;
        exploration.hold_scale =
            task.actuators.iter().map(|name| if is_slide(name) { slide_hold } else { 1.0 }).collect();
    }
    exploration.coordination = coordination(hand, task);
    if !exploration.coordination.is_empty() {
        exploration.start = task.start_action();
    }
    exploration.validate(task.action_len())?;
    Ok(exploration)
}

/// What each actuator does in a coordinated random action: the hand closes or opens, the slide goes down or up.
fn coordination(hand: &Hand, task: &GraspTask) -> Vec<Coordination> {
    let closing = &hand.manifest.closing;
    if closing.is_empty() {
        return Vec::new();
    }
    let of = |name: &String| match closing.get(name) {
        Some(&sign) => Coordination::Together(sign as f32),
        None if *name == hand.manifest.slide.name => Coordination::Ends,
        None => Coordination::Free,
    };
    task.actuators.iter().map(of).collect()
}
