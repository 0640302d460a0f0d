//! The map from a posture to actuator commands.

use serde::{Deserialize, Serialize};

use crate::SynergyError;
use crate::pca::check_numbers;

/// The affine map `ctrl = clamp(matrix q + offset)`.
///
/// Actuators are not joints: one may drive several coupled joints, and then commands, say, their sum.
///
/// # Shapes
/// For `nu` actuators and `n` joints: `matrix` nu x n, all else nu.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ActuationMap {
    /// The actuators' names, in the order of a command's numbers.
    pub actuators: Vec<String>,
    /// The least command of each actuator; `-inf` for one without a limit.
    pub control_min: Vec<f64>,
    /// The greatest command of each actuator; `inf` for one without a limit.
    pub control_max: Vec<f64>,
    /// The command's change with each joint's coordinate.
    pub matrix: Vec<Vec<f64>>,
    /// The command at the posture of zeros.
    pub offset: Vec<f64>,
}

impl ActuationMap {
    /// Returns the commands that hold `posture`, clamped to the actuators' ranges.
    ///
    /// # Panics
    /// When `posture` has not one number for each column of the matrix.
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

    /// Checks every length and number against the number of joints.
    ///
    /// # Errors
    /// [`SynergyError::Invalid`], which names the field.
    pub fn validate(&self, n_joints: usize) -> Result<(), SynergyError> {
        let nu = self.actuators.len();
        check_numbers("actuation.offset", &self.offset, nu)?;
        for (name, length) in [
            ("actuation.control_min", self.control_min.len()),
            ("actuation.control_max", self.control_max.len()),
            ("actuation.matrix", self.matrix.len()),
        ] {
            if length != nu {
                let expected = format!("{nu}, one for each actuator");
                return Err(SynergyError::invalid(format!("length of {name}"), expected, length));
            }
        }
        for (i, row) in self.matrix.iter().enumerate() {
            check_numbers(&format!("actuation.matrix[{i}]"), row, n_joints)?;
        }
        for (i, (low, high)) in self.control_min.iter().zip(&self.control_max).enumerate() {
            // Written so that a NaN fails too.
            let ordered = low <= high;
            if !ordered {
                let expected = format!("at most actuation.control_max[{i}] = {high}");
                return Err(SynergyError::invalid(format!("actuation.control_min[{i}]"), expected, low));
            }
        }
        Ok(())
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
        map().validate(3).unwrap();
        assert_eq!(map().control(&[0.25, 1.0, 2.0]), [0.75, 3.0]);
        assert_eq!(map().control(&[9.0, 0.0, 0.0]), [1.0, 0.0]);
        assert_eq!(map().control(&[-9.0, 0.0, -50.0]), [-1.0, -50.0]);
    }

    #[test]
    fn wrong_shapes_are_named() {
        let mut wrong = map();
        wrong.matrix[1].pop();
        assert!(wrong.validate(3).unwrap_err().to_string().contains("actuation.matrix[1]"));
        let mut wrong = map();
        wrong.control_min[1] = f64::NAN;
        assert!(wrong.validate(3).unwrap_err().to_string().contains("control_min[1]"));
        let mut wrong = map();
        wrong.control_max.pop();
        assert!(wrong.validate(3).unwrap_err().to_string().contains("length of actuation.control_max"));
        let mut wrong = map();
        wrong.offset[0] = f64::INFINITY;
        assert!(wrong.validate(3).unwrap_err().to_string().contains("actuation.offset[0]"));
    }
}
