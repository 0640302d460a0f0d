//! Actuators for a model that has none; control ranges, bounds, damping and armature for all.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_posture::Unit;
use xmltree::Element;

use super::imported::Imported;
use crate::error::HandError;
use crate::mjcf::{Defaults, of_each_joint, section};
use crate::model::Joints;
use crate::parts::Transmission;
use crate::servo;
use crate::xml::{append, element, elements_mut, numbers, set};

mod added;
mod bounds;
mod carriers;
mod drives;
mod dynamics;
mod steady;

use bounds::Bounds;

/// Torque limit of a hinge (N m) and force limit of a slide (N) if the file states none that is plausible for a finger.
const TORQUE: f64 = 1.0;
const FORCE: f64 = 20.0;
/// Plausible efforts of a finger (N m, N); others are placeholders or belong to an arm.
const TORQUES: [f64; 2] = [0.05, 5.0];
const FORCES: [f64; 2] = [1.0, 200.0];
/// Torque limit of a joint that carries several fingers, such as a wrist, and its plausible efforts (N m).
const CARRIER_TORQUE: f64 = 10.0;
const CARRIER_TORQUES: [f64; 2] = [0.05, 50.0];
/// Position error at which a servo reaches its force limit (rad, m).
const HINGE_ERROR: f64 = 0.3;
const SLIDE_ERROR: f64 = 0.01;
/// Time constant (s) of a servo against its joint's damping, long against the simulation's step.
const TIME_CONSTANT: f64 = 0.06;
/// Least armature of a hinge (kg m2) and of a slide (kg).
const LEAST_ARMATURES: [f64; 2] = [1e-3, 0.02];
/// Half of the range of a servo on a joint without limits (rad, m).
const TURN: f64 = std::f64::consts::PI;
const TRAVEL: f64 = 0.1;

/// Completes a model: servos if it has no actuator, control ranges for actuators without one, bounds for its servos,
/// and damping and armature if servos were added or no joint has damping.
pub(super) fn complete(imported: &mut Imported, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    if Joints::read(&imported.model, file)?.0.is_empty() {
        return Err(HandError::model(file, "the model", "at least one joint that turns or slides", "none"));
    }
    let mut bounds = Bounds::default();
    if section(&imported.model, "actuator").next().is_none() {
        added::add(imported, file, notes)?;
        steady::steady(&mut imported.model, file, notes)?;
    } else {
        let model = &mut imported.model;
        control_ranges(model, file, notes)?;
        bounds.limit_forces(model, file)?;
        let is_passive = |name: &String| imported.passive.contains(name);
        if damping(model, file)?.iter().all(|(name, value)| *value <= 0.0 || is_passive(name)) {
            steady::steady(model, file, notes)?;
        }
    }
    bounds.limit_speeds(&mut imported.model, file)?;
    bounds.soften_constraints(&mut imported.model);
    bounds.finish(notes);
    integrate_implicitly(&mut imported.model, file)
}

/// States the integrator that keeps velocity feedback of servos steady, if there is any.
fn integrate_implicitly(root: &mut Element, file: &Path) -> Result<(), HandError> {
    if drives::drives(root, file)?.iter().flatten().any(|drive| drive.feedback > 0.0) {
        append(root, element("option", &[("integrator", "implicit".to_owned())]));
    }
    Ok(())
}

/// Reads the damping of each joint.
fn damping(root: &mut Element, file: &Path) -> Result<BTreeMap<String, f64>, HandError> {
    let defaults = Defaults::read(root, file)?;
    of_each_joint(root, &defaults, "damping", file)
}

/// Gives actuators without a control range one: the range that covers the whole joint, or a guess.
fn control_ranges(root: &mut Element, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    let defaults = Defaults::read(root, file)?;
    let joints = Joints::read(root, file)?.0;
    let mut made = Vec::new();
    for section in elements_mut(root).filter(|e| e.name == "actuator") {
        for actuator in elements_mut(section) {
            let resolved = defaults.resolve(actuator, None, file)?;
            if resolved.limits("ctrlrange", "ctrllimited")?.is_some() {
                continue;
            }
            let servo = servo::read(&actuator.name, &resolved)?;
            let gear = resolved.number("gear")?.unwrap_or(1.0);
            let target = resolved.text("joint").or(resolved.text("jointinparent"));
            let joint = target.and_then(|name| joints.iter().find(|joint| joint.name == name));
            let computed =
                target.and_then(|name| servo::reach(&joints, &Transmission::Joint(name.to_owned()), gear, servo));
            let (low, high) = match (computed, resolved.limits("forcerange", "forcelimited")?, servo, joint) {
                (Some(range), ..) => range,
                (None, _, Some(_), Some(joint)) if joint.unit == Unit::Radian => (-TURN, TURN),
                (None, _, Some(_), Some(_)) => (-TRAVEL, TRAVEL),
                (None, Some((low, high)), None, _) if gear != 0.0 => (low / gear.abs(), high / gear.abs()),
                _ => (-1.0, 1.0),
            };
            set(actuator, "ctrllimited", "true");
            set(actuator, "ctrlrange", numbers(&[low, high]));
            if computed.is_none() {
                made.push(actuator.attributes.get("name").cloned().unwrap_or_default());
            }
        }
    }
    if !made.is_empty() {
        notes.push(format!("actuators without a control range got a guessed one, check it: {}", made.join(", ")));
    }
    Ok(())
}

fn round(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}
