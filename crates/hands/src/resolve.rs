//! Resolves the names in a manifest against the model.

use std::collections::BTreeSet;
use std::path::Path;

use eigenhand_posture::{JointInfo, Unit};

use crate::error::HandError;
use crate::manifest::HandManifest;
use crate::model::Contents;
use crate::parts::{Fingertip, FrameKind};

/// Resolves the palm and the fingertips.
pub(crate) fn frames(manifest: &HandManifest, contents: &Contents, file: &Path) -> Result<Vec<Fingertip>, HandError> {
    if !contents.bodies.contains(&manifest.palm) {
        let known = contents.bodies.iter().map(String::as_str);
        return Err(HandError::unresolved(file, "palm", "a body of the model", &manifest.palm, known));
    }
    let mut tips = Vec::with_capacity(manifest.fingertips.len());
    for (i, name) in manifest.fingertips.iter().enumerate() {
        let kind = match (contents.sites.contains(name), contents.bodies.contains(name)) {
            (true, _) => FrameKind::Site,
            (false, true) => FrameKind::Body,
            (false, false) => {
                let known = contents.sites.iter().chain(&contents.bodies).map(String::as_str);
                return Err(HandError::unresolved(
                    file,
                    format!("fingertips[{i}]"),
                    "a site or body of the model",
                    name,
                    known,
                ));
            }
        };
        tips.push(Fingertip { name: name.clone(), kind });
    }
    Ok(tips)
}

/// Resolves the joints of the posture, including the slide.
pub(crate) fn posture(manifest: &HandManifest, contents: &Contents, file: &Path) -> Result<Vec<JointInfo>, HandError> {
    let slide = &manifest.slide;
    let taken = contents.joints.iter().map(|j| &j.info.name).chain(contents.actuators.iter().map(|a| &a.name));
    if taken.collect::<BTreeSet<_>>().contains(&slide.name) {
        return Err(HandError::invalid(
            file,
            "slide.name",
            "a name that no joint or actuator of the model has",
            format!("\"{}\"", slide.name),
        ));
    }
    let [lower, upper] = slide.range;
    let slide_joint = JointInfo { name: slide.name.clone(), unit: Unit::Metre, lower, upper };
    let joints = contents.joints.iter().map(|joint| joint.info.clone());
    let all: Vec<JointInfo> = std::iter::once(slide_joint).chain(joints).collect();
    let Some(names) = &manifest.posture_joints else { return Ok(all) };
    let find = |(i, name): (usize, &String)| {
        all.iter().find(|joint| joint.name == *name).cloned().ok_or_else(|| {
            let known = all.iter().map(|j| j.name.as_str());
            HandError::unresolved(
                file,
                format!("posture_joints[{i}]"),
                "a joint of the model or the slide",
                name,
                known,
            )
        })
    };
    names.iter().enumerate().map(find).collect()
}

/// Checks that `closing` names actuators of the model.
pub(crate) fn check_closing(manifest: &HandManifest, contents: &Contents, file: &Path) -> Result<(), HandError> {
    for name in manifest.closing.keys() {
        if !contents.actuators.iter().any(|actuator| actuator.name == *name) {
            let known = contents.actuators.iter().map(|actuator| actuator.name.as_str());
            return Err(HandError::unresolved(
                file,
                format!("closing.{name}"),
                "an actuator of the model",
                name,
                known,
            ));
        }
    }
    Ok(())
}

/// Checks that `open_posture` names joints and that every value is in its joint's range.
pub(crate) fn check_open_posture(manifest: &HandManifest, contents: &Contents, file: &Path) -> Result<(), HandError> {
    for (name, &value) in &manifest.open_posture {
        let key = format!("open_posture.{name}");
        let Some(joint) = contents.joints.iter().find(|joint| joint.name == *name) else {
            if *name == manifest.slide.name {
                return Err(HandError::invalid(
                    file,
                    &key,
                    "joints of the model only; the slide's start is `slide.start`",
                    value,
                ));
            }
            let known = contents.joints.iter().map(|j| j.name.as_str());
            return Err(HandError::unresolved(file, key, "a joint of the model", name, known));
        };
        if let Some((low, high)) = joint.range().filter(|(low, high)| !(*low..=*high).contains(&value)) {
            return Err(HandError::invalid(
                file,
                &key,
                &format!("a value from {low} to {high} ({})", joint.unit),
                value,
            ));
        }
    }
    Ok(())
}
