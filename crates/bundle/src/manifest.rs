//! `manifest.json`: every file of a bundle, with its size and its digest.

use std::fs;
use std::path::{Path, PathBuf};

use eigenhand_files::{cannot, sha256, write_atomically};
use serde::Serialize;

use crate::{Bundle, BundleError, MOTORS};

/// Name of the file.
pub const NAME: &str = "manifest.json";

#[derive(Serialize)]
struct Manifest<'a> {
    schema: u32,
    hand: &'a str,
    eigenhand_version: &'a str,
    files: Vec<Entry>,
}

#[derive(Serialize)]
struct Entry {
    path: String,
    bytes: usize,
    sha256: String,
}

/// Writes the manifest of a directory, and returns the files that it names. The file of motors, which its owner changes, is
/// none of them.
pub fn write(bundle: &Bundle, directory: &Path) -> Result<Vec<PathBuf>, BundleError> {
    let mut files = Vec::new();
    list(directory, "", &mut files)?;
    files.sort_by(|a, b| a.path.cmp(&b.path));
    let paths = files.iter().map(|file| directory.join(&file.path)).collect();
    let manifest = Manifest { schema: 1, hand: &bundle.hand.manifest.name, eigenhand_version: bundle.version, files };
    write_atomically(&directory.join(NAME), &serde_json::to_vec_pretty(&manifest)?)?;
    Ok(paths)
}

fn list(directory: &Path, prefix: &str, files: &mut Vec<Entry>) -> Result<(), BundleError> {
    for entry in fs::read_dir(directory).map_err(cannot("list", directory))? {
        let path = entry.map_err(cannot("list", directory))?.path();
        let name = format!("{prefix}{}", path.file_name().unwrap_or_default().to_string_lossy());
        if path.is_dir() {
            list(&path, &format!("{name}/"), files)?;
        } else if name != NAME && name != MOTORS {
            let bytes = fs::read(&path).map_err(cannot("read", &path))?;
            files.push(Entry { path: name, bytes: bytes.len(), sha256: sha256(&bytes) });
        }
    }
    Ok(())
}
