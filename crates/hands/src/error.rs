//! Errors of a hand, written so that its owner can fix them.

use std::path::{Path, PathBuf};

/// An error in a hand's files. Every message names the file, the place in it and the expected value.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HandError {
    /// A file or directory could not be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A directory has no manifest.
    #[error("{}: no {expected} in this directory; name a directory that holds one", path.display())]
    NoManifest {
        /// The directory.
        path: PathBuf,
        /// The manifest's file name.
        expected: &'static str,
    },
    /// The manifest is not TOML.
    #[error("{}: not valid TOML: {message}", file.display())]
    Toml {
        /// The manifest.
        file: PathBuf,
        /// The parser's reason, with line and column.
        message: String,
    },
    /// The manifest has an unknown key.
    #[error("{}: unknown key `{key}`{}; known here: {}", file.display(), did_you_mean(nearest), known.join(", "))]
    UnknownKey {
        /// The manifest.
        file: PathBuf,
        /// The key, with its table.
        key: String,
        /// The most similar known key.
        nearest: Option<String>,
        /// All known keys of this table.
        known: Vec<String>,
    },
    /// The manifest lacks a key.
    #[error("{}: key `{key}` is missing; expected {expected}", file.display())]
    MissingKey {
        /// The manifest.
        file: PathBuf,
        /// The key, with its table.
        key: String,
        /// The expected value.
        expected: String,
    },
    /// A value in the manifest has the wrong type or is out of range.
    #[error("{}: key `{key}`: expected {expected}, got {got}", file.display())]
    InvalidValue {
        /// The manifest.
        file: PathBuf,
        /// The key, with its table.
        key: String,
        /// The expected value.
        expected: String,
        /// The value found.
        got: String,
    },
    /// A path leads out of the hand's directory.
    #[error("{}: `{key}`: path `{got}` leads out of the hand's directory {}; copy the file into it", file.display(), directory.display())]
    Escape {
        /// The file that holds the path.
        file: PathBuf,
        /// The key or attribute.
        key: String,
        /// The path as written.
        got: String,
        /// The hand's directory.
        directory: PathBuf,
    },
    /// A file named in another file does not exist.
    #[error("{}: `{key}`: file {} does not exist", file.display(), got.display())]
    MissingFile {
        /// The file that names it.
        file: PathBuf,
        /// The key or attribute.
        key: String,
        /// The missing file.
        got: PathBuf,
    },
    /// A file was cloned without Git LFS, so it holds a pointer instead of its content.
    #[error(
        "{} is a pointer of Git LFS, not the file itself; fetch the files with `git lfs pull` in the checkout that it \
         comes from",
        path.display()
    )]
    LfsPointer {
        /// The file.
        path: PathBuf,
    },
    /// A link names a mesh that was not found.
    #[error("{}: link `{link}`: mesh `{got}` was not found; {way_out}", file.display())]
    MissingMesh {
        /// The model file.
        file: PathBuf,
        /// The link.
        link: String,
        /// The mesh as written.
        got: String,
        /// How to fix it.
        way_out: String,
    },
    /// The model file is not XML.
    #[error("{}: not valid XML: {message}", file.display())]
    Xml {
        /// The model file.
        file: PathBuf,
        /// The parser's reason.
        message: String,
    },
    /// The model file holds something that a hand cannot use.
    #[error("{}: {place}: expected {expected}, got {got}", file.display())]
    Model {
        /// The model file.
        file: PathBuf,
        /// The element or attribute.
        place: String,
        /// The expected content.
        expected: String,
        /// The content found.
        got: String,
    },
    /// The model has nothing of this name.
    #[error("{}: `{key}`: expected the name of {expected}, got `{got}`{}", file.display(), did_you_mean(nearest))]
    Unresolved {
        /// The file that holds the name.
        file: PathBuf,
        /// The key or attribute.
        key: String,
        /// The expected kind of part.
        expected: String,
        /// The name.
        got: String,
        /// The most similar name of this kind.
        nearest: Option<String>,
    },
    /// Two directories hold hands of the same name.
    #[error("two hands are named `{name}`: {} and {}; rename one in its hand.toml, or remove one directory from the search path", first.display(), second.display())]
    DuplicateHand {
        /// The name.
        name: String,
        /// The directory found first.
        first: PathBuf,
        /// The other directory.
        second: PathBuf,
    },
    /// No hand has this name.
    #[error(
        "no hand is named `{got}`{}; known hands: {}; searched: {}",
        did_you_mean(nearest),
        list_or(known, "none"),
        list_or(searched, "nothing")
    )]
    UnknownHand {
        /// The requested name.
        got: String,
        /// The most similar known name.
        nearest: Option<String>,
        /// All known names.
        known: Vec<String>,
        /// The searched directories.
        searched: Vec<String>,
    },
    /// A directory holds both a hand and a compiled plugin.
    #[error("{}: holds both {first} and {second}; a hand is either written or generated, so remove one", path.display())]
    TwoManifests {
        /// The directory.
        path: PathBuf,
        /// File name of a written hand's manifest.
        first: &'static str,
        /// File name of a generated hand's sidecar.
        second: &'static str,
    },
    /// The library of a compiled plugin was not found.
    #[error(
        "{}: `library`: no {expected} was found; {}; looked in: {}",
        file.display(),
        build.as_ref().map_or("put the library into this directory".to_owned(), |build| format!("build it with `{build}`")),
        searched.join(", ")
    )]
    MissingLibrary {
        /// The sidecar.
        file: PathBuf,
        /// The missing file.
        expected: String,
        /// The command to build it.
        build: Option<String>,
        /// The searched directories.
        searched: Vec<String>,
    },
    /// The system refused to open the library of a compiled plugin.
    #[error("{}: cannot open this library: {message}; rebuild it for this machine", file.display())]
    DamagedLibrary {
        /// The library.
        file: PathBuf,
        /// The system's reason.
        message: String,
    },
    /// A compiled plugin was built for another version of the plugin interface.
    #[error("{}: built for version {got} of the plugin interface, expected {expected}; rebuild the plugin with eigenhand-hand-abi {expected}", file.display())]
    PluginVersion {
        /// The sidecar or the library.
        file: PathBuf,
        /// This program's version.
        expected: String,
        /// The plugin's version.
        got: String,
    },
    /// A compiled plugin breaks the rules of the plugin interface.
    #[error("{}: {place}: expected {expected}, got {got}; this is a bug in the plugin, report it to its author", file.display())]
    Plugin {
        /// The library.
        file: PathBuf,
        /// The function or field.
        place: String,
        /// The expected content.
        expected: String,
        /// The content found.
        got: String,
    },
    /// An error in the process that ran a compiled plugin.
    #[error("{message}")]
    InPlugin {
        /// The error's text.
        message: String,
    },
    /// A compiled plugin generated no hand.
    #[error("{}: the plugin generated no hand from its options: {message}", file.display())]
    PluginRefused {
        /// The library.
        file: PathBuf,
        /// The plugin's reason.
        message: String,
    },
    /// A compiled plugin generated a hand with an error.
    #[error("{}: the generated hand is broken: {source}", file.display())]
    Generated {
        /// The sidecar.
        file: PathBuf,
        /// The error in the generated files.
        #[source]
        source: Box<HandError>,
    },
    /// A directory of plugins does not exist.
    #[error("{}: {origin} names this as a directory of plugins, but it is no directory", path.display())]
    NoPluginDirectory {
        /// The directory.
        path: PathBuf,
        /// The option or environment variable that named it.
        origin: String,
    },
}

impl HandError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io { path, source }
    }

    pub(crate) fn invalid(file: &Path, key: &str, expected: &str, got: impl ToString) -> Self {
        Self::InvalidValue {
            file: file.to_path_buf(),
            key: key.to_owned(),
            expected: expected.to_owned(),
            got: got.to_string(),
        }
    }

    pub(crate) fn model(file: &Path, place: impl Into<String>, expected: &str, got: impl ToString) -> Self {
        Self::Model {
            file: file.to_path_buf(),
            place: place.into(),
            expected: expected.to_owned(),
            got: got.to_string(),
        }
    }

    pub(crate) fn plugin(library: &Path, place: &str, expected: &str, got: impl ToString) -> Self {
        Self::Plugin {
            file: library.to_path_buf(),
            place: place.to_owned(),
            expected: expected.to_owned(),
            got: got.to_string(),
        }
    }

    pub(crate) fn unresolved<'a>(
        file: &Path,
        key: impl Into<String>,
        expected: &str,
        got: &str,
        known: impl IntoIterator<Item = &'a str>,
    ) -> Self {
        Self::Unresolved {
            file: file.to_path_buf(),
            key: key.into(),
            expected: expected.to_owned(),
            got: got.to_owned(),
            nearest: nearest(got, known),
        }
    }
}

/// Returns the known name most similar to `got`, if it is similar enough for a typing error.
pub(crate) fn nearest<'a>(got: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    const LIKELY: f64 = 0.6;
    let got_lower = got.to_lowercase();
    known
        .into_iter()
        .map(|name| {
            let lower = name.to_lowercase();
            let score = strsim::normalized_damerau_levenshtein(&got_lower, &lower)
                .max(strsim::jaro_winkler(&got_lower, &lower) - 0.2);
            (score, name)
        })
        .filter(|(score, _)| *score >= LIKELY)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, name)| name.to_owned())
}

fn did_you_mean(nearest: &Option<String>) -> String {
    nearest.as_ref().map(|name| format!(" (did you mean `{name}`?)")).unwrap_or_default()
}

fn list_or(names: &[String], none: &str) -> String {
    if names.is_empty() { none.to_owned() } else { names.join(", ") }
}
