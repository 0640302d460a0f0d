//! The hands and the ready synergies that come with the program.
//!
//! Their directories are compiled into the program. They are written once into the user's cache, in a directory with
//! their digest as its name. Compiled plugins are not among them, because their libraries are built in a checkout.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use directories::ProjectDirs;
use eigenhand_files::{cannot, create_directory, sha256};
use eigenhand_hands::MANIFEST_FILE;
use include_dir::{Dir, DirEntry, include_dir};

static PLUGINS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../plugins");
static SYNERGIES: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../synergies");

/// Characters of the digest that name the directory.
const DIGITS: usize = 16;

/// Returns the directory of the bundled hands, and writes it first if it does not exist.
pub(crate) fn directory() -> anyhow::Result<PathBuf> {
    let is_hand = |hand: &&Dir<'_>| hand.get_file(hand.path().join(MANIFEST_FILE)).is_some();
    write_below(&cache()?, "hands", &PLUGINS.dirs().filter(is_hand).collect::<Vec<_>>())
}

/// Returns the names of the ready synergies, which are those of their hands.
pub(crate) fn synergies() -> Vec<&'static str> {
    SYNERGIES.dirs().filter_map(|hand| hand.path().file_name()?.to_str()).collect()
}

/// Returns the path of a synergy that the user named: a path that exists, or else the directory of the ready synergy with
/// this name, which is written first if it does not exist. Any other path is returned as it is.
pub(crate) fn synergy_at(path: &Path) -> anyhow::Result<PathBuf> {
    match path.to_str().filter(|name| !path.exists() && synergies().contains(name)) {
        None => Ok(path.to_owned()),
        Some(name) => Ok(write_below(&cache()?, "synergies", &SYNERGIES.dirs().collect::<Vec<_>>())?.join(name)),
    }
}

fn cache() -> anyhow::Result<PathBuf> {
    let project = ProjectDirs::from("", "", "eigenhand").context("there is no home directory; set HOME")?;
    Ok(project.cache_dir().to_owned())
}

/// (cache, what they are, directories) => the directory with all of these
fn write_below(cache: &Path, kind: &str, directories: &[&Dir<'_>]) -> anyhow::Result<PathBuf> {
    let mut described = String::new();
    directories.iter().for_each(|directory| describe(directory, &mut described));
    let directory = cache.join(format!("{kind}-{}", &sha256(described.as_bytes())[..DIGITS]));
    if directory.is_dir() {
        return Ok(directory);
    }
    create_directory(cache)?;
    // Removed with its contents if a line below fails.
    let partial =
        tempfile::Builder::new().prefix(&format!(".{kind}-")).tempdir_in(cache).map_err(cannot("write in", cache))?;
    for inner in directories {
        let place = partial.path().join(inner.path());
        create_directory(&place)?;
        inner.extract(partial.path()).map_err(cannot("write", &place))?;
    }
    match fs::rename(partial.path(), &directory) {
        // Another process was faster.
        Err(_) if directory.is_dir() => Ok(directory),
        outcome => {
            outcome.map_err(cannot("write", &directory))?;
            Ok(directory)
        }
    }
}

/// Appends the name and the digest of every file below a directory.
fn describe(directory: &Dir, text: &mut String) {
    for entry in directory.entries() {
        match entry {
            DirEntry::Dir(inner) => describe(inner, text),
            DirEntry::File(file) => {
                text.push_str(&format!("{} {}\n", file.path().display(), sha256(file.contents())));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use eigenhand_hands::{Registry, SearchPath};

    use super::*;

    #[test]
    fn the_bundled_hands_are_sound_and_written_once() {
        let cache = tempfile::tempdir().expect("a directory");
        let hands: Vec<&Dir<'_>> = PLUGINS.dirs().collect();
        let write = || write_below(&cache.path().join("deep"), "hands", &hands).expect("writable");
        let directory = write();
        let mut path = SearchPath::new();
        path.push(&directory, "the test");
        let registry = Registry::discover(&path).expect("readable");
        assert!(registry.list().len() >= 4 && registry.list().iter().all(|entry| entry.hand.is_ok()), "{registry:?}");
        let written = || directory.metadata().and_then(|metadata| metadata.modified()).expect("it is there");
        let before = written();
        assert_eq!(write(), directory);
        assert_eq!((written(), cache.path().join("deep").read_dir().expect("readable").count()), (before, 1));
    }
}
