//! What several modules need.

use std::path::PathBuf;

use eigenhand_hands::{Registry, SearchPath};

/// Returns the root of the workspace.
pub fn workspace() -> PathBuf {
    let tests = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    tests.parent().expect("tests/ lies in the workspace").to_owned()
}

/// Returns the hands of the workspace, whatever the environment adds.
pub fn registry() -> Registry {
    let mut path = SearchPath::new();
    path.push(workspace().join("plugins"), "the workspace");
    Registry::discover(&path).expect("plugins/")
}
