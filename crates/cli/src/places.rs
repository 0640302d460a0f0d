//! Where hands are looked for.

use std::path::PathBuf;

use eigenhand_hands::SearchPath;

use crate::bundled;

/// Returns the places in which hands are looked for: `plugins/` of the working directory or of the workspace around it,
/// the directories of `EIGENHAND_PLUGINS`, then `extra`; last the hands that come with the program, each of which gives
/// way to a hand of its name elsewhere.
pub fn search_path(extra: &[PathBuf]) -> SearchPath {
    let mut path = SearchPath::from_environment(extra);
    match bundled::directory() {
        Ok(directory) => path.fall_back_on(directory),
        Err(error) => eprintln!("note: the hands that come with the program are not available: {error:#}"),
    }
    path
}
