//! Finds hands by name in the directories of plugins.

use std::path::{Path, PathBuf};

use crate::compiled::{self, SIDECAR_FILE};
use crate::error::{HandError, nearest};
use crate::hand::Hand;
use crate::manifest::MANIFEST_FILE;
use crate::sources::read_text;
use crate::summary::HandSummary;

/// Environment variable with more directories of plugins, separated as in `PATH`.
pub const PLUGINS_VARIABLE: &str = "EIGENHAND_PLUGINS";

const PLUGINS_FOLDER: &str = "plugins";
const WORKSPACE_MARK: &str = "Cargo.lock";

/// Directories to search for plugins, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SearchPath {
    places: Vec<Place>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Place {
    directory: PathBuf,
    origin: String,
    must_exist: bool,
    /// True if a hand here is ignored when another place has a hand of the same name.
    gives_way: bool,
}

impl SearchPath {
    /// Starts an empty search path.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the usual path: `plugins/` of the workspace or current directory, then the directories of
    /// [`PLUGINS_VARIABLE`], then `extra`.
    pub fn from_environment(extra: &[PathBuf]) -> Self {
        let mut path = Self::new();
        if let Ok(current) = std::env::current_dir() {
            path.add_workspace(&current);
        }
        if let Some(value) = std::env::var_os(PLUGINS_VARIABLE) {
            std::env::split_paths(&value)
                .filter(|p| !p.as_os_str().is_empty())
                .for_each(|p| path.push(p, PLUGINS_VARIABLE));
        }
        extra.iter().for_each(|p| path.push(p.clone(), "--plugins"));
        path
    }

    /// Adds a directory of plugins, or one plugin's own directory. Errors name `origin`, the option or variable that
    /// named it.
    pub fn push(&mut self, directory: impl Into<PathBuf>, origin: &str) {
        let (directory, origin) = (directory.into(), origin.to_owned());
        self.places.push(Place { directory, origin, must_exist: true, gives_way: false });
    }

    /// Adds a directory of hands that come with the program. Such a hand is ignored if an earlier place has a hand of the
    /// same name.
    pub fn fall_back_on(&mut self, directory: impl Into<PathBuf>) {
        let (directory, origin) = (directory.into(), "the program".to_owned());
        self.places.push(Place { directory, origin, must_exist: true, gives_way: true });
    }

    fn add_workspace(&mut self, current: &Path) {
        let here = current.join(PLUGINS_FOLDER);
        let above = || {
            current
                .ancestors()
                .find(|d| d.join(WORKSPACE_MARK).is_file() && d.join(PLUGINS_FOLDER).is_dir())
                .map(|d| d.join(PLUGINS_FOLDER))
        };
        let directory = if here.is_dir() { here } else { above().unwrap_or(here) };
        self.places.push(Place { directory, origin: "the workspace".to_owned(), must_exist: false, gives_way: false });
    }
}

/// A hand that was found, valid or broken.
#[derive(Debug)]
pub struct RegistryEntry {
    /// Name in the manifest; name of the directory if the manifest cannot be read.
    pub name: String,
    /// The hand's directory.
    pub directory: PathBuf,
    /// The hand, or its error.
    pub hand: Result<Hand, HandError>,
}

impl RegistryEntry {
    /// Summarises the hand; none if it is broken.
    pub fn summary(&self) -> Option<HandSummary> {
        self.hand.as_ref().ok().map(HandSummary::of)
    }
}

/// All hands of a search path.
#[derive(Debug)]
pub struct Registry {
    entries: Vec<RegistryEntry>,
    searched: Vec<PathBuf>,
}

impl Registry {
    /// Looks for hands in every directory of `path`. A broken hand becomes an entry with its error.
    ///
    /// # Errors
    /// A named directory does not exist or cannot be read.
    pub fn discover(path: &SearchPath) -> Result<Self, HandError> {
        let mut registry = Self { entries: Vec::new(), searched: Vec::new() };
        let mut seen = Vec::new();
        for place in &path.places {
            if !place.directory.is_dir() {
                if place.must_exist {
                    return Err(HandError::NoPluginDirectory {
                        path: place.directory.clone(),
                        origin: place.origin.clone(),
                    });
                }
                continue;
            }
            registry.searched.push(place.directory.clone());
            for directory in plugin_directories(&place.directory)? {
                let canonical = directory.canonicalize().map_err(HandError::io(&directory))?;
                if seen.contains(&canonical) {
                    continue;
                }
                seen.push(canonical);
                let entry = read_entry(directory);
                let is_taken = registry.entries.iter().any(|known| known.name == entry.name);
                if !(place.gives_way && is_taken) {
                    registry.entries.push(entry);
                }
            }
        }
        registry.mark_duplicates();
        registry.entries.sort_by(|a, b| a.name.cmp(&b.name).then_with(|| a.directory.cmp(&b.directory)));
        Ok(registry)
    }

    /// Lists every hand that was found, by name.
    pub fn list(&self) -> &[RegistryEntry] {
        &self.entries
    }

    /// Returns the hand of this name, or the hand in this directory if `name` is a path.
    ///
    /// # Errors
    /// No such hand, several of that name, or a broken one.
    pub fn get(&self, name: &str) -> Result<Hand, HandError> {
        // The name of a broken hand may be a guess, so it hides neither a valid hand nor two valid hands of one name.
        let unreadable = |entry: &&RegistryEntry| match &entry.hand {
            Ok(_) | Err(HandError::DuplicateHand { .. }) => false,
            Err(_) => true,
        };
        let named = self.entries.iter().filter(|entry| entry.name == name);
        match named.min_by_key(unreadable) {
            Some(RegistryEntry { hand: Ok(hand), .. }) => Ok(hand.clone()),
            Some(RegistryEntry { hand: Err(HandError::DuplicateHand { name, first, second }), .. }) => {
                Err(HandError::DuplicateHand { name: name.clone(), first: first.clone(), second: second.clone() })
            }
            Some(entry) => compiled::load_either(&entry.directory),
            None if name.contains(std::path::MAIN_SEPARATOR) || compiled::holds_hand(Path::new(name)) => {
                compiled::load_either(Path::new(name))
            }
            None => Err(HandError::UnknownHand {
                got: name.to_owned(),
                nearest: nearest(name, self.entries.iter().map(|e| e.name.as_str())),
                known: self.entries.iter().map(|e| e.name.clone()).collect(),
                searched: self.searched.iter().map(|p| p.display().to_string()).collect(),
            }),
        }
    }

    /// Replaces every valid hand that shares its name with another valid hand by an error.
    fn mark_duplicates(&mut self) {
        let named: Vec<(String, PathBuf)> =
            self.entries.iter().filter(|e| e.hand.is_ok()).map(|e| (e.name.clone(), e.directory.clone())).collect();
        for entry in self.entries.iter_mut().filter(|e| e.hand.is_ok()) {
            let mut same = named.iter().filter(|(name, _)| *name == entry.name);
            let (Some((_, first)), Some((_, next))) = (same.next(), same.next()) else {
                continue;
            };
            let other = if entry.directory == *first { next } else { &entry.directory };
            entry.hand =
                Err(HandError::DuplicateHand { name: entry.name.clone(), first: first.clone(), second: other.clone() });
        }
    }
}

fn plugin_directories(place: &Path) -> Result<Vec<PathBuf>, HandError> {
    if compiled::holds_hand(place) {
        return Ok(vec![place.to_path_buf()]);
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(place).map_err(HandError::io(place))? {
        let path = entry.map_err(HandError::io(place))?.path();
        // A new hand is written under a hidden name and then renamed.
        let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if !hidden && compiled::holds_hand(&path) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn read_entry(directory: PathBuf) -> RegistryEntry {
    let hand = compiled::load_either(&directory);
    let name = match &hand {
        Ok(hand) => hand.manifest.name.clone(),
        Err(_) => written_name(&directory),
    };
    RegistryEntry { name, directory, hand }
}

/// Returns the name of a broken hand: from its manifest or sidecar if readable, otherwise from its directory.
fn written_name(directory: &Path) -> String {
    let name_in = |file: &&str| {
        let table: toml::Table = toml::from_str(&read_text(&directory.join(file)).ok()?).ok()?;
        table.get("name").and_then(toml::Value::as_str).map(str::to_owned)
    };
    let name = [MANIFEST_FILE, SIDECAR_FILE].iter().find_map(name_in);
    name.unwrap_or_else(|| directory.file_name().unwrap_or_default().to_string_lossy().into_owned())
}
