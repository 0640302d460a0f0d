//! Writes a converted robot as MJCF.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Vector3};
use urdf_rs::Robot;
use xmltree::Element;

use super::geometry::{Geom, Geoms, Visual};
use super::inertia::Inertial;
use super::joints::{Joint, Motion};
use super::mimic::Mimic;
use super::tree::Tree;
use crate::xml::{append, append_section, element, numbers, set};

/// Name that MuJoCo reserves.
const WORLD: &str = "world";

/// Groups of geoms that show and of geoms that collide: MuJoCo's viewer shows groups 0 to 2.
const VISUAL_GROUP: &str = "2";
const SOLID_GROUP: &str = "3";

/// The parts of the bodies, by the indices of the robot's links and joints.
pub(super) struct Parts<'a> {
    pub(super) robot: &'a Robot,
    pub(super) tree: &'a Tree,
    pub(super) joints: &'a [Joint],
    pub(super) geoms: &'a Geoms,
    pub(super) inertials: &'a [Option<Inertial>],
}

impl Parts<'_> {
    /// Writes the whole model.
    pub(super) fn model(&self, groups: &[usize], mimics: &[Mimic], notes: &mut Vec<String>) -> Element {
        let names = self.body_names(notes);
        let mut model = element("mujoco", &[("model", self.robot.name.clone())]);
        append(&mut model, element("compiler", &[("angle", "radian".to_owned())]));
        let meshes =
            self.geoms.assets.iter().map(|(file, _)| element("mesh", &[("name", stem(file)), ("file", file.clone())]));
        append_section(&mut model, "asset", meshes);
        // The root comes first in the order.
        let bodies = self.tree.order.first().map(|&root| self.body(root, &names));
        append_section(&mut model, "worldbody", bodies);
        append_section(&mut model, "contact", self.excludes(groups, &names));
        append_section(&mut model, "equality", mimics.iter().map(|mimic| self.equality(mimic)));
        model
    }

    fn body_names(&self, notes: &mut Vec<String>) -> Vec<String> {
        let mut names: Vec<String> = self.robot.links.iter().map(|link| link.name.clone()).collect();
        if let Some(at) = names.iter().position(|name| name == WORLD) {
            let mut name = format!("{WORLD}_link");
            while names.contains(&name) {
                name.push('_');
            }
            notes.push(format!("link `{WORLD}` was renamed `{name}`: MuJoCo reserves the name"));
            names[at] = name;
        }
        names
    }

    /// Writes a body and its children. The recursion is as deep as the tree, whose depth is bounded.
    fn body(&self, link: usize, names: &[String]) -> Element {
        let mut body = element("body", &[("name", names[link].clone())]);
        let joint = self.tree.joint[link].map(|j| (&self.robot.joints[j].name, &self.joints[j]));
        if let Some((name, joint)) = joint {
            place(&mut body, &joint.pose);
            if joint.motion != Motion::Fixed {
                append(&mut body, joint_element(name, joint));
            }
        }
        if let Some(inertial) = &self.inertials[link] {
            let mut of_body = element("inertial", &[]);
            place(&mut of_body, &inertial.pose);
            of_body.attributes.entry("pos".to_owned()).or_insert_with(|| "0 0 0".to_owned());
            set(&mut of_body, "mass", inertial.mass.to_string());
            set(&mut of_body, "diaginertia", vector(&inertial.moments));
            append(&mut body, of_body);
        } else if !(self.geoms.solid[link].is_empty() && self.geoms.visual[link].is_empty()) {
            // Without it, MuJoCo would look for a centre of mass among geoms without mass.
            let nothing = [("pos", "0 0 0"), ("mass", "0"), ("diaginertia", "0 0 0")];
            append(&mut body, element("inertial", &nothing.map(|(key, value)| (key, value.to_owned()))));
        }
        let shown = &self.geoms.visual[link];
        for geom in &self.geoms.solid[link] {
            append(&mut body, solid_element(geom, !shown.is_empty()));
        }
        for visual in shown {
            append(&mut body, visual_element(visual));
        }
        for &child in &self.tree.children[link] {
            append(&mut body, self.body(child, names));
        }
        body
    }

    /// Excludes from contact the links of one rigid group, and those of groups that one joint connects.
    ///
    /// Links without geometry need no exclusion. Two groups with only a group without geometry between them count as
    /// connected; such a group often separates two joints with crossing axes.
    fn excludes(&self, groups: &[usize], names: &[String]) -> Vec<Element> {
        let mut solid: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for &link in self.tree.order.iter().filter(|&&link| !self.geoms.solid[link].is_empty()) {
            solid.entry(groups[link]).or_default().push(link);
        }
        let above = |group: usize| {
            let mut at = self.tree.parent[group].map(|link| groups[link]);
            while let Some(next) = at.filter(|g| !solid.contains_key(g)) {
                at = self.tree.parent[next].map(|link| groups[link]);
            }
            at.and_then(|group| solid.get(&group))
        };
        let mut excludes = Vec::new();
        let mut exclude = |a: usize, b: usize| {
            excludes.push(element("exclude", &[("body1", names[a].clone()), ("body2", names[b].clone())]));
        };
        for (&group, links) in &solid {
            for (i, &a) in links.iter().enumerate() {
                links[i + 1..].iter().for_each(|&b| exclude(a, b));
            }
            for &a in above(group).into_iter().flatten() {
                links.iter().for_each(|&b| exclude(a, b));
            }
        }
        excludes
    }

    fn equality(&self, mimic: &Mimic) -> Element {
        let name = |joint: usize| self.robot.joints[joint].name.clone();
        let mut joint = element("joint", &[("joint1", name(mimic.dependent))]);
        if let Some(driver) = mimic.driver {
            set(&mut joint, "joint2", name(driver));
        }
        let slope = if mimic.driver.is_some() { mimic.multiplier } else { 0.0 };
        set(&mut joint, "polycoef", numbers(&[mimic.offset, slope, 0.0, 0.0, 0.0]));
        joint
    }
}

fn joint_element(name: &str, joint: &Joint) -> Element {
    let kind = if joint.motion == Motion::Slide { "slide" } else { "hinge" };
    let mut element = element("joint", &[("name", name.to_owned()), ("type", kind.to_owned())]);
    set(&mut element, "axis", vector(&joint.axis));
    set(&mut element, "limited", joint.range.is_some().to_string());
    if let Some([lower, upper]) = joint.range {
        set(&mut element, "range", numbers(&[lower, upper]));
    }
    for (key, value) in [("damping", joint.damping), ("frictionloss", joint.friction)] {
        if let Some(value) = value {
            set(&mut element, key, value.to_string());
        }
    }
    element
}

fn geom_element(geom: &Geom) -> Element {
    let mut element = element("geom", &[("type", geom.kind.to_owned())]);
    if !geom.size.is_empty() {
        set(&mut element, "size", numbers(&geom.size));
    }
    if let Some(file) = &geom.mesh {
        set(&mut element, "mesh", stem(file));
    }
    place(&mut element, &geom.pose);
    // All mass comes from the file's inertias; without this, MuJoCo would add the geom's own.
    set(&mut element, "mass", "0");
    element
}

/// Writes a geom that collides; a link with visual geoms shows those instead.
fn solid_element(geom: &Geom, hidden: bool) -> Element {
    let mut element = geom_element(geom);
    set(&mut element, "contype", "1");
    set(&mut element, "conaffinity", "1");
    if hidden {
        set(&mut element, "group", SOLID_GROUP);
    }
    element
}

fn visual_element(visual: &Visual) -> Element {
    let mut element = geom_element(&visual.geom);
    set(&mut element, "contype", "0");
    set(&mut element, "conaffinity", "0");
    set(&mut element, "group", VISUAL_GROUP);
    if let Some(colour) = &visual.colour {
        set(&mut element, "rgba", numbers(colour));
    }
    element
}

fn place(element: &mut Element, pose: &Isometry3<f64>) {
    let position = pose.translation.vector;
    if position != Vector3::zeros() {
        set(element, "pos", vector(&position));
    }
    let q = pose.rotation;
    if q.w.abs() != 1.0 {
        set(element, "quat", numbers(&[q.w, q.i, q.j, q.k]));
    }
}

fn vector(v: &Vector3<f64>) -> String {
    numbers(v.as_slice())
}

fn stem(file: &str) -> String {
    file.strip_suffix(".stl").unwrap_or(file).to_owned()
}
