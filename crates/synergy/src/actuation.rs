//! Checks of the map from a posture to actuator commands.

use eigenhand_posture::ActuationMap;

use crate::SynergyError;
use crate::pca::check_numbers;

/// Checks every length and every number of a map; `n_joints` is the number of joints.
///
/// # Errors
/// [`SynergyError::Invalid`], which names the field.
pub(crate) fn check_actuation(map: &ActuationMap, n_joints: usize) -> Result<(), SynergyError> {
    let nu = map.actuators.len();
    check_numbers("actuation.offset", &map.offset, nu)?;
    for (name, length) in [
        ("actuation.control_min", map.control_min.len()),
        ("actuation.control_max", map.control_max.len()),
        ("actuation.matrix", map.matrix.len()),
    ] {
        if length != nu {
            let expected = format!("{nu}, one for each actuator");
            return Err(SynergyError::invalid(format!("length of {name}"), expected, length));
        }
    }
    for (i, row) in map.matrix.iter().enumerate() {
        check_numbers(&format!("actuation.matrix[{i}]"), row, n_joints)?;
    }
    for (i, (low, high)) in map.control_min.iter().zip(&map.control_max).enumerate() {
        // A NaN fails too.
        let ordered = low <= high;
        if !ordered {
            let expected = format!("at most actuation.control_max[{i}] = {high}");
            return Err(SynergyError::invalid(format!("actuation.control_min[{i}]"), expected, low));
        }
    }
    Ok(())
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
    fn wrong_shapes_are_named() {
        let mut wrong = map();
        wrong.matrix[1].pop();
        assert!(check_actuation(&wrong, 3).unwrap_err().to_string().contains("actuation.matrix[1]"));
        let mut wrong = map();
        wrong.control_min[1] = f64::NAN;
        assert!(check_actuation(&wrong, 3).unwrap_err().to_string().contains("control_min[1]"));
        let mut wrong = map();
        wrong.control_max.pop();
        assert!(check_actuation(&wrong, 3).unwrap_err().to_string().contains("length of actuation.control_max"));
        let mut wrong = map();
        wrong.offset[0] = f64::INFINITY;
        assert!(check_actuation(&wrong, 3).unwrap_err().to_string().contains("actuation.offset[0]"));
    }
}
