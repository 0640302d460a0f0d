//! Joints that carry several fingers, such as a wrist.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use xmltree::Element;

use crate::error::HandError;
use crate::mjcf::{Attributes, section};
use crate::xml::elements;

const GRAVITY: f64 = 9.81;

/// What hangs on a body, seen from the body's frame.
#[derive(Debug, Default, Clone, Copy)]
struct Load {
    /// Number of fingers: ends of chains of joints that move by themselves.
    fingers: usize,
    /// Mass (kg), and mass times the longest distance that it can have (kg m).
    mass: f64,
    moment: f64,
}

/// Lists the joints that carry several fingers, each with the torque (N m) that bears, at most, the weight in the
/// file's `<inertial>` elements, or the force (N) for a slide.
pub(super) fn carriers(root: &Element, file: &Path) -> Result<BTreeMap<String, f64>, HandError> {
    let followers: BTreeSet<&str> = section(root, "equality")
        .filter(|e| e.name == "joint" && e.attributes.contains_key("joint2"))
        .filter_map(|e| e.attributes.get("joint1").map(String::as_str))
        .collect();
    let mut found = BTreeMap::new();
    for world in elements(root).filter(|e| e.name == "worldbody") {
        load(world, &followers, file, &mut found)?;
    }
    Ok(found)
}

/// The recursion is as deep as the document, whose depth is bounded.
fn load(
    body: &Element,
    followers: &BTreeSet<&str>,
    file: &Path,
    found: &mut BTreeMap<String, f64>,
) -> Result<Load, HandError> {
    let distance = |element: &Element| -> Result<f64, HandError> {
        let place = Attributes::of(element, file).numbers("pos")?.unwrap_or_default();
        Ok(place.iter().map(|x| x * x).sum::<f64>().sqrt())
    };
    let mut all = Load::default();
    for child in elements(body) {
        match child.name.as_str() {
            "body" => {
                let below = load(child, followers, file, found)?;
                all.fingers += below.fingers;
                all.mass += below.mass;
                all.moment += below.moment + below.mass * distance(child)?;
            }
            "inertial" => {
                let mass = Attributes::of(child, file).number("mass")?.unwrap_or(0.0).max(0.0);
                all.mass += mass;
                all.moment += mass * distance(child)?;
            }
            _ => {}
        }
    }
    let names = || elements(body).filter(|e| e.name == "joint").filter_map(|e| e.attributes.get("name"));
    if all.fingers > 1 {
        let slides = |e: &Element| e.attributes.get("type").is_some_and(|kind| kind == "slide");
        for joint in elements(body).filter(|e| e.name == "joint") {
            let weight = GRAVITY * if slides(joint) { all.mass } else { all.moment };
            found.extend(joint.attributes.get("name").map(|name| (name.clone(), weight)));
        }
    }
    if all.fingers == 0 && names().any(|name| !followers.contains(name.as_str())) {
        all.fingers = 1;
    }
    Ok(all)
}
