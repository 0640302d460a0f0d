//! Replaces a directory as a whole.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::SynergyError;

/// What becomes of a directory that holds files of others.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Others {
    /// It is an error.
    Refuse,
    /// They stay.
    Keep,
}

/// Replaces the directory `dir` with one that holds `files`; `may_go` tells whether an old entry of that name may be
/// removed.
///
/// # Errors
/// A directory at `dir` with any other entry, unless these are to be kept, or a failure of the file system. After an error,
/// `dir` is unchanged.
pub(crate) fn replace_directory(
    dir: &Path,
    files: &[(&str, Vec<u8>)],
    may_go: fn(&str) -> bool,
    others: Others,
) -> Result<(), SynergyError> {
    // A symbolic link stays; the directory that it points to is replaced.
    let target = fs::canonicalize(dir).unwrap_or_else(|_| dir.to_owned());
    let exists = fs::symlink_metadata(&target).is_ok();
    let kept = if exists { others_in(&target, may_go)? } else { Vec::new() };
    if let Some(found) = kept.first().filter(|_| others == Others::Refuse) {
        let found = found.to_string_lossy().into_owned();
        return Err(SynergyError::NotAnExport { path: target, found });
    }
    let parent = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    fs::create_dir_all(parent).map_err(SynergyError::io("create", parent))?;
    let fresh = Scratch::create(&target, parent, "new")?;
    for (name, bytes) in files {
        write_synced(&fresh.path.join(name), bytes)?;
    }
    sync_directory(&fresh.path)?;
    if exists {
        let old = Scratch::create(&target, parent, "old")?;
        let aside = old.path.join("synergy");
        fs::rename(&target, &aside).map_err(SynergyError::io("move aside", &target))?;
        if let Err(error) = fs::rename(&fresh.path, &target) {
            if let Err(error) = fs::rename(&aside, &target) {
                // Keeps the copy of the earlier export: it is the only one left.
                std::mem::forget(old);
                return Err(SynergyError::io("restore", aside)(error));
            }
            return Err(SynergyError::io("replace", &target)(error));
        }
        for name in kept {
            let (from, to) = (aside.join(&name), target.join(&name));
            if let Err(error) = fs::rename(&from, to) {
                // Keeps what is left there: it is of others.
                std::mem::forget(old);
                return Err(SynergyError::io("move back", from)(error));
            }
        }
    } else {
        fs::rename(&fresh.path, &target).map_err(SynergyError::io("rename into place", &target))?;
    }
    sync_directory(parent)
}

/// Lists the entries that may not go.
fn others_in(dir: &Path, may_go: fn(&str) -> bool) -> Result<Vec<OsString>, SynergyError> {
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).map_err(SynergyError::io("list", dir))? {
        let name = entry.map_err(SynergyError::io("list", dir))?.file_name();
        if !name.to_str().is_some_and(may_go) {
            found.push(name);
        }
    }
    Ok(found)
}

fn write_synced(path: &Path, bytes: &[u8]) -> Result<(), SynergyError> {
    let inner = || {
        let mut file = File::create(path)?;
        file.write_all(bytes)?;
        file.sync_all()
    };
    inner().map_err(SynergyError::io("write", path))
}

fn sync_directory(dir: &Path) -> Result<(), SynergyError> {
    File::open(dir).and_then(|dir| dir.sync_all()).map_err(SynergyError::io("sync", dir))
}

/// A directory beside the target. It is removed with its content when dropped.
struct Scratch {
    path: PathBuf,
}

impl Scratch {
    fn create(target: &Path, parent: &Path, purpose: &str) -> Result<Self, SynergyError> {
        let Some(name) = target.file_name() else {
            let error = io::Error::new(io::ErrorKind::InvalidInput, "the path does not end in a name");
            return Err(SynergyError::io("create", target)(error));
        };
        let mut attempt = 0;
        loop {
            let path = parent.join(format!(".{}.{purpose}-{}-{attempt}", name.to_string_lossy(), std::process::id()));
            match fs::create_dir(&path) {
                Ok(()) => return Ok(Scratch { path }),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => attempt += 1,
                Err(error) => return Err(SynergyError::io("create", path)(error)),
            }
        }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // After a rename, nothing is left to remove. A leftover is harmless, and its error must not hide an earlier
        // one.
        let _ = fs::remove_dir_all(&self.path);
    }
}
