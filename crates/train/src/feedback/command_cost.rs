//! The cost of commands that the synergy cannot produce.

use eigenhand_rl::ActionCost;
use eigenhand_sim::FAILURE;
use eigenhand_synergy::{ActuationMap, CommandSpace, Synergy};

/// Returns the cost `weight * distance^2` of an action, for transitions that succeed. The distance is that from the
/// action's command to the nearest command that the synergy can produce.
pub(super) fn command_cost(synergy: &Synergy, actuation: &ActuationMap, weight: f64) -> ActionCost {
    let space = CommandSpace::new(synergy, actuation);
    let ranges = actuation.control_min.iter().zip(&actuation.control_max);
    let half: Vec<f64> = ranges.map(|(low, high)| (high - low) / 2.0).collect();
    let rows = space.metric().chunks_exact(half.len().max(1)).zip(&half);
    let matrix = rows
        .flat_map(|(row, left)| row.iter().zip(&half).map(move |(g, right)| (weight * left * g * right) as f32))
        .collect();
    ActionCost::new(matrix, half.len(), FAILURE)
}

#[cfg(test)]
mod tests {
    use eigenhand_synergy::{JointInfo, Unit};

    use super::*;

    #[test]
    fn an_actions_cost_is_the_squared_distance_of_its_command() {
        let joint = |name: &str| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 };
        let postures: Vec<[f64; 3]> =
            (0..50).map(|i| [f64::from(i).sin(), f64::from(i * i).cos(), 0.3 * f64::from(i).cos()]).collect();
        let synergy = Synergy::fit(&["a", "b", "c"].map(joint), &postures, 1).unwrap();
        let actuation = ActuationMap {
            actuators: ["a", "b", "c"].map(str::to_owned).to_vec(),
            control_min: vec![-1.0, 0.0, 2.0],
            control_max: vec![1.0, 3.0, 2.5],
            matrix: vec![vec![1.0, 0.0, 0.0], vec![0.0, 2.0, 0.0], vec![0.0, 0.5, 1.0]],
            offset: vec![0.1, -0.2, 2.0],
        };
        let (space, weight) = (CommandSpace::new(&synergy, &actuation), 1.7);
        let cost = command_cost(&synergy, &actuation, weight);
        for deviation in [[0.3, -0.5, 0.9], [0.0, 1.0, 0.0], [-0.7, 0.2, 0.1]] {
            let ctrl: Vec<f64> = (0..3)
                .map(|i| {
                    let half = (actuation.control_max[i] - actuation.control_min[i]) / 2.0;
                    space.centre()[i] + half * deviation[i]
                })
                .collect();
            let expected = weight * space.distance(&ctrl).powi(2);
            let found = f64::from(cost.cost(&deviation.map(|d| d as f32)));
            assert!(expected > 1e-3 && (found - expected).abs() < 1e-5 * expected, "{found} {expected}");
        }
    }
}
