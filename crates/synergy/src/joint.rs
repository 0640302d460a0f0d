//! Checks of postures and of their joints.

use std::collections::HashSet;

use eigenhand_posture::JointInfo;

use crate::SynergyError;

/// Checks that `joints` can name the columns of a posture.
///
/// # Errors
/// [`SynergyError::Joints`] when there is no joint, a name is empty or occurs twice, a limit is NaN, or a lower limit
/// is above its upper one.
pub(crate) fn check_joints(joints: &[JointInfo]) -> Result<(), SynergyError> {
    if joints.is_empty() {
        return Err(SynergyError::Joints { message: "a posture needs at least one joint".to_owned() });
    }
    check_coordinates(joints)
}

/// Checks the names and limits of a list of joints or actuators, which may be empty.
///
/// # Errors
/// As [`check_joints`].
pub(crate) fn check_coordinates(joints: &[JointInfo]) -> Result<(), SynergyError> {
    let fail = |message: String| Err(SynergyError::Joints { message });
    let mut seen = HashSet::new();
    for joint in joints {
        let JointInfo { name, lower, upper, .. } = joint;
        if name.is_empty() {
            return fail("a joint has an empty name".to_owned());
        }
        if !seen.insert(name.as_str()) {
            return fail(format!("the name {name:?} occurs twice"));
        }
        if lower.is_nan() || upper.is_nan() || lower > upper {
            return fail(format!("joint {name:?} has the limits [{lower}, {upper}]; expected lower <= upper"));
        }
    }
    Ok(())
}

/// Checks that `posture` has one finite number for each of `n_joints`.
pub(crate) fn check_posture(posture: &[f64], n_joints: usize, row: usize) -> Result<(), SynergyError> {
    if posture.len() != n_joints {
        return Err(SynergyError::PostureLength { row, expected: n_joints, got: posture.len() });
    }
    match posture.iter().position(|value| !value.is_finite()) {
        Some(column) => Err(SynergyError::NonFinitePosture { row, column, got: posture[column] }),
        None => Ok(()),
    }
}

/// Checks that two joint lists name the same coordinates: names and units in the same order (limits may differ).
pub(crate) fn check_same_joints(expected: &[JointInfo], got: &[JointInfo]) -> Result<(), SynergyError> {
    let same =
        expected.len() == got.len() && expected.iter().zip(got).all(|(a, b)| a.name == b.name && a.unit == b.unit);
    if same {
        return Ok(());
    }
    Err(SynergyError::JointMismatch { expected: describe(expected), got: describe(got) })
}

fn describe(joints: &[JointInfo]) -> String {
    let names: Vec<String> = joints.iter().map(|joint| format!("{:?} [{}]", joint.name, joint.unit)).collect();
    format!("{} joints: {}", joints.len(), names.join(", "))
}

#[cfg(test)]
mod tests {
    use eigenhand_posture::Unit;

    use super::*;

    fn joint(name: &str, lower: f64, upper: f64) -> JointInfo {
        JointInfo { name: name.to_owned(), unit: Unit::Radian, lower, upper }
    }

    #[test]
    fn bad_joint_lists_are_refused() {
        for (joints, part) in [
            (vec![], "at least one joint"),
            (vec![joint("", 0.0, 1.0)], "empty name"),
            (vec![joint("a", 0.0, 1.0), joint("a", 0.0, 1.0)], "occurs twice"),
            (vec![joint("a", 1.0, 0.0)], "lower <= upper"),
            (vec![joint("a", f64::NAN, 0.0)], "lower <= upper"),
        ] {
            let message = check_joints(&joints).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
        check_joints(&[joint("a", f64::NEG_INFINITY, f64::INFINITY), joint("A", 0.0, 0.0)]).unwrap();
    }
}
