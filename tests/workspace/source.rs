//! Rules for the sources: `unsafe` code, the loader of libraries, and names of the parts of hands.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use eigenhand_hands::xmltree::Element;

use crate::support::{registry, workspace};

/// The places that may hold `unsafe` code.
const FENCED: [&str; 3] = ["crates/mujoco/src", "crates/hands/src/compiled/library.rs", "crates/hand-abi/src"];

/// The only file of the crate `hands` that opens a plugin's library, for the process in which it runs, and the files that may
/// load such a hand.
const LOADER: &str = "compiled/host.rs";
const LOADER_CALLERS: [&str; 2] = ["compiled.rs", "registry.rs"];

/// Lists the Rust files below a directory.
pub fn rust_files(directory: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(rust_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Lists the numbered lines of a file up to its unit tests, without comments.
pub fn code(file: &Path) -> Vec<(usize, String)> {
    let text = std::fs::read_to_string(file).unwrap();
    text.lines()
        .enumerate()
        .take_while(|(_, line)| !line.starts_with("#[cfg(test)]"))
        .map(|(i, line)| (i + 1, line.split("//").next().unwrap_or_default().to_owned()))
        .collect()
}

/// Splits a line into words of letters, digits and underscores.
pub fn words(line: &str) -> impl Iterator<Item = &str> {
    line.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty())
}

/// Lists the source directories of the workspace's crates.
fn source_directories() -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = ["crates", "plugins"]
        .iter()
        .flat_map(|parent| std::fs::read_dir(workspace().join(parent)).unwrap())
        .map(|entry| entry.unwrap().path().join("src"))
        .filter(|path| path.is_dir())
        .collect();
    found.push(workspace().join("xtask/src"));
    found
}

/// Checks that `unsafe` code is only in the fenced places, and that every other crate forbids it.
///
/// A crate with a fenced module must deny unsafe code outside that module. So must a compiled plugin; only the macro
/// that exports the plugin allows its one item.
pub fn check_fences() {
    let fences = FENCED.map(|fence| workspace().join(fence));
    let plugins = workspace().join("plugins");
    for directory in source_directories() {
        for file in rust_files(&directory) {
            let fenced = fences.iter().any(|fence| file.starts_with(fence));
            for (number, line) in code(&file) {
                let found = words(&line).any(|word| word == "unsafe");
                assert!(fenced || !found, "{}:{number}: unsafe code outside the fence", file.display());
            }
        }
        if fences.iter().any(|fence| fence == &directory) {
            continue;
        }
        let root = ["lib.rs", "main.rs"].map(|name| directory.join(name)).into_iter().find(|path| path.is_file());
        let root = root.unwrap_or_else(|| panic!("{} has no lib.rs or main.rs", directory.display()));
        let text = std::fs::read_to_string(&root).unwrap();
        let has_fence = fences.iter().any(|fence| fence.starts_with(&directory));
        let allowed_inside = has_fence || directory.starts_with(&plugins);
        let level = if allowed_inside { "deny" } else { "forbid" };
        if !text.contains(&format!("#![{level}(unsafe_code)]")) {
            panic!("{} does not {level} unsafe code", root.display());
        }
    }
}

/// Checks that only the registry opens plugins' libraries.
pub fn check_openers() {
    let hands = workspace().join("crates/hands/src");
    for file in rust_files(&hands) {
        let name = file.strip_prefix(&hands).unwrap().to_str().unwrap();
        for (number, line) in code(&file) {
            let opens = line.contains("load_either");
            assert!(!opens || LOADER_CALLERS.contains(&name), "{name}:{number} opens libraries");
            let talks = line.contains("library::generate");
            assert!(!talks || name == LOADER, "{name}:{number} talks to a library");
        }
    }
    let text = std::fs::read_to_string(hands.join("lib.rs")).unwrap();
    assert!(!text.contains("load_either"), "the loader is not public");
}

/// Checks that no generic crate contains the name of a part of a hand.
pub fn check_names() {
    let names = names_of_parts();
    assert!(names.len() > 50, "only {} names were read from the hands", names.len());
    for directory in source_directories().iter().filter(|path| path.starts_with(workspace().join("crates"))) {
        for file in rust_files(directory) {
            for (number, line) in code(&file) {
                let found = words(&line).find_map(|word| names.get_key_value(word));
                if let Some((name, hand)) = found {
                    panic!("{}:{number} names {name} of the hand {hand}: {line}", file.display());
                }
            }
        }
    }
}

/// Lists the joints, actuators, bodies and fingertips of all registered hands, each with its hand.
///
/// Leaves out words that are keys of `hand.toml`, or default values of keys such as the slide's name.
fn names_of_parts() -> BTreeMap<String, String> {
    let manifest: BTreeSet<&str> =
        eigenhand_hands::keys().iter().flat_map(|info| info.key.split('.')).chain(["slide", "base"]).collect();
    let mut names = BTreeMap::new();
    for entry in registry().list() {
        let hand = entry.hand.as_ref().expect("every hand of the workspace is sound");
        let mut parts: Vec<String> = hand.joints.iter().map(|joint| joint.name.clone()).collect();
        parts.extend(hand.actuators.iter().map(|actuator| actuator.name.clone()));
        parts.extend(hand.fingertips.iter().map(|tip| tip.name.clone()));
        bodies(&hand.model, &mut parts);
        for part in parts.into_iter().filter(|part| !manifest.contains(part.as_str())) {
            names.insert(part, entry.name.clone());
        }
    }
    names
}

fn bodies(parent: &Element, names: &mut Vec<String>) {
    for child in parent.children.iter().filter_map(|node| node.as_element()) {
        if child.name == "body" {
            names.extend(child.attributes.get("name").cloned());
        }
        bodies(child, names);
    }
}
