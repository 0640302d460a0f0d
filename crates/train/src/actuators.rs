//! The hand's actuators, without the slide that stands for the arm.

use eigenhand_hands::Hand;
use eigenhand_rl::ActionMap;
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{JointInfo, Synergy, Unit};

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
    /// Indices in a posture and open positions of the hand's joints, without the slide.
    open: Vec<(usize, f64)>,
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
        let is_slide = |i: usize| task.posture_joints[i].name == hand.manifest.slide.name;
        HandActuators {
            coordinates: actions.iter().map(coordinate).collect(),
            holding: actions.iter().map(holding).collect(),
            actions,
            n_actions: task.action_len(),
            open: hand.open_posture_vector().into_iter().enumerate().filter(|(i, _)| !is_slide(*i)).collect(),
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

    /// (posture) => the squared distance of the hand's joints to the open hand
    pub fn distance_to_open(&self, posture: &[f64]) -> f64 {
        self.open.iter().map(|&(i, open)| (posture[i] - open) * (posture[i] - open)).sum()
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
            open: self.open.clone(),
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

    /// Returns the map that projects an action's commands on an affine space. The slide's action stays as it is.
    ///
    /// # Shapes
    /// For `n` coordinates: `mean` n, `rows` k orthonormal rows of n, in the actuators' units.
    ///
    /// # Errors
    /// [`TrainError::Rl`] for numbers that are not finite.
    pub fn project(&self, mean: &[f64], rows: &[f64]) -> Result<ActionMap, TrainError> {
        let numbers = rows.chunks_exact(self.coordinates.len()).map(|row| {
            let from_mean: f64 =
                row.iter().zip(self.centre_and_half()).zip(mean).map(|((c, (u, _)), m)| c * (u - m)).sum();
            Number { row, middle: from_mean, scale: 1.0 }
        });
        self.mix(0.0, mean, &numbers.collect::<Vec<_>>())
    }

    /// Returns the map that moves an action's commands towards the first `k` numbers of a space, each in the range of the
    /// space's samples: for `rest` = 0 there are only these numbers, for `rest` = 1 the commands stay. The slide's action
    /// stays as it is.
    ///
    /// Number `i` is `middle + scale c (u - centre)` for the commands `u`, with the component `c`, the middle of the samples'
    /// range, and the middle `centre` of the actuators' ranges. With `scale`, at most 1, all commands together give no more
    /// than that range.
    ///
    /// # Errors
    /// [`TrainError::Rl`] for numbers that are not finite.
    pub fn confine(&self, space: &Synergy, k: usize, rest: f64) -> Result<ActionMap, TrainError> {
        let numbers = (0..k).map(|i| {
            let (row, low, high) = (space.component(i), space.coefficient_min()[i], space.coefficient_max()[i]);
            let reach: f64 = row.iter().zip(self.centre_and_half()).map(|(c, (_, half))| c.abs() * half).sum();
            let scale = if reach > 0.0 { ((high - low) / 2.0 / reach).min(1.0) } else { 1.0 };
            Number { row, middle: (low + high) / 2.0, scale }
        });
        self.mix(rest, space.mean(), &numbers.collect::<Vec<_>>())
    }

    /// Returns the map to the commands `rest u + (1 - rest) (mean + numbers rows)`.
    fn mix(&self, rest: f64, mean: &[f64], numbers: &[Number]) -> Result<ActionMap, TrainError> {
        let n_actions = self.n_actions;
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
            for (j, &other) in self.actions.iter().enumerate() {
                let linear: f64 = numbers.iter().map(|number| number.scale * number.row[i] * number.row[j]).sum();
                let same = if i == j { rest } else { 0.0 };
                matrix[action * n_actions + other] = (same + (1.0 - rest) * linear * scales[j].1 / half) as f32;
            }
            let middle: f64 = mean[i] + numbers.iter().map(|number| number.middle * number.row[i]).sum::<f64>();
            offset[action] = ((1.0 - rest) * (middle - centre) / half) as f32;
        }
        Ok(ActionMap::new(matrix, offset, n_actions)?)
    }
}

/// A number `middle + scale row (u - centre)` that commands `u` give, with the middle `centre` of the actuators' ranges.
struct Number<'a> {
    row: &'a [f64],
    middle: f64,
    scale: f64,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Three actuators with ranges of their own; the slide has the second action. The hand has the second joint of two, and
    /// is open at 0.5.
    pub(crate) fn actuators() -> HandActuators {
        let coordinate = |(name, lower, upper): (&str, f64, f64)| JointInfo {
            name: name.to_owned(),
            unit: Unit::Radian,
            lower,
            upper,
        };
        let coordinates = [("a", -1.0, 3.0), ("b", 0.0, 0.5), ("c", 2.0, 2.5)].map(coordinate).to_vec();
        let holding = vec![Some((vec![2.0, 0.0], 0.1)), None, Some((vec![0.0, 1.0], 0.0))];
        HandActuators { coordinates, holding, actions: vec![0, 2, 3], n_actions: 4, open: vec![(1, 0.5)] }
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
    fn confined_commands_are_as_far_outside_the_space_as_asked_and_fill_the_range_of_its_samples() {
        let hand = actuators();
        let samples = [[0.0, 0.1, 2.1], [2.0, 0.3, 2.4], [1.0, 0.4, 2.2], [0.5, 0.2, 2.3]];
        let space = Synergy::fit(&hand.coordinates, &samples, 2).unwrap();
        // The numbers after the first `k` are 0.
        let numbers = |commands: &[f64], k: usize| -> Vec<f64> {
            space.encode(commands).into_iter().enumerate().map(|(i, z)| if i < k { z } else { 0.0 }).collect()
        };
        let [low, high] = [space.coefficient_min(), space.coefficient_max()];
        for k in [1, 2] {
            let confined = hand.confine(&space, k, 0.0).unwrap();
            for action in ACTIONS {
                let all = hand.commands(&mapped(&confined, &action));
                assert_near(&space.decode(&numbers(&all, k)), &all);
                assert!(
                    numbers(&all, k).iter().take(k).enumerate().all(|(i, z)| (low[i]..=high[i]).contains(z)),
                    "{all:?}"
                );
                for rest in [0.25, 1.0] {
                    let found = mapped(&hand.confine(&space, k, rest).unwrap(), &action);
                    let free = hand.commands(&action).into_iter().zip(&all);
                    let expected: Vec<f64> = free.map(|(free, all)| rest * free + (1.0 - rest) * all).collect();
                    assert_near(&hand.commands(&found), &expected);
                    assert_eq!(found[1], action[1], "the slide is free");
                }
            }
            // The actions that move each actuator towards a component give the end of the range.
            for i in 0..k {
                for (sign, end) in [(1.0, high[i]), (-1.0, low[i])] {
                    let toward = |j: usize| sign * space.component(i)[j].signum() as f32;
                    let found = hand.commands(&mapped(&confined, &[toward(0), 0.0, toward(1), toward(2)]));
                    assert!((space.encode(&found)[i] - end).abs() < 1e-4, "{i}: {found:?} {end}");
                }
            }
        }
    }

    #[test]
    fn projected_commands_lie_in_the_space() {
        let hand = actuators();
        let (mean, row) = ([0.5, 0.3, 2.2], [0.6, 0.0, 0.8]);
        let map = hand.project(&mean, &row).unwrap();
        for action in ACTIONS {
            let commands = hand.commands(&action);
            let along: f64 = (0..3).map(|i| row[i] * (commands[i] - mean[i])).sum();
            let expected: Vec<f64> = (0..3).map(|i| mean[i] + along * row[i]).collect();
            let found = mapped(&map, &action);
            assert_near(&hand.commands(&found), &expected);
            assert_eq!(found[1], action[1], "the slide is free");
        }
        let constant = hand.project(&mean, &[]).unwrap();
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
        let map = hand.project(&[0.5, 2.2], &[0.6, 0.8]).unwrap();
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
