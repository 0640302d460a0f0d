//! Settings as dotted keys with values, and the differences between two configurations.

use std::collections::BTreeMap;

use toml::{Table, Value};

use super::error::ConfigError;

/// The TOML value of every setting, by its dotted key.
pub type Settings = BTreeMap<String, String>;

/// Reads settings from TOML; unknown keys are allowed.
pub(crate) fn parse_settings(origin: &str, text: &str) -> Result<Settings, ConfigError> {
    let table: Table = text.parse().map_err(|error: toml::de::Error| ConfigError::Syntax {
        origin: origin.to_owned(),
        reason: error.to_string(),
    })?;
    let mut settings = Settings::new();
    flatten(table, "", &mut settings);
    Ok(settings)
}

fn flatten(table: Table, prefix: &str, settings: &mut Settings) {
    for (key, value) in table {
        let path = if prefix.is_empty() { key } else { format!("{prefix}.{key}") };
        match value {
            Value::Table(inner) => flatten(inner, &path, settings),
            value => _ = settings.insert(path, value.to_string()),
        }
    }
}

/// Lists the keys whose values differ, with both values; `None` for a side without the key.
pub fn differences<'a>(a: &'a Settings, b: &'a Settings) -> Vec<(&'a str, Option<&'a str>, Option<&'a str>)> {
    let absent = b.keys().filter(|key| !a.contains_key(*key));
    let mut keys: Vec<&String> = a.keys().chain(absent).collect();
    keys.sort();
    keys.into_iter()
        .map(|key| (key.as_str(), a.get(key).map(String::as_str), b.get(key).map(String::as_str)))
        .filter(|(_, a, b)| a != b)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Layers, Preset};

    #[test]
    fn differences_are_named_with_both_values() {
        let settings = |assignments: &[&str]| {
            let mut layers = Layers::new(Preset::Default).expect("compiled in");
            assignments.iter().for_each(|a| layers.add_assignment(a).expect("known"));
            layers.resolve().and_then(|config| config.settings()).expect("valid")
        };
        let (a, b) = (settings(&[]), settings(&["learner.gamma=0.9", "lambda=0.5"]));
        let found: Vec<&str> = differences(&a, &b).iter().map(|(key, ..)| *key).collect();
        assert_eq!(found, ["lambda", "learner.gamma"]);
        assert_eq!(differences(&a, &b)[1].2, Some("0.9"));
        assert!(differences(&a, &a).is_empty());
    }
}
