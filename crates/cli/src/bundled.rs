//! The hands that come with the program.
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

/// Characters of the digest that name the directory.
const DIGITS: usize = 16;

/// Returns the directory of the bundled hands, and writes it first if it does not exist.
pub(crate) fn directory() -> anyhow::Result<PathBuf> {
    let project = ProjectDirs::from("", "", "eigenhand").context("there is no home directory; set HOME")?;
    write_below(project.cache_dir())
}

fn write_below(cache: &Path) -> anyhow::Result<PathBuf> {
    let hands: Vec<&Dir> =
        PLUGINS.dirs().filter(|hand| hand.get_file(hand.path().join(MANIFEST_FILE)).is_some()).collect();
    let mut described = String::new();
    hands.iter().for_each(|hand| describe(hand, &mut described));
    let directory = cache.join(format!("hands-{}", &sha256(described.as_bytes())[..DIGITS]));
    if directory.is_dir() {
        return Ok(directory);
    }
    create_directory(cache)?;
    // Removed with its contents if a line below fails.
    let partial = tempfile::Builder::new().prefix(".hands-").tempdir_in(cache).map_err(cannot("write in", cache))?;
    for hand in hands {
        let place = partial.path().join(hand.path());
        create_directory(&place)?;
        hand.extract(partial.path()).map_err(cannot("write", &place))?;
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
        let directory = write_below(&cache.path().join("deep")).expect("writable");
        let mut path = SearchPath::new();
        path.push(&directory, "the test");
        let registry = Registry::discover(&path).expect("readable");
        assert!(registry.list().len() >= 4 && registry.list().iter().all(|entry| entry.hand.is_ok()), "{registry:?}");
        let written = || directory.metadata().and_then(|metadata| metadata.modified()).expect("it is there");
        let before = written();
        assert_eq!(write_below(&cache.path().join("deep")).expect("readable"), directory);
        assert_eq!((written(), cache.path().join("deep").read_dir().expect("readable").count()), (before, 1));
    }
}
