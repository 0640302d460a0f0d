//! The hand's actuators, without the slide that stands for the arm.

use eigenhand_hands::Hand;
use eigenhand_rl::ActionMap;
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{JointInfo, Unit};

use crate::error::TrainError;

/// The hand's actuators as coordinates of a command: all but the slide, which stands for the arm.
#[derive(Clone, Debug)]
pub struct HandActuators {
    /// Names, units and ranges.
    pub coordinates: Vec<JointInfo>,
    /// For each the weights of the posture's joints and the offset that give the command at which it holds a posture; none
    /// for an actuator that holds no position.
    holding: Vec<Option<(Vec<f64>, f64)>>,
    /// Index of each in an action.
    actions: Vec<usize>,
    n_actions: usize,
}

impl HandActuators {
    /// Returns the actuators of a hand.
    pub fn of(hand: &Hand, task: &GraspTask) -> HandActuators {
        let actuation = hand.actuation();
        let slide = task.slide_action();
        let actions: Vec<usize> = (0..task.action_len()).filter(|&i| i != slide).collect();
        let coordinate = |&i: &usize| {
            let joint = actuation.matrix[i].iter().position(|weight| *weight != 0.0);
            let (lower, upper) = task.control_ranges[i];
            let unit = joint.map_or(Unit::Radian, |joint| task.posture_joints[joint].unit);
            JointInfo { name: task.actuators[i].clone(), unit, lower, upper }
        };
        let holding = |&i: &usize| {
            let (row, offset) = (&actuation.matrix[i], actuation.offset[i]);
            row.iter().any(|weight| *weight != 0.0).then(|| (row.clone(), offset))
        };
        HandActuators {
            coordinates: actions.iter().map(coordinate).collect(),
            holding: actions.iter().map(holding).collect(),
            actions,
            n_actions: task.action_len(),
        }
    }

    fn centre_and_half(&self) -> impl Iterator<Item = (f64, f64)> {
        self.coordinates.iter().map(|c| ((c.upper + c.lower) / 2.0, (c.upper - c.lower) / 2.0))
    }

    /// (action) => commands in the actuators' units, beyond their ranges where the action is beyond [-1, 1]
    pub fn commands(&self, action: &[f32]) -> Vec<f64> {
        let scaled = self.actions.iter().zip(self.centre_and_half());
        scaled.map(|(&i, (centre, half))| centre + half * f64::from(action[i])).collect()
    }

    /// (posture, commands that were given in it) => the commands that hold the posture; those of an actuator that holds no
    /// position stay
    pub fn commands_that_hold(&self, posture: &[f64], commands: &[f64]) -> Vec<f64> {
        let command = |(holding, &given): (&Option<(Vec<f64>, f64)>, &f64)| match holding {
            Some((row, offset)) => row.iter().zip(posture).map(|(weight, q)| weight * q).sum::<f64>() + offset,
            None => given,
        };
        self.holding.iter().zip(commands).map(command).collect()
    }

    /// Returns these actuators without those of the given names, which then are as free as the slide.
    ///
    /// # Errors
    /// [`TrainError::Option`] for a name that is none of them, or if none is left.
    pub fn without(&self, names: &[String]) -> Result<HandActuators, TrainError> {
        let wrong = |reason: String| TrainError::Option { option: format!("--free {}", names.join(",")), reason };
        let known = || self.coordinates.iter().map(|c| c.name.clone()).collect::<Vec<_>>().join(", ");
        if let Some(name) = names.iter().find(|name| self.coordinates.iter().all(|c| c.name != **name)) {
            return Err(wrong(format!("the hand has no actuator {name:?}; it has {}", known())));
        }
        let kept = |i: &usize| !names.contains(&self.coordinates[*i].name);
        let kept: Vec<usize> = (0..self.coordinates.len()).filter(kept).collect();
        if kept.is_empty() {
            return Err(wrong(format!("no actuator is left for the numbers; the hand has {}", known())));
        }
        Ok(HandActuators {
            coordinates: kept.iter().map(|&i| self.coordinates[i].clone()).collect(),
            holding: kept.iter().map(|&i| self.holding[i].clone()).collect(),
            actions: kept.iter().map(|&i| self.actions[i]).collect(),
            n_actions: self.n_actions,
        })
    }

    /// Returns the map from numbers, the slide's action last, to actions: the commands are `centre + numbers rows`.
    ///
    /// # Shapes
    /// For `n` coordinates: `centre` n, each of `rows` n, in the actuators' units.
    ///
    /// # Errors
    /// [`TrainError::Rl`] for numbers that are not finite.
    pub fn map_of_numbers(&self, centre: &[f64], rows: &[Vec<f64>]) -> Result<ActionMap, TrainError> {
        let n_outputs = rows.len() + 1;
        let mut matrix = vec![0.0f32; self.n_actions * n_outputs];
        let mut offset = vec![0.0f32; self.n_actions];
        for action in (0..self.n_actions).filter(|action| !self.actions.contains(action)) {
            matrix[action * n_outputs + rows.len()] = 1.0;
        }
        for ((i, &action), (middle, half)) in self.actions.iter().enumerate().zip(self.centre_and_half()) {
            if half > 0.0 {
                offset[action] = ((centre[i] - middle) / half) as f32;
                for (output, row) in rows.iter().enumerate() {
                    matrix[action * n_outputs + output] = (row[i] / half) as f32;
                }
            }
        }
        Ok(ActionMap::new(matrix, offset, n_outputs)?)
    }

    /// Returns the map that moves an action's commands towards their projection on an affine space: for `rest` = 0 onto it,
    /// for `rest` = 1 nowhere. The slide's action stays as it is.
    ///
    /// # Shapes
    /// For `n` coordinates: `mean` n, `rows` k orthonormal rows of n, in the actuators' units.
    ///
    /// # Errors
    /// [`TrainError::Rl`] for numbers that are not finite.
    pub fn confine(&self, mean: &[f64], rows: &[f64], rest: f64) -> Result<ActionMap, TrainError> {
        let (n, n_actions) = (self.coordinates.len(), self.n_actions);
        let scales: Vec<(f64, f64)> = self.centre_and_half().collect();
        let mut matrix = vec![0.0f32; n_actions * n_actions];
        let mut offset = vec![0.0f32; n_actions];
        for i in 0..n_actions {
            matrix[i * n_actions + i] = 1.0;
        }
        for (i, &action) in self.actions.iter().enumerate() {
            let (centre, half) = scales[i];
            if half <= 0.0 {
                continue;
            }
            let mut shift = mean[i] - centre;
            for j in 0..n {
                let onto: f64 = rows.chunks_exact(n).map(|row| row[i] * row[j]).sum();
                let same = if i == j { rest } else { 0.0 };
                let (other_centre, other_half) = scales[j];
                matrix[action * n_actions + self.actions[j]] = (same + (1.0 - rest) * onto * other_half / half) as f32;
                shift -= onto * (mean[j] - other_centre);
            }
            offset[action] = ((1.0 - rest) * shift / half) as f32;
        }
        Ok(ActionMap::new(matrix, offset, n_actions)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three actuators with ranges of their own; the slide has the second action.
    fn actuators() -> HandActuators {
        let coordinate = |(name, lower, upper): (&str, f64, f64)| JointInfo {
            name: name.to_owned(),
            unit: Unit::Radian,
            lower,
            upper,
        };
        let coordinates = [("a", -1.0, 3.0), ("b", 0.0, 0.5), ("c", 2.0, 2.5)].map(coordinate).to_vec();
        let holding = vec![Some((vec![2.0, 0.0], 0.1)), None, Some((vec![0.0, 1.0], 0.0))];
        HandActuators { coordinates, holding, actions: vec![0, 2, 3], n_actions: 4 }
    }

    const ACTIONS: [[f32; 4]; 3] = [[0.3, -0.7, 0.2, 0.9], [-1.0, 1.0, 0.0, 0.4], [0.1, 0.2, 0.8, -0.6]];

    fn mapped(map: &ActionMap, action: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; map.n_actions()];
        map.apply(action, &mut out);
        out
    }

    fn assert_near(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
    }

    #[test]
    fn confined_commands_are_as_far_outside_the_space_as_asked() {
        let hand = actuators();
        let (mean, row) = ([0.5, 0.3, 2.2], [0.6, 0.0, 0.8]);
        for rest in [0.0, 0.25, 1.0] {
            let map = hand.confine(&mean, &row, rest).unwrap();
            for action in ACTIONS {
                let commands = hand.commands(&action);
                let along: f64 = (0..3).map(|i| row[i] * (commands[i] - mean[i])).sum();
                let projected: Vec<f64> = (0..3).map(|i| mean[i] + along * row[i]).collect();
                let expected: Vec<f64> = (0..3).map(|i| projected[i] + rest * (commands[i] - projected[i])).collect();
                let found = mapped(&map, &action);
                assert_near(&hand.commands(&found), &expected);
                assert_eq!(found[1], action[1], "the slide is free");
            }
        }
        let constant = hand.confine(&mean, &[], 0.0).unwrap();
        ACTIONS.iter().for_each(|action| assert_near(&hand.commands(&mapped(&constant, action)), &mean));
    }

    #[test]
    fn numbers_command_what_the_rows_say_and_the_last_one_is_the_slides() {
        let hand = actuators();
        let (centre, rows) = ([0.5, 0.3, 2.2], [vec![0.6, 0.1, 0.8], vec![-0.2, 0.05, 0.1]]);
        let map = hand.map_of_numbers(&centre, &rows).unwrap();
        let action = mapped(&map, &[0.5, -1.0, 0.25]);
        let expected: Vec<f64> = (0..3).map(|i| centre[i] + 0.5 * rows[0][i] - rows[1][i]).collect();
        assert_near(&hand.commands(&action), &expected);
        assert_eq!(action[1], 0.25);
    }

    #[test]
    fn a_posture_is_held_by_its_own_commands() {
        assert_near(&actuators().commands_that_hold(&[0.3, 0.7], &[9.0, 0.4, 9.0]), &[0.7, 0.4, 0.7]);
    }

    #[test]
    fn actuators_that_are_left_out_are_free() {
        let hand = actuators().without(&["b".to_owned()]).unwrap();
        let map = hand.confine(&[0.5, 2.2], &[0.6, 0.8], 0.0).unwrap();
        for action in ACTIONS {
            let found = mapped(&map, &action);
            assert_eq!((found[1], found[2]), (action[1], action[2]));
            assert!(hand.commands(&found) != hand.commands(&action));
        }
        for (names, part) in [(vec!["d"], "has no actuator \"d\""), (vec!["a", "b", "c"], "no actuator is left")] {
            let names: Vec<String> = names.into_iter().map(str::to_owned).collect();
            let message = actuators().without(&names).unwrap_err().to_string();
            assert!(message.contains(part) && message.contains("a, b, c"), "{message}");
        }
    }
}
