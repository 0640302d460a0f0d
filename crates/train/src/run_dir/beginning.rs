//! The beginning of a run: what it leaves if it is stopped before its first checkpoint, and the configuration that it keeps.

use std::fs;
use std::path::Path;

use eigenhand_files::{cannot, create_directory, write_atomically};
use eigenhand_synergy::{PostureDatabase, SynergyError};

use super::{CONFIG, DATABASE, LOCK, PROVENANCE};
use crate::config::{Settings, parse_settings, read_layer};
use crate::error::TrainError;

const CHECKPOINTS: &str = "checkpoints";
/// Keys of the configuration that may change while a run is stopped.
const FREE: [&str; 3] = ["episodes", "workers", "tensorboard"];
/// Files that a run writes before its first checkpoint.
const WRITTEN: [&str; 9] =
    [LOCK, CONFIG, PROVENANCE, DATABASE, "action-space.toml", "start.sqlite", "log.txt", "status.json", "metrics.csv"];
/// What writers append to the name of a file while they write it.
const UNFINISHED: [&str; 5] = ["", ".partial", "-wal", "-shm", "-journal"];
/// Beginning of the names of event files, and of checkpoints that are being written.
const EVENTS: &str = "events.out.tfevents.";
const PARTIAL: &str = ".episode-";
/// Files in the directory of checkpoints beside these.
const BESIDE: [&str; 2] = ["replay.bin", CONFIG];
/// Size in bytes of an SQLite file without a table, at most.
const BLANK: u64 = 8192;

/// Tells whether a directory is empty, or holds nothing but what a run leaves that is stopped before its first checkpoint.
pub(super) fn is_beginning(run: &Path) -> Result<bool, TrainError> {
    let names = names(run)?;
    if !names.is_empty() && !names.iter().any(|name| name == LOCK) {
        return Ok(false);
    }
    let known = |name: &String| is_one_of(&WRITTEN, name) || name.starts_with(EVENTS) || name == CHECKPOINTS;
    if !names.iter().all(known) {
        return Ok(false);
    }
    let in_checkpoints = names_if_any(&run.join(CHECKPOINTS))?;
    if !in_checkpoints.iter().all(|name| is_one_of(&BESIDE, name) || name.starts_with(PARTIAL)) {
        return Ok(false);
    }
    let database = run.join(DATABASE);
    if !database.exists() {
        return Ok(true);
    }
    match PostureDatabase::open_existing(&database).and_then(|database| database.is_empty()) {
        Ok(is_empty) => Ok(is_empty),
        Err(SynergyError::Io { .. }) => Ok(false),
        Err(_) => Ok(fs::metadata(&database).is_ok_and(|metadata| metadata.len() <= BLANK)),
    }
}

/// Removes what such a run has left, but for its lock, configuration and provenance.
pub(super) fn clear(run: &Path) -> Result<(), TrainError> {
    for name in names(run)? {
        let path = run.join(&name);
        if name == CHECKPOINTS {
            fs::remove_dir_all(&path).map_err(cannot("remove", &path))?;
        } else if ![LOCK, CONFIG, PROVENANCE].contains(&name.as_str()) {
            fs::remove_file(&path).map_err(cannot("remove", &path))?;
        }
    }
    Ok(())
}

/// Keeps a copy of the configuration, with which a resumed run is compared.
pub(super) fn keep_config(run: &Path, text: &str) -> Result<(), TrainError> {
    create_directory(&run.join(CHECKPOINTS))?;
    Ok(write_atomically(&run.join(CHECKPOINTS).join(CONFIG), text.as_bytes())?)
}

/// Compares the configuration with the copy. A run of an earlier version has none.
pub(super) fn check_config(run: &Path) -> Result<(), TrainError> {
    let (path, copy) = (run.join(CONFIG), run.join(CHECKPOINTS).join(CONFIG));
    if !copy.exists() {
        return Ok(());
    }
    let settings = |path: &Path| -> Result<Settings, TrainError> {
        Ok(parse_settings(&path.display().to_string(), &read_layer(path)?)?)
    };
    let (before, now) = (settings(&copy)?, settings(&path)?);
    let value = |settings: &Settings, key: &String| settings.get(key).cloned().unwrap_or_else(|| "absent".to_owned());
    let differs = |key: &&String| !FREE.contains(&key.as_str()) && before.get(*key) != now.get(*key);
    match before.keys().chain(now.keys()).find(differs) {
        None => Ok(()),
        Some(key) => Err(TrainError::ConfigChanged {
            path,
            key: key.clone(),
            before: value(&before, key),
            now: value(&now, key),
        }),
    }
}

fn is_one_of(names: &[&str], name: &str) -> bool {
    names.iter().any(|known| name.strip_prefix(known).is_some_and(|rest| UNFINISHED.contains(&rest)))
}

fn names_if_any(directory: &Path) -> Result<Vec<String>, TrainError> {
    if directory.is_dir() { names(directory) } else { Ok(Vec::new()) }
}

fn names(directory: &Path) -> Result<Vec<String>, TrainError> {
    let entries = fs::read_dir(directory).map_err(cannot("read", directory))?;
    let name = |entry: std::io::Result<fs::DirEntry>| Ok(entry?.file_name().to_string_lossy().into_owned());
    Ok(entries.map(name).collect::<std::io::Result<_>>().map_err(cannot("read", directory))?)
}
