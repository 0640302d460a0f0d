//! Mends MJCF as makers publish it: MuJoCo 2.2.2 loads the result, and it holds the hand alone.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use xmltree::Element;

use super::imported::Imported;
use crate::error::HandError;
use crate::mjcf::{Compiler, Defaults, each_in_world};
use crate::model::Joints;
use crate::sources;
use crate::xml::{append, attribute, element, elements_mut, retain_elements};

mod assets;
mod balls;
mod newer;
mod physics;
mod references;
mod world;

pub(super) use references::drop_dangling;
pub(super) use world::keep_body;

/// Sections that do not describe the hand's body; they are removed with everything in them.
const LEFT_OUT: [&str; 8] = ["option", "size", "visual", "statistic", "custom", "sensor", "keyframe", "deformable"];

/// Reads the MJCF that `file` holds as `bytes`.
pub(super) fn read(file: &Path, bytes: Vec<u8>, notes: &mut Vec<String>) -> Result<Imported, HandError> {
    let mut root = sources::expand(file, bytes, notes)?;
    let compiler = Compiler::read(&root, file)?;
    leave_out_sections(&mut root, notes);
    newer::mend(&mut root, file, notes)?;
    if root.name == "mujocoinclude" {
        let got = "<mujocoinclude>, a part of a model; name the file that includes it";
        return Err(HandError::model(file, "root element", "<mujoco>", got));
    }
    settings(&mut root, file, notes)?;
    let defaults = Defaults::read(&root, file)?;
    world::one_root(&mut root, &defaults, file, notes);
    world::name_parts(&mut root, notes);
    let passive = balls::to_hinges(&mut root, &defaults, file, notes)?;
    if Joints::read(&root, file)?.0.is_empty() {
        return Err(HandError::model(file, "the model", "at least one joint that turns or slides", "none"));
    }
    references::drop_dangling(&mut root, notes);
    let assets = assets::assets(&mut root, &defaults, &compiler, file, notes)?;
    physics::inertia_groups(&mut root, &defaults, file, notes)?;
    physics::contact_bits(&mut root, &defaults, file, notes)?;
    references::connections(&mut root, notes);
    physics::force_limits(&mut root, &defaults, file, notes)?;
    physics::velocity_feedback(&mut root, &defaults, file, notes)?;
    Ok(Imported { model: root, assets, looks: 0, efforts: BTreeMap::new(), velocities: BTreeMap::new(), passive })
}

/// Mends compiler settings, which would also apply to the scene around the hand.
fn settings(root: &mut Element, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    if in_radians_unsaid(root, file)? {
        append(root, element("compiler", &[("angle", "radian".to_owned())]));
        notes.push(
            "the file names no unit of angles; radians were assumed, because no hinge range is beyond one turn"
                .to_owned(),
        );
    }
    let mut limits_written = false;
    for compiler in elements_mut(root).filter(|e| e.name == "compiler") {
        if attribute(compiler, "coordinate") == Some("global") {
            return Err(HandError::model(
                file,
                "compiler coordinate",
                "`local`",
                "`global`; save the model with MuJoCo 2.2.2, which writes local coordinates",
            ));
        }
        if compiler.attributes.shift_remove("settotalmass").is_some() {
            notes.push("compiler settotalmass was removed: it would also scale the object's mass".to_owned());
        }
        limits_written |= compiler.attributes.contains_key("autolimits");
    }
    if !limits_written {
        append(root, element("compiler", &[("autolimits", "true".to_owned())]));
    }
    Ok(())
}

/// Returns true if the file names no unit of angles but means radians, as a file that others include may: no hinge
/// range is beyond one turn in radians, and in degrees such ranges would be far too small.
fn in_radians_unsaid(root: &mut Element, file: &Path) -> Result<bool, HandError> {
    if elements_mut(root).any(|e| e.name == "compiler" && attribute(e, "angle").is_some()) {
        return Ok(false);
    }
    let defaults = Defaults::read(root, file)?;
    let mut widest: f64 = 0.0;
    each_in_world(root, &mut |element, class| {
        if element.name == "joint" {
            let joint = defaults.resolve(element, class, file)?;
            if matches!(joint.text("type"), None | Some("hinge")) {
                let range = joint.numbers("range")?;
                widest = range.into_iter().flatten().fold(widest, |most, end| most.max(end.abs()));
            }
        }
        Ok::<(), HandError>(())
    })?;
    Ok((f64::EPSILON..=std::f64::consts::TAU).contains(&widest))
}

fn leave_out_sections(root: &mut Element, notes: &mut Vec<String>) {
    let mut gone = BTreeSet::new();
    retain_elements(root, |section| {
        let stays = !LEFT_OUT.contains(&section.name.as_str());
        if !stays {
            gone.insert(section.name.clone());
        }
        stays
    });
    for silent in ["option", "size", "visual", "statistic"] {
        gone.remove(silent);
    }
    if !gone.is_empty() {
        notes.push(format!(
            "sections removed, because they do not describe the hand: {}",
            gone.into_iter().collect::<Vec<_>>().join(", ")
        ));
    }
}
