//! Finds the library of a compiled plugin.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::path::{Path, PathBuf};

use super::sidecar::{SIDECAR_FILE, Sidecar};
use crate::error::HandError;

/// Folder of cargo's builds for tests; its libraries are newer than those beside it.
const DEPS: &str = "deps";
const LOCK_FILE: &str = "Cargo.lock";

/// Finds the library that `sidecar` names, and returns its absolute path: the system's loader would search its own
/// folders for a plain name.
///
/// A path is relative to the plugin's directory. A plain name is searched there, then beside the running program, then
/// in cargo's build folders of the plugin's workspace.
pub(super) fn find(directory: &Path, sidecar: &Sidecar) -> Result<PathBuf, HandError> {
    let written = Path::new(&sidecar.library);
    let name = written.file_name().unwrap_or_default().to_string_lossy();
    let names = [name.to_string(), format!("{DLL_PREFIX}{name}{DLL_SUFFIX}")];
    let is_name = written.components().count() == 1;
    let mut places = vec![match written.parent() {
        Some(folder) if !is_name => directory.join(folder),
        _ => directory.to_path_buf(),
    }];
    if is_name {
        places.extend(
            std::env::current_exe().ok().as_deref().and_then(Path::parent).map(build_folders).unwrap_or_default(),
        );
        places.extend(target_folders(directory));
    }
    let found = places.iter().flat_map(|place| names.iter().map(|name| place.join(name))).find(|path| path.is_file());
    match found {
        Some(path) => path.canonicalize().map_err(HandError::io(&path)),
        None => Err(HandError::MissingLibrary {
            file: directory.join(SIDECAR_FILE),
            expected: names[1].clone(),
            build: sidecar.build.clone(),
            searched: places.iter().map(|place| place.display().to_string()).collect(),
        }),
    }
}

/// Lists the folders of a build, given the folder of a program or of a test.
fn build_folders(program: &Path) -> Vec<PathBuf> {
    let root = if program.ends_with(DEPS) { program.parent().unwrap_or(program) } else { program };
    vec![root.join(DEPS), root.to_path_buf()]
}

/// Lists cargo's build folders of the workspace around `directory`.
fn target_folders(directory: &Path) -> Vec<PathBuf> {
    let Ok(complete) = directory.canonicalize() else { return Vec::new() };
    let Some(workspace) = complete.ancestors().find(|folder| folder.join(LOCK_FILE).is_file()) else {
        return Vec::new();
    };
    let target = std::env::var_os("CARGO_TARGET_DIR").filter(|value| !value.is_empty());
    let target = workspace.join(target.unwrap_or_else(|| "target".into()));
    ["release", "debug"].iter().flat_map(|profile| build_folders(&target.join(profile))).collect()
}
