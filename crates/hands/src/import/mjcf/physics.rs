//! Masses, contact bits and damping.

use std::collections::BTreeMap;
use std::path::Path;

use xmltree::Element;

use super::each_in_world;
use crate::error::HandError;
use crate::mjcf::{Attributes, Defaults};
use crate::xml::{attribute, elements, elements_mut, set};

/// Rotor inertia (kg m2) that stands in for a joint's inertia where a damping ratio has to become a damping.
const NOMINAL_INERTIA: f64 = 1e-3;

/// Says on each geom that the compiler's group range leaves without mass that it has none: the range would reach the object.
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
    notes.push(format!("inertiagrouprange {low} {high} was written onto the geoms as mass 0"));
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

/// Makes the geoms that collide with anything meet the object and the plane, whose `contype` and `conaffinity` are 1.
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
        notes.push(format!("{blind} geoms would not meet the object: bit 1 was added to their contype"));
    }
    if colliding == 0 {
        each_in_world(root, &mut |element, _| {
            if element.name == "geom" {
                set(element, "contype", "1");
                set(element, "conaffinity", "0");
            }
            Ok::<(), HandError>(())
        })?;
        notes.push("no geom collides: the visual ones stand in, as convex hulls".to_owned());
    }
    Ok(())
}

/// Turns a servo's `kv` and `dampratio` into damping of its joint, which MuJoCo integrates implicitly.
pub(super) fn damping(
    root: &mut Element,
    defaults: &Defaults,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<(), HandError> {
    let mut added: BTreeMap<String, f64> = BTreeMap::new();
    let mut lost = Vec::new();
    for section in elements(root).filter(|e| e.name == "actuator") {
        for actuator in elements(section).filter(|e| e.name == "position") {
            let resolved = defaults.resolve(actuator, None, file)?;
            let kp = resolved.number("kp")?.unwrap_or(1.0);
            let ratio = resolved.number("dampratio")?.map(|ratio| 2.0 * ratio * (kp * NOMINAL_INERTIA).sqrt());
            let Some(value) = resolved.number("kv")?.or(ratio).filter(|value| *value > 0.0) else { continue };
            match resolved.text("joint") {
                Some(joint) => *added.entry(joint.to_owned()).or_default() += value,
                None => lost.push(resolved.place().to_owned()),
            }
        }
    }
    each_in_world(root, &mut |element, class| {
        let Some(extra) =
            attribute(element, "name").and_then(|name| added.get(name)).filter(|_| element.name == "joint")
        else {
            return Ok(());
        };
        let own = defaults.resolve(element, class, file)?.number("damping")?.unwrap_or(0.0);
        set(element, "damping", (own + extra).to_string());
        Ok::<(), HandError>(())
    })?;
    remove_everywhere(root, &["kv", "dampratio"]);
    if !added.is_empty() {
        notes.push(format!(
            "newer than MuJoCo 2.2.2: kv or dampratio of {} servos became damping of their joints",
            added.len()
        ));
    }
    if !lost.is_empty() {
        notes.push(format!("kv or dampratio left out, as they act on no joint: {}", lost.join(", ")));
    }
    Ok(())
}

fn remove_everywhere(element: &mut Element, keys: &[&str]) {
    if element.name == "position" {
        keys.iter().for_each(|key| {
            element.attributes.shift_remove(*key);
        });
    }
    elements_mut(element).for_each(|child| remove_everywhere(child, keys));
}
