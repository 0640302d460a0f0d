//! `hand-plugin.toml`: the description of a compiled plugin, read before its library is opened.

use std::path::{Component, Path};

use eigenhand_hand_abi::{ABI_MAJOR, ABI_MINOR};
use toml::{Table, Value};

use crate::error::{HandError, nearest};
use crate::sources::read_text;

/// File name of the sidecar in a compiled plugin's directory.
pub const SIDECAR_FILE: &str = "hand-plugin.toml";

/// Every key of the sidecar with its expected value, in the order of the documentation.
pub const SIDECAR_KEYS: [(&str, &str); 6] = [
    ("schema", "the integer 1"),
    ("name", "the name of the hand that the library generates, in quotes"),
    ("library", "the library's name, or its path inside the plugin's directory, in quotes"),
    ("abi", "two integers [major, minor]: the version of the plugin interface that the library was built for"),
    ("build", "the command that builds the library, in quotes"),
    ("options", "a table [options]"),
];

/// The schema that this crate reads.
const SCHEMA: i64 = 1;
const OPTIONAL: [&str; 2] = ["build", "options"];

/// The contents of a sidecar.
#[derive(Debug)]
pub(super) struct Sidecar {
    /// Name of the hand.
    pub(super) name: String,
    /// Name of the library, or its path inside the plugin's directory.
    pub(super) library: String,
    /// Command that builds the library.
    pub(super) build: Option<String>,
    /// The plugin's options, as TOML.
    pub(super) options: String,
}

/// Reads the sidecar in `directory`, and returns it with its bytes. A library for another version of the interface is
/// refused here, before it is opened.
pub(super) fn read(directory: &Path) -> Result<(Sidecar, Vec<u8>), HandError> {
    let file = directory.join(SIDECAR_FILE);
    let text = read_text(&file)?;
    let mut table: Table = toml::from_str(&text)
        .map_err(|e| HandError::Toml { file: file.clone(), message: e.to_string().trim_end().to_owned() })?;
    check_keys(&table, &file)?;
    if table.get("schema").and_then(Value::as_integer) != Some(SCHEMA) {
        return Err(invalid(&table, "schema", &file));
    }
    let text_of = |key: &str| match table.get(key) {
        Some(Value::String(text)) if !text.is_empty() => Ok(Some(text.clone())),
        None => Ok(None),
        Some(_) => Err(invalid(&table, key, &file)),
    };
    let required = |key: &str| text_of(key)?.ok_or_else(|| invalid(&table, key, &file));
    let (name, library, build) = (required("name")?, required("library")?, text_of("build")?);
    check_abi(&table, &file)?;
    let inside = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    if !Path::new(&library).components().all(inside) {
        return Err(HandError::Escape {
            file,
            key: "library".to_owned(),
            got: library,
            directory: directory.to_path_buf(),
        });
    }
    let options = match table.remove("options") {
        None => String::new(),
        Some(Value::Table(options)) => {
            toml::to_string(&options).map_err(|e| HandError::invalid(&file, "options", expected("options"), e))?
        }
        Some(_) => return Err(HandError::invalid(&file, "options", expected("options"), "something else")),
    };
    Ok((Sidecar { name, library, build, options }, text.into_bytes()))
}

fn check_keys(table: &Table, file: &Path) -> Result<(), HandError> {
    let known = || SIDECAR_KEYS.iter().map(|(key, _)| *key);
    if let Some(key) = table.keys().find(|key| !known().any(|k| k == *key)) {
        return Err(HandError::UnknownKey {
            file: file.to_path_buf(),
            key: key.clone(),
            nearest: nearest(key, known()),
            known: known().map(str::to_owned).collect(),
        });
    }
    match known().find(|key| !OPTIONAL.contains(key) && !table.contains_key(*key)) {
        None => Ok(()),
        Some(key) => Err(HandError::MissingKey {
            file: file.to_path_buf(),
            key: key.to_owned(),
            expected: expected(key).to_owned(),
        }),
    }
}

fn check_abi(table: &Table, file: &Path) -> Result<(), HandError> {
    let numbers: Option<Vec<u32>> = table.get("abi").and_then(Value::as_array).and_then(|parts| {
        parts.iter().map(|part| part.as_integer().and_then(|number| u32::try_from(number).ok())).collect()
    });
    let Some([major, minor]) = numbers.as_deref() else {
        return Err(invalid(table, "abi", file));
    };
    check_version(*major, *minor, file)
}

/// Refuses a plugin of another major version. Any minor version is accepted: later versions only append functions, and
/// each function is checked for null.
pub(super) fn check_version(major: u32, minor: u32, file: &Path) -> Result<(), HandError> {
    if major == ABI_MAJOR {
        return Ok(());
    }
    Err(HandError::PluginVersion {
        file: file.to_path_buf(),
        expected: format!("{ABI_MAJOR}.{ABI_MINOR}"),
        got: format!("{major}.{minor}"),
    })
}

fn expected(key: &str) -> &'static str {
    SIDECAR_KEYS.iter().find(|(known, _)| *known == key).map_or("another value", |(_, expected)| expected)
}

fn invalid(table: &Table, key: &str, file: &Path) -> HandError {
    let got = table.get(key).map_or_else(|| "nothing".to_owned(), ToString::to_string);
    HandError::invalid(file, key, expected(key), got)
}
