//! Applies the additions of a manifest to a model: servos, couplings, contact bits.

use std::path::Path;

use xmltree::Element;

use crate::error::HandError;
use crate::manifest::HandManifest;
use crate::mjcf::{Defaults, each_in_world};
use crate::model::Joints;
use crate::xml::{append_section, attribute, element, elements_mut, numbers, retain_elements, set};

/// Applies the additions of the manifest in `file` to the model.
pub(crate) fn apply(model: &mut Element, manifest: &HandManifest, file: &Path) -> Result<(), HandError> {
    couplings(model, manifest, file)?;
    actuators(model, manifest, file)?;
    contact(model, manifest, file)
}

fn known(joints: &Joints, name: &str, key: String, file: &Path) -> Result<(), HandError> {
    if joints.0.iter().any(|joint| joint.name == name) {
        return Ok(());
    }
    let names = joints.0.iter().map(|joint| joint.name.as_str());
    Err(HandError::unresolved(file, key, "a joint of the model", name, names))
}

/// Removes the actuators that act on this joint alone.
fn free(model: &mut Element, joint: &str) {
    for section in elements_mut(model).filter(|e| e.name == "actuator") {
        retain_elements(section, |e| attribute(e, "joint") != Some(joint));
    }
}

fn couplings(model: &mut Element, manifest: &HandManifest, file: &Path) -> Result<(), HandError> {
    if manifest.couplings.is_empty() {
        return Ok(());
    }
    let joints = Joints::read(model, file)?;
    for (i, coupling) in manifest.couplings.iter().enumerate() {
        known(&joints, &coupling.joint, format!("couplings[{i}].joint"), file)?;
        known(&joints, &coupling.follows, format!("couplings[{i}].follows"), file)?;
        if coupling.joint == coupling.follows {
            return Err(HandError::invalid(
                file,
                &format!("couplings[{i}].follows"),
                "another joint",
                &coupling.follows,
            ));
        }
        free(model, &coupling.joint);
        let polynomial = numbers(&[coupling.offset, coupling.multiplier, 0.0, 0.0, 0.0]);
        let attributes =
            [("joint1", coupling.joint.clone()), ("joint2", coupling.follows.clone()), ("polycoef", polynomial)];
        append_section(model, "equality", [element("joint", &attributes)]);
    }
    Ok(())
}

fn actuators(model: &mut Element, manifest: &HandManifest, file: &Path) -> Result<(), HandError> {
    if manifest.actuators.is_empty() {
        return Ok(());
    }
    let joints = Joints::read(model, file)?;
    for (i, actuator) in manifest.actuators.iter().enumerate() {
        known(&joints, &actuator.joint, format!("actuators[{i}].joint"), file)?;
        let range = joints.0.iter().find(|joint| joint.name == actuator.joint).and_then(|joint| joint.range());
        let Some([low, high]) = actuator.control_range.or(range.map(|(low, high)| [low, high])) else {
            let key = format!("actuators[{i}].control_range");
            return Err(HandError::invalid(file, &key, "two numbers, as the joint has no range", "none"));
        };
        free(model, &actuator.joint);
        let name = actuator.name.clone().unwrap_or_else(|| actuator.joint.clone());
        let attributes = [
            ("name", name),
            ("joint", actuator.joint.clone()),
            ("kp", actuator.kp.to_string()),
            ("ctrllimited", "true".to_owned()),
            ("ctrlrange", numbers(&[low, high])),
            ("forcelimited", "true".to_owned()),
            ("forcerange", numbers(&[-actuator.force_limit, actuator.force_limit])),
        ];
        append_section(model, "actuator", [element("position", &attributes)]);
    }
    Ok(())
}

fn contact(model: &mut Element, manifest: &HandManifest, file: &Path) -> Result<(), HandError> {
    let Some(bits) = manifest.contact else { return Ok(()) };
    let defaults = Defaults::read(model, file)?;
    each_in_world(model, &mut |element, class| {
        if element.name != "geom" {
            return Ok(());
        }
        let resolved = defaults.resolve(element, class, file)?;
        if resolved.number("contype")? == Some(0.0) && resolved.number("conaffinity")? == Some(0.0) {
            return Ok(());
        }
        set(element, "contype", bits.contype.to_string());
        set(element, "conaffinity", bits.conaffinity.to_string());
        Ok::<(), HandError>(())
    })
}
