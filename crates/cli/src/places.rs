//! The places that are searched for hands.

use std::path::PathBuf;

use eigenhand_hands::SearchPath;

use eigenhand_train::say;

use crate::bundled;

/// Returns the places that are searched for hands: `plugins/` of the working directory or of the workspace around it,
/// the directories of `EIGENHAND_PLUGINS`, then `extra`, and last the hands that come with the program. A hand in
/// another place replaces a hand of the same name that comes with the program.
pub fn search_path(extra: &[PathBuf]) -> SearchPath {
    let mut path = SearchPath::from_environment(extra);
    match bundled::directory() {
        Ok(directory) => path.fall_back_on(directory),
        Err(error) => say!("note: the hands that come with the program are not available: {error:#}"),
    }
    path
}
