//! Joints that follow another joint.

use std::path::Path;

use urdf_rs::Robot;

use super::finite::finite;
use super::joints::{Joint, Motion};
use crate::error::HandError;
use crate::notes::note;

/// `dependent = offset + multiplier * driver`.
#[derive(Debug)]
pub(super) struct Mimic {
    pub(super) dependent: usize,
    /// The joint at the end of the chain, which follows no other joint; none if it is fixed.
    pub(super) driver: Option<usize>,
    pub(super) offset: f64,
    pub(super) multiplier: f64,
}

/// Follows every `<mimic>` to a joint without one.
pub(super) fn resolve(
    robot: &Robot,
    joints: &[Joint],
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<Mimic>, HandError> {
    let mut mimics = Vec::new();
    for (dependent, joint) in robot.joints.iter().enumerate() {
        if joint.mimic.is_some() && joints[dependent].motion != Motion::Fixed {
            mimics.push(follow(robot, joints, dependent, file)?);
        }
    }
    let names: Vec<&str> = mimics.iter().map(|m| robot.joints[m.dependent].name.as_str()).collect();
    note(notes, "joints that follow another joint (`mimic`) and need no actuator", &names);
    Ok(mimics)
}

fn follow(robot: &Robot, joints: &[Joint], dependent: usize, file: &Path) -> Result<Mimic, HandError> {
    let mut found = Mimic { dependent, driver: Some(dependent), offset: 0.0, multiplier: 1.0 };
    let mut at = dependent;
    for _ in 0..=joints.len() {
        let Some(mimic) = robot.joints[at].mimic.as_ref().filter(|_| joints[at].motion != Motion::Fixed) else {
            if joints[at].motion == Motion::Fixed {
                found.offset += found.multiplier * joints[at].held_at;
                found.driver = None;
            }
            return Ok(found);
        };
        let place = format!("joint `{}` <mimic>", robot.joints[at].name);
        let values = [mimic.offset.unwrap_or(0.0), mimic.multiplier.unwrap_or(1.0)];
        let [offset, multiplier] = finite(&values, &place, file)?;
        found.offset += found.multiplier * offset;
        found.multiplier *= multiplier;
        at = robot.joints.iter().position(|j| j.name == mimic.joint).ok_or_else(|| {
            let known: Vec<&str> = robot.joints.iter().map(|j| j.name.as_str()).collect();
            let expected = format!("a joint (known joints: {})", known.join(", "));
            HandError::unresolved(file, &place, &expected, &mimic.joint, known.iter().copied())
        })?;
        found.driver = Some(at);
    }
    Err(HandError::model(
        file,
        format!("joint `{}` <mimic>", robot.joints[dependent].name),
        "a chain that ends at a joint without <mimic>",
        "a cycle",
    ))
}
