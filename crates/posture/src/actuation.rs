//! The map from a posture to the actuator commands that hold it.

use serde::{Deserialize, Serialize};

/// The affine map `ctrl = clamp(matrix q + offset)`. An actuator that holds no position has a row of zeros.
///
/// Actuators are not joints: an actuator may drive several coupled joints and command, for example, their sum.
///
/// # Shapes
/// For `nu` actuators and `n` joints: `matrix` nu x n, all other fields nu.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ActuationMap {
    /// The actuators' names, in the order of a command's numbers.
    pub actuators: Vec<String>,
    /// The least command of each actuator; `-inf` for one without a limit.
    pub control_min: Vec<f64>,
    /// The greatest command of each actuator; `inf` for one without a limit.
    pub control_max: Vec<f64>,
    /// The change of each command with each joint's coordinate.
    pub matrix: Vec<Vec<f64>>,
    /// The commands at the posture of zeros.
    pub offset: Vec<f64>,
}

impl ActuationMap {
    /// Returns the commands that hold `posture`, clamped to the actuators' ranges.
    ///
    /// # Panics
    /// When `posture` does not have one number for each column of the matrix.
    pub fn control(&self, posture: &[f64]) -> Vec<f64> {
        let ranges = self.control_min.iter().zip(&self.control_max);
        self.matrix
            .iter()
            .zip(&self.offset)
            .zip(ranges)
            .map(|((row, offset), (low, high))| {
                assert_eq!(posture.len(), row.len(), "one number for each joint is needed");
                (row.iter().zip(posture).map(|(a, q)| a * q).sum::<f64>() + offset).clamp(*low, *high)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> ActuationMap {
        ActuationMap {
            actuators: vec!["single".to_owned(), "coupled".to_owned()],
            control_min: vec![-1.0, f64::NEG_INFINITY],
            control_max: vec![1.0, f64::INFINITY],
            matrix: vec![vec![1.0, 0.0, 0.0], vec![0.0, 1.0, 1.0]],
            offset: vec![0.5, 0.0],
        }
    }

    #[test]
    fn commands_are_affine_and_clamped() {
        assert_eq!(map().control(&[0.25, 1.0, 2.0]), [0.75, 3.0]);
        assert_eq!(map().control(&[9.0, 0.0, 0.0]), [1.0, 0.0]);
        assert_eq!(map().control(&[-9.0, 0.0, -50.0]), [-1.0, -50.0]);
    }
}
