//! Servos for a model without actuators.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use eigenhand_posture::Unit;
use xmltree::Element;

use super::carriers::carriers;
use super::{
    CARRIER_TORQUE, CARRIER_TORQUES, FORCE, FORCES, HINGE_ERROR, SLIDE_ERROR, TIME_CONSTANT, TORQUE, TORQUES, TRAVEL,
    TURN, damping, dynamics, round,
};
use crate::error::HandError;
use crate::import::imported::Imported;
use crate::mjcf::section;
use crate::model::Joints;
use crate::notes::note;
use crate::parts::HandJoint;
use crate::xml::{append, element, numbers};

/// An effort that means nothing, for a slide (N): makers write it where their format demands a number.
const PLACEHOLDER: f64 = 1.0;
/// Force of a servo that carries fingers, as a multiple of the weight that it bears.
const RESERVE: f64 = 1.5;

/// Adds a position servo to every joint that follows no other.
pub(super) fn add(imported: &mut Imported, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    let dependent: BTreeSet<&String> = section(&imported.model, "equality")
        .filter(|e| e.name == "joint" && e.attributes.contains_key("joint2"))
        .filter_map(|e| e.attributes.get("joint1"))
        .collect();
    let joints: Vec<HandJoint> = Joints::read(&imported.model, file)?.0;
    let driven: Vec<&HandJoint> = joints.iter().filter(|joint| !dependent.contains(&joint.name)).collect();
    let carriers = carriers(&imported.model, file)?;
    let mut forces = BTreeMap::new();
    let (mut stated, mut assumed, mut raised) = (0, 0, Vec::new());
    for joint in &driven {
        let effort = imported.efforts.get(&joint.name);
        let (mut force, most) = match (joint.unit, carriers.contains_key(&joint.name)) {
            (Unit::Radian, false) => (limit(effort, TORQUES, TORQUE), TORQUES[1]),
            (Unit::Radian, true) => (limit(effort, CARRIER_TORQUES, CARRIER_TORQUE), CARRIER_TORQUES[1]),
            (Unit::Metre, _) => (limit(effort.filter(|effort| **effort != PLACEHOLDER), FORCES, FORCE), FORCES[1]),
        };
        if effort == Some(&force) {
            stated += 1
        } else {
            assumed += 1
        }
        let weight = carriers.get(&joint.name).map_or(0.0, |weight| (RESERVE * weight).min(most));
        if weight > force {
            force = round(weight);
            raised.push(&joint.name);
        }
        forces.insert(joint.name.clone(), force);
    }
    dynamics::bound(&mut imported.model, &joints, &forces, &imported.velocities, file, notes)?;
    let damping = damping(&mut imported.model, file)?;
    let mut actuators = Element::new("actuator");
    for joint in &driven {
        let (error, half) = match joint.unit {
            Unit::Radian => (HINGE_ERROR, TURN),
            Unit::Metre => (SLIDE_ERROR, TRAVEL),
        };
        let force = forces.get(&joint.name).copied().unwrap_or(TORQUE);
        let (low, high) = joint.range().unwrap_or((-half, half));
        // With much damping, a soft servo would not reach its command within an episode.
        let kp = (force / error).max(damping.get(&joint.name).copied().unwrap_or(0.0) / TIME_CONSTANT);
        let attributes = [
            ("name", joint.name.clone()),
            ("joint", joint.name.clone()),
            ("kp", round(kp).to_string()),
            ("ctrllimited", "true".to_owned()),
            ("ctrlrange", numbers(&[low, high])),
            ("forcelimited", "true".to_owned()),
            ("forcerange", numbers(&[-force, force])),
        ];
        append(&mut actuators, element("position", &attributes));
    }
    let n = actuators.children.len();
    notes.push(format!(
        "the file has no actuators: {n} position servos were added, {stated} with the file's effort as force limit, \
         {assumed} with {TORQUE} N m (slides: {FORCE} N; joints that carry several fingers: {CARRIER_TORQUE} N m)"
    ));
    note(notes, "the force limit was raised so that the joint carries its fingers, at the joints", &raised);
    append(&mut imported.model, actuators);
    Ok(())
}

fn limit(effort: Option<&f64>, [least, most]: [f64; 2], usual: f64) -> f64 {
    effort.copied().filter(|effort| (least..=most).contains(effort)).unwrap_or(usual)
}
