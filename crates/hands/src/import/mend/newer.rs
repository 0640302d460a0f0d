//! Elements and attributes that MuJoCo 2.2.2 does not know: removed, or refused if the hand would change without them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use xmltree::{Element, XMLNode};

use crate::error::HandError;
use crate::xml::{elements, retain_elements};

/// Elements and attributes of MJCF in MuJoCo 2.2.2, as its own `mj_printSchema` lists them.
const SCHEMA: &str = include_str!("mjcf-2.2.2.txt");
/// Column of [`SCHEMA`] in which attributes stand.
const ATTRIBUTE_COLUMN: usize = 30;
/// Blanks for each level of nesting in [`SCHEMA`].
const INDENT: usize = 3;

/// Attributes by element, the element named with its parent: `body/geom`.
struct Schema(BTreeMap<String, BTreeSet<&'static str>>);

impl Schema {
    fn read() -> Self {
        let mut known: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
        let mut path: Vec<&str> = Vec::new();
        let mut current = String::new();
        for line in SCHEMA.lines() {
            let indent = line.len() - line.trim_start().len();
            let attributes = if indent >= ATTRIBUTE_COLUMN {
                line.trim_start()
            } else {
                let (name, rest) = line.trim_start().split_once(' ').unwrap_or((line.trim(), ""));
                path.truncate(indent / INDENT);
                path.push(plain(name));
                let parent = path.len().checked_sub(2).map_or("", |at| path[at]);
                current = format!("{parent}/{}", plain(name));
                rest.trim_start().split_once(')').map_or("", |(_, attributes)| attributes)
            };
            known.entry(current.clone()).or_default().extend(attributes.split_whitespace());
        }
        Self(known)
    }

    fn attributes(&self, parent: &str, name: &str) -> Option<&BTreeSet<&'static str>> {
        // Bodies hold bodies, and default classes default classes.
        let own = match name {
            "worldbody" | "body" => "mujoco/body".to_owned(),
            "default" => "mujoco/default".to_owned(),
            _ => format!("{}/{name}", plain(parent)),
        };
        self.0.get(&own)
    }
}

fn plain(name: &str) -> &str {
    match name {
        "(world)body" | "worldbody" => "body",
        other => other,
    }
}

/// Removes elements and attributes that MuJoCo 2.2.2 does not know, with notes.
///
/// # Errors
/// Names an element without which the hand would be a different hand.
pub(super) fn mend(root: &mut Element, file: &Path, notes: &mut Vec<String>) -> Result<(), HandError> {
    let schema = Schema::read();
    let mut found = BTreeSet::new();
    let is_extension = |e: &Element| e.name == "extension";
    if elements(root).any(is_extension) && !elements(root).filter(|e| !is_extension(e)).any(uses_plugin) {
        retain_elements(root, |e| !is_extension(e));
        notes.push("<extension> was removed: nothing that is kept uses its engine plugins".to_owned());
    }
    walk(root, &schema, file, &mut found)?;
    if !found.is_empty() {
        let list: Vec<String> = found.into_iter().collect();
        notes.push(format!("removed, because unknown to MuJoCo 2.2.2: {}", list.join(", ")));
    }
    Ok(())
}

/// Returns true if an element or one inside it is made by an engine plugin.
fn uses_plugin(element: &Element) -> bool {
    element.name == "plugin" || element.attributes.contains_key("plugin") || elements(element).any(uses_plugin)
}

fn walk(element: &mut Element, schema: &Schema, file: &Path, found: &mut BTreeSet<String>) -> Result<(), HandError> {
    let parent = element.name.clone();
    let mut kept = Vec::with_capacity(element.children.len());
    for node in std::mem::take(&mut element.children) {
        let XMLNode::Element(mut child) = node else {
            continue;
        };
        let Some(known) = schema.attributes(&parent, &child.name) else {
            refuse(&parent, &child, file)?;
            found.insert(format!("<{}> in <{parent}>", child.name));
            continue;
        };
        let newer: Vec<String> = child.attributes.keys().filter(|key| !known.contains(key.as_str())).cloned().collect();
        for key in newer {
            if is_converted(&child, &key) {
                continue;
            }
            if matches!((child.name.as_str(), key.as_str()), (_, "plugin" | "instance")) {
                return Err(newer_error(file, format!("{} {key}", child.name), "an engine plugin", &child));
            }
            if matches!((child.name.as_str(), key.as_str()), ("weld", "site1" | "site2")) {
                let what = "a weld between sites; write it with body1, body2 and relpose";
                return Err(newer_error(file, format!("weld {key}"), what, &child));
            }
            child.attributes.shift_remove(&key);
            found.insert(format!("{} {key}", child.name));
        }
        walk(&mut child, schema, file, found)?;
        kept.push(XMLNode::Element(child));
    }
    element.children = kept;
    Ok(())
}

/// Returns true if a later step of [`super`] converts the attribute.
fn is_converted(element: &Element, key: &str) -> bool {
    matches!(
        (element.name.as_str(), key),
        ("position", "kv" | "dampratio")
            | ("connect", "site1" | "site2")
            | ("joint", "actuatorfrcrange" | "actuatorfrclimited")
    )
}

fn refuse(parent: &str, child: &Element, file: &Path) -> Result<(), HandError> {
    let what = match child.name.as_str() {
        "extension" | "plugin" => "engine plugins; rewrite their actuators as <position>, or remove them",
        "frame" => "frames; save the model with a newer MuJoCo (mj_saveLastXML), which resolves them",
        "replicate" | "attach" | "model" => {
            "models made of models; save the model with a newer MuJoCo (mj_saveLastXML), which resolves them"
        }
        "flex" | "flexcomp" => "soft bodies",
        _ if matches!(parent, "body" | "worldbody" | "actuator" | "equality" | "tendon" | "contact" | "mujoco") => {
            "an element it does not know"
        }
        _ => return Ok(()),
    };
    Err(newer_error(file, format!("<{}> in <{parent}>", child.name), what, child))
}

fn newer_error(file: &Path, place: String, what: &str, element: &Element) -> HandError {
    let name = element.attributes.get("name").map(|name| format!(" `{name}`")).unwrap_or_default();
    HandError::model(file, place, "MJCF of MuJoCo 2.2.2", format!("<{}>{name}: {what}", element.name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_schema_is_read() {
        let schema = Schema::read();
        assert!(schema.attributes("body", "geom").unwrap().contains("fluidcoef"));
        assert!(schema.attributes("worldbody", "body").unwrap().contains("childclass"));
        assert!(schema.attributes("default", "position").unwrap().contains("kp"));
        assert!(!schema.attributes("actuator", "position").unwrap().contains("kv"));
        assert!(schema.attributes("fixed", "joint").unwrap().contains("coef"));
        assert!(schema.attributes("mujoco", "extension").is_none());
    }
}
