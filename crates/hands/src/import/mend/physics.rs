//! Masses, contact bits, and the force laws of servos.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use xmltree::Element;

use crate::error::HandError;
use crate::mjcf::{Attributes, Defaults, each_in_world, of_each_joint};
use crate::notes::note;
use crate::xml::{attribute, elements_mut, numbers, set};

/// Least inertia (kg m2) assumed for a joint when a damping ratio is converted to a velocity feedback.
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

/// Writes servos with `kv` or `dampratio`, unknown to MuJoCo 2.2.2, as `general` actuators with the same velocity
/// feedback, which stays within the force limit.
pub(super) fn velocity_feedback(
    root: &mut Element,
    defaults: &Defaults,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<(), HandError> {
    let inertias = of_each_joint(root, defaults, "armature", file)?;
    let mut changed = 0;
    for section in elements_mut(root).filter(|e| e.name == "actuator") {
        for actuator in elements_mut(section) {
            let resolved = defaults.resolve(actuator, None, file)?;
            let Some((kp, feedback)) = newer_servo(&actuator.name, &resolved)? else { continue };
            let joint = resolved.text("joint").or(resolved.text("jointinparent"));
            let inertia = joint.and_then(|name| inertias.get(name)).copied().unwrap_or(0.0).max(NOMINAL_INERTIA);
            let gear = resolved.number("gear")?.filter(|gear| *gear != 0.0).unwrap_or(1.0);
            let kv = match feedback {
                Feedback::Constant(kv) => kv,
                // The servo feels the joint's inertia through its gear.
                Feedback::Ratio(ratio) => ratio * 2.0 * (kp.abs() * inertia).sqrt() / gear.abs(),
            };
            actuator.name = "general".to_owned();
            ["kp", "kv", "dampratio"].iter().for_each(|key| {
                actuator.attributes.shift_remove(*key);
            });
            for (key, value) in [("dyntype", "none"), ("gaintype", "fixed"), ("biastype", "affine")] {
                set(actuator, key, value);
            }
            set(actuator, "gainprm", numbers(&[kp]));
            set(actuator, "biasprm", numbers(&[0.0, -kp, -kv]));
            changed += 1;
        }
    }
    remove_everywhere(root, "position", &["kv", "dampratio"]);
    if changed > 0 {
        notes.push(format!(
            "kv or dampratio of {changed} servos, unknown to MuJoCo 2.2.2, became the velocity feedback of general \
             actuators"
        ));
    }
    Ok(())
}

/// Velocity feedback as newer versions of MuJoCo write it.
enum Feedback {
    /// Force for each unit of velocity.
    Constant(f64),
    /// Damping ratio.
    Ratio(f64),
}

/// Reads stiffness and velocity feedback of a servo that MuJoCo 2.2.2 does not know so; none for other actuators.
fn newer_servo(tag: &str, attributes: &Attributes) -> Result<Option<(f64, Feedback)>, HandError> {
    let gain = attributes.number("gainprm")?.unwrap_or(1.0);
    let found = match tag {
        "position" => {
            let kp = attributes.number("kp")?.unwrap_or(gain);
            let constant = attributes.number("kv")?.filter(|kv| *kv > 0.0).map(Feedback::Constant);
            let ratio = attributes.number("dampratio")?.filter(|ratio| *ratio > 0.0).map(Feedback::Ratio);
            constant.or(ratio).map(|feedback| (kp, feedback))
        }
        // In the bias of a position servo, newer versions read a positive third number as a damping ratio.
        "general" if attributes.text("biastype") == Some("affine") => {
            match attributes.numbers("biasprm")?.unwrap_or_default()[..] {
                [_, bias, ratio, ..] if ratio > 0.0 && bias == -gain => Some((gain, Feedback::Ratio(ratio))),
                _ => None,
            }
        }
        _ => None,
    };
    Ok(found)
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

fn remove_everywhere(element: &mut Element, name: &str, keys: &[&str]) {
    if element.name == name {
        keys.iter().for_each(|key| {
            element.attributes.shift_remove(*key);
        });
    }
    elements_mut(element).for_each(|child| remove_everywhere(child, name, keys));
}
