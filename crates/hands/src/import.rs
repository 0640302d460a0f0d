//! Reading of model files as their makers publish them: mended, or converted, to a model that MuJoCo 2.2.2 loads.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use xmltree::Element;

use crate::closure::{self, Closure};
use crate::error::HandError;
use crate::manifest::{HandManifest, MANIFEST_FILE};

mod mesh;
pub(crate) mod mjcf;
mod newer;
mod servos;
mod urdf;

/// What the reader of a file has to be told.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// Directories of ROS packages by name, for `package://name/...`.
    pub packages: BTreeMap<String, PathBuf>,
}

/// Files by the names that a model uses.
pub type Assets = Vec<(String, Vec<u8>)>;

/// A model that was read, mended and, where it was URDF, converted.
#[derive(Debug)]
pub struct Imported {
    /// Root `<mujoco>` element; files are named as in `assets`, without directories.
    pub model: Element,
    /// The files that the model names, by the names it uses.
    pub assets: Assets,
    /// Largest effort that the file states for a joint (N m or N), by joint.
    pub efforts: BTreeMap<String, f64>,
}

impl Imported {
    /// Keeps the body `hand` with what hangs on it, without the joints named, which moved it: an arm. What refers to parts
    /// that go is left out with a note.
    pub fn leave_out_arm(&mut self, hand: &str, joints: &[String], notes: &mut Vec<String>) {
        mjcf::keep_body(&mut self.model, hand, joints);
        note(notes, &format!("the hand begins with `{hand}`; left out above it, with the arm's joints"), joints);
        mjcf::drop_dangling(&mut self.model, notes);
    }
}

/// Reads the model in `file`, MJCF or URDF. `notes` holds what was changed until then even where reading fails.
///
/// # Errors
/// Names the file, the place in it and the way out: see [`HandError`].
pub fn import(file: &Path, options: &ImportOptions, notes: &mut Vec<String>) -> Result<Imported, HandError> {
    let bytes = std::fs::read(file).map_err(HandError::io(file))?;
    let text = String::from_utf8_lossy(&bytes);
    let mut imported = match first_tag(&text).map(|(_, name)| name) {
        Some("robot") => urdf::convert(file, options, None, notes)?,
        Some("mujoco" | "mujocoinclude") => mjcf::read(file, notes)?,
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

/// Reads the URDF of a hand's directory, with the files that its model names.
pub(crate) fn read_urdf(
    directory: &Path,
    manifest_path: &Path,
    manifest: &HandManifest,
    notes: &mut Vec<String>,
) -> Result<(Closure, Assets), HandError> {
    let file = directory.join(&manifest.model);
    if !file.is_file() {
        return Err(HandError::MissingFile { file: manifest_path.to_path_buf(), key: "model".to_owned(), got: file });
    }
    let packages = manifest.packages.iter().map(|(name, path)| (name.clone(), directory.join(path))).collect();
    let mut imported = urdf::convert(&file, &ImportOptions { packages }, Some(directory), notes)?;
    servos::complete(&mut imported, &file, notes)?;
    let read = |path: &Path| std::fs::read(path).map_err(HandError::io(path));
    let mut contents = BTreeMap::from([
        (PathBuf::from(MANIFEST_FILE), read(manifest_path)?),
        (PathBuf::from(&manifest.model), read(&file)?),
    ]);
    let files = contents.keys().cloned().collect();
    contents.extend(imported.assets.iter().map(|(name, bytes)| (PathBuf::from(name), bytes.clone())));
    let closure = Closure { model: imported.model, files, digest: closure::digest(&contents) };
    Ok((closure, imported.assets))
}

/// Finds a document's first element, whatever stands before it: where its name begins, and the name.
fn first_tag(text: &str) -> Option<(usize, &str)> {
    let mut rest = text;
    loop {
        rest = &rest[rest.find('<')?..];
        let end = if rest.starts_with("<!--") {
            rest.find("-->")? + 3
        } else if rest.starts_with("<?") || rest.starts_with("<!") {
            rest.find('>')? + 1
        } else {
            let name = rest[1..].split(|c: char| c.is_whitespace() || c == '>' || c == '/').next()?;
            return Some((text.len() - rest.len() + 1, name));
        };
        rest = &rest[end..];
    }
}

/// Adds the note `what: names` where there are names, with the first few of many.
fn note<S: AsRef<str>>(notes: &mut Vec<String>, what: &str, names: &[S]) {
    const SHOWN: usize = 12;
    if names.is_empty() {
        return;
    }
    let shown: Vec<&str> = names.iter().take(SHOWN).map(AsRef::as_ref).collect();
    let more = match names.len().saturating_sub(SHOWN) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    notes.push(format!("{what}: {}{more}", shown.join(", ")));
}
