//! Changes to the model of a new hand.

use std::collections::BTreeSet;

use eigenhand_hands::Imported;
use eigenhand_hands::xml::{append_section, attribute, element, elements, elements_mut, numbers, retain_elements, set};
use eigenhand_hands::xmltree::{Element, XMLNode};

use super::ASSETS;
use crate::survey::{OtherHands, Survey};

/// Leaves out the hands beside that of the palm.
pub(super) fn leave_out_others(imported: &mut Imported, others: &OtherHands, notes: &mut Vec<String>) {
    fn remove(parent: &mut Element, names: &[String]) {
        let named = |e: &Element| attribute(e, "name").is_some_and(|name| names.iter().any(|n| n == name));
        retain_elements(parent, |e| e.name != "body" || !named(e));
        elements_mut(parent).filter(|e| matches!(e.name.as_str(), "worldbody" | "body")).for_each(|e| remove(e, names));
    }
    let names = others.bodies.join(", ");
    match &others.keep {
        Some(hand) => {
            notes.push(format!("the hand begins with `{hand}`; other hands in the file were left out: {names}"));
            imported.leave_out_arm(hand, &[], notes);
        }
        None => {
            notes.push(format!("other hands in the file were left out: {names}"));
            remove(&mut imported.model, &others.bodies);
            let root = elements(&imported.model).filter(|e| e.name == "worldbody").flat_map(elements);
            let root = root.filter(|e| e.name == "body").find_map(|body| attribute(body, "name").map(str::to_owned));
            if let Some(root) = root {
                // The elements that name the removed bodies go too.
                imported.leave_out_arm(&root, &[], notes);
            }
        }
    }
}

/// Puts a site on the tip of every finger and returns their names.
pub(super) fn add_tips(model: &mut Element, found: &Survey) -> Vec<String> {
    let mut taken = BTreeSet::new();
    names(model, &mut taken);
    let mut tips = Vec::new();
    for finger in &found.fingers {
        let mut name = format!("{}_{}", finger.body, if finger.body.ends_with("tip") { "site" } else { "tip" });
        while taken.contains(&name) {
            name.push('_');
        }
        taken.insert(name.clone());
        let attributes = [
            ("name", name.clone()),
            ("pos", numbers(&finger.tip)),
            ("size", "0.003".to_owned()),
            ("group", "4".to_owned()),
        ];
        if let Some(body) = body_named(model, &finger.body) {
            body.children.insert(0, XMLNode::Element(element("site", &attributes)));
        }
        tips.push(name);
    }
    tips
}

fn names(element: &Element, found: &mut BTreeSet<String>) {
    found.extend(element.attributes.get("name").cloned());
    elements(element).for_each(|child| names(child, found));
}

fn body_named<'a>(element: &'a mut Element, name: &str) -> Option<&'a mut Element> {
    if element.name == "body" && attribute(element, "name") == Some(name) {
        return Some(element);
    }
    elements_mut(element).filter(|e| matches!(e.name.as_str(), "worldbody" | "body")).find_map(|e| body_named(e, name))
}

/// Colours of palm, fingers and fingertips in a model that has none.
const PALM: [f64; 4] = [0.45, 0.46, 0.5, 1.0];
const FINGER: [f64; 4] = [0.8, 0.78, 0.74, 1.0];
const TIP: [f64; 4] = [0.35, 0.55, 0.75, 1.0];

/// Tells palm, fingers and fingertips apart by colour, if the model states no colour at all.
pub(super) fn colour_plain(model: &mut Element, found: &Survey) {
    fn coloured(element: &Element) -> bool {
        let own = element.name == "geom" && ["rgba", "material"].iter().any(|key| attribute(element, key).is_some());
        own || elements(element).any(coloured)
    }
    fn paint(parent: &mut Element, found: &Survey, beyond_palm: bool) {
        let name = attribute(parent, "name").unwrap_or_default();
        let is_tip = found.fingers.iter().any(|finger| finger.body == name);
        let colour = if is_tip { TIP } else { [PALM, FINGER][usize::from(beyond_palm)] };
        let beyond_palm = beyond_palm || name == found.palm;
        for child in elements_mut(parent) {
            match child.name.as_str() {
                "geom" => set(child, "rgba", numbers(&colour)),
                "body" => paint(child, found, beyond_palm),
                _ => {}
            }
        }
    }
    if !coloured(model) {
        elements_mut(model).filter(|e| e.name == "worldbody").for_each(|world| paint(world, found, false));
    }
}

pub(super) fn exclude_overlaps(model: &mut Element, found: &Survey, notes: &mut Vec<String>) {
    if found.overlaps.is_empty() {
        return;
    }
    let exclude = |(a, b): &(String, String)| element("exclude", &[("body1", a.clone()), ("body2", b.clone())]);
    append_section(model, "contact", found.overlaps.iter().map(exclude));
    let pairs: Vec<String> = found.overlaps.iter().map(|(a, b)| format!("{a} and {b}")).collect();
    notes.push(format!("contacts between links that overlap at rest are switched off: {}", pairs.join(", ")));
}

/// Switches off the contacts of bodies above the palm that would touch the plane first. On a real robot, these bodies
/// are beside the table.
pub(super) fn clear_the_way(model: &mut Element, found: &Survey, notes: &mut Vec<String>) {
    for name in &found.in_the_way {
        let geoms =
            body_named(model, name).into_iter().flat_map(|body| elements_mut(body).filter(|e| e.name == "geom"));
        for geom in geoms {
            for bits in ["contype", "conaffinity"] {
                set(geom, bits, "0");
            }
        }
    }
    if !found.in_the_way.is_empty() {
        let names = found.in_the_way.join(", ");
        notes.push(format!("contacts of bodies that would touch the plane before the palm are switched off: {names}"));
    }
}

pub(super) fn name_meshes_directory(imported: &mut Imported) {
    if !imported.assets.is_empty() {
        let compiler = element("compiler", &[("meshdir", ASSETS.to_owned())]);
        imported.model.children.insert(0, XMLNode::Element(compiler));
    }
}

/// Returns a name for the slide that the model does not have yet.
pub(super) fn slide_name(imported: &Imported) -> String {
    let mut taken = BTreeSet::new();
    names(&imported.model, &mut taken);
    let mut name = "slide".to_owned();
    while taken.contains(&name) {
        name.insert_str(0, "hand_");
    }
    name
}
