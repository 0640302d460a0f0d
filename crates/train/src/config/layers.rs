//! Layers of configuration, and where each value came from.

use std::collections::BTreeMap;
use std::path::Path;

use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

use eigenhand_sim::Object;

use super::error::{ConfigError, InvalidSetting};
use super::{DEFAULT, Preset, RunConfig};

/// Keys that earlier runs lack. Their defaults are what these runs did.
const ADDED: [&str; 1] = ["from"];

/// Least similarity at which a known key is suggested for an unknown one.
const ALIKE: f64 = 0.7;

/// Layers of configuration. Each layer may hold only keys of the default, and is checked when it is added.
#[derive(Clone, Debug)]
pub struct Layers {
    merged: Table,
    /// The file with line, or the option, that set each key; without the keys that still have the default's value.
    origins: BTreeMap<String, String>,
}

/// One value of a layer.
struct Entry {
    key: String,
    /// `None` for a table without entries.
    value: Option<Value>,
    origin: String,
}

impl Layers {
    /// Starts from the default and a preset.
    ///
    /// # Errors
    /// None in practice: the texts are compiled in, and the tests read them.
    pub fn new(preset: Preset) -> Result<Layers, ConfigError> {
        let merged = DEFAULT.parse().map_err(|error: toml::de::Error| ConfigError::Syntax {
            origin: DEFAULT_ORIGIN.to_owned(),
            reason: error.to_string(),
        })?;
        let mut layers = Layers { merged, origins: BTreeMap::new() };
        if let Some(text) = preset.text() {
            layers.add_text(&format!("preset {}", preset.name()), text)?;
        }
        layers.set("preset", preset.name(), "--preset")?;
        Ok(layers)
    }

    /// Starts from the resolved configuration of a run directory.
    ///
    /// # Errors
    /// [`ConfigError`] names the file and the key. A missing key is an error too, unless it was added since and its default
    /// means what earlier runs did: a run continues with the settings that it began with, even if the defaults have changed.
    pub fn of_run(path: &Path) -> Result<Layers, ConfigError> {
        let mut layers = Layers::new(Preset::Default)?;
        let required = layers.resolve()?.settings()?;
        let origin = path.display().to_string();
        layers.origins.clear();
        layers.add_text(&origin, &read_layer(path)?)?;
        match required.into_keys().find(|key| layers.origin(key).is_none() && !ADDED.contains(&key.as_str())) {
            Some(key) => Err(ConfigError::Value {
                origin,
                reason: format!(
                    "{key} is absent: another version wrote this file; use that version, or start a new run"
                ),
            }),
            None => Ok(layers),
        }
    }

    /// Adds the text of a file; `origin` names the file in errors.
    ///
    /// # Errors
    /// [`ConfigError`] names the file, the line and the key.
    pub fn add_text(&mut self, origin: &str, text: &str) -> Result<(), ConfigError> {
        entries(origin, text)?.into_iter().try_for_each(|entry| self.add(entry))
    }

    /// Adds a `key=value` with a dotted key. A value that is not TOML is taken as text.
    ///
    /// # Errors
    /// [`ConfigError`] names the key.
    pub fn add_assignment(&mut self, assignment: &str) -> Result<(), ConfigError> {
        let Some((key, value)) = assignment.split_once('=') else {
            return Err(ConfigError::Syntax {
                origin: format!("--set {assignment}"),
                reason: "expected key=value, such as --set learner.gamma=0.95".to_owned(),
            });
        };
        let (key, value) = (key.trim(), value.trim());
        let parsed = toml_value(value).unwrap_or_else(|| Value::String(value.to_owned()));
        self.set(key, parsed, &format!("--set {assignment}"))
    }

    /// Sets one dotted key; `origin` is the option that an error names.
    ///
    /// # Errors
    /// [`ConfigError`] names the option and the key.
    pub fn set(&mut self, key: &str, value: impl Into<Value>, origin: &str) -> Result<(), ConfigError> {
        self.add(Entry { key: key.to_owned(), value: Some(value.into()), origin: origin.to_owned() })
    }

    /// Combines the layers into a configuration, and checks it. A set of objects becomes a list of its objects.
    ///
    /// # Errors
    /// [`ConfigError::Value`] names the file and line, or the option, of a value that is out of range.
    pub fn resolve(&self) -> Result<RunConfig, ConfigError> {
        let mut config =
            self.config().map_err(|reason| ConfigError::Value { origin: DEFAULT_ORIGIN.to_owned(), reason })?;
        config
            .validate()
            .map_err(|invalid| ConfigError::Value { origin: self.culprit(&invalid), reason: invalid.to_string() })?;
        config.objects = Object::expand(&config.objects).map_err(|error| ConfigError::Value {
            origin: self.origin("objects").unwrap_or(DEFAULT_ORIGIN).to_owned(),
            reason: error.to_string(),
        })?;
        Ok(config)
    }

    /// Returns the file with line, or the option, that set a key; none if no layer set it.
    pub fn origin(&self, key: &str) -> Option<&str> {
        self.origins.get(key).map(String::as_str)
    }

    /// Returns the layer that set an invalid value, or else a layer that set a value on which its range depends.
    fn culprit(&self, invalid: &InvalidSetting) -> String {
        let mut keys = std::iter::once(invalid.key.as_str()).chain(invalid.related.iter().copied());
        keys.find_map(|key| self.origin(key)).unwrap_or(DEFAULT_ORIGIN).to_owned()
    }

    fn config(&self) -> Result<RunConfig, String> {
        let first_line = |error: toml::de::Error| in_english(error.message().lines().next().unwrap_or_default());
        Value::Table(self.merged.clone()).try_into().map_err(first_line)
    }

    fn add(&mut self, entry: Entry) -> Result<(), ConfigError> {
        let Entry { key, value, origin } = entry;
        let slot = find(&mut self.merged, &key, &origin)?;
        let Some(value) = value else { return Ok(()) };
        let shown = value.to_string();
        match (&mut *slot, value) {
            // A user may write 1 for 1.0.
            (Value::Float(slot), Value::Integer(whole)) => *slot = whole as f64,
            (Value::Table(_), _) => {
                let reason = format!("{key} = {shown} is not allowed: {key} is a table; set its keys one by one");
                return Err(ConfigError::Value { origin, reason });
            }
            (slot, value) => *slot = value,
        }
        if let Err(reason) = self.config() {
            return Err(ConfigError::Value { origin, reason: format!("{key} = {shown} is not allowed: {reason}") });
        }
        self.origins.insert(key, origin);
        Ok(())
    }
}

/// The origin that an error names if no layer set the value.
const DEFAULT_ORIGIN: &str = "the default configuration";

/// Reads the text of a layer.
///
/// # Errors
/// [`ConfigError::Read`].
pub(crate) fn read_layer(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })
}

/// Reads one TOML value.
fn toml_value(text: &str) -> Option<Value> {
    format!("value = {text}").parse::<Table>().ok()?.remove("value")
}

/// Finds the value of a dotted key. The error names the part of the key that does not exist.
fn find<'a>(table: &'a mut Table, key: &str, origin: &str) -> Result<&'a mut Value, ConfigError> {
    let unknown =
        |key: &str, nearest| ConfigError::UnknownKey { origin: origin.to_owned(), key: key.to_owned(), nearest };
    let (mut known, mut prefix, mut rest) = (table, String::new(), key);
    loop {
        let (part, after) = rest.split_once('.').map_or((rest, None), |(part, after)| (part, Some(after)));
        let path = format!("{prefix}{part}");
        if !known.contains_key(part) {
            let nearest = nearest(known, part).map(|near| format!("{prefix}{near}"));
            return Err(unknown(&path, nearest));
        }
        let Some(after) = after else { return known.get_mut(part).ok_or_else(|| unknown(&path, None)) };
        match known.get_mut(part) {
            Some(Value::Table(inner)) => known = inner,
            _ => return Err(unknown(key, Some(path))),
        }
        (prefix, rest) = (format!("{path}."), after);
    }
}

/// Returns the key of a table that is most similar to a word, if any is similar enough.
fn nearest<'a>(table: &'a Table, word: &str) -> Option<&'a String> {
    let scored = table.keys().map(|known| (strsim::jaro_winkler(known, word), known));
    scored.filter(|(score, _)| *score > ALIKE).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, known)| known)
}

/// Words of a type, in the reader's errors and in English.
const TYPES: [(&str, &str); 8] = [
    ("f32", "a number"),
    ("f64", "a number"),
    ("u32", "a whole number of at least 0"),
    ("u64", "a whole number of at least 0"),
    ("usize", "a whole number of at least 0"),
    ("a boolean", "true or false"),
    ("a sequence", "a list"),
    ("a map", "a table"),
];

/// (the reader's reason for refusing a value) => what it expected
fn in_english(reason: &str) -> String {
    let Some((_, expected)) = reason.strip_prefix("invalid ").and_then(|_| reason.rsplit_once("expected ")) else {
        return reason.to_owned();
    };
    let word = TYPES.iter().find(|(name, _)| *name == expected).map_or(expected, |(_, word)| word);
    format!("expected {word}")
}

/// Lists the values of a TOML text, each with its line.
fn entries(origin: &str, text: &str) -> Result<Vec<Entry>, ConfigError> {
    let syntax = |error: toml::de::Error| ConfigError::Syntax {
        origin: origin.to_owned(),
        reason: error.to_string().trim().to_owned(),
    };
    let root = DeTable::parse(text).map_err(syntax)?;
    let mut found = Vec::new();
    collect(root.get_ref(), "", origin, text, &mut found)?;
    Ok(found)
}

fn collect(
    table: &DeTable<'_>,
    prefix: &str,
    origin: &str,
    text: &str,
    found: &mut Vec<Entry>,
) -> Result<(), ConfigError> {
    for (name, value) in table.iter() {
        let key = if prefix.is_empty() { name.get_ref().to_string() } else { format!("{prefix}.{}", name.get_ref()) };
        let line = text.get(..name.span().start).unwrap_or_default().matches('\n').count() + 1;
        let here = format!("{origin}, line {line}");
        let value = match value.get_ref() {
            DeValue::Table(inner) if !inner.is_empty() => {
                collect(inner, &key, origin, text, found)?;
                continue;
            }
            DeValue::Table(_) => None,
            _ => match text.get(value.span()).and_then(toml_value) {
                Some(value) => Some(value),
                None => {
                    return Err(ConfigError::Syntax {
                        origin: here,
                        reason: format!("cannot read the value of {key}; expected a TOML value"),
                    });
                }
            },
        };
        found.push(Entry { key, value, origin: here });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;

    fn default() -> Layers {
        Layers::new(Preset::Default).expect("compiled in")
    }

    #[test]
    fn every_preset_resolves_and_survives_writing() {
        for preset in [Preset::Default, Preset::Quick, Preset::Paper] {
            let config = Layers::new(preset).and_then(|l| l.resolve()).expect("compiled in");
            assert_eq!(config.preset, preset);
            let text = config.to_toml().expect("TOML");
            let directory = tempfile::tempdir().expect("a directory");
            let path = directory.path().join("config.toml");
            std::fs::write(&path, text).expect("writable");
            assert_eq!(RunConfig::read(&path).expect("its own text"), config);
        }
    }

    #[test]
    fn an_unknown_key_is_answered_with_origin_and_nearest() {
        let error = default().add_assignment("learner.gama=0.9").expect_err("no such key");
        assert_eq!(
            error.to_string(),
            "--set learner.gama=0.9: unknown key \"learner.gama\"; did you mean \"learner.gamma\"?"
        );
        let error = default().add_assignment("lamda=1").expect_err("no such key");
        assert!(error.to_string().contains("\"lambda\""), "{error}");
    }

    #[test]
    fn layers_override_in_order() {
        let mut layers = Layers::new(Preset::Quick).expect("compiled in");
        layers.add_assignment("episodes = 7").expect("known");
        layers.add_assignment("lambda=1").expect("an integer is a float");
        layers.add_assignment("objects=[\"cube\", \"disc\"]").expect("known");
        let config = layers.resolve().expect("valid");
        assert_eq!((config.episodes, config.lambda), (7, 1.0));
        assert_eq!(config.objects, ["cube", "disc"]);
    }

    #[test]
    fn a_runs_configuration_is_complete() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("config.toml");
        let text = default().resolve().and_then(|config| config.to_toml()).expect("compiled in");
        let without: Vec<&str> = text.lines().filter(|line| !line.starts_with("window")).collect();
        assert!(without.len() < text.lines().count());
        std::fs::write(&path, without.join("\n")).expect("writable");
        let message = RunConfig::read(&path).expect_err("incomplete").to_string();
        assert!(message.contains("synergy.window is absent"), "{message}");
        let without: Vec<&str> = text.lines().filter(|line| !line.starts_with("from")).collect();
        std::fs::write(&path, without.join("\n")).expect("writable");
        assert_eq!(RunConfig::read(&path).expect("of an earlier version").from, "");
    }

    #[test]
    fn a_wrong_value_is_answered_with_its_layer_and_line() {
        let in_file = |text: &str| {
            let mut layers = default();
            layers.add_text("run.toml", text).and_then(|()| layers.resolve()).expect_err(text).to_string()
        };
        for (text, expected) in [
            (
                "seed = 2\n\n[learner]\ngamma = 2.0\n",
                "run.toml, line 4: learner.gamma = 2 is not allowed: expected a number",
            ),
            (
                "learner.normalizer = { epsilon = -1.0 }",
                "run.toml, line 1: learner.normalizer.epsilon = -1 is not allowed",
            ),
            (
                "[task]\n# up\ngoal_height = [0.2, 0.1]\n",
                "run.toml, line 3: task.goal_height = [0.2, 0.1] is not allowed",
            ),
            (
                "lambda = 1\nseed = \"abc\"\n",
                "run.toml, line 2: seed = \"abc\" is not allowed: expected a whole number",
            ),
            ("seed = -1\n", "run.toml, line 1: seed = -1 is not allowed: expected a whole number of at least 0"),
            ("lambda = true\n", "run.toml, line 1: lambda = true is not allowed: expected a number"),
            ("tensorboard = 1\n", "run.toml, line 1: tensorboard = 1 is not allowed: expected true or false"),
            ("[synergy]\nstart_after = 500\n", "run.toml, line 2: synergy.window = 300 is not allowed"),
            ("learner = 3\n", "run.toml, line 1: learner = 3 is not allowed"),
            ("[learner]\n[lerner]\n", "run.toml, line 2: unknown key \"lerner\"; did you mean \"learner\"?"),
            ("seed.deep = 3\n", "run.toml, line 1: unknown key \"seed.deep\""),
        ] {
            let message = in_file(text);
            assert!(message.starts_with(expected), "{message}");
        }
        let mut layers = default();
        layers.add_text("run.toml", "learner.gamma = 0.9\n").expect("valid");
        layers.add_assignment("learner.gamma=1.5").expect("a number");
        let message = layers.resolve().expect_err("too large").to_string();
        assert!(message.starts_with("--set learner.gamma=1.5: learner.gamma = 1.5 is not allowed"), "{message}");
    }
}
