//! Masses, contact bits and damping.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use xmltree::Element;

use crate::error::HandError;
use crate::mjcf::{Attributes, Defaults, each_in_world};
use crate::notes::note;
use crate::xml::{attribute, elements, elements_mut, numbers, set};

/// Rotor inertia (kg m2) assumed for a joint when a damping ratio is converted to a damping.
const NOMINAL_INERTIA: f64 = 1e-3;

/// Replaces the compiler's `inertiagrouprange` by mass 0 on the geoms outside it: the range would also apply to the
/// object.
pub(super) fn inertia_groups(
    root: &mut Element,
    defaults: &Defaults,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<(), HandError> {
    let mut range = None;
    for compiler in elements_mut(root).filter(|e| e.name == "compiler") {
        range = Attributes::of(compiler, file).numbers("inertiagrouprange")?.or(range);
        compiler.attributes.shift_remove("inertiagrouprange");
    }
    let Some([low, high]) = range.as_deref().and_then(|r| <[f64; 2]>::try_from(r).ok()) else {
        return Ok(());
    };
    notes.push(format!("inertiagrouprange {low} {high} was replaced by mass 0 on the geoms outside it"));
    each_in_world(root, &mut |element, class| {
        if element.name == "geom" {
            let group = defaults.resolve(element, class, file)?.number("group")?.unwrap_or(0.0);
            if !(low..=high).contains(&group) {
                set(element, "mass", "0");
            }
        }
        Ok(())
    })
}

/// Lets every colliding geom touch the object and the plane, whose `contype` and `conaffinity` are 1.
pub(super) fn contact_bits(
    root: &mut Element,
    defaults: &Defaults,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<(), HandError> {
    let (mut colliding, mut blind) = (0, 0);
    each_in_world(root, &mut |element, class| {
        if element.name != "geom" {
            return Ok(());
        }
        let resolved = defaults.resolve(element, class, file)?;
        let bits = |key: &str| Ok(resolved.number(key)?.map_or(1, |value| value as i64));
        let (contype, conaffinity) = (bits("contype")?, bits("conaffinity")?);
        if contype == 0 && conaffinity == 0 {
            return Ok(());
        }
        colliding += 1;
        if (contype | conaffinity) & 1 == 0 {
            blind += 1;
            set(element, "contype", (contype | 1).to_string());
        }
        Ok::<(), HandError>(())
    })?;
    if blind > 0 {
        notes.push(format!("{blind} geoms could not touch the object: bit 1 was added to their contype"));
    }
    if colliding == 0 {
        each_in_world(root, &mut |element, _| {
            if element.name == "geom" {
                set(element, "contype", "1");
                set(element, "conaffinity", "0");
            }
            Ok::<(), HandError>(())
        })?;
        notes.push("no geom collides: the visual geoms collide instead, meshes as convex hulls".to_owned());
    }
    Ok(())
}

/// Converts a servo's `kv` and `dampratio` to damping of its joint or tendon; MuJoCo integrates that implicitly.
pub(super) fn damping(
    root: &mut Element,
    defaults: &Defaults,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<(), HandError> {
    let mut added: BTreeMap<(&str, String), f64> = BTreeMap::new();
    let mut lost = Vec::new();
    for section in elements(root).filter(|e| e.name == "actuator") {
        for actuator in elements(section).filter(|e| e.name == "position") {
            let resolved = defaults.resolve(actuator, None, file)?;
            // Force and speed of the servo, seen from the joint, are scaled by the gear.
            let geared = resolved.number("gear")?.unwrap_or(1.0).powi(2);
            let stiffness = geared * resolved.number("kp")?.unwrap_or(1.0);
            let ratio = resolved.number("dampratio")?.map(|ratio| 2.0 * ratio * (stiffness * NOMINAL_INERTIA).sqrt());
            let constant = resolved.number("kv")?.map(|kv| geared * kv);
            let Some(value) = constant.or(ratio).filter(|value| *value > 0.0) else { continue };
            match ["joint", "tendon"].iter().find_map(|kind| Some((*kind, resolved.text(kind)?.to_owned()))) {
                Some(target) => *added.entry(target).or_default() += value,
                None => lost.push(resolved.place().to_owned()),
            }
        }
    }
    let extra =
        |element: &Element, kind: &'static str| added.get(&(kind, attribute(element, "name")?.to_owned())).copied();
    each_in_world(root, &mut |element, class| match extra(element, "joint").filter(|_| element.name == "joint") {
        Some(value) => add_damping(element, &defaults.resolve(element, class, file)?, value),
        None => Ok(()),
    })?;
    for section in elements_mut(root).filter(|e| e.name == "tendon") {
        for tendon in elements_mut(section) {
            if let Some(value) = extra(tendon, "tendon") {
                add_damping(tendon, &defaults.resolve(tendon, None, file)?, value)?;
            }
        }
    }
    let n_damped = added.len();
    remove_everywhere(root, "position", &["kv", "dampratio"]);
    if n_damped > 0 {
        notes.push(format!(
            "kv or dampratio of {n_damped} servos, unknown to MuJoCo 2.2.2, became damping of joints and tendons"
        ));
    }
    note(notes, "kv or dampratio removed, because the servo acts on no joint or tendon", &lost);
    Ok(())
}

/// Moves the limits of actuator forces on joints (`actuatorfrcrange`) to the actuators that act on them.
pub(super) fn force_limits(
    root: &mut Element,
    defaults: &Defaults,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<(), HandError> {
    let mut limits: BTreeMap<String, [f64; 2]> = BTreeMap::new();
    each_in_world(root, &mut |element, class| {
        if element.name == "joint" {
            let resolved = defaults.resolve(element, class, file)?;
            let limit = resolved.limits("actuatorfrcrange", "actuatorfrclimited")?;
            if let (Some(name), Some((low, high))) = (attribute(element, "name"), limit) {
                limits.insert(name.to_owned(), [low, high]);
            }
        }
        Ok::<(), HandError>(())
    })?;
    let (mut moved, mut taken) = (Vec::new(), BTreeSet::new());
    for section in elements_mut(root).filter(|e| e.name == "actuator") {
        for actuator in elements_mut(section) {
            let resolved = defaults.resolve(actuator, None, file)?;
            let joint = resolved.text("joint").or(resolved.text("jointinparent"));
            let gear = resolved.number("gear")?.unwrap_or(1.0).abs();
            let limit = joint.and_then(|name| limits.get_key_value(name)).filter(|_| gear > 0.0);
            let Some((name, [low, high])) = limit else { continue };
            let (own_low, own_high) =
                resolved.limits("forcerange", "forcelimited")?.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
            let range = [own_low.max(low / gear), own_high.min(high / gear)];
            taken.insert(name);
            moved.push(resolved.place().to_owned());
            set(actuator, "forcelimited", "true");
            set(actuator, "forcerange", numbers(&range));
        }
    }
    remove_everywhere(root, "joint", &["actuatorfrcrange", "actuatorfrclimited"]);
    note(notes, "the joints' actuatorfrcrange, unknown to MuJoCo 2.2.2, became the force range of", &moved);
    let lost: Vec<&String> = limits.keys().filter(|name| !taken.contains(name)).collect();
    note(notes, "actuatorfrcrange removed from joints that no actuator drives directly", &lost);
    Ok(())
}

fn add_damping(element: &mut Element, resolved: &Attributes, value: f64) -> Result<(), HandError> {
    let own = resolved.number("damping")?.unwrap_or(0.0);
    set(element, "damping", (own + value).to_string());
    Ok(())
}

fn remove_everywhere(element: &mut Element, name: &str, keys: &[&str]) {
    if element.name == name {
        keys.iter().for_each(|key| {
            element.attributes.shift_remove(*key);
        });
    }
    elements_mut(element).for_each(|child| remove_everywhere(child, name, keys));
}
