//! The synergy's feedback into the actor: what a command outside the synergy space costs.

use eigenhand_hands::Hand;
use eigenhand_rl::ActionCost;
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{ActuationMap, CommandSpace, Synergy};

/// Returns the map from a posture to the commands of a task's actuators.
pub fn actuation_map(hand: &Hand, task: &GraspTask) -> ActuationMap {
    let actuation = hand.actuation();
    let (control_min, control_max) = task.control_ranges.iter().copied().unzip();
    ActuationMap {
        actuators: task.actuators.clone(),
        control_min,
        control_max,
        matrix: actuation.matrix,
        offset: actuation.offset,
    }
}

/// Returns the cost `weight * distance^2` of an action, where the distance is that of its command from the commands the
/// synergy can give, on transitions that earn more than `failure`.
pub fn command_cost(synergy: &Synergy, actuation: &ActuationMap, weight: f64, failure: f64) -> ActionCost {
    let space = CommandSpace::new(synergy, actuation);
    let ranges = || actuation.control_min.iter().zip(&actuation.control_max);
    let half: Vec<f64> = ranges().map(|(low, high)| (high - low) / 2.0).collect();
    let centre = ranges().zip(&half).zip(space.centre());
    let centre = centre.map(|(((low, high), half), centre)| ((centre - (low + high) / 2.0) / half) as f32).collect();
    let rows = space.metric().chunks_exact(half.len().max(1)).zip(&half);
    let matrix = rows
        .flat_map(|(row, left)| row.iter().zip(&half).map(move |(g, right)| (weight * left * g * right) as f32))
        .collect();
    ActionCost::new(matrix, centre, failure as f32)
}
