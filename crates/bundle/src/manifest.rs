//! `manifest.json`: every file of a bundle, with its size and its digest.

use std::fs;
use std::path::{Component, Path, PathBuf};

use eigenhand_files::{cannot, create_directory, sha256, write_atomically};
use serde::{Deserialize, Serialize};

use crate::{Bundle, BundleError, MOTORS};

/// Name of the file.
pub const NAME: &str = "manifest.json";

/// Version of the file.
const SCHEMA: u32 = 1;

/// Suffix of a file of an earlier export that somebody changed.
const EDITED: &str = ".edited";

/// What exports write besides the files of the bundle.
const WRITTEN: [&str; 8] = [
    "synergy/",
    "synergy-postures/",
    "scenes/",
    "ros2/",
    "synergy.npz",
    "policy.onnx",
    "policy.safetensors",
    "policy.toml",
];

#[derive(Serialize, Deserialize)]
struct Manifest {
    schema: u32,
    hand: String,
    eigenhand_version: String,
    files: Vec<Entry>,
}

#[derive(Serialize, Deserialize)]
struct Entry {
    path: String,
    bytes: usize,
    sha256: String,
}

/// Writes the manifest of a directory: every file but that of motors, which its owner changes.
pub fn write(bundle: &Bundle, directory: &Path) -> Result<(), BundleError> {
    let mut files = Vec::new();
    for path in list(directory)?.into_iter().filter(|path| path != MOTORS) {
        let file = directory.join(&path);
        let bytes = fs::read(&file).map_err(cannot("read", &file))?;
        files.push(Entry { path, bytes: bytes.len(), sha256: sha256(&bytes) });
    }
    let manifest = Manifest {
        schema: SCHEMA,
        hand: bundle.hand.manifest.name.clone(),
        eigenhand_version: bundle.version.to_owned(),
        files,
    };
    Ok(write_atomically(&directory.join(NAME), &serde_json::to_vec_pretty(&manifest)?)?)
}

/// Returns the files of an export: those of its manifest, the manifest, and the file of motors.
pub fn files(directory: &Path) -> Result<Vec<PathBuf>, BundleError> {
    let path = directory.join(NAME);
    let manifest: Manifest = serde_json::from_slice(&fs::read(&path).map_err(cannot("read", &path))?)?;
    let named = manifest.files.into_iter().map(|entry| directory.join(entry.path));
    let motors = Some(directory.join(MOTORS)).filter(|motors| motors.exists());
    Ok(named.chain([path]).chain(motors).collect())
}

/// Moves the files of a new export into a directory, in place of those of an earlier one, and returns notes. What the earlier
/// export wrote and somebody changed since is kept with a suffix.
pub fn replace(directory: &Path, new: &Path) -> Result<Vec<String>, BundleError> {
    let mut notes = Vec::new();
    let earlier = fs::read(directory.join(NAME)).ok().and_then(|bytes| serde_json::from_slice::<Manifest>(&bytes).ok());
    let entries = match earlier.filter(|earlier| earlier.schema == SCHEMA) {
        Some(earlier) => earlier.files.into_iter().map(|entry| (entry.path, Some(entry.sha256))).collect(),
        // An export of an earlier version has no manifest.
        None => list(directory)?
            .into_iter()
            .filter(|path| is_of_an_export(path))
            .map(|path| (path, None))
            .collect::<Vec<_>>(),
    };
    for (name, digest) in entries {
        let (path, file) = (Path::new(&name), directory.join(&name));
        // A manifest names no file outside its directory; one that does is not ours.
        if !path.components().all(|part| matches!(part, Component::Normal(_))) || !file.is_file() {
            continue;
        }
        let bytes = fs::read(&file).map_err(cannot("read", &file))?;
        if digest.is_some_and(|digest| digest != sha256(&bytes)) {
            let kept = format!("{name}{EDITED}");
            fs::rename(&file, directory.join(&kept)).map_err(cannot("rename", &file))?;
            notes.push(format!("{name} had been changed: it is kept as {kept}"));
        } else {
            fs::remove_file(&file).map_err(cannot("remove", &file))?;
        }
    }
    for name in list(new)? {
        let (from, to) = (new.join(&name), directory.join(&name));
        create_directory(to.parent().unwrap_or(directory))?;
        fs::rename(&from, &to).map_err(cannot("write", &to))?;
    }
    Ok(notes)
}

fn is_of_an_export(path: &str) -> bool {
    WRITTEN.iter().any(|name| path == *name || (name.ends_with('/') && path.starts_with(name)))
}

/// Lists the files below a directory, by their relative paths; none if it does not exist.
fn list(directory: &Path) -> Result<Vec<String>, BundleError> {
    let (mut found, mut places) = (Vec::new(), vec![String::new()]);
    while let Some(prefix) = places.pop() {
        let place = directory.join(&prefix);
        if !place.is_dir() {
            continue;
        }
        for entry in fs::read_dir(&place).map_err(cannot("list", &place))? {
            let path = entry.map_err(cannot("list", &place))?.path();
            let name = format!("{prefix}{}", path.file_name().unwrap_or_default().to_string_lossy());
            if path.is_dir() { places.push(format!("{name}/")) } else { found.push(name) }
        }
    }
    found.sort();
    Ok(found)
}
