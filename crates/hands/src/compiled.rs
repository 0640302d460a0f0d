//! Compiled plugins: hands that a library generates from options.
//!
//! Such a plugin is a directory with a sidecar, `hand-plugin.toml`. Its library returns the files of a hand's
//! directory. They are copied, written to a cache and read from there like any other hand. Only `library` holds unsafe
//! code, and `host` runs it in a process of its own.

mod cache;
mod host;
mod library;
mod locate;
mod sidecar;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::error::HandError;
use crate::hand::Hand;
use crate::manifest::MANIFEST_FILE;
use crate::sources;

pub use host::serve_plugins;
pub use sidecar::{SIDECAR_FILE, SIDECAR_KEYS};

/// Loads the hand in `directory`, which holds a manifest or a sidecar.
///
/// # Errors
/// The directory holds both files, or the hand has an error: see [`HandError`].
pub(crate) fn load_either(directory: &Path) -> Result<Hand, HandError> {
    match (directory.join(MANIFEST_FILE).is_file(), directory.join(SIDECAR_FILE).is_file()) {
        (true, true) => {
            Err(HandError::TwoManifests { path: directory.to_path_buf(), first: MANIFEST_FILE, second: SIDECAR_FILE })
        }
        (false, true) => load(directory),
        _ => Hand::load(directory),
    }
}

/// Returns true if `directory` holds a hand of either kind.
pub(crate) fn holds_hand(directory: &Path) -> bool {
    [MANIFEST_FILE, SIDECAR_FILE].iter().any(|name| directory.join(name).is_file())
}

fn load(directory: &Path) -> Result<Hand, HandError> {
    let (sidecar, written) = sidecar::read(directory)?;
    let library = locate::find(directory, &sidecar)?;
    let mut files = BTreeMap::new();
    for (name, content) in host::generate(&library, &sidecar.options)? {
        let name = plain_path(&name).map_err(|got| {
            HandError::plugin(&library, "the name of a file", "a plain path below the hand's directory", got)
        })?;
        if files.insert(PathBuf::from(&name), content).is_some() {
            return Err(HandError::plugin(
                &library,
                "the names of the files",
                "distinct names",
                format!("{name} twice"),
            ));
        }
    }
    let Some(manifest) = files.get(Path::new(MANIFEST_FILE)) else {
        return Err(HandError::plugin(&library, "the files", MANIFEST_FILE, "none of that name"));
    };
    if let Err(error) = std::str::from_utf8(manifest) {
        return Err(HandError::plugin(&library, MANIFEST_FILE, "UTF-8", error));
    }
    let generated = cache::store(&files)?;
    let broken = |source| HandError::Generated { file: directory.join(SIDECAR_FILE), source: Box::new(source) };
    let mut hand = Hand::load(&generated).map_err(broken)?;
    if hand.manifest.name != sidecar.name {
        let expected = format!("\"{}\", the name of the hand that the library generates", hand.manifest.name);
        let got = format!("\"{}\"", sidecar.name);
        return Err(HandError::invalid(&directory.join(SIDECAR_FILE), "name", &expected, got));
    }
    files.insert(PathBuf::from(SIDECAR_FILE), written);
    hand.directory = directory.to_path_buf();
    hand.digest = sources::digest(&files);
    hand.files = files.into_keys().collect();
    Ok(hand)
}

/// Returns the name if it is a plain path below a directory.
///
/// # Errors
/// The name, described for a message.
fn plain_path(name: &[u8]) -> Result<String, String> {
    let text = std::str::from_utf8(name).map_err(|_| format!("`{}`, which is not UTF-8", name.escape_ascii()))?;
    let plain = |part: &str| {
        !matches!(part, "" | "." | "..") && !part.contains(|c: char| c.is_control() || matches!(c, '\\' | ':'))
    };
    // The sidecar is already a file of this hand.
    if text.split('/').all(plain) && text != SIDECAR_FILE {
        Ok(text.to_owned())
    } else {
        Err(format!("`{}`", text.escape_debug()))
    }
}

#[cfg(test)]
mod tests {
    use super::plain_path;

    #[test]
    fn names_stay_below_the_directory() {
        for good in ["hand.toml", "meshes/palm.stl", "a b/ü.obj", "...", ".hidden"] {
            assert_eq!(plain_path(good.as_bytes()).as_deref(), Ok(good));
        }
        for bad in [
            "",
            "/",
            "/etc/passwd",
            "..",
            "../x",
            "a/../b",
            "a//b",
            "./a",
            "a/",
            "a\\b",
            "C:x",
            "a\0b",
            "hand-plugin.toml",
        ] {
            assert!(plain_path(bad.as_bytes()).is_err(), "{bad:?}");
        }
        assert_eq!(plain_path(b"a\xff"), Err("`a\\xff`, which is not UTF-8".to_owned()));
    }
}
