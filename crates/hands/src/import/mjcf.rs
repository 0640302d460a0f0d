//! MJCF as its makers publish it, mended until it is a hand that MuJoCo 2.2.2 loads and nothing else.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use xmltree::Element;

use super::{Imported, newer};
use crate::closure;
use crate::error::HandError;
use crate::mjcf::{Compiler, Defaults};
use crate::xml::{append, attribute, element, elements_mut, retain_elements};

mod assets;
mod physics;
mod references;
mod world;

/// Reads the MJCF in `file`.
pub(super) fn read(file: &Path, notes: &mut Vec<String>) -> Result<Imported, HandError> {
    let mut root = closure::expand(file)?;
    let compiler = Compiler::read(&root, file)?;
    newer::mend(&mut root, file, notes)?;
    settings(&mut root, file, notes)?;
    leave_out_sections(&mut root, notes);
    world::one_root(&mut root, notes);
    world::name_parts(&mut root, notes);
    references::drop_dangling(&mut root, notes);
    let defaults = Defaults::read(&root, file)?;
    let assets = assets::assets(&mut root, &defaults, &compiler, file, notes)?;
    physics::inertia_groups(&mut root, &defaults, file, notes)?;
    physics::contact_bits(&mut root, &defaults, file, notes)?;
    references::connections(&mut root, file, notes)?;
    physics::damping(&mut root, &defaults, file, notes)?;
    Ok(Imported { model: root, assets, efforts: BTreeMap::new() })
}

/// Calls `act` with every element below `parent` inside bodies, and the class that its bodies give it.
fn each_in_bodies<E>(
    parent: &mut Element,
    childclass: Option<&str>,
    act: &mut impl FnMut(&mut Element, Option<&str>) -> Result<(), E>,
) -> Result<(), E> {
    for child in elements_mut(parent) {
        let own = attribute(child, "childclass").map(str::to_owned);
        let class = own.as_deref().or(childclass);
        act(child, class)?;
        if child.name == "body" {
            each_in_bodies(child, class, act)?;
        }
    }
    Ok(())
}

pub(crate) fn each_in_world<E>(
    root: &mut Element,
    act: &mut impl FnMut(&mut Element, Option<&str>) -> Result<(), E>,
) -> Result<(), E> {
    elements_mut(root).filter(|e| e.name == "worldbody").try_for_each(|world| each_in_bodies(world, None, act))
}

/// Settings of the compiler that would change the scene around the hand.
fn settings(root: &mut Element, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
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
            notes
                .push("compiler settotalmass is left out: it would scale the object's mass with the hand's".to_owned());
        }
        limits_written |= compiler.attributes.contains_key("autolimits");
    }
    if !limits_written {
        append(root, element("compiler", &[("autolimits", "true".to_owned())]));
    }
    Ok(())
}

fn leave_out_sections(root: &mut Element, notes: &mut Vec<String>) {
    let mut gone = BTreeSet::new();
    retain_elements(root, |section| {
        let stays = !newer::LEFT_OUT.contains(&section.name.as_str());
        if !stays {
            gone.insert(section.name.clone());
        }
        stays
    });
    for silent in ["option", "size", "visual", "statistic"] {
        gone.remove(silent);
    }
    if !gone.is_empty() {
        notes.push(format!("left out, as they are not the hand: {}", gone.into_iter().collect::<Vec<_>>().join(", ")));
    }
}
