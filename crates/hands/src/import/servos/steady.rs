//! Damping and armature that keep servos stable.

use std::collections::BTreeMap;
use std::path::Path;

use xmltree::Element;

use super::drives::drives;
use super::{LEAST_ARMATURES, TIME_CONSTANT, round};
use crate::error::HandError;
use crate::mjcf::{Defaults, each_in_world};
use crate::xml::set;

/// Damping of a hinge (N m s) and of a slide (N s/m) without a servo.
const FREE_HINGE_DAMPING: f64 = 0.02;
const FREE_SLIDE_DAMPING: f64 = 5.0;
/// Rotor inertia (kg m2) or mass (kg) for each N m/rad or N/m of stiffness, in s2: the servo's frequency, 5 Hz, stays
/// far below the step's.
const ARMATURE: f64 = 1e-3;
/// Least speed (rad/s) and acceleration (rad/s2) that the force limit of a hinge's servo leaves to it.
const LEAST_SPEED: f64 = 2.0;
const LEAST_ACCELERATION: f64 = 50.0;

/// Raises damping and armature of the joints until their servos are stable.
pub(super) fn steady(root: &mut Element, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    let defaults = Defaults::read(root, file)?;
    // Stiffness and force limit of the servos on each joint.
    let mut servos: BTreeMap<String, [f64; 2]> = BTreeMap::new();
    for drive in drives(root, file)?.into_iter().flatten() {
        if let [pull] = &drive.pulls[..] {
            let of_joint = servos.entry(pull.joint.clone()).or_default();
            of_joint[0] += drive.stiffness * pull.lever.powi(2);
            of_joint[1] +=
                drive.limit.map_or(f64::INFINITY, |(low, high)| high.abs().max(low.abs())) * pull.lever.abs();
        }
    }
    let mut changed = 0;
    each_in_world(root, &mut |element, class| {
        if element.name != "joint" {
            return Ok(());
        }
        let resolved = defaults.resolve(element, class, file)?;
        let servo = element.attributes.get("name").and_then(|name| servos.get(name)).copied();
        let slides = resolved.text("type") == Some("slide");
        let free = if slides { FREE_SLIDE_DAMPING } else { FREE_HINGE_DAMPING };
        // A stiff servo with a low force limit still has to move its joint.
        let most = |limit: f64, of: f64| if slides { f64::INFINITY } else { limit / of };
        let least = servo.map_or(free, |[stiffness, limit]| (TIME_CONSTANT * stiffness).min(most(limit, LEAST_SPEED)));
        let (damped, armed) =
            (resolved.number("damping")?.unwrap_or(0.0) >= least, resolved.number("armature")?.unwrap_or(0.0) > 0.0);
        changed += u64::from(!damped || !armed);
        if !damped {
            set(element, "damping", round(least).to_string());
        }
        if !armed {
            let [stiffness, limit] = servo.unwrap_or([0.0, f64::INFINITY]);
            let armature = (ARMATURE * stiffness).min(most(limit, LEAST_ACCELERATION));
            set(element, "armature", round(armature.max(LEAST_ARMATURES[usize::from(slides)])).to_string());
        }
        Ok::<(), HandError>(())
    })?;
    if changed > 0 {
        notes.push(format!(
            "{changed} joints got the damping or armature that a stable servo needs: damping {TIME_CONSTANT} s times \
             the servo's stiffness (without a servo {FREE_HINGE_DAMPING} N m s, slides {FREE_SLIDE_DAMPING} N s/m), \
             armature {ARMATURE} s2 times it, both less if the force limit is low"
        ));
    }
    Ok(())
}
