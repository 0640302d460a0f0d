//! Where the library of a compiled plugin is.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::path::{Path, PathBuf};

use super::sidecar::{SIDECAR_FILE, Sidecar};
use crate::error::HandError;

/// Folder in which cargo leaves libraries of a build for tests, newer than those beside it.
const DEPS: &str = "deps";
const LOCK_FILE: &str = "Cargo.lock";

/// Finds the library that `sidecar` names, as an absolute path: a name alone would be looked for in the system's folders.
///
/// A path is looked for in the plugin's directory. A plain name is looked for there, then beside the running program, then
/// where cargo puts what it builds from the plugin's sources.
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

/// The folders of a build: that of a program, or of a test below it.
fn build_folders(program: &Path) -> Vec<PathBuf> {
    let root = if program.ends_with(DEPS) { program.parent().unwrap_or(program) } else { program };
    vec![root.join(DEPS), root.to_path_buf()]
}

/// The folders in which cargo builds the workspace that holds `directory`.
fn target_folders(directory: &Path) -> Vec<PathBuf> {
    let Ok(complete) = directory.canonicalize() else { return Vec::new() };
    let Some(workspace) = complete.ancestors().find(|folder| folder.join(LOCK_FILE).is_file()) else {
        return Vec::new();
    };
    let target = std::env::var_os("CARGO_TARGET_DIR").filter(|value| !value.is_empty());
    let target = workspace.join(target.unwrap_or_else(|| "target".into()));
    ["release", "debug"].iter().flat_map(|profile| build_folders(&target.join(profile))).collect()
}
