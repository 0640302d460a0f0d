//! Finding hands by name.

use std::path::Path;
use std::process::Command;

use eigenhand_hands::{HandError, PLUGINS_VARIABLE, Registry, SearchPath};
use tempfile::TempDir;

use crate::fixture;

fn rename(directory: &Path, name: &str) {
    let path = directory.join("hand.toml");
    let text = std::fs::read_to_string(&path).unwrap().replace("\"pincer\"", &format!("\"{name}\""));
    std::fs::write(path, text).unwrap();
}

fn place_with(hands: &[(&str, &str)]) -> TempDir {
    let place = TempDir::new().unwrap();
    for (folder, name) in hands {
        fixture::write(&place.path().join(folder));
        rename(&place.path().join(folder), name);
    }
    place
}

fn discover(places: &[&Path]) -> Registry {
    let mut path = SearchPath::new();
    places.iter().for_each(|p| path.push(*p, "--plugins"));
    Registry::discover(&path).unwrap()
}

#[test]
fn hands_are_found_by_name_and_by_path() {
    let place = place_with(&[("b", "bravo"), ("a", "alpha")]);
    std::fs::create_dir(place.path().join("no-hand")).unwrap();
    // A hand that is being written.
    fixture::write(&place.path().join(".bravo.x1y2"));
    let registry = discover(&[place.path()]);
    let names: Vec<&str> = registry.list().iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["alpha", "bravo"]);
    assert_eq!(registry.get("bravo").unwrap().directory, place.path().join("b"));
    let other = place_with(&[("c", "charlie")]);
    let path = other.path().join("c");
    assert_eq!(registry.get(path.to_str().unwrap()).unwrap().manifest.name, "charlie");
    assert_eq!(discover(&[&path]).get("charlie").unwrap().directory, path);
}

#[test]
fn an_unknown_hand_names_the_nearest() {
    let place = place_with(&[("a", "alpha"), ("b", "bravo")]);
    let error = discover(&[place.path()]).get("alhpa").unwrap_err();
    assert_eq!(
        error.to_string(),
        format!(
            "no hand is named `alhpa` (did you mean `alpha`?); known hands: alpha, bravo; searched: {}",
            place.path().display()
        )
    );
}

#[test]
fn two_hands_of_one_name_are_refused_and_the_others_stay() {
    let (one, two) = (place_with(&[("a", "alpha"), ("b", "bravo")]), place_with(&[("x", "alpha")]));
    let registry = discover(&[one.path(), two.path()]);
    let error = registry.get("alpha").unwrap_err();
    assert_eq!(
        error.to_string(),
        format!(
            "two hands are named `alpha`: {} and {}; rename one in its hand.toml, or remove one directory from the search path",
            one.path().join("a").display(),
            two.path().join("x").display()
        )
    );
    assert_eq!(registry.list().iter().filter(|e| e.hand.is_err()).count(), 2);
    assert!(registry.get("bravo").is_ok());
}

#[test]
fn one_directory_reached_twice_is_one_hand() {
    let place = place_with(&[("a", "alpha")]);
    let registry = discover(&[place.path(), &place.path().join("a"), &place.path().join("a/..")]);
    assert_eq!(registry.list().len(), 1);
    assert!(registry.get("alpha").is_ok());
}

#[test]
fn a_broken_hand_is_listed_with_its_error() {
    let place = place_with(&[("a", "alpha"), ("b", "bravo")]);
    std::fs::remove_file(place.path().join("a/pincer.xml")).unwrap();
    std::fs::create_dir(place.path().join("c")).unwrap();
    std::fs::write(place.path().join("c/hand.toml"), "schema = ").unwrap();
    let registry = discover(&[place.path()]);
    let state: Vec<(&str, bool)> = registry.list().iter().map(|e| (e.name.as_str(), e.summary().is_some())).collect();
    assert_eq!(state, [("alpha", false), ("bravo", true), ("c", false)]);
    assert!(matches!(registry.get("alpha"), Err(HandError::MissingFile { .. })));
    assert!(matches!(registry.get("c"), Err(HandError::Toml { .. })));
}

#[test]
fn a_broken_hand_does_not_hide_a_sound_one() {
    let (one, two) = (place_with(&[("alpha", "bravo")]), place_with(&[("x", "alpha")]));
    std::fs::write(one.path().join("alpha/hand.toml"), "schema = ").unwrap();
    let registry = discover(&[one.path(), two.path()]);
    assert_eq!(registry.list().len(), 2);
    assert_eq!(registry.get("alpha").unwrap().directory, two.path().join("x"));
}

#[test]
fn a_directory_that_somebody_named_must_exist() {
    let mut path = SearchPath::new();
    path.push("/nowhere/at/all", "--plugins");
    let error = Registry::discover(&path).unwrap_err();
    assert_eq!(
        error.to_string(),
        "/nowhere/at/all: --plugins names this as a directory of plugins, but it is no directory"
    );
}

/// Runs as the child of the next test, where the environment is set.
#[test]
#[ignore = "a child process of `the_environment_adds_places` runs it"]
fn child_prints_the_search_path() {
    let path = SearchPath::from_environment(&["../../extra".into()]);
    println!("{}", Registry::discover(&path).unwrap().get("nobody").unwrap_err());
}

#[test]
fn the_environment_adds_places() {
    let work = TempDir::new().unwrap();
    let deep = work.path().join("crates/deep");
    std::fs::create_dir_all(&deep).unwrap();
    for place in ["plugins", "one", "two", "extra"] {
        std::fs::create_dir(work.path().join(place)).unwrap();
    }
    std::fs::write(work.path().join("Cargo.lock"), "").unwrap();
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "registry::child_prints_the_search_path", "--ignored", "--nocapture"])
        .current_dir(&deep)
        .env(PLUGINS_VARIABLE, "../../one:../../two")
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let plugins = work.path().canonicalize().unwrap().join("plugins");
    let searched = format!("searched: {}, ../../one, ../../two, ../../extra", plugins.display());
    assert!(text.lines().any(|line| line.ends_with(&searched)), "{text}");
}
