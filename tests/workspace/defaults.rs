//! The file of defaults is the only place that has any.

use std::collections::BTreeSet;

use eigenhand_train::config::RunConfig;
use toml::{Table, Value};

use crate::source::{code, rust_files};
use crate::support::workspace;

/// Crates whose types hold settings.
const CRATES: [&str; 4] = ["rl", "sim", "synergy", "train"];
/// A field that no file sets: the hand knows its value, not the user.
const NO_SETTING: (&str, &str) = ("ExplorationConfig", "#[serde(skip)]");

#[test]
fn every_setting_is_in_the_file_of_defaults_with_the_value_that_is_used() {
    let file = workspace().join("crates/train/src/presets/default.toml");
    let written: Table = std::fs::read_to_string(file).unwrap().parse().unwrap();
    let used: Table = RunConfig::default_preset().unwrap().to_toml().unwrap().parse().unwrap();
    let (written, used) = (flat("", &Value::Table(written)), flat("", &Value::Table(used)));
    assert!(written.len() > 60, "{written:?}");
    assert_eq!(written, used);
}

/// Lists the numbers and texts of a value with their dotted keys; single precision is written in more digits than it was
/// read from.
fn flat(key: &str, value: &Value) -> Vec<String> {
    match value {
        Value::Table(table) => table.iter().flat_map(|(name, value)| flat(&format!("{key}.{name}"), value)).collect(),
        Value::Array(values) => values.iter().flat_map(|value| flat(key, value)).collect(),
        Value::Float(number) => vec![format!("{key} = {}", *number as f32)],
        other => vec![format!("{key} = {other}")],
    }
}

#[test]
fn no_type_of_settings_has_defaults_of_its_own() {
    let mut found = BTreeSet::new();
    for name in CRATES {
        for file in rust_files(&workspace().join("crates").join(name).join("src")) {
            let lines: Vec<String> = code(&file).into_iter().map(|(_, line)| line).collect();
            for (i, line) in lines.iter().enumerate() {
                let rest = line.split_once("impl Default for ").map(|(_, rest)| rest);
                assert!(!rest.is_some_and(|rest| rest.contains("Config")), "{}: {line}", file.display());
                let Some((_, rest)) = line.split_once("struct ") else { continue };
                let name = rest.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
                if name.ends_with("Config") {
                    check(name, &lines, i);
                    found.insert(name.to_owned());
                }
            }
        }
    }
    assert!(found.len() >= 11, "only {found:?} were found");
}

/// Checks the attributes of a type, whose name is in line `at`, and of its fields.
fn check(name: &str, lines: &[String], at: usize) {
    let attributes = lines[..at].iter().rev().take_while(|line| line.starts_with("#["));
    let body = lines[at..].iter().take_while(|line| !line.starts_with('}'));
    for line in attributes.chain(body).filter(|line| line.trim_start().starts_with("#[")) {
        let exception = (name, line.trim()) == NO_SETTING;
        let has_default = ["Default", "default", "skip"].iter().any(|word| line.contains(word));
        assert!(exception || !has_default, "{name} has a default outside default.toml: {line}");
    }
}
