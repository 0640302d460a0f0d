//! Bounds of servos: without them, fingers turn so fast that they throw the object.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_posture::Unit;
use xmltree::Element;

use super::carriers::carriers;
use super::drives::{Drive, Pull, drives};
use super::{
    CARRIER_TORQUE, CARRIER_TORQUES, FORCE, FORCES, HINGE_ERROR, LEAST_ARMATURES, TORQUE, TORQUES, TRAVEL, TURN, round,
};
use crate::error::HandError;
use crate::mjcf::{Defaults, each_in_world};
use crate::xml::{elements_mut, numbers, set};

/// Highest speed of a joint (rad/s, m/s) that is left as it is, and the speed of a joint that was faster.
const FASTEST: [f64; 2] = [5.0, 0.2];
const SPEED: [f64; 2] = [4.0, 0.15];
/// Rounding of speeds that are compared with [`FASTEST`].
const ROUNDING: f64 = 1e-3;
/// Longest time constant (s) to which damping may slow a hinge's servo.
const SLOWEST: f64 = 0.3;
/// Two time steps of a scene (s): shorter time constants of contacts and limits are unstable.
const TWO_STEPS: f64 = 0.008;
/// Number of actuators that the note names.
const NAMED: usize = 6;

/// The changes made.
#[derive(Debug, Default)]
pub(super) struct Bounds {
    limited: Vec<String>,
    damped: usize,
    armed: usize,
    softened: usize,
}

/// The servos on one joint together.
#[derive(Debug, Default, Clone, Copy)]
struct Total {
    force: f64,
    stiffness: f64,
    feedback: f64,
    span: f64,
}

impl Bounds {
    /// Gives servos a force limit if they have none that is plausible for a hand.
    pub(super) fn limit_forces(&mut self, root: &mut Element, file: &Path) -> Result<(), HandError> {
        let drives = drives(root, file)?;
        let carriers = carriers(root, file)?;
        let mut drives = drives.into_iter();
        for section in elements_mut(root).filter(|e| e.name == "actuator") {
            for actuator in elements_mut(section) {
                let Some(drive) = drives.next().flatten() else { continue };
                let carries = drive.strongest().is_some_and(|pull| carriers.contains_key(&pull.joint));
                let Some((low, high)) = bounded(&drive, carries) else { continue };
                set(actuator, "forcelimited", "true");
                set(actuator, "forcerange", numbers(&[low, high]));
                self.limited.push(drive.name);
            }
        }
        Ok(())
    }

    /// Gives joints with servos the damping that bounds their speed, and the least armature.
    pub(super) fn limit_speeds(&mut self, root: &mut Element, file: &Path) -> Result<(), HandError> {
        let mut totals: BTreeMap<String, Total> = BTreeMap::new();
        for drive in drives(root, file)?.iter().flatten() {
            for pull in &drive.pulls {
                totals.entry(pull.joint.clone()).or_default().add(drive, pull);
            }
        }
        let defaults = Defaults::read(root, file)?;
        each_in_world(root, &mut |element, class| {
            let total = element.attributes.get("name").filter(|_| element.name == "joint").and_then(|n| totals.get(n));
            let Some(total) = total else { return Ok(()) };
            let resolved = defaults.resolve(element, class, file)?;
            let kind = usize::from(resolved.text("type") == Some("slide"));
            let damping = resolved.number("damping")?.unwrap_or(0.0);
            if total.speed(damping) > FASTEST[kind] * (1.0 + ROUNDING) {
                set(element, "damping", round(total.force / SPEED[kind]).max(damping).to_string());
                self.damped += 1;
            }
            if resolved.number("armature")?.unwrap_or(0.0) < LEAST_ARMATURES[kind] {
                set(element, "armature", LEAST_ARMATURES[kind].to_string());
                self.armed += 1;
            }
            Ok::<(), HandError>(())
        })
    }

    /// Makes contacts, limits and couplings no stiffer than the time step allows, wherever the file states them.
    pub(super) fn soften_constraints(&mut self, element: &mut Element) {
        for key in ["solref", "solreflimit", "solreffriction"] {
            let Some(value) = element.attributes.get(key) else { continue };
            let written: Option<Vec<f64>> = value.split_whitespace().map(|word| word.parse().ok()).collect();
            let Some(mut values) = written.filter(|values| !values.is_empty()) else { continue };
            if softened(&mut values) {
                set(element, key, numbers(&values));
                self.softened += 1;
            }
        }
        elements_mut(element).for_each(|child| self.soften_constraints(child));
    }

    /// Adds one note about all changes.
    pub(super) fn finish(self, notes: &mut Vec<String>) {
        let mut parts = Vec::new();
        if !self.limited.is_empty() {
            let more = match self.limited.len().saturating_sub(NAMED) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            let named: Vec<&str> = self.limited.iter().take(NAMED).map(String::as_str).collect();
            parts.push(format!(
                "a force limit of at most {TORQUE} N m (slides {FORCE} N; joints that carry several fingers \
                 {CARRIER_TORQUE} N m) for {}{more}, which had none or one that no finger has",
                named.join(", ")
            ));
        }
        if self.damped > 0 {
            parts.push(format!("more damping for {} joints", self.damped));
        }
        if self.armed > 0 {
            parts.push(format!("more armature for {} joints", self.armed));
        }
        if self.softened > 0 {
            parts.push(format!("solref of at least two time steps ({TWO_STEPS} s) in {} places", self.softened));
        }
        if !parts.is_empty() {
            notes.push(format!(
                "servos were bounded so that they move joints at no more than about {} rad/s (slides {} m/s) and stay \
                 stable: {}",
                FASTEST[0],
                FASTEST[1],
                parts.join("; ")
            ));
        }
    }
}

impl Total {
    fn add(&mut self, drive: &Drive, pull: &Pull) {
        let half = if pull.unit == Unit::Radian { TURN } else { TRAVEL };
        self.span = pull.range.map_or(2.0 * half, |(low, high)| high - low);
        // All joints of a tendon move together when the servo closes them.
        let levers: f64 = drive.pulls.iter().filter(|p| p.unit == pull.unit).map(|p| p.lever.abs()).sum();
        let geared = pull.lever.abs() * levers;
        let stiffness = drive.stiffness * geared;
        let limit = drive.limit.map_or(f64::INFINITY, |(low, high)| low.abs().max(high.abs())) * pull.lever.abs();
        let mut force = limit.min(stiffness * self.span);
        if pull.unit == Unit::Radian {
            force = force.min(SLOWEST * SPEED[0] * stiffness);
        }
        self.force += force;
        self.stiffness += stiffness;
        self.feedback += drive.feedback.max(0.0) * geared;
    }

    /// Returns the highest steady speed (rad/s, m/s) with this damping of the joint.
    fn speed(&self, damping: f64) -> f64 {
        let by_force = self.force / damping;
        by_force.min(self.stiffness * self.span / (self.feedback + damping))
    }
}

/// Returns the force range that a servo needs; none if it has a good one, or if its joints are not known.
fn bounded(drive: &Drive, carries: bool) -> Option<(f64, f64)> {
    let pull = drive.strongest()?;
    let lever = pull.lever.abs();
    let stiffness = drive.stiffness * lever.powi(2);
    let (usual, most) = match (pull.unit, carries) {
        (Unit::Radian, false) => (TORQUE.min(HINGE_ERROR * stiffness), TORQUES[1]),
        (Unit::Radian, true) => (CARRIER_TORQUE.min(HINGE_ERROR * stiffness), CARRIER_TORQUES[1]),
        (Unit::Metre, _) => {
            let span = pull.range.map_or(2.0 * TRAVEL, |(low, high)| high - low);
            (FORCE.min(span * stiffness), FORCES[1])
        }
    };
    let (low, high) = drive.limit.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
    if low.abs().max(high.abs()) * lever <= most {
        return None;
    }
    let limit = round(usual / lever);
    let (low, high) = (low.max(-limit), high.min(limit));
    (low < high).then_some((low, high))
}

/// Raises the time constants in a `solref`; returns true if it changed.
fn softened(solref: &mut [f64]) -> bool {
    // Negative numbers are stiffness and damping.
    let (hardest, strongest) = (-1.0 / TWO_STEPS.powi(2), -2.0 / TWO_STEPS);
    match solref {
        [time, ..] if *time > 0.0 && *time < TWO_STEPS => *time = TWO_STEPS,
        [stiffness, damping, ..] if *stiffness < hardest || (*stiffness < 0.0 && *damping < strongest) => {
            *stiffness = stiffness.max(hardest);
            *damping = damping.max(strongest);
        }
        _ => return false,
    }
    true
}
