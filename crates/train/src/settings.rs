//! Settings as dotted keys with values, and what sets two configurations apart.

use std::collections::BTreeMap;
use std::path::Path;

use toml::{Table, Value};

use crate::TrainError;
use crate::config::{ConfigError, RunConfig};
use crate::run_dir::{CONFIG, require_run};

/// Every setting by its dotted key, as TOML writes its value.
pub type Settings = BTreeMap<String, String>;

impl RunConfig {
    /// Returns every setting by its dotted key.
    ///
    /// # Errors
    /// As [`RunConfig::to_toml`].
    pub fn settings(&self) -> Result<Settings, ConfigError> {
        parse("configuration", &self.to_toml()?)
    }
}

/// Reads the settings of the run in a directory, also where another version of this program wrote keys that this one does
/// not have.
///
/// # Errors
/// [`TrainError::NotARun`] when there are none, [`TrainError::Config`] when they are not TOML.
pub fn read_settings(run: &Path) -> Result<Settings, TrainError> {
    require_run(run)?;
    let path = run.join(CONFIG);
    let text = std::fs::read_to_string(&path).map_err(|source| ConfigError::Read { path: path.clone(), source })?;
    Ok(parse(&path.display().to_string(), &text)?)
}

pub(crate) fn parse(origin: &str, text: &str) -> Result<Settings, ConfigError> {
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

/// Lists the keys whose values differ, with both; a key that one side lacks has no value there.
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
        let (a, b) =
            (settings(&[]), settings(&["learner.gamma=0.9", "synergy.penalty={ kind = \"share\", cap = 0.5 }"]));
        let found: Vec<&str> = differences(&a, &b).iter().map(|(key, ..)| *key).collect();
        assert_eq!(found, ["learner.gamma", "synergy.penalty.cap", "synergy.penalty.kind"]);
        assert_eq!(differences(&a, &b)[0].2, Some("0.9"));
        assert!(differences(&a, &a).is_empty());
    }
}
