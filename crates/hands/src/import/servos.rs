//! Actuators, damping and control ranges for a model that has none.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use eigenhand_posture::Unit;
use xmltree::Element;

use super::imported::Imported;
use crate::error::HandError;
use crate::mjcf::{Defaults, each_in_world, section};
use crate::model::Joints;
use crate::parts::Transmission;
use crate::servo;
use crate::xml::{append, element, elements_mut, numbers, set};

/// Torque limit of a hinge (N m) and force limit of a slide (N) if the file states none that is plausible for a finger.
const TORQUE: f64 = 1.0;
const FORCE: f64 = 20.0;
/// Plausible efforts of a finger (N m, N); others are placeholders or belong to an arm.
const TORQUES: [f64; 2] = [0.05, 5.0];
const FORCES: [f64; 2] = [1.0, 200.0];
/// Position error at which a servo reaches its force limit (rad, m).
const HINGE_ERROR: f64 = 0.3;
const SLIDE_ERROR: f64 = 0.01;
/// Time constant (s) of a servo against its joint's damping, long against the simulation's step.
const TIME_CONSTANT: f64 = 0.06;
/// Damping of a hinge (N m s) and of a slide (N s/m) without a servo.
const FREE_HINGE_DAMPING: f64 = 0.02;
const FREE_SLIDE_DAMPING: f64 = 5.0;
/// Rotor inertia (kg m2) or mass (kg) for each N m/rad or N/m of stiffness, in s2: the servo's frequency, 5 Hz, stays
/// far below the step's.
const ARMATURE: f64 = 1e-3;
/// Least armature of a hinge (kg m2) and of a slide (kg).
const LEAST_ARMATURES: [f64; 2] = [1e-3, 0.02];
/// Half of the range of a servo on a joint without limits (rad, m).
const TURN: f64 = std::f64::consts::PI;
const TRAVEL: f64 = 0.1;

/// Completes a model: servos if it has no actuator, control ranges for actuators without one, and damping and armature
/// if servos were added or no joint has damping.
pub(super) fn complete(imported: &mut Imported, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    if Joints::read(&imported.model, file)?.0.is_empty() {
        return Err(HandError::model(file, "the model", "at least one joint that turns or slides", "none"));
    }
    if section(&imported.model, "actuator").next().is_none() {
        add(imported, file, notes)?;
        return steady(&mut imported.model, file, notes);
    }
    control_ranges(&mut imported.model, file, notes)?;
    if damping(&mut imported.model, file)?.values().all(|value| *value <= 0.0) {
        steady(&mut imported.model, file, notes)?;
    }
    Ok(())
}

fn limit(effort: Option<&f64>, [least, most]: [f64; 2], usual: f64) -> f64 {
    effort.copied().filter(|effort| (least..=most).contains(effort)).unwrap_or(usual)
}

fn add(imported: &mut Imported, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    let joints = Joints::read(&imported.model, file)?;
    let damping = damping(&mut imported.model, file)?;
    let dependent: BTreeSet<&String> = section(&imported.model, "equality")
        .filter(|e| e.name == "joint" && e.attributes.contains_key("joint2"))
        .filter_map(|e| e.attributes.get("joint1"))
        .collect();
    let mut actuators = Element::new("actuator");
    let (mut stated, mut assumed) = (0, 0);
    for joint in joints.0.iter().filter(|joint| !dependent.contains(&joint.name)) {
        let effort = imported.efforts.get(&joint.name);
        let (force, error, half) = match joint.unit {
            Unit::Radian => (limit(effort, TORQUES, TORQUE), HINGE_ERROR, TURN),
            Unit::Metre => (limit(effort, FORCES, FORCE), SLIDE_ERROR, TRAVEL),
        };
        if effort == Some(&force) {
            stated += 1
        } else {
            assumed += 1
        }
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
    append(&mut imported.model, actuators);
    notes.push(format!(
        "the file has no actuators: {n} position servos were added, {stated} with the file's effort as force limit, \
         {assumed} with {TORQUE} N m (slides: {FORCE} N)"
    ));
    Ok(())
}

/// Reads the damping of each joint.
fn damping(root: &mut Element, file: &Path) -> Result<BTreeMap<String, f64>, HandError> {
    let defaults = Defaults::read(root, file)?;
    let mut found = BTreeMap::new();
    each_in_world(root, &mut |element, class| {
        if let Some(name) = element.attributes.get("name").filter(|_| element.name == "joint") {
            let value = defaults.resolve(element, class, file)?.number("damping")?.unwrap_or(0.0);
            found.insert(name.clone(), value);
        }
        Ok::<(), HandError>(())
    })?;
    Ok(found)
}

/// Raises damping and armature of the joints until their servos are stable.
fn steady(root: &mut Element, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    let defaults = Defaults::read(root, file)?;
    let mut stiffness = BTreeMap::new();
    for actuator in section(root, "actuator") {
        let resolved = defaults.resolve(actuator, None, file)?;
        let joint = resolved.text("joint").or(resolved.text("jointinparent"));
        if let (Some(joint), Some(servo)) = (joint, servo::read(&actuator.name, &resolved)?) {
            let gear = resolved.number("gear")?.unwrap_or(1.0);
            *stiffness.entry(joint.to_owned()).or_insert(0.0) += servo.stiffness * gear.powi(2);
        }
    }
    let mut changed = 0;
    each_in_world(root, &mut |element, class| {
        if element.name != "joint" {
            return Ok(());
        }
        let resolved = defaults.resolve(element, class, file)?;
        let stiffness = element.attributes.get("name").and_then(|name| stiffness.get(name)).copied();
        let slides = resolved.text("type") == Some("slide");
        let free = if slides { FREE_SLIDE_DAMPING } else { FREE_HINGE_DAMPING };
        let least = stiffness.map_or(free, |stiffness| TIME_CONSTANT * stiffness);
        let (damped, armed) =
            (resolved.number("damping")?.unwrap_or(0.0) >= least, resolved.number("armature")?.unwrap_or(0.0) > 0.0);
        changed += u64::from(!damped || !armed);
        if !damped {
            set(element, "damping", round(least).to_string());
        }
        if !armed {
            let armature = (ARMATURE * stiffness.unwrap_or(0.0)).max(LEAST_ARMATURES[usize::from(slides)]);
            set(element, "armature", round(armature).to_string());
        }
        Ok::<(), HandError>(())
    })?;
    if changed > 0 {
        notes.push(format!(
            "{changed} joints got the damping or armature that a stable servo needs: damping {TIME_CONSTANT} s times \
             the servo's stiffness (without a servo {FREE_HINGE_DAMPING} N m s, slides {FREE_SLIDE_DAMPING} N s/m), \
             armature {ARMATURE} s2 times it"
        ));
    }
    Ok(())
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
