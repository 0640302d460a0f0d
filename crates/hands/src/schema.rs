//! The keys of `hand.toml`: one table to check a manifest, explain its errors and test the documentation.

use std::collections::BTreeSet;
use std::path::Path;

use toml::{Table, Value};

use crate::error::{HandError, nearest};

/// One key of `hand.toml`.
#[derive(Debug, Clone, Copy)]
pub struct KeyInfo {
    /// The key, with its table before a dot.
    pub key: &'static str,
    /// True if a manifest must have it.
    pub required: bool,
    /// The expected value, for messages.
    pub expected: &'static str,
    kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Integer,
    Text,
    Texts,
    Number,
    Numbers(usize),
    Table,
    /// A table from names in the model to numbers.
    NumberMap,
    /// A table from names to text.
    TextMap,
    /// A list of tables.
    Tables,
}

const fn key(key: &'static str, required: bool, kind: Kind, expected: &'static str) -> KeyInfo {
    KeyInfo { key, required, expected, kind }
}

const KEYS: &[KeyInfo] = &[
    key("schema", true, Kind::Integer, "the integer 1"),
    key("name", true, Kind::Text, "a name of lower-case letters, digits, `-` and `_`, in quotes"),
    key("description", false, Kind::Text, "a line of text in quotes"),
    key("model", true, Kind::Text, "the model file's path inside the hand's directory, in quotes"),
    key("format", false, Kind::Text, "\"mjcf\" or \"urdf\""),
    key("packages", false, Kind::TextMap, "a table of package name = directory inside the hand's directory, in quotes"),
    key("posture_joints", false, Kind::Texts, "a list of joint names"),
    key("palm", true, Kind::Text, "the name of the palm's body, in quotes"),
    key("fingertips", true, Kind::Texts, "a list of site or body names, one for each finger"),
    key("licence", false, Kind::Text, "an SPDX licence expression in quotes"),
    key("provenance", false, Kind::Texts, "a list of lines of text"),
    key("mount", true, Kind::Table, "a table [mount]"),
    key("mount.position", true, Kind::Numbers(3), "three numbers [x, y, z] in metres"),
    key("mount.quaternion", false, Kind::Numbers(4), "four numbers [w, x, y, z], not all zero"),
    key("mount.euler_deg", false, Kind::Numbers(3), "three numbers [about x, about y, about z] in degrees"),
    key("slide", false, Kind::Table, "a table [slide]"),
    key("slide.name", false, Kind::Text, "a joint name in quotes"),
    key("slide.range", false, Kind::Numbers(2), "two numbers [low, high] in metres, low < high"),
    key("slide.start", false, Kind::Number, "a number of metres inside slide.range"),
    key("slide.kp", false, Kind::Number, "a positive number (N/m)"),
    key("slide.damping", false, Kind::Number, "a number >= 0 (N s/m)"),
    key("slide.force_limit", false, Kind::Number, "a positive number (N)"),
    key("slide.armature", false, Kind::Number, "a number >= 0 (kg)"),
    key("slide.rise_speed", false, Kind::Number, "a positive number (m/s)"),
    key("open_posture", false, Kind::NumberMap, "a table of joint name = value"),
    key("closing", false, Kind::NumberMap, "a table of actuator name = 1 or -1"),
    key("objects", false, Kind::Table, "a table [objects]"),
    key("objects.scale", false, Kind::Number, "a positive number"),
    key("scripted_grasps", false, Kind::Table, "a table [scripted_grasps]"),
    key("scripted_grasps.tried", false, Kind::Integer, "a number of grasps"),
    key("scripted_grasps.lifted", false, Kind::Integer, "a number of grasps, at most those that were tried"),
    key("scripted_grasps.reached", false, Kind::Integer, "a number of grasps, at most those that were tried"),
    key("actuators", false, Kind::Tables, "tables [[actuators]]"),
    key("actuators.joint", false, Kind::Text, "the name of a joint of the model, in quotes"),
    key("actuators.name", false, Kind::Text, "a name in quotes"),
    key("actuators.kp", false, Kind::Number, "a positive number (N m/rad or N/m)"),
    key("actuators.force_limit", false, Kind::Number, "a positive number (N m or N)"),
    key("actuators.control_range", false, Kind::Numbers(2), "two numbers [low, high] (rad or m), low < high"),
    key("couplings", false, Kind::Tables, "tables [[couplings]]"),
    key("couplings.joint", false, Kind::Text, "the name of a joint of the model, in quotes"),
    key("couplings.follows", false, Kind::Text, "the name of another joint of the model, in quotes"),
    key("couplings.multiplier", false, Kind::Number, "a number"),
    key("couplings.offset", false, Kind::Number, "a number (rad or m)"),
    key("contact", false, Kind::Table, "a table [contact]"),
    key("contact.contype", false, Kind::Integer, "an integer of bits >= 0"),
    key("contact.conaffinity", false, Kind::Integer, "an integer of bits >= 0"),
];

/// Lists every key of `hand.toml` in the order of the documentation.
pub fn keys() -> &'static [KeyInfo] {
    KEYS
}

pub(crate) fn expected(key: &str) -> &'static str {
    KEYS.iter().find(|info| info.key == key).map_or("another value", |info| info.expected)
}

/// Checks the keys and the types of their values, and returns the written keys.
pub(crate) fn check(table: &Table, file: &Path) -> Result<BTreeSet<String>, HandError> {
    let mut written = BTreeSet::new();
    check_table(table, "", file, &mut written)?;
    for info in KEYS.iter().filter(|info| info.required) {
        if !written.contains(info.key) {
            return Err(HandError::MissingKey {
                file: file.to_path_buf(),
                key: info.key.to_owned(),
                expected: info.expected.to_owned(),
            });
        }
    }
    Ok(written)
}

fn check_table(table: &Table, parent: &str, file: &Path, written: &mut BTreeSet<String>) -> Result<(), HandError> {
    for (name, value) in table {
        let path = if parent.is_empty() { name.clone() } else { format!("{parent}.{name}") };
        let Some(info) = KEYS.iter().find(|info| info.key == path) else {
            return Err(unknown_key(name, parent, path, file));
        };
        if !matches_kind(value, info.kind) {
            return Err(HandError::invalid(file, &path, info.expected, describe(value)));
        }
        match (value, info.kind) {
            (Value::Table(inner), Kind::Table) => check_table(inner, &path, file, written)?,
            (Value::Array(items), Kind::Tables) => {
                for inner in items.iter().filter_map(Value::as_table) {
                    check_table(inner, &path, file, written)?;
                }
            }
            (Value::Table(inner), Kind::NumberMap) => {
                for (joint, value) in inner {
                    if !is_number(value) {
                        return Err(HandError::invalid(
                            file,
                            &format!("{path}.{joint}"),
                            "a finite number",
                            describe(value),
                        ));
                    }
                }
            }
            _ => {}
        }
        written.insert(path);
    }
    Ok(())
}

fn unknown_key(name: &str, parent: &str, path: String, file: &Path) -> HandError {
    let known: Vec<&str> = KEYS
        .iter()
        .filter_map(|info| match info.key.rsplit_once('.') {
            Some((table, key)) => (table == parent).then_some(key),
            None => parent.is_empty().then_some(info.key),
        })
        .collect();
    HandError::UnknownKey {
        file: file.to_path_buf(),
        key: path,
        nearest: nearest(name, known.iter().copied()),
        known: known.into_iter().map(str::to_owned).collect(),
    }
}

fn matches_kind(value: &Value, kind: Kind) -> bool {
    match kind {
        Kind::Integer => value.is_integer(),
        Kind::Text => value.is_str(),
        Kind::Texts => value.as_array().is_some_and(|items| items.iter().all(Value::is_str)),
        Kind::Number => is_number(value),
        Kind::Numbers(n) => value.as_array().is_some_and(|items| items.len() == n && items.iter().all(is_number)),
        Kind::Table | Kind::NumberMap => value.is_table(),
        Kind::TextMap => value.as_table().is_some_and(|table| table.values().all(Value::is_str)),
        Kind::Tables => value.as_array().is_some_and(|items| items.iter().all(Value::is_table)),
    }
}

fn is_number(value: &Value) -> bool {
    value.is_integer() || value.as_float().is_some_and(f64::is_finite)
}

fn describe(value: &Value) -> String {
    match value {
        Value::Table(_) => "a table".to_owned(),
        other => other.to_string(),
    }
}
