//! Reads model files as makers publish them: MJCF is mended and URDF converted, so that MuJoCo 2.2.2 loads the result.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::error::HandError;
use crate::manifest::{HandManifest, MANIFEST_FILE};
use crate::notes::note;
use crate::sources::{self, Sources};
use crate::xml::first_tag;
use imported::Assets;

mod imported;
mod mend;
mod mesh;
mod servos;
mod urdf;

pub use imported::{ImportOptions, Imported};

impl Imported {
    /// Keeps the body `hand` with everything below it, and removes the arm: the bodies above it and its `joints`.
    /// Elements that name removed parts are removed with a note.
    pub fn leave_out_arm(&mut self, hand: &str, joints: &[String], notes: &mut Vec<String>) {
        mend::keep_body(&mut self.model, hand, joints);
        note(notes, &format!("the hand begins with `{hand}`; the arm above it was removed, with its joints"), joints);
        mend::drop_dangling(&mut self.model, notes);
    }
}

/// Reads the model in `file`, MJCF or URDF. If reading fails, `notes` holds the changes made so far.
///
/// # Errors
/// Names the file, the place in it and how to fix it: see [`HandError`].
pub fn import(file: &Path, options: &ImportOptions, notes: &mut Vec<String>) -> Result<Imported, HandError> {
    let bytes = sources::read_file(file)?;
    let text = String::from_utf8_lossy(&bytes);
    let root = first_tag(&text).map(|(_, name)| name.to_owned());
    let mut imported = match root.as_deref() {
        Some("robot") => urdf::convert(file, &bytes, options, None, notes)?,
        Some("mujoco" | "mujocoinclude") => mend::read(file, bytes, notes)?,
        other => {
            let is_name =
                |name: &&str| name.len() < 100 && name.chars().all(|c| c.is_alphanumeric() || ":_-.".contains(c));
            let got = other.filter(is_name).map_or_else(|| "no element".to_owned(), |name| format!("<{name}>"));
            return Err(HandError::model(file, "the root element", "<mujoco> (MJCF) or <robot> (URDF)", got));
        }
    };
    servos::complete(&mut imported, file, notes)?;
    Ok(imported)
}

/// Reads the URDF of a hand's directory with its meshes. `text` is the content of the manifest.
pub(crate) fn read_urdf(
    directory: &Path,
    manifest_path: &Path,
    text: &str,
    manifest: &HandManifest,
    notes: &mut Vec<String>,
) -> Result<(Sources, Assets), HandError> {
    let file = directory.join(&manifest.model);
    if !file.is_file() {
        return Err(HandError::MissingFile { file: manifest_path.to_path_buf(), key: "model".to_owned(), got: file });
    }
    let bytes = sources::read_file(&file)?;
    let packages = manifest.packages.iter().map(|(name, path)| (name.clone(), directory.join(path))).collect();
    let mut imported = urdf::convert(&file, &bytes, &ImportOptions { packages }, Some(directory), notes)?;
    servos::complete(&mut imported, &file, notes)?;
    let mut contents = BTreeMap::from([
        (PathBuf::from(MANIFEST_FILE), text.as_bytes().to_vec()),
        (PathBuf::from(&manifest.model), bytes),
    ]);
    let files = contents.keys().cloned().collect();
    // What only pictures show is no part of the hand that learned.
    let touching = imported.assets.iter().take(imported.assets.len() - imported.looks);
    contents.extend(touching.map(|(name, bytes)| (PathBuf::from(name), bytes.clone())));
    let sources = Sources { model: imported.model, files, digest: sources::digest(&contents) };
    Ok((sources, imported.assets))
}
