//! Makes the hand one body in the world, and names its parts.

use std::collections::BTreeSet;
use std::path::Path;

use xmltree::{Element, XMLNode};

use super::references::{Named, named_by};
use crate::mjcf::{Defaults, each_in_world};
use crate::notes::note;
use crate::xml::{append, attribute, element, elements, elements_mut, retain_elements, set};

/// Name of the body made for a file that has parts of the hand directly in the world.
const BASE: &str = "base";
const ACTUATOR: &str = "actuator";

/// Returns the type of a joint or geom, given the `childclass` of the bodies around it.
type TypeOf<'a> = dyn Fn(&Element, Option<&str>) -> Option<String> + 'a;

/// Leaves one body in the world, the hand's root; floors, lights and objects are removed.
pub(super) fn one_root(root: &mut Element, defaults: &Defaults, file: &Path, notes: &mut Vec<String>) {
    let mut world = Element::new("worldbody");
    root.children.retain(|node| match node {
        XMLNode::Element(e) if e.name == "worldbody" => {
            world.children.extend(e.children.iter().cloned());
            false
        }
        _ => true,
    });
    let mut gone = Vec::new();
    // A later step refuses a class that does not exist.
    let type_of: &TypeOf = &|part, class| defaults.resolve(part, class, file).ok()?.text("type").map(str::to_owned);
    world.children.retain_mut(|node| node.as_mut_element().is_some_and(|child| belongs(child, type_of, &mut gone)));
    leave_out_unmoved(&mut world, root, &mut gone);
    strip(&mut world);
    let bodies = elements(&world).filter(|e| e.name == "body").count();
    let parts = elements(&world).filter(|e| matches!(e.name.as_str(), "geom" | "site")).count();
    if bodies != 1 || parts > 0 {
        let mut base = element("body", &[("name", BASE.to_owned())]);
        base.children = std::mem::take(&mut world.children);
        append(&mut world, base);
        notes.push(format!("the parts in the world were moved into one body `{BASE}`"));
    }
    append(root, world);
    note(notes, "removed, because they are not part of the hand", &gone);
}

/// Returns true if a child of the world is part of the hand; removes its free joint, because the mount carries the
/// hand.
fn belongs(child: &mut Element, type_of: &TypeOf, gone: &mut Vec<String>) -> bool {
    let name = attribute(child, "name").map(|name| format!(" `{name}`")).unwrap_or_default();
    match child.name.as_str() {
        "light" | "camera" => false,
        "geom" if matches!(type_of(child, None).as_deref(), Some("plane" | "hfield")) => {
            gone.push(format!("the floor{name}"));
            false
        }
        "body" => {
            let moves = has_joint(child, None, type_of);
            let class = attribute(child, "childclass").map(str::to_owned);
            let mocap = child.attributes.shift_remove("mocap").is_some_and(|value| value == "true");
            let free = |e: &Element| e.name == "freejoint" || is_free(e, class.as_deref(), type_of);
            let was_free = elements(child).any(free);
            retain_elements(child, |e| !free(e));
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

/// Removes objects: if actuators move some bodies of the world, a body that no actuator, tendon or coupling reaches is
/// one.
fn leave_out_unmoved(world: &mut Element, root: &Element, gone: &mut Vec<String>) {
    fn reached(part: &Element, named: &BTreeSet<Named>) -> bool {
        attribute(part, "name").is_some_and(|name| named.contains(&(part.name.clone(), name.to_owned())))
            || elements(part).any(|inner| reached(inner, named))
    }
    let mut named = BTreeSet::new();
    elements(root)
        .filter(|e| matches!(e.name.as_str(), ACTUATOR | "tendon" | "equality"))
        .for_each(|section| named_by(section, &mut named));
    if !elements(world).any(|body| body.name == "body" && reached(body, &named)) {
        return;
    }
    retain_elements(world, |child| {
        let stays = child.name != "body" || reached(child, &named);
        if !stays {
            let name = attribute(child, "name").map(|name| format!(" `{name}`")).unwrap_or_default();
            gone.push(format!("the object{name}, which no actuator moves"));
        }
        stays
    });
}

/// Makes `name` the only body in the world, and removes these of its joints.
pub(in crate::import) fn keep_body(root: &mut Element, name: &str, joints: &[String]) {
    // The body keeps the `childclass` of the bodies around it.
    fn take(parent: &mut Element, name: &str, class: Option<&str>) -> Option<Element> {
        for child in elements_mut(parent).filter(|e| e.name == "body") {
            let class = attribute(child, "childclass").or(class).map(str::to_owned);
            if attribute(child, "name") == Some(name) {
                if let Some(class) = class {
                    set(child, "childclass", class);
                }
                return Some(child.clone());
            }
            if let Some(found) = take(child, name, class.as_deref()) {
                return Some(found);
            }
        }
        None
    }
    for world in elements_mut(root).filter(|e| e.name == "worldbody") {
        let Some(mut body) = take(world, name, None) else { continue };
        let is_gone = |e: &Element| e.name == "joint" && joints.iter().any(|joint| attribute(e, "name") == Some(joint));
        retain_elements(&mut body, |e| !is_gone(e));
        world.children.clear();
        append(world, body);
    }
}

fn has_joint(body: &Element, childclass: Option<&str>, type_of: &TypeOf) -> bool {
    let class = attribute(body, "childclass").or(childclass);
    elements(body).any(|child| match child.name.as_str() {
        "joint" => !is_free(child, class, type_of),
        "body" => has_joint(child, class, type_of),
        _ => false,
    })
}

fn is_free(element: &Element, class: Option<&str>, type_of: &TypeOf) -> bool {
    element.name == "joint" && type_of(element, class).as_deref() == Some("free")
}

/// Removes cameras and lights from the bodies.
fn strip(parent: &mut Element) {
    retain_elements(parent, |e| !matches!(e.name.as_str(), "camera" | "light"));
    elements_mut(parent).filter(|e| e.name == "body").for_each(strip);
}

/// Names joints, bodies and actuators without a name; an actuator gets the name of its joint or tendon.
pub(super) fn name_parts(root: &mut Element, notes: &mut Vec<String>) {
    let mut taken = BTreeSet::new();
    let mut made = Vec::new();
    collect_names(root, &mut taken);
    let mut name = |element: &mut Element, like: String| {
        if attribute(element, "name").is_some_and(|name| !name.is_empty()) {
            return;
        }
        let kind = if matches!(element.name.as_str(), "joint" | "body") { &element.name } else { ACTUATOR };
        let numbered =
            (1..).map(|number| if like == kind || number > 1 { format!("{like}_{number}") } else { like.clone() });
        let fresh = numbered.into_iter().find(|name| !taken.contains(&(kind.to_owned(), name.clone())));
        if let Some(fresh) = fresh {
            made.push(format!("{kind} `{fresh}`"));
            taken.insert((kind.to_owned(), fresh.clone()));
            set(element, "name", fresh);
        }
    };
    let _: Result<(), ()> = each_in_world(root, &mut |element, _| {
        if matches!(element.name.as_str(), "joint" | "body") {
            let kind = element.name.clone();
            name(element, kind);
        }
        Ok(())
    });
    for section in elements_mut(root).filter(|e| e.name == ACTUATOR) {
        for actuator in elements_mut(section) {
            let target = ["joint", "jointinparent", "tendon"].iter().find_map(|key| attribute(actuator, key));
            let like = target.unwrap_or(ACTUATOR).to_owned();
            name(actuator, like);
        }
    }
    note(notes, "unnamed parts got a name", &made);
}

/// Collects the kinds and names of joints, bodies and actuators; in MJCF, names are distinct within a kind.
fn collect_names(root: &Element, names: &mut BTreeSet<(String, String)>) {
    for child in elements(root) {
        let kind = if root.name == ACTUATOR { ACTUATOR } else { child.name.as_str() };
        names.extend(attribute(child, "name").map(|name| (kind.to_owned(), name.to_owned())));
        collect_names(child, names);
    }
}
