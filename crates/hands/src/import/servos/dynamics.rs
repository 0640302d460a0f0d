//! Friction and damping that no servo of the model overcomes: numbers that were made for another simulator.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_posture::Unit;
use xmltree::Element;

use super::round;
use crate::error::HandError;
use crate::mjcf::{Attributes, Defaults, each_in_world, section};
use crate::notes::note;
use crate::parts::HandJoint;
use crate::xml::set;

/// Largest part of a servo's force that friction takes.
const FRICTION: f64 = 0.2;
/// Highest speed (rad/s, m/s) that damping has to leave to a servo, whatever the file states.
const ENOUGH: [f64; 2] = [5.0, 0.15];
/// Time (s) in which a servo has to cross the range of its joint.
const CROSSING: f64 = 1.0;

/// A joint that follows another: position of the one for each unit of the other.
struct Follower {
    driver: String,
    multiplier: f64,
}

/// Scales friction and damping down where a servo with the force in `forces` could not move its joint, with all joints
/// that follow it, at about the velocity in `velocities`.
pub(super) fn bound(
    root: &mut Element,
    joints: &[HandJoint],
    forces: &BTreeMap<String, f64>,
    velocities: &BTreeMap<String, f64>,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<(), HandError> {
    let followers = followers(root, file)?;
    let defaults = Defaults::read(root, file)?;
    let driver_of = |name: &str| match followers.get(name) {
        Some(follower) => (follower.driver.clone(), follower.multiplier.abs()),
        None => (name.to_owned(), 1.0),
    };
    // Friction and damping that each servo feels.
    let mut felt: BTreeMap<String, [f64; 2]> = BTreeMap::new();
    each_in_world(root, &mut |element, class| {
        let Some(name) = element.attributes.get("name").filter(|_| element.name == "joint") else { return Ok(()) };
        let resolved = defaults.resolve(element, class, file)?;
        let (driver, multiplier) = driver_of(name);
        let sum = felt.entry(driver).or_default();
        sum[0] += multiplier * resolved.number("frictionloss")?.unwrap_or(0.0);
        sum[1] += multiplier.powi(2) * resolved.number("damping")?.unwrap_or(0.0);
        Ok::<(), HandError>(())
    })?;
    // Factors on friction and damping by servo.
    let mut factors: BTreeMap<&str, [f64; 2]> = BTreeMap::new();
    for joint in joints {
        let (Some(force), Some([friction, damping])) = (forces.get(&joint.name), felt.get(&joint.name)) else {
            continue;
        };
        let enough = ENOUGH[usize::from(joint.unit == Unit::Metre)];
        let stated = velocities.get(&joint.name).map_or(0.0, |stated| stated.min(enough));
        let crossing = joint.range().map_or(0.0, |(low, high)| (high - low) / CROSSING).min(enough);
        let speed = stated.max(crossing);
        let factor = |most: f64, felt: f64| if felt > most { most / felt } else { 1.0 };
        let of_damping = if speed > 0.0 { factor(force / speed, *damping) } else { 1.0 };
        factors.insert(&joint.name, [factor(FRICTION * force, *friction), of_damping]);
    }
    let mut changed = [Vec::new(), Vec::new()];
    each_in_world(root, &mut |element, class| {
        let Some(name) = element.attributes.get("name").filter(|_| element.name == "joint").cloned() else {
            return Ok(());
        };
        let resolved = defaults.resolve(element, class, file)?;
        let Some(of_joint) = factors.get(driver_of(&name).0.as_str()) else { return Ok(()) };
        for (i, key) in ["frictionloss", "damping"].into_iter().enumerate() {
            let value = resolved.number(key)?.unwrap_or(0.0);
            if of_joint[i] < 1.0 && value > 0.0 {
                set(element, key, round(value * of_joint[i]).to_string());
                changed[i].push(name.clone());
            }
        }
        Ok::<(), HandError>(())
    })?;
    note(
        notes,
        &format!("friction was lowered to {FRICTION} of the force limit, which it exceeded, at the joints"),
        &changed[0],
    );
    note(
        notes,
        "damping was lowered so that the servo reaches the joint's stated velocity, or crosses its range in a second, \
         at the joints",
        &changed[1],
    );
    Ok(())
}

fn followers(root: &Element, file: &Path) -> Result<BTreeMap<String, Follower>, HandError> {
    let mut found = BTreeMap::new();
    for coupling in section(root, "equality").filter(|e| e.name == "joint") {
        let (Some(joint), Some(driver)) = (coupling.attributes.get("joint1"), coupling.attributes.get("joint2")) else {
            continue;
        };
        let polynomial = Attributes::of(coupling, file).numbers("polycoef")?.unwrap_or_default();
        let multiplier = polynomial.get(1).copied().unwrap_or(1.0);
        found.insert(joint.clone(), Follower { driver: driver.clone(), multiplier });
    }
    Ok(found)
}
