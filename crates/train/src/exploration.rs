//! Exploration for a hand: the role of each actuator, which the learner does not know.

use eigenhand_hands::Hand;
use eigenhand_rl::{ActionDimension, Coordination, ExplorationConfig};
use eigenhand_sim::GraspTask;

use crate::action_space::Outputs;
use crate::config::RunConfig;
use crate::error::TrainError;

/// Returns the exploration that a configuration describes for a hand.
///
/// Random actions of the slide are held longer than those of the fingers (`training.slide_hold`). If the hand has
/// `closing` in `hand.toml`, random actions can also close or open the whole hand and move the slide to one of its
/// ends.
///
/// # Errors
/// [`TrainError::Rl`] when a setting is out of range.
pub(crate) fn exploration_of(
    config: &RunConfig,
    hand: &Hand,
    task: &GraspTask,
    outputs: Option<&Outputs>,
) -> Result<ExplorationConfig, TrainError> {
    let mut exploration = config.exploration.clone();
    exploration.dimensions = match outputs {
        Some(outputs) => outputs.dimensions.clone(),
        None => dimensions(hand, task, config.training.slide_hold),
    };
    exploration.validate(exploration.dimensions.len())?;
    Ok(exploration)
}

/// Returns the role of each actuator in exploration. In a coordinated action the hand closes or opens, and the slide
/// goes down or up.
pub(crate) fn dimensions(hand: &Hand, task: &GraspTask, slide_hold: f32) -> Vec<ActionDimension> {
    let closing = &hand.manifest.closing;
    let dimension = |(name, start): (&String, f32)| {
        let slide = *name == hand.manifest.slide.name;
        let coordination = match closing.get(name) {
            Some(&sign) => Coordination::Together(sign as f32),
            None if slide && !closing.is_empty() => Coordination::Ends,
            None => Coordination::Free,
        };
        ActionDimension { hold_scale: if slide { slide_hold } else { 1.0 }, coordination, start }
    };
    task.actuators.iter().zip(task.start_action()).map(dimension).collect()
}
