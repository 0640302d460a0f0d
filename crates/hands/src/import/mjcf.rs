//! MJCF as its makers publish it, mended until it is a hand that MuJoCo 2.2.2 loads and nothing else.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use xmltree::{Element, XMLNode};

use super::{Imported, newer};
use crate::closure;
use crate::error::HandError;
use crate::mjcf::{Attributes, Compiler, Defaults, elements};

/// Sections in which an element names others.
const REFERRING: [&str; 4] = ["contact", "equality", "tendon", "actuator"];
/// Attributes that name bodies, geoms, sites and joints, with the kind of what they name.
const REFERENCES: [(&str, &str); 16] = [
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
];
/// Name of the body that is made where a file keeps parts of the hand in the world.
const BASE: &str = "base";
/// Rotor inertia (kg m2) that stands in for a joint's inertia where a damping ratio has to become a damping.
const NOMINAL_INERTIA: f64 = 1e-3;

/// Reads the MJCF in `file`.
pub(super) fn read(file: &Path, notes: &mut Vec<String>) -> Result<Imported, HandError> {
    let mut root = closure::expand(file)?;
    let compiler = Compiler::read(&root, file)?;
    newer::mend(&mut root, file, notes)?;
    settings(&mut root, file, notes)?;
    leave_out_sections(&mut root, notes);
    one_root(&mut root, notes);
    name_parts(&mut root, notes);
    drop_dangling(&mut root, notes);
    let defaults = Defaults::read(&root, file)?;
    let assets = assets(&mut root, &defaults, &compiler, file, notes)?;
    inertia_groups(&mut root, &defaults, file, notes)?;
    contact_bits(&mut root, &defaults, file, notes)?;
    connections(&mut root, file, notes)?;
    damping(&mut root, &defaults, file, notes)?;
    Ok(Imported { model: root, assets, efforts: BTreeMap::new() })
}

pub(crate) fn elements_mut(parent: &mut Element) -> impl Iterator<Item = &mut Element> {
    parent.children.iter_mut().filter_map(XMLNode::as_mut_element)
}

fn attribute<'a>(element: &'a Element, key: &str) -> Option<&'a str> {
    element.attributes.get(key).map(String::as_str)
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
        let mut compiler = Element::new("compiler");
        compiler.attributes.insert("autolimits".to_owned(), "true".to_owned());
        root.children.push(XMLNode::Element(compiler));
    }
    Ok(())
}

fn leave_out_sections(root: &mut Element, notes: &mut Vec<String>) {
    let mut gone = BTreeSet::new();
    root.children.retain(|node| match node {
        XMLNode::Element(e) if newer::LEFT_OUT.contains(&e.name.as_str()) => {
            gone.insert(e.name.clone());
            false
        }
        node => node.as_element().is_some(),
    });
    for silent in ["option", "size", "visual", "statistic"] {
        gone.remove(silent);
    }
    if !gone.is_empty() {
        notes.push(format!("left out, as they are not the hand: {}", gone.into_iter().collect::<Vec<_>>().join(", ")));
    }
}

/// Leaves one body in the world, the hand's root, without the floor, lights and objects that a hand's file may carry.
fn one_root(root: &mut Element, notes: &mut Vec<String>) {
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
fn name_parts(root: &mut Element, notes: &mut Vec<String>) {
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

/// Leaves out what refers to parts that were left out.
fn drop_dangling(root: &mut Element, notes: &mut Vec<String>) {
    let mut known: BTreeSet<(String, String)> = BTreeSet::new();
    let _: Result<(), ()> = each_in_world(root, &mut |element, _| {
        if let Some(name) = attribute(element, "name") {
            known.insert((element.name.clone(), name.to_owned()));
        }
        Ok(())
    });
    known.insert(("body".to_owned(), "world".to_owned()));
    let refers_well = |e: &Element| {
        REFERENCES.iter().all(|(key, kind)| {
            attribute(e, key).is_none_or(|name| known.contains(&((*kind).to_owned(), name.to_owned())))
        })
    };
    let mut dropped = 0;
    let mut tendons = BTreeSet::new();
    for section in elements_mut(root).filter(|e| e.name == "tendon") {
        section.children.retain(|node| {
            let keep = node.as_element().is_some_and(|tendon| elements(tendon).all(refers_well));
            dropped += usize::from(!keep);
            keep
        });
        tendons.extend(elements(section).filter_map(|t| t.attributes.get("name").cloned()));
    }
    for section in elements_mut(root).filter(|e| REFERRING.contains(&e.name.as_str()) && e.name != "tendon") {
        section.children.retain(|node| {
            let keep = node.as_element().is_some_and(|e| {
                let named = ["tendon", "tendon1", "tendon2"].iter().filter_map(|key| attribute(e, key));
                refers_well(e) && named.into_iter().all(|name| tendons.contains(name))
            });
            dropped += usize::from(!keep);
            keep
        });
    }
    if dropped > 0 {
        notes.push(format!(
            "{dropped} equalities, tendons, actuators or contact pairs refer to parts that are left out"
        ));
    }
}

/// Reads the meshes, gives every file a name of its own, and writes what its class gives an asset onto the asset.
fn assets(
    root: &mut Element,
    defaults: &Defaults,
    compiler: &Compiler,
    file: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<(String, Vec<u8>)>, HandError> {
    let mut kept: Vec<(String, Vec<u8>)> = Vec::new();
    let mut names: BTreeMap<PathBuf, String> = BTreeMap::new();
    let mut looks = 0;
    for section in elements_mut(root).filter(|e| e.name == "asset") {
        let before = section.children.len();
        section.children.retain(|n| n.as_element().is_some_and(|e| matches!(e.name.as_str(), "mesh" | "material")));
        looks += before - section.children.len();
        for asset in elements_mut(section) {
            let resolved = defaults.resolve(asset, None, file)?;
            asset.attributes.shift_remove("class");
            asset.attributes.shift_remove("texture");
            for key in ["scale", "emission", "specular", "shininess", "reflectance", "rgba"] {
                if let Some(value) = resolved.text(key) {
                    asset.attributes.insert(key.to_owned(), value.to_owned());
                }
            }
            let Some(written) = attribute(asset, "file").map(str::to_owned) else { continue };
            if attribute(asset, "name").is_none() {
                let stem = Path::new(&written).file_stem().unwrap_or_default().to_string_lossy().into_owned();
                asset.attributes.insert("name".to_owned(), stem);
            }
            let path = closure::mesh_path(&written, compiler, file);
            if !names.contains_key(&path) {
                let bytes = closure::read_asset(&path, asset, file)?;
                let name = free_name(&written, &kept);
                kept.push((name.clone(), bytes));
                names.insert(path.clone(), name);
            }
            asset.attributes.insert("file".to_owned(), names[&path].clone());
        }
    }
    for folder in elements_mut(root).filter(|e| e.name == "compiler") {
        for key in ["meshdir", "texturedir", "assetdir", "strippath"] {
            folder.attributes.shift_remove(key);
        }
    }
    if looks > 0 {
        notes.push(format!("{looks} textures, skins and height fields are left out: they are looks, not the hand"));
    }
    Ok(kept)
}

/// Returns a plain file name like the written one that no kept file has, whatever the case of its letters.
fn free_name(written: &str, kept: &[(String, Vec<u8>)]) -> String {
    let path = Path::new(written);
    let plain = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    let stem: String = path.file_stem().unwrap_or_default().to_string_lossy().chars().map(plain).collect();
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let mut name = format!("{stem}.{extension}");
    let mut count = 1;
    while kept.iter().any(|(known, _)| known.eq_ignore_ascii_case(&name)) {
        count += 1;
        name = format!("{stem}_{count}.{extension}");
    }
    name
}

/// Says on each geom that the compiler's group range leaves without mass that it has none: the range would reach the object.
fn inertia_groups(
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
    notes.push(format!("inertiagrouprange {low} {high} was written onto the geoms as mass 0"));
    each_in_world(root, &mut |element, class| {
        if element.name == "geom" {
            let group = defaults.resolve(element, class, file)?.number("group")?.unwrap_or(0.0);
            if !(low..=high).contains(&group) {
                element.attributes.insert("mass".to_owned(), "0".to_owned());
            }
        }
        Ok(())
    })
}

/// Makes the geoms that collide with anything meet the object and the plane, whose `contype` and `conaffinity` are 1.
fn contact_bits(
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
            element.attributes.insert("contype".to_owned(), (contype | 1).to_string());
        }
        Ok::<(), HandError>(())
    })?;
    if blind > 0 {
        notes.push(format!("{blind} geoms would not meet the object: bit 1 was added to their contype"));
    }
    if colliding == 0 {
        each_in_world(root, &mut |element, _| {
            if element.name == "geom" {
                element.attributes.insert("contype".to_owned(), "1".to_owned());
                element.attributes.insert("conaffinity".to_owned(), "0".to_owned());
            }
            Ok::<(), HandError>(())
        })?;
        notes.push("no geom collides: the visual ones stand in, as convex hulls".to_owned());
    }
    Ok(())
}

/// Writes connections between sites as connections between their bodies.
fn connections(root: &mut Element, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
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
                let Some(name) = connect.attributes.shift_remove(site_key) else { continue };
                let Some((site, body)) = known.get(&name) else {
                    return Err(HandError::unresolved(
                        file,
                        format!("connect {site_key}"),
                        "a site of the model",
                        &name,
                        known.keys().map(String::as_str),
                    ));
                };
                connect.attributes.insert(body_key.to_owned(), (*body).to_owned());
                if site_key == "site1" {
                    let anchor = attribute(site, "pos").unwrap_or("0 0 0");
                    connect.attributes.insert("anchor".to_owned(), anchor.to_owned());
                }
                changed += 1;
            }
        }
    }
    if changed > 0 {
        notes.push(
            "connections between sites, newer than MuJoCo 2.2.2, are written as connections between bodies".to_owned(),
        );
    }
    Ok(())
}

/// Turns a servo's `kv` and `dampratio` into damping of its joint, which MuJoCo integrates implicitly.
fn damping(root: &mut Element, defaults: &Defaults, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    let mut added: BTreeMap<String, f64> = BTreeMap::new();
    let mut lost = Vec::new();
    for section in elements(root).filter(|e| e.name == "actuator") {
        for actuator in elements(section).filter(|e| e.name == "position") {
            let resolved = defaults.resolve(actuator, None, file)?;
            let kp = resolved.number("kp")?.unwrap_or(1.0);
            let ratio = resolved.number("dampratio")?.map(|ratio| 2.0 * ratio * (kp * NOMINAL_INERTIA).sqrt());
            let Some(value) = resolved.number("kv")?.or(ratio).filter(|value| *value > 0.0) else { continue };
            match resolved.text("joint") {
                Some(joint) => *added.entry(joint.to_owned()).or_default() += value,
                None => lost.push(resolved.place().to_owned()),
            }
        }
    }
    each_in_world(root, &mut |element, class| {
        let Some(extra) =
            attribute(element, "name").and_then(|name| added.get(name)).filter(|_| element.name == "joint")
        else {
            return Ok(());
        };
        let own = defaults.resolve(element, class, file)?.number("damping")?.unwrap_or(0.0);
        element.attributes.insert("damping".to_owned(), (own + extra).to_string());
        Ok::<(), HandError>(())
    })?;
    remove_everywhere(root, &["kv", "dampratio"]);
    if !added.is_empty() {
        notes.push(format!(
            "newer than MuJoCo 2.2.2: kv or dampratio of {} servos became damping of their joints",
            added.len()
        ));
    }
    if !lost.is_empty() {
        notes.push(format!("kv or dampratio left out, as they act on no joint: {}", lost.join(", ")));
    }
    Ok(())
}

fn remove_everywhere(element: &mut Element, keys: &[&str]) {
    if element.name == "position" {
        keys.iter().for_each(|key| {
            element.attributes.shift_remove(*key);
        });
    }
    elements_mut(element).for_each(|child| remove_everywhere(child, keys));
}
