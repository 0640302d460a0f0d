//! One body in the world, and names on its parts.

use std::collections::{BTreeMap, BTreeSet};

use xmltree::{Element, XMLNode};

use super::{attribute, each_in_world, elements_mut};
use crate::mjcf::elements;

/// Name of the body that is made where a file keeps parts of the hand in the world.
const BASE: &str = "base";
/// Leaves one body in the world, the hand's root, without the floor, lights and objects that a hand's file may carry.
pub(super) fn one_root(root: &mut Element, notes: &mut Vec<String>) {
    let mut world = Element::new("worldbody");
    root.children.retain(|node| match node {
        XMLNode::Element(e) if e.name == "worldbody" => {
            world.children.extend(e.children.iter().cloned());
            false
        }
        _ => true,
    });
    let mut gone = Vec::new();
    world.children.retain_mut(|node| node.as_mut_element().is_some_and(|child| belongs(child, &mut gone)));
    strip(&mut world);
    let bodies = elements(&world).filter(|e| e.name == "body").count();
    let parts = elements(&world).filter(|e| matches!(e.name.as_str(), "geom" | "site")).count();
    if bodies != 1 || parts > 0 {
        let mut base = Element::new("body");
        base.attributes.insert("name".to_owned(), BASE.to_owned());
        base.children = std::mem::take(&mut world.children);
        world.children.push(XMLNode::Element(base));
        notes.push(format!("the parts in the world were put into one body `{BASE}`"));
    }
    root.children.push(XMLNode::Element(world));
    if !gone.is_empty() {
        notes.push(format!("left out of the hand: {}", gone.join(", ")));
    }
}

/// Tells whether a child of the world is part of the hand, which is then tied to its mount.
fn belongs(child: &mut Element, gone: &mut Vec<String>) -> bool {
    let name = attribute(child, "name").map(|name| format!(" `{name}`")).unwrap_or_default();
    match child.name.as_str() {
        "light" | "camera" => false,
        "geom" if matches!(attribute(child, "type"), Some("plane" | "hfield")) => {
            gone.push(format!("the floor{name}"));
            false
        }
        "body" => {
            let moves = has_joint(child);
            let mocap = child.attributes.shift_remove("mocap").is_some_and(|value| value == "true");
            let free =
                |e: &Element| e.name == "freejoint" || (e.name == "joint" && attribute(e, "type") == Some("free"));
            let was_free = elements(child).any(free);
            child.children.retain(|node| node.as_element().is_some_and(|e| !free(e)));
            if moves {
                return true;
            }
            let what = match (was_free, mocap) {
                (true, _) => "the free object",
                (_, true) => "the mocap body",
                _ => "the fixed body",
            };
            gone.push(format!("{what}{name}"));
            false
        }
        _ => true,
    }
}

fn has_joint(body: &Element) -> bool {
    elements(body).any(|child| match child.name.as_str() {
        "joint" => attribute(child, "type") != Some("free"),
        "body" => has_joint(child),
        _ => false,
    })
}

/// Takes cameras and lights off the bodies.
fn strip(parent: &mut Element) {
    parent.children.retain(|n| n.as_element().is_some_and(|e| !matches!(e.name.as_str(), "camera" | "light")));
    elements_mut(parent).filter(|e| e.name == "body").for_each(strip);
}

/// Names joints, bodies and actuators that have no name.
pub(super) fn name_parts(root: &mut Element, notes: &mut Vec<String>) {
    let mut made: BTreeMap<&str, usize> = BTreeMap::new();
    let mut taken = BTreeSet::new();
    collect_names(root, &mut taken);
    let mut name = |element: &mut Element, kind: &'static str| {
        if attribute(element, "name").is_some_and(|name| !name.is_empty()) {
            return;
        }
        let count = made.entry(kind).or_default();
        let fresh = loop {
            *count += 1;
            let candidate = format!("{kind}_{count}");
            if !taken.contains(&candidate) {
                break candidate;
            }
        };
        element.attributes.insert("name".to_owned(), fresh);
    };
    let _: Result<(), ()> = each_in_world(root, &mut |element, _| {
        match element.name.as_str() {
            "joint" => name(element, "joint"),
            "body" => name(element, "body"),
            _ => {}
        }
        Ok(())
    });
    for section in elements_mut(root).filter(|e| e.name == "actuator") {
        for actuator in elements_mut(section) {
            let target = attribute(actuator, "joint").or(attribute(actuator, "tendon")).map(str::to_owned);
            match target.filter(|name| !taken.contains(name) || attribute(actuator, "tendon").is_none()) {
                Some(target) if !actuator.attributes.contains_key("name") => {
                    actuator.attributes.insert("name".to_owned(), target);
                }
                _ => name(actuator, "actuator"),
            }
        }
    }
    for (kind, count) in made {
        notes.push(format!("{count} {kind} names were made up where the file has none"));
    }
}

fn collect_names(element: &Element, names: &mut BTreeSet<String>) {
    names.extend(element.attributes.get("name").cloned());
    elements(element).for_each(|child| collect_names(child, names));
}
