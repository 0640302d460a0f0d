//! The cache of generated hands: their files on disk, to be read like those of any other hand.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::error::HandError;
use crate::sources;

/// Writes files to a directory named after their digest, and returns it. A missing or damaged directory is written
/// again.
pub(super) fn store(files: &BTreeMap<PathBuf, Vec<u8>>) -> Result<PathBuf, HandError> {
    let digest = sources::digest(files);
    let mut roots = roots().into_iter();
    // The last root is the folder for temporary files; if it fails too, its error is returned.
    let last = roots.next_back().unwrap_or_default();
    roots.find_map(|root| store_in(&root, &digest, files).ok()).map_or_else(|| store_in(&last, &digest, files), Ok)
}

fn roots() -> Vec<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let cache = absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".cache")));
    cache.into_iter().chain([std::env::temp_dir()]).map(|root| root.join("eigenhand").join("hands")).collect()
}

fn store_in(root: &Path, digest: &str, files: &BTreeMap<PathBuf, Vec<u8>>) -> Result<PathBuf, HandError> {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let directory = root.join(digest);
    if holds(&directory, files) {
        return Ok(directory);
    }
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let partial = root.join(format!(".{digest}.{}.{number}.partial", std::process::id()));
    let written = write(&partial, files).and_then(|()| {
        if directory.exists() {
            std::fs::remove_dir_all(&directory).map_err(HandError::io(&directory))?;
        }
        std::fs::rename(&partial, &directory).map_err(HandError::io(&directory))
    });
    if written.is_err() {
        // The error to report is that of writing, not of this clean-up.
        _ = std::fs::remove_dir_all(&partial);
    }
    // Another process may have written the same hand first.
    if holds(&directory, files) { Ok(directory) } else { written.map(|()| directory) }
}

fn write(directory: &Path, files: &BTreeMap<PathBuf, Vec<u8>>) -> Result<(), HandError> {
    std::fs::create_dir_all(directory).map_err(HandError::io(directory))?;
    for (name, content) in files {
        let path = directory.join(name);
        let folder = path.parent().unwrap_or(directory);
        std::fs::create_dir_all(folder).map_err(HandError::io(folder))?;
        std::fs::write(&path, content).map_err(HandError::io(&path))?;
    }
    Ok(())
}

fn holds(directory: &Path, files: &BTreeMap<PathBuf, Vec<u8>>) -> bool {
    files.iter().all(|(name, content)| std::fs::read(directory.join(name)).is_ok_and(|found| found == *content))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_or_damaged_is_written_again() {
        let root = tempfile::tempdir().unwrap();
        let files: BTreeMap<PathBuf, Vec<u8>> =
            [("hand.toml".into(), b"a".to_vec()), ("meshes/b.stl".into(), b"b".to_vec())].into();
        let directory = store_in(root.path(), "digest", &files).unwrap();
        assert!(holds(&directory, &files));
        std::fs::write(directory.join("meshes/b.stl"), "c").unwrap();
        assert_eq!(store_in(root.path(), "digest", &files).unwrap(), directory);
        assert!(holds(&directory, &files));
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 1, "nothing else is left");
        let clash: BTreeMap<PathBuf, Vec<u8>> = [("a".into(), Vec::new()), ("a/b".into(), Vec::new())].into();
        assert!(matches!(store_in(root.path(), "clash", &clash), Err(HandError::Io { .. })));
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 1, "nothing else is left");
    }
}
