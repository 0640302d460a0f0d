//! Names that refer to parts of the hand.

use std::collections::{BTreeMap, BTreeSet};

use xmltree::Element;

use crate::mjcf::each_in_world;
use crate::notes::note;
use crate::xml::{attribute, elements, elements_mut, retain_elements, set};

/// Sections in which an element names others.
const REFERRING: [&str; 4] = ["contact", "equality", "tendon", "actuator"];
/// Attributes that name bodies, geoms, sites and joints, with the kind of the named part.
const REFERENCES: [(&str, &str); 17] = [
    ("body", "body"),
    ("body1", "body"),
    ("body2", "body"),
    ("geom", "geom"),
    ("geom1", "geom"),
    ("geom2", "geom"),
    ("sidesite", "site"),
    ("site", "site"),
    ("site1", "site"),
    ("site2", "site"),
    ("refsite", "site"),
    ("cranksite", "site"),
    ("slidersite", "site"),
    ("joint", "joint"),
    ("joint1", "joint"),
    ("joint2", "joint"),
    ("jointinparent", "joint"),
];

/// A part of the hand: its kind of element, and its name.
pub(super) type Named = (String, String);

/// Lists the parts that an element itself names.
fn references(element: &Element) -> impl Iterator<Item = Named> {
    let named = |(key, kind): &(&str, &str)| Some(((*kind).to_owned(), attribute(element, key)?.to_owned()));
    REFERENCES.iter().filter_map(named)
}

/// Collects the parts that `element` and its descendants name.
pub(super) fn named_by(element: &Element, found: &mut BTreeSet<Named>) {
    found.extend(references(element));
    elements(element).for_each(|child| named_by(child, found));
}

/// Removes elements that name parts which were removed.
pub(in crate::import) fn drop_dangling(root: &mut Element, notes: &mut Vec<String>) {
    let mut known: BTreeSet<Named> = BTreeSet::new();
    let _: Result<(), ()> = each_in_world(root, &mut |element, _| {
        if let Some(name) = attribute(element, "name") {
            known.insert((element.name.clone(), name.to_owned()));
        }
        Ok(())
    });
    known.insert(("body".to_owned(), "world".to_owned()));
    let refers_well = |e: &Element| references(e).all(|part| known.contains(&part));
    let mut dropped = Vec::new();
    let mut tendons = BTreeSet::new();
    for section in elements_mut(root).filter(|e| e.name == "tendon") {
        retain_elements(section, |tendon| {
            let keep = elements(tendon).all(refers_well);
            dropped.extend((!keep).then(|| described(tendon)));
            keep
        });
        tendons.extend(elements(section).filter_map(|t| t.attributes.get("name").cloned()));
    }
    for section in elements_mut(root).filter(|e| REFERRING.contains(&e.name.as_str()) && e.name != "tendon") {
        let kind = section.name.clone();
        retain_elements(section, |e| {
            let named = ["tendon", "tendon1", "tendon2"].iter().filter_map(|key| attribute(e, key));
            let keep = refers_well(e) && named.into_iter().all(|name| tendons.contains(name));
            // A removed <exclude> changes nothing, so it needs no note.
            dropped.extend((!keep && e.name != "exclude").then(|| format!("{kind} {}", described(e))));
            keep
        });
    }
    note(notes, "removed, because they name parts that were removed", &dropped);
}

fn described(element: &Element) -> String {
    let name = attribute(element, "name").map(|name| format!(" `{name}`")).unwrap_or_default();
    format!("<{}>{name}", element.name)
}

/// Converts connections between sites to connections between their bodies.
pub(super) fn connections(root: &mut Element, notes: &mut Vec<String>) {
    fn sites<'a>(parent: &'a Element, found: &mut BTreeMap<String, (&'a Element, &'a str)>) {
        for child in elements(parent) {
            match child.name.as_str() {
                "site" => {
                    let body = attribute(parent, "name").unwrap_or("world");
                    found.extend(attribute(child, "name").map(|name| (name.to_owned(), (child, body))));
                }
                "body" | "worldbody" => sites(child, found),
                _ => {}
            }
        }
    }
    let tree = root.clone();
    let mut known = BTreeMap::new();
    sites(&tree, &mut known);
    let mut changed = 0;
    for section in elements_mut(root).filter(|e| e.name == "equality") {
        for connect in elements_mut(section).filter(|e| e.name == "connect") {
            for (site_key, body_key) in [("site1", "body1"), ("site2", "body2")] {
                let site = connect.attributes.shift_remove(site_key).and_then(|name| known.get(&name));
                let Some((site, body)) = site else { continue };
                set(connect, body_key, (*body).to_owned());
                if site_key == "site1" {
                    let anchor = attribute(site, "pos").unwrap_or("0 0 0");
                    set(connect, "anchor", anchor.to_owned());
                }
                changed += 1;
            }
        }
    }
    if changed > 0 {
        notes.push("connects between sites, unknown to MuJoCo 2.2.2, became connects between bodies".to_owned());
    }
}
