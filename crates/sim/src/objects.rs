//! Objects to grasp. Each is a file in a set; the sets of this repository are compiled into the program.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use eigenhand_files::read_regular;
use eigenhand_hands::LARGEST_FILE;
use include_dir::{Dir, include_dir};

use crate::SimError;

mod definition;
mod mesh;
mod shape;

use definition::ObjectManifest;
pub use mesh::ConvexMesh;
pub use shape::Shape;

static SETS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../objects");

/// The set whose objects need no name of a set.
pub const PAPER: &str = "paper";
const EXTENSION: &str = "toml";

/// An object to grasp.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Name: that of its file.
    pub name: String,
    /// The object id of the observation.
    pub id: usize,
    /// Shape and size.
    pub shape: Shape,
    /// Mass in kg.
    pub mass: f64,
    /// Sliding friction, instead of `physics.friction`.
    pub friction: Option<f64>,
}

/// A set of objects that comes with the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectSet {
    /// Name.
    pub name: String,
    /// Names of its objects, sorted.
    pub objects: Vec<String>,
}

impl ObjectSet {
    /// Lists the sets that come with the program.
    pub fn all() -> Vec<ObjectSet> {
        let name = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mut sets: Vec<ObjectSet> = SETS
            .dirs()
            .map(|set| {
                let files = set.files().map(|file| file.path()).filter(|path| is_object(path));
                let mut objects: Vec<String> = files.map(name).collect();
                objects.sort();
                ObjectSet { name: name(set.path()), objects }
            })
            .collect();
        sets.sort_by(|a, b| a.name.cmp(&b.name));
        sets
    }
}

impl Object {
    /// Lists the words of single objects that some words stand for: a set or a directory becomes its objects, and the
    /// path of a file becomes absolute. The objects of a set are in the order of their ids.
    ///
    /// A word is an object (`cube`, `varied/can`), a set (`varied`), a directory or a file.
    ///
    /// # Errors
    /// [`SimError::UnknownObject`] lists the sets and their objects. A set's or directory's objects are read, with the
    /// errors of [`read_all`](Self::read_all).
    pub fn expand(words: &[String]) -> Result<Vec<String>, SimError> {
        let mut found = Vec::new();
        for word in words {
            if let Some((set, object)) = bundled(word) {
                found.push(short(&set, &object));
            } else if let Some(set) = ObjectSet::all().into_iter().find(|set| set.name == *word) {
                found.extend(by_id(set.objects.iter().map(|object| short(&set.name, object)).collect())?);
            } else {
                let path = std::path::absolute(word).unwrap_or_else(|_| PathBuf::from(word));
                if path.is_dir() {
                    found.extend(by_id(files_in(&path)?.iter().map(|file| file.display().to_string()).collect())?);
                } else if is_object(&path) {
                    found.push(path.display().to_string());
                } else {
                    return Err(unknown(word));
                }
            }
        }
        Ok(found)
    }

    /// Reads the objects that some words stand for, with their lengths multiplied by `scale`.
    ///
    /// # Errors
    /// As [`expand`](Self::expand); [`SimError::ReadAsset`] for a file that cannot be read, [`SimError::ObjectFile`] for
    /// one that is wrong, [`SimError::Setting`] for two objects of one name.
    pub fn read_all(words: &[String], scale: f64) -> Result<Vec<Object>, SimError> {
        let objects: Vec<Object> =
            Object::expand(words)?.iter().map(|word| Object::read(word)).collect::<Result<_, _>>()?;
        let mut names = BTreeSet::new();
        if let Some(twice) = objects.iter().find(|object| !names.insert(object.name.as_str())) {
            return Err(SimError::Setting {
                name: "objects",
                expected: "objects of distinct names",
                got: format!("{} twice", twice.name),
            });
        }
        Ok(objects.into_iter().map(|object| Object { shape: object.shape.scaled(scale), ..object }).collect())
    }

    /// Reads the object of a word that stands for one.
    fn read(word: &str) -> Result<Object, SimError> {
        let file = |name: &str| Path::new(name).with_extension(EXTENSION);
        if let Some((set, object)) = bundled(word) {
            let path = Path::new(&set).join(file(&object));
            let read = |path: &Path| -> Result<Vec<u8>, SimError> {
                let file = SETS.get_file(path).map(|file| file.contents().to_vec());
                file.ok_or_else(|| SimError::ObjectFile {
                    path: path.to_owned(),
                    reason: "there is no file".to_owned(),
                })
            };
            let place = ObjectSet::all().into_iter().find(|s| s.name == set).map(|s| s.objects);
            return Object::of(&path, place.unwrap_or_default().iter().position(|name| *name == object), read);
        }
        let path = Path::new(word);
        let read = |path: &Path| {
            read_regular(path, LARGEST_FILE).map_err(|source| SimError::ReadAsset { path: path.to_owned(), source })
        };
        let beside = path.parent().map(files_in).transpose()?.unwrap_or_default();
        Object::of(path, beside.iter().position(|file| file == path), read)
    }

    fn of(
        path: &Path,
        place: Option<usize>,
        read: impl Fn(&Path) -> Result<Vec<u8>, SimError>,
    ) -> Result<Object, SimError> {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if !is_name(&name) {
            let reason = "expected a file name of lower-case letters, digits, '-' and '_'".to_owned();
            return Err(SimError::ObjectFile { path: path.to_owned(), reason });
        }
        let manifest = ObjectManifest::parse(&String::from_utf8_lossy(&read(path)?), path)?;
        Ok(Object {
            id: manifest.id.or(place).unwrap_or(0),
            shape: manifest.shape(path, read)?,
            mass: manifest.mass,
            friction: manifest.friction,
            name,
        })
    }
}

/// Finds an object that comes with the program; returns its set and its name.
fn bundled(word: &str) -> Option<(String, String)> {
    let (set, object) = word.split_once('/').unwrap_or((PAPER, word));
    let known = ObjectSet::all().into_iter().find(|known| known.name == set)?;
    known.objects.iter().any(|name| name == object).then(|| (set.to_owned(), object.to_owned()))
}

/// Sorts words of single objects by the objects' ids.
fn by_id(words: Vec<String>) -> Result<Vec<String>, SimError> {
    let read = |word: String| Ok((Object::read(&word)?.id, word));
    let mut objects: Vec<(usize, String)> = words.into_iter().map(read).collect::<Result<_, SimError>>()?;
    objects.sort_by_key(|(id, _)| *id);
    Ok(objects.into_iter().map(|(_, word)| word).collect())
}

/// Returns the word of an object that comes with the program.
fn short(set: &str, object: &str) -> String {
    if set == PAPER { object.to_owned() } else { format!("{set}/{object}") }
}

fn unknown(word: &str) -> SimError {
    let sets: Vec<String> =
        ObjectSet::all().iter().map(|set| format!("{} ({})", set.name, set.objects.join(", "))).collect();
    SimError::UnknownObject { name: word.to_owned(), known: sets.join("; ") }
}

/// Lists the files of objects in a directory, sorted.
fn files_in(directory: &Path) -> Result<Vec<PathBuf>, SimError> {
    let failed = |source| SimError::ReadAsset { path: directory.to_owned(), source };
    let entries = directory.read_dir().map_err(failed)?.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let mut files: Vec<PathBuf> = entries.iter().map(|entry| entry.path()).filter(|path| is_object(path)).collect();
    files.sort();
    if files.is_empty() {
        let reason = "there is no object in it: expected files that end with .toml".to_owned();
        return Err(SimError::ObjectFile { path: directory.to_owned(), reason });
    }
    Ok(files)
}

fn is_object(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == EXTENSION)
}

fn is_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_';
    !name.is_empty() && name.chars().all(allowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(words: &[&str]) -> Vec<String> {
        words.iter().map(|&word| word.to_owned()).collect()
    }

    #[test]
    fn the_objects_of_the_paper_keep_their_ids_and_sizes() {
        let names = ["sphere", "cube", "cylinder", "capsule", "box", "ellipsoid", "disc"];
        let objects = Object::read_all(&words(&names), 1.0).expect("bundled");
        assert_eq!(objects.iter().map(|object| object.id).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6]);
        assert!(objects.iter().all(|object| object.mass == 0.1 && object.friction.is_none()));
        let shapes: Vec<Shape> = objects.into_iter().map(|object| object.shape).collect();
        let expected = [
            Shape::Sphere { radius: 0.035 },
            Shape::Box { half: [0.03, 0.03, 0.03] },
            Shape::Cylinder { radius: 0.03, half_height: 0.04 },
            Shape::Capsule { radius: 0.028, half_length: 0.025 },
            Shape::Box { half: [0.025, 0.03, 0.045] },
            Shape::Ellipsoid { half: [0.03, 0.035, 0.045] },
            Shape::Cylinder { radius: 0.04, half_height: 0.02 },
        ];
        assert_eq!(shapes, expected);
        assert_eq!(Object::expand(&words(&["paper"])).expect("bundled"), names);
    }

    #[test]
    fn every_object_that_comes_with_the_program_is_sound_and_has_an_id_and_a_name_of_its_own() {
        let sets = ObjectSet::all();
        let mut names = BTreeSet::new();
        for set in &sets {
            let objects = Object::read_all(std::slice::from_ref(&set.name), 1.0).unwrap_or_else(|e| panic!("{e}"));
            let ids: BTreeSet<usize> = objects.iter().map(|object| object.id).collect();
            assert_eq!(ids, (0..objects.len()).collect());
            assert!(objects.into_iter().all(|object| names.insert(object.name)), "{}: a name is used twice", set.name);
        }
        let count = |name: &str| sets.iter().find(|set| set.name == name).map_or(0, |set| set.objects.len());
        assert!(count("varied") >= 20 && count("unseen") >= 8, "{sets:?}");
    }

    #[test]
    fn words_stand_for_objects_sets_and_files() {
        let expand = |list: &[&str]| Object::expand(&words(list)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(expand(&["paper/cube", "sphere", "varied/can"]), ["cube", "sphere", "varied/can"]);
        let directory = std::env::temp_dir().join(format!("eigenhand-objects-{}", std::process::id()));
        std::fs::create_dir_all(&directory).expect("writable");
        for name in ["b", "a"] {
            let text = "schema = 1\nmass = 0.1\nfriction = 0.5\n[shape]\nkind = \"sphere\"\nradius = 0.03\n";
            std::fs::write(directory.join(name).with_extension("toml"), text).expect("writable");
        }
        let found = expand(&[&directory.display().to_string()]);
        assert_eq!(expand(&[&found[0], &found[1]]), found, "expanded words stay as they are");
        let objects = Object::read_all(&found, 2.0).unwrap_or_else(|error| panic!("{error}"));
        let seen: Vec<_> = objects.iter().map(|o| (o.name.as_str(), o.id, o.friction)).collect();
        assert_eq!(seen, [("a", 0, Some(0.5)), ("b", 1, Some(0.5))]);
        assert_eq!(objects[0].shape, Shape::Sphere { radius: 0.06 });
        let twice = words(&["cube", "cube"]);
        assert!(Object::read_all(&twice, 1.0).expect_err("twice").to_string().contains("cube twice"));
        std::fs::remove_dir_all(&directory).expect("it is there");
    }

    #[test]
    fn an_unknown_word_is_answered_with_the_sets_and_their_objects() {
        for word in ["cub", "varied/cup-of-tea", "no/such/directory"] {
            let message = Object::expand(&words(&[word])).expect_err(word).to_string();
            let known = ["paper (box, capsule, cube", "unseen (", "varied ("];
            assert!(message.contains(word) && known.iter().all(|part| message.contains(part)), "{message}");
        }
    }
}
