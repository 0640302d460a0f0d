//! The source files of a hand: the manifest, the model with its includes, and the assets that the model names.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};

use eigenhand_files::read_regular;
use sha2::{Digest, Sha256};
use xmltree::{Element, XMLNode};

use crate::error::HandError;
use crate::manifest::MANIFEST_FILE;
use crate::mjcf::Compiler;
use crate::notes::latin_note;
use crate::xml::{self, elements};

/// Deepest nesting of elements across included files; real hands stay far below.
const MAX_DEPTH: usize = 200;

/// A model with its includes expanded, and the files it was read from.
#[derive(Debug)]
pub(crate) struct Sources {
    /// Root element of the model.
    pub(crate) model: Element,
    /// Every file by its path relative to the hand's directory.
    pub(crate) files: Vec<PathBuf>,
    /// SHA-256 over names and contents of the files, in hexadecimal.
    pub(crate) digest: String,
}

/// Reads the model at `model` (relative to `directory`) with every file that it includes or names.
///
/// `manifest` is the path of the manifest, and `text` is its content.
pub(crate) fn read(
    directory: &Path,
    manifest: &Path,
    text: &str,
    model: &str,
    notes: &mut Vec<String>,
) -> Result<Sources, HandError> {
    let mut files = Files::new(directory, notes)?;
    let (_, relative) = files.locate(manifest, MANIFEST_FILE, manifest)?;
    files.contents.insert(relative, text.as_bytes().to_vec());
    let model_path = directory.join(model);
    let text = files.text(manifest, "model", &model_path)?;
    let mut root = parse(&text, &model_path)?;
    if root.name != "mujoco" {
        return Err(HandError::model(
            &model_path,
            format!("<{}>", root.name),
            "<mujoco> as the root element",
            format!("<{}>", root.name),
        ));
    }
    let base = model_path.parent().unwrap_or(directory).to_path_buf();
    expand_includes(&mut root, &model_path, &base, &mut files, 0)?;
    check_size(&root, &model_path)?;
    let compiler = Compiler::read(&root, &model_path)?;
    for section in elements(&root).filter(|e| matches!(e.name.as_str(), "asset" | "deformable")) {
        for asset in elements(section) {
            add_asset(asset, &compiler, &model_path, &base, &mut files)?;
        }
    }
    let (files, digest) = files.finish();
    Ok(Sources { model: root, files, digest })
}

/// Most elements of a model by name: real hands stay far below.
const MOST: [(&str, usize); 3] = [("joint", 200), ("body", 1000), ("geom", 5000)];

/// Checks that a model is no larger than the simulator can take in good time.
fn check_size(root: &Element, file: &Path) -> Result<(), HandError> {
    fn count(element: &Element, name: &str) -> usize {
        usize::from(element.name == name) + elements(element).map(|child| count(child, name)).sum::<usize>()
    }
    let world = || elements(root).filter(|e| e.name == "worldbody");
    for (name, most) in MOST {
        let found: usize = world().map(|world| count(world, name)).sum();
        if found > most {
            return Err(HandError::model(file, format!("<{name}>"), &format!("at most {most} of them"), found));
        }
    }
    Ok(())
}

/// Attributes of MJCF that hold text, in which `nan` and `inf` are words.
const WORDS: [&str; 24] = [
    "name",
    "class",
    "childclass",
    "file",
    "mesh",
    "material",
    "texture",
    "hfield",
    "skin",
    "joint",
    "joint1",
    "joint2",
    "body",
    "body1",
    "body2",
    "geom",
    "geom1",
    "geom2",
    "site",
    "tendon",
    "actuator",
    "target",
    "prefix",
    "model",
];

/// Parses a model. MuJoCo accepts numbers that are not finite, and computes nothing with them.
fn parse(text: &str, file: &Path) -> Result<Element, HandError> {
    fn check(element: &Element, file: &Path) -> Result<(), HandError> {
        let not_finite = |word: &str| word.parse::<f64>().is_ok_and(|number| !number.is_finite());
        for (key, value) in element.attributes.iter().filter(|(key, _)| !WORDS.contains(&key.as_str())) {
            let numbers = value.split_whitespace().all(|word| word.parse::<f64>().is_ok());
            if numbers && value.split_whitespace().any(not_finite) {
                let name = element.attributes.get("name").map_or_else(String::new, |name| format!(" `{name}`"));
                return Err(HandError::model(file, format!("{}{name} {key}", element.name), "finite numbers", value));
            }
        }
        elements(element).try_for_each(|child| check(child, file))
    }
    let root = xml::parse(text, file)?;
    check(&root, file)?;
    Ok(root)
}

/// Expands the includes of the model that `file` holds as `bytes`; included files may lie anywhere.
pub(crate) fn expand(file: &Path, bytes: Vec<u8>, notes: &mut Vec<String>) -> Result<Element, HandError> {
    let mut files = Files::anywhere(notes);
    let text = files.decode(file, &bytes);
    let (_, canonical) = files.locate(file, "model", file)?;
    files.contents.insert(canonical, bytes);
    let mut root = parse(&text, file)?;
    let base = file.parent().unwrap_or(Path::new("")).to_path_buf();
    expand_includes(&mut root, file, &base, &mut files, 0)?;
    check_size(&root, file)?;
    Ok(root)
}

/// Reads a file named by an element of the model.
pub(crate) fn read_asset(path: &Path, asset: &Element, file: &Path) -> Result<Vec<u8>, HandError> {
    if !path.is_file() {
        let name = asset.attributes.get("name").map_or(String::new(), |name| format!(" {name}"));
        return Err(HandError::MissingFile {
            file: file.to_path_buf(),
            key: format!("{}{name}", asset.name),
            got: path.to_path_buf(),
        });
    }
    read_file(path)
}

/// First bytes of a pointer that Git LFS leaves in place of a file's content.
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// Largest file of a hand, in bytes.
pub const LARGEST_FILE: u64 = 256 << 20;

/// Reads a file, unless it is a pointer of Git LFS, no regular file, or larger than [`LARGEST_FILE`].
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, HandError> {
    let bytes = read_regular(path, LARGEST_FILE).map_err(HandError::io(path))?;
    if bytes.starts_with(LFS_POINTER) { Err(HandError::LfsPointer { path: path.to_path_buf() }) } else { Ok(bytes) }
}

/// Reads a file of text, as [`read_file`] does.
pub(crate) fn read_text(path: &Path) -> Result<String, HandError> {
    let invalid = |error| HandError::io(path)(std::io::Error::new(std::io::ErrorKind::InvalidData, error));
    String::from_utf8(read_file(path)?).map_err(invalid)
}

fn expand_includes(
    element: &mut Element,
    file: &Path,
    base: &Path,
    files: &mut Files,
    depth: usize,
) -> Result<(), HandError> {
    if depth > MAX_DEPTH {
        return Err(HandError::model(file, "<include>", &format!("nesting of at most {MAX_DEPTH} elements"), "more"));
    }
    let mut children = Vec::with_capacity(element.children.len());
    for node in std::mem::take(&mut element.children) {
        match node {
            XMLNode::Element(include) if include.name == "include" => {
                let Some(name) = include.attributes.get("file") else {
                    return Err(HandError::model(file, "<include>", "an attribute `file`", "none"));
                };
                let path = base.join(name);
                if files.contains(&path) {
                    return Err(HandError::model(
                        file,
                        "<include>",
                        "each file included once",
                        format!("`{name}` a second time"),
                    ));
                }
                let text = files.text(file, "include file", &path)?;
                let mut included = parse(&text, &path)?;
                expand_includes(&mut included, &path, base, files, depth + 1)?;
                children.append(&mut included.children);
            }
            XMLNode::Element(mut child) => {
                expand_includes(&mut child, file, base, files, depth + 1)?;
                children.push(XMLNode::Element(child));
            }
            other => children.push(other),
        }
    }
    element.children = children;
    Ok(())
}

fn add_asset(
    asset: &Element,
    compiler: &Compiler,
    model: &Path,
    base: &Path,
    files: &mut Files,
) -> Result<(), HandError> {
    for (attribute, value) in asset.attributes.iter().filter(|(name, _)| name.starts_with("file")) {
        let path = compiler.asset_path(&asset.name, value, base);
        files.add(model, &format!("{} {attribute}", asset.name), &path)?;
    }
    Ok(())
}

/// Files read so far, by canonical path.
struct Files<'a> {
    directory: PathBuf,
    /// The directory that must hold all files; none if they may lie anywhere.
    canonical: Option<PathBuf>,
    contents: BTreeMap<PathBuf, Vec<u8>>,
    notes: &'a mut Vec<String>,
}

impl<'a> Files<'a> {
    fn new(directory: &Path, notes: &'a mut Vec<String>) -> Result<Self, HandError> {
        let canonical = directory.canonicalize().map_err(HandError::io(directory))?;
        Ok(Self { directory: directory.to_path_buf(), canonical: Some(canonical), contents: BTreeMap::new(), notes })
    }

    fn anywhere(notes: &'a mut Vec<String>) -> Self {
        Self { directory: PathBuf::new(), canonical: None, contents: BTreeMap::new(), notes }
    }

    /// Returns the key of a canonical path, if the path is allowed.
    fn relative(&self, canonical: PathBuf) -> Option<PathBuf> {
        match &self.canonical {
            Some(directory) => canonical.strip_prefix(directory).map(Path::to_path_buf).ok(),
            None => Some(canonical),
        }
    }

    fn contains(&self, path: &Path) -> bool {
        path.canonicalize().ok().and_then(|p| self.relative(p)).is_some_and(|p| self.contents.contains_key(&p))
    }

    /// Finds a file that `referrer` names in `key`: its canonical path, and the path under which it is kept.
    fn locate(&self, referrer: &Path, key: &str, path: &Path) -> Result<(PathBuf, PathBuf), HandError> {
        let escape = || HandError::Escape {
            file: referrer.to_path_buf(),
            key: key.to_owned(),
            got: path.strip_prefix(&self.directory).unwrap_or(path).display().to_string(),
            directory: self.directory.clone(),
        };
        let confined = self.canonical.is_some();
        if confined && !stays_inside(path.strip_prefix(&self.directory).map_err(|_| escape())?) {
            return Err(escape());
        }
        let Ok(canonical) = path.canonicalize() else {
            return Err(HandError::MissingFile {
                file: referrer.to_path_buf(),
                key: key.to_owned(),
                got: path.to_path_buf(),
            });
        };
        let relative = self.relative(canonical.clone()).ok_or_else(escape)?;
        Ok((canonical, relative))
    }

    /// Reads a file that `referrer` names in `key`, if it lies in the hand's directory.
    fn add(&mut self, referrer: &Path, key: &str, path: &Path) -> Result<&[u8], HandError> {
        let (_, relative) = self.locate(referrer, key, path)?;
        Ok(match self.contents.entry(relative) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(read_file(path)?),
        })
    }

    /// Reads a file of XML as [`Self::add`] does, with a note if it is not UTF-8.
    fn text(&mut self, referrer: &Path, key: &str, path: &Path) -> Result<String, HandError> {
        let bytes = self.add(referrer, key, path)?.to_vec();
        Ok(self.decode(path, &bytes))
    }

    fn decode(&mut self, path: &Path, bytes: &[u8]) -> String {
        let (text, is_latin) = xml::decode(bytes);
        if is_latin {
            self.notes.push(latin_note(path));
        }
        text
    }

    fn finish(self) -> (Vec<PathBuf>, String) {
        let digest = digest(&self.contents);
        (self.contents.into_keys().collect(), digest)
    }
}

/// Returns the SHA-256 over names and contents of files, in hexadecimal.
pub(crate) fn digest(files: &BTreeMap<PathBuf, Vec<u8>>) -> String {
    let mut hash = Sha256::new();
    for (path, bytes) in files {
        let name = path.to_string_lossy();
        // Without the lengths, bytes could move between a name, its file and the next name without changing the digest.
        hash.update((name.len() as u64).to_le_bytes());
        hash.update(name.as_bytes());
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    }
    hash.finalize().iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn stays_inside(relative: &Path) -> bool {
    let mut depth = 0_i64;
    for part in relative.components() {
        match part {
            Component::Normal(_) => depth += 1,
            Component::ParentDir => depth -= 1,
            Component::CurDir => {}
            Component::RootDir | Component::Prefix(_) => return false,
        }
        if depth < 0 {
            return false;
        }
    }
    true
}
