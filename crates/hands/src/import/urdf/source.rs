//! Reads the robot in the text of a URDF, which is first cleaned for a strict XML reader.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use xmltree::Element;

use crate::error::HandError;
use crate::notes::{latin_note, note};
use crate::xml::{self, append, element, elements, first_tag, set};

/// Facts about a joint's text that the URDF reader hides, because it fills in defaults.
#[derive(Debug, Default)]
pub(super) struct Stated {
    /// True if the joint has at least one of `lower` and `upper`.
    pub(super) range: bool,
}

/// A robot, and facts about its text.
#[derive(Debug)]
pub(super) struct Source {
    /// The robot as read; links and joints in the order of the file.
    pub(super) robot: urdf_rs::Robot,
    /// For every joint, in the order of `robot.joints`.
    pub(super) stated: Vec<Stated>,
    /// For every link, in the order of `robot.links`: true if it has a complete `<inertial>`.
    pub(super) has_inertial: Vec<bool>,
}

/// Name of the elements that only change the looks.
const VISUAL: &str = "visual";

/// The parts of a [`Source`] while they are gathered.
struct Clean {
    robot: Element,
    stated: Vec<Stated>,
    has_inertial: Vec<bool>,
    /// Name of the elements used as collision geometry.
    shape: &'static str,
    /// Links with visual but no collision geometry.
    ghosts: Vec<String>,
    /// The materials of the whole file by name.
    colours: BTreeMap<String, String>,
}

/// Reads the robot that `file` holds as `bytes`.
pub(super) fn read(file: &Path, bytes: &[u8], notes: &mut Vec<String>) -> Result<Source, HandError> {
    let (text, is_latin) = xml::decode(bytes);
    if is_latin {
        notes.push(latin_note(file));
    }
    let (text, comment) = xml::without_declaration(&text);
    if comment {
        notes.push("a comment before the XML declaration, which XML forbids, was skipped".to_owned());
    }
    refuse_xacro_tags(&text, file)?;
    let root = xml::parse(&declare_prefixes(&text), file)?;
    if root.name != "robot" {
        return Err(HandError::model(file, "root element", "<robot>", format!("<{}>", root.name)));
    }
    refuse_xacro_values(&root, file)?;
    let Clean { robot, stated, has_inertial, .. } = clean(&root, file, notes)?;
    let mut text = Vec::new();
    let xml = |message: String| HandError::Xml { file: file.to_path_buf(), message };
    robot.write(&mut text).map_err(|e| xml(e.to_string()))?;
    let robot = urdf_rs::read_from_string(&String::from_utf8_lossy(&text)).map_err(|e| {
        // The URDF reader breaks long reasons into several lines.
        let reason = e.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        HandError::model(file, "<robot>", "a URDF", reason)
    })?;
    if robot.joints.len() != stated.len() || robot.links.len() != has_inertial.len() {
        return Err(HandError::model(
            file,
            "<robot>",
            "as many links and joints as <link> and <joint> elements",
            "another number",
        ));
    }
    Ok(Source { robot, stated, has_inertial })
}

/// Declares on the root element all undeclared prefixes of names, such as `drake:`.
fn declare_prefixes(text: &str) -> String {
    let declared: BTreeSet<&str> =
        text.split("xmlns:").skip(1).filter_map(|rest| rest.split_once('=')).map(|(prefix, _)| prefix).collect();
    let mut undeclared = BTreeSet::new();
    for tag in text.split('<').skip(1).map(|rest| rest.split('>').next().unwrap_or(rest)) {
        // Text in quotes is a value.
        let names: String = tag.split(['"', '\'']).step_by(2).collect::<Vec<_>>().join(" ");
        for name in names.split(|c: char| c.is_whitespace() || matches!(c, '=' | '/')) {
            if let Some((prefix, _)) = name.split_once(':').filter(|(prefix, _)| *prefix != "xmlns" && *prefix != "xml")
            {
                let plain = prefix.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.'));
                if plain && prefix.starts_with(|c: char| c.is_ascii_alphabetic()) && !declared.contains(prefix) {
                    undeclared.insert(prefix.to_owned());
                }
            }
        }
    }
    let declarations: String =
        undeclared.iter().map(|prefix| format!(" xmlns:{prefix}=\"undeclared:{prefix}\"")).collect();
    let Some((at, name)) = first_tag(text) else { return text.to_owned() };
    let (before, after) = text.split_at(at + name.len());
    format!("{before}{declarations}{after}")
}

fn xacro(file: &Path, got: String) -> HandError {
    HandError::model(
        file,
        "<robot>",
        "an expanded URDF: this is xacro, expand it with `xacro in.xacro > out.urdf` and read out.urdf",
        got,
    )
}

/// Looks for xacro tags in the text, before the XML reader refuses their undeclared prefix with a less helpful reason.
fn refuse_xacro_tags(text: &str, file: &Path) -> Result<(), HandError> {
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        rest = &rest[start..];
        if let Some(comment) = rest.strip_prefix("<!--") {
            let Some(end) = comment.find("-->") else { break };
            rest = &comment[end..];
            continue;
        }
        let tag = &rest[..rest.find('>').unwrap_or(rest.len())];
        if let Some(word) = tag.split_whitespace().find(|w| w.starts_with("<xacro:") || w.starts_with("xacro:")) {
            return Err(xacro(file, format!("`{}`", word.trim_matches(['<', '/']))));
        }
        rest = &rest[1..];
    }
    Ok(())
}

fn refuse_xacro_values(element: &Element, file: &Path) -> Result<(), HandError> {
    for (key, value) in &element.attributes {
        if value.contains("${") || value.contains("$(") {
            return Err(xacro(file, format!("`{key}=\"{value}\"` in <{}>", element.name)));
        }
    }
    // The parser bounds the depth.
    elements(element).try_for_each(|child| refuse_xacro_values(child, file))
}

/// Copies only the known parts of a URDF: real files hold extensions that a strict reader refuses.
fn clean(root: &Element, file: &Path, notes: &mut Vec<String>) -> Result<Clean, HandError> {
    let links = || elements(root).filter(|e| e.name == "link");
    let holds = |name: &str| links().any(|link| link.get_child(name).is_some());
    let visual = !holds("collision") && holds(VISUAL);
    if visual {
        notes.push("no link has collision geometry; the visual geometry collides instead".to_owned());
    }
    let mut clean = Clean {
        robot: copy(root),
        stated: Vec::new(),
        has_inertial: Vec::new(),
        shape: if visual { VISUAL } else { "collision" },
        ghosts: Vec::new(),
        colours: colours(root),
    };
    for child in elements(root) {
        match child.name.as_str() {
            "link" => clean.add_link(child, file)?,
            "joint" => clean.add_joint(child, file)?,
            _ => {}
        }
    }
    if clean.has_inertial.is_empty() {
        return Err(HandError::model(file, "<robot>", "at least one <link>", "none"));
    }
    note(notes, "links with visual but no collision geometry touch nothing", &clean.ghosts);
    note(notes, "elements outside of links and joints were ignored", &strays(root));
    Ok(clean)
}

/// Lists unknown elements outside links and joints, such as an `<inertial>` that its maker put outside its link by
/// mistake.
fn strays(root: &Element) -> Vec<String> {
    const KNOWN: [&str; 5] = ["link", "joint", "material", "transmission", "gazebo"];
    let mut names: Vec<String> = elements(root)
        .filter(|e| e.namespace.is_none() && !KNOWN.contains(&e.name.as_str()))
        .map(|e| format!("<{}>", e.name))
        .collect();
    names.sort();
    names.dedup();
    names
}

impl Clean {
    fn add_link(&mut self, link: &Element, file: &Path) -> Result<(), HandError> {
        let name = name_of(link, file)?;
        let mut clean = copy(link);
        let inertial = link.get_child("inertial").and_then(clean_inertial);
        self.has_inertial.push(inertial.is_some());
        if let Some(inertial) = inertial {
            append(&mut clean, inertial);
        }
        for shape in elements(link).filter(|e| e.name == self.shape) {
            append(&mut clean, clean_shape(shape, &name, file)?);
        }
        if self.shape != VISUAL {
            for shape in elements(link).filter(|e| e.name == VISUAL) {
                // Looks that cannot be read leave the hand as it is.
                if let Ok(mut visual) = clean_shape(shape, &name, file) {
                    visual.name = VISUAL.to_owned();
                    if let Some(colour) = shape.get_child("material").and_then(|material| self.colour(material)) {
                        let mut material = element("material", &[("name", "colour".to_owned())]);
                        append(&mut material, element("color", &[("rgba", colour)]));
                        append(&mut visual, material);
                    }
                    append(&mut clean, visual);
                }
            }
        }
        if link.get_child(VISUAL).is_some() && link.get_child(self.shape).is_none() {
            self.ghosts.push(name);
        }
        append(&mut self.robot, clean);
        Ok(())
    }

    /// Returns the colour of a material, which may be defined elsewhere in the file.
    fn colour(&self, material: &Element) -> Option<String> {
        stated_colour(material).or_else(|| self.colours.get(material.attributes.get("name")?).cloned())
    }

    fn add_joint(&mut self, joint: &Element, file: &Path) -> Result<(), HandError> {
        let (joint, stated) = clean_joint(joint, file)?;
        append(&mut self.robot, joint);
        self.stated.push(stated);
        Ok(())
    }
}

/// Returns the materials of a file that state a colour, by name.
fn colours(root: &Element) -> BTreeMap<String, String> {
    let of_links = elements(root).filter(|e| e.name == "link").flat_map(elements).filter(|e| e.name == VISUAL);
    let materials = elements(root).chain(of_links.flat_map(elements)).filter(|e| e.name == "material");
    materials.filter_map(|e| Some((e.attributes.get("name")?.clone(), stated_colour(e)?))).collect()
}

/// Returns the `rgba` of a material, if it is four numbers from 0 to 1.
fn stated_colour(material: &Element) -> Option<String> {
    let rgba = material.get_child("color")?.attributes.get("rgba")?;
    let numbers: Vec<f64> = rgba.split_whitespace().map(str::parse).collect::<Result<_, _>>().ok()?;
    (numbers.len() == 4 && numbers.iter().all(|x| (0.0..=1.0).contains(x))).then(|| rgba.clone())
}

/// Returns a clean `<inertial>` if it holds a mass and a whole tensor.
fn clean_inertial(inertial: &Element) -> Option<Element> {
    let mut clean = Element::new("inertial");
    if let Some(origin) = inertial.get_child("origin") {
        append(&mut clean, copy(origin));
    }
    for (name, keys) in [("mass", &["value"][..]), ("inertia", &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"])] {
        let child = copy(inertial.get_child(name)?);
        if !keys.iter().all(|key| child.attributes.get(*key).is_some_and(|v| v.trim().parse::<f64>().is_ok())) {
            return None;
        }
        append(&mut clean, child);
    }
    Some(clean)
}

fn clean_shape(shape: &Element, link: &str, file: &Path) -> Result<Element, HandError> {
    const SHAPES: [&str; 5] = ["box", "cylinder", "capsule", "sphere", "mesh"];
    let place = format!("link `{link}` <{}>", shape.name);
    let expected = "one of <box>, <cylinder>, <capsule>, <sphere> and <mesh> in <geometry>";
    let geometry =
        shape.get_child("geometry").ok_or_else(|| HandError::model(file, &place, expected, "no <geometry>"))?;
    let kinds: Vec<&Element> = elements(geometry).filter(|e| SHAPES.contains(&e.name.as_str())).collect();
    let [kind] = kinds[..] else {
        let got: Vec<String> = elements(geometry).map(|e| format!("<{}>", e.name)).collect();
        let got = if got.is_empty() { "nothing".to_owned() } else { got.join(", ") };
        return Err(HandError::model(file, &place, expected, got));
    };
    // From here on it is collision geometry, even if it was visual in the file.
    let mut clean = Element::new("collision");
    if let Some(origin) = shape.get_child("origin") {
        append(&mut clean, copy(origin));
    }
    let mut holder = Element::new("geometry");
    append(&mut holder, copy(kind));
    append(&mut clean, holder);
    Ok(clean)
}

fn clean_joint(joint: &Element, file: &Path) -> Result<(Element, Stated), HandError> {
    const KINDS: [&str; 4] = ["revolute", "continuous", "prismatic", "fixed"];
    let name = name_of(joint, file)?;
    let place = format!("joint `{name}`");
    let kind = joint.attributes.get("type").map_or("", |kind| kind.trim());
    if !KINDS.contains(&kind) {
        let expected = "one of the types revolute, continuous, prismatic and fixed";
        let got = if kind.is_empty() { "no type".to_owned() } else { format!("type `{kind}`") };
        return Err(HandError::model(file, place, expected, got));
    }
    let mut clean = copy(joint);
    set(&mut clean, "type", kind.to_owned());
    for key in ["parent", "child"] {
        let end = joint
            .get_child(key)
            .filter(|end| end.attributes.contains_key("link"))
            .ok_or_else(|| HandError::model(file, &place, &format!("<{key} link=\"...\">"), "none"))?;
        append(&mut clean, copy(end));
    }
    let mut stated = Stated::default();
    for key in ["origin", "axis", "limit", "mimic", "dynamics"] {
        let Some(child) = joint.get_child(key) else { continue };
        let mut child = copy(child);
        if key == "limit" {
            stated.range = ["lower", "upper"].iter().any(|bound| child.attributes.contains_key(*bound));
            // The URDF reader requires it, and some makers omit it; zero counts as absent.
            child.attributes.entry("velocity".to_owned()).or_insert_with(|| "0".to_owned());
        }
        append(&mut clean, child);
    }
    Ok((clean, stated))
}

fn name_of(element: &Element, file: &Path) -> Result<String, HandError> {
    match element.attributes.get("name").map(String::as_str) {
        Some(name) if !name.trim().is_empty() => Ok(name.to_owned()),
        _ => Err(HandError::model(file, format!("<{}>", element.name), "a name", "none")),
    }
}

/// Copies an element without its children, and with the attributes of URDF alone.
///
/// The reader of URDF takes a time that grows as the square of the number of attributes (RUSTSEC-2026-0194).
fn copy(element: &Element) -> Element {
    const KNOWN: [&str; 27] = [
        "damping",
        "effort",
        "filename",
        "friction",
        "ixx",
        "ixy",
        "ixz",
        "iyy",
        "iyz",
        "izz",
        "joint",
        "length",
        "link",
        "lower",
        "multiplier",
        "name",
        "offset",
        "radius",
        "rpy",
        "scale",
        "size",
        "type",
        "upper",
        "value",
        "velocity",
        "version",
        "xyz",
    ];
    let mut copy = Element::new(&element.name);
    let known = element.attributes.iter().filter(|(name, _)| KNOWN.contains(&name.as_str()));
    copy.attributes.extend(known.map(|(name, value)| (name.clone(), value.clone())));
    copy
}
