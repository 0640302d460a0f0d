//! The hand's actuators, without the slide that stands for the arm.

use eigenhand_hands::Hand;
use eigenhand_rl::ActionMap;
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{JointInfo, Synergy};

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
    /// Names of the joints that they do not move, such as that of the slide.
    pub free: Vec<String>,
}

impl HandActuators {
    /// Returns the actuators of a hand.
    pub fn of(hand: &Hand, task: &GraspTask) -> HandActuators {
        let actuation = hand.actuation();
        let slide = task.slide_action();
        let actions: Vec<usize> = (0..task.action_len()).filter(|&i| i != slide).collect();
        let coordinate = |(&i, coordinate): (&usize, JointInfo)| {
            let (lower, upper) = task.control_ranges[i];
            JointInfo { lower, upper, ..coordinate }
        };
        let holding = |&i: &usize| {
            let (row, offset) = (&actuation.matrix[i], actuation.offset[i]);
            row.iter().any(|weight| *weight != 0.0).then(|| (row.clone(), offset))
        };
        let is_slide = |i: usize| task.posture_joints[i].name == hand.manifest.slide.name;
        HandActuators {
            coordinates: actions.iter().zip(hand.command_coordinates()).map(coordinate).collect(),
            holding: actions.iter().map(holding).collect(),
            actions,
            n_actions: task.action_len(),
            open: hand.open_posture_vector().into_iter().enumerate().filter(|(i, _)| !is_slide(*i)).collect(),
            free: hand.joints_free_of(hand.actuators.iter().map(|actuator| actuator.name.as_str())),
        }
    }

    /// Returns the index of each in an action.
    pub fn actions(&self) -> &[usize] {
        &self.actions
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
            free: self.free.clone(),
        })
    }

    /// Returns the map from a policy's outputs to actions: `k` numbers, the slide's action, and, if `rest` is above 0, the
    /// action of every coordinate, of which the part outside the space is added with the factor `rest`.
    ///
    /// A number goes from the lowest to the highest value of the space's samples while its output goes from -1 to 1. Only
    /// the first `used` outputs of the `k` have an effect; the other numbers are 0.
    ///
    /// # Errors
    /// [`TrainError::Rl`] for numbers that are not finite.
    pub fn act_in(&self, space: &Synergy, [used, k]: [usize; 2], rest: f64) -> Result<ActionMap, TrainError> {
        let n = self.coordinates.len();
        let n_outputs = k + 1 + if rest > 0.0 { n } else { 0 };
        let mut matrix = vec![0.0f32; self.n_actions * n_outputs];
        let mut offset = vec![0.0f32; self.n_actions];
        for action in (0..self.n_actions).filter(|action| !self.actions.contains(action)) {
            matrix[action * n_outputs + k] = 1.0;
        }
        let range = |c: usize| (space.coefficient_min()[c], space.coefficient_max()[c]);
        let scales: Vec<(f64, f64)> = self.centre_and_half().collect();
        for (i, &action) in self.actions.iter().enumerate().filter(|(i, _)| scales[*i].1 > 0.0) {
            let (centre, half) = scales[i];
            let row = &mut matrix[action * n_outputs..][..n_outputs];
            let mut command = space.mean()[i];
            for (c, out) in row.iter_mut().enumerate().take(used) {
                let ((low, high), weight) = (range(c), space.component(c)[i]);
                *out = (weight * (high - low) / 2.0 / half) as f32;
                command += weight * (high + low) / 2.0;
            }
            // The part of the rest that lies outside the space.
            for (j, out) in row.iter_mut().skip(k + 1).enumerate() {
                let inside: f64 = (0..k).map(|c| space.component(c)[i] * space.component(c)[j]).sum();
                let outside = rest * (if i == j { 1.0 } else { 0.0 } - inside);
                *out = (outside * scales[j].1 / half) as f32;
                command += outside * (scales[j].0 - space.mean()[j]);
            }
            offset[action] = ((command - centre) / half) as f32;
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
        let n_actions = self.n_actions;
        let scales: Vec<(f64, f64)> = self.centre_and_half().collect();
        let mut matrix = vec![0.0f32; n_actions * n_actions];
        let mut offset = vec![0.0f32; n_actions];
        for i in 0..n_actions {
            matrix[i * n_actions + i] = 1.0;
        }
        for (i, &action) in self.actions.iter().enumerate().filter(|(i, _)| scales[*i].1 > 0.0) {
            let (centre, half) = scales[i];
            let mut command = mean[i];
            for (j, &other) in self.actions.iter().enumerate() {
                let weight: f64 = rows.chunks_exact(self.coordinates.len()).map(|row| row[i] * row[j]).sum();
                matrix[action * n_actions + other] = (weight * scales[j].1 / half) as f32;
                command += weight * (scales[j].0 - mean[j]);
            }
            offset[action] = ((command - centre) / half) as f32;
        }
        Ok(ActionMap::new(matrix, offset, n_actions)?)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use eigenhand_synergy::Unit;

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
        HandActuators {
            coordinates,
            holding,
            actions: vec![0, 2, 3],
            n_actions: 4,
            open: vec![(1, 0.5)],
            free: vec!["s".to_owned()],
        }
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
    fn numbers_fill_the_range_of_the_samples_and_the_rest_lies_outside_the_space() {
        let hand = actuators();
        let samples = [[0.0, 0.1, 2.1], [2.0, 0.3, 2.4], [1.0, 0.4, 2.2], [0.5, 0.2, 2.3]];
        let space = Synergy::fit(&hand.coordinates, &samples, 2).unwrap();
        let [low, high] = [space.coefficient_min(), space.coefficient_max()];
        let outputs = [[0.5, -0.25], [1.0, -1.0], [-1.0, 0.75]];
        for used in [1, 2] {
            let map = hand.act_in(&space, [used, 2], 0.0).unwrap();
            for [first, second] in outputs {
                let action = mapped(&map, &[first, second, 0.25]);
                let number = |i: usize, output: f32| low[i] + (high[i] - low[i]) * (f64::from(output) + 1.0) / 2.0;
                let expected = [number(0, first), if used == 2 { number(1, second) } else { 0.0 }];
                assert_near(&hand.commands(&action), &space.decode(&expected));
                assert_eq!(action[1], 0.25, "the slide is free");
            }
        }
        for (action, rest) in ACTIONS.iter().zip([0.25, 0.5, 1.0]) {
            let free = [action[0], action[2], action[3]];
            let map = hand.act_in(&space, [2, 2], rest).unwrap();
            let found = hand.commands(&mapped(&map, &[&[0.5, -0.25, action[1]], &free[..]].concat()));
            let within = hand.commands(&mapped(&hand.act_in(&space, [2, 2], 0.0).unwrap(), &[0.5, -0.25, action[1]]));
            let commands = hand.commands(action);
            let inside = space.decode(&space.encode(&commands));
            let expected: Vec<f64> = (0..3).map(|i| within[i] + rest * (commands[i] - inside[i])).collect();
            assert_near(&found, &expected);
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
