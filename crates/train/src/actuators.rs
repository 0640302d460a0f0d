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
        HandActuators { coordinates: actions.iter().map(coordinate).collect(), actions, n_actions: task.action_len() }
    }

    fn centre_and_half(&self) -> impl Iterator<Item = (f64, f64)> {
        self.coordinates.iter().map(|c| ((c.upper + c.lower) / 2.0, (c.upper - c.lower) / 2.0))
    }

    /// (action) => commands in the actuators' units, beyond their ranges where the action is beyond [-1, 1]
    pub fn commands(&self, action: &[f32]) -> Vec<f64> {
        let scaled = self.actions.iter().zip(self.centre_and_half());
        scaled.map(|(&i, (centre, half))| centre + half * f64::from(action[i])).collect()
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
