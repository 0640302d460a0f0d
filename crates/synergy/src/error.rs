//! The errors of this crate.

use std::path::PathBuf;

/// Errors of synergies, postures and their files.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SynergyError {
    /// A joint list that cannot name the columns of a posture.
    #[error("bad joint list: {message}")]
    Joints {
        /// The fault.
        message: String,
    },
    /// Two joint lists that should name the same coordinates, but differ.
    #[error("the joints differ: expected {expected}; got {got}. Use the same hand for both")]
    JointMismatch {
        /// The joints that the caller gave.
        expected: String,
        /// The joints to which they were compared.
        got: String,
    },
    /// Two spaces without a joint that both move.
    #[error(
        "the spaces have no joint in common that both move: a joint counts if it has the same name and unit in both. The first \
         has {}; the second has {}",
        list(first),
        list(second)
    )]
    NothingInCommon {
        /// Names of the joints that only the first space has.
        first: Vec<String>,
        /// Names of the joints that only the second space has.
        second: Vec<String>,
    },
    /// A posture of the wrong length.
    #[error("posture {row} has {got} numbers; expected {expected}, one for each joint")]
    PostureLength {
        /// The posture's index in the list.
        row: usize,
        /// The number of joints.
        expected: usize,
        /// The posture's length.
        got: usize,
    },
    /// A posture with a number that is not finite.
    #[error("posture {row} holds {got} in column {column}; every number must be finite")]
    NonFinitePosture {
        /// The posture's index in the list.
        row: usize,
        /// The joint's index.
        column: usize,
        /// The number.
        got: f64,
    },
    /// Too few postures for a covariance.
    #[error("a principal component analysis needs at least {expected} postures; got {got}")]
    TooFewPostures {
        /// The least number.
        expected: usize,
        /// The number given.
        got: usize,
    },
    /// A synergy space without components.
    #[error("a synergy space needs at least one component; ask for 1 or more")]
    NoComponents,
    /// The eigenvalue or singular value iteration failed.
    #[error("the decomposition of the {what} did not converge; look for enormous numbers among the postures")]
    Decomposition {
        /// The matrix.
        what: &'static str,
    },
    /// Postures that do not vary, so that their explained variance is not defined.
    #[error("the postures do not vary, so their explained variance is not defined; pass postures that differ")]
    NoVariance,
    /// A wrong number, length or relation in a synergy.
    #[error("bad synergy: {name}: expected {expected}, got {got}")]
    Invalid {
        /// The field.
        name: String,
        /// The expected value.
        expected: String,
        /// The value found.
        got: String,
    },
    /// A wrong entry of `motors.toml`.
    #[error("{name}: expected {expected}, got {got}")]
    Motors {
        /// The entry.
        name: String,
        /// The expected value.
        expected: String,
        /// The value found.
        got: String,
    },
    /// An error in a file; the source describes it.
    #[error("{path}: {source}", path = path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// The error.
        #[source]
        source: Box<SynergyError>,
    },
    /// Reading or writing failed.
    #[error("cannot {action} {path}: {source}", path = path.display())]
    Io {
        /// The verb: read, write, rename ...
        action: &'static str,
        /// The file or directory.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        source: std::io::Error,
    },
    /// A text that is not TOML, or whose fields are missing or of the wrong type.
    #[cfg(feature = "files")]
    #[error("not a synergy file: {0}")]
    Toml(#[from] toml::de::Error),
    /// A text that is not TOML, or whose fields are not those of `motors.toml`.
    #[cfg(feature = "files")]
    #[error("not a file of motors: {0}")]
    MotorsToml(toml::de::Error),
    /// A value that TOML cannot hold.
    #[cfg(feature = "files")]
    #[error("cannot be written as TOML: {0}")]
    TomlWrite(#[from] toml::ser::Error),
    /// A file of another version.
    #[error("{what} has schema {got}; this program reads schema {expected}. Read it with the version that wrote it")]
    Schema {
        /// The kind of file.
        what: &'static str,
        /// The version this program reads.
        expected: i64,
        /// The version of the file.
        got: i64,
    },
    /// A file that is no posture database.
    #[error("not a posture database ({reason}); give the path of a postures.sqlite, or a path that does not exist yet")]
    NotADatabase {
        /// The difference.
        reason: String,
    },
    /// A posture database whose pages are damaged.
    #[error(
        "the posture database is damaged ({reason}); restore it from a copy, or save what `sqlite3 FILE .recover` finds"
    )]
    Damaged {
        /// The result of the integrity check.
        reason: String,
    },
    /// An error of SQLite.
    #[cfg(feature = "database")]
    #[error("SQLite: {0}")]
    Sqlite(#[from] rusqlite::Error),
    /// An export would replace a directory that holds other files.
    #[error(
        "{path} exists and holds {found:?}, which is not part of an export; choose another directory, or remove this one",
        path = path.display()
    )]
    NotAnExport {
        /// The directory.
        path: PathBuf,
        /// The first foreign entry.
        found: String,
    },
}

fn list(names: &[String]) -> String {
    const SHOWN: usize = 6;
    match names.len() {
        0 => "no other joint".to_owned(),
        n if n > SHOWN => format!("{} and {} more", names[..SHOWN].join(", "), n - SHOWN),
        _ => names.join(", "),
    }
}

impl SynergyError {
    /// Names the file in which the error was found.
    pub(crate) fn in_file(self, path: impl Into<PathBuf>) -> Self {
        SynergyError::InFile { path: path.into(), source: Box::new(self) }
    }

    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| SynergyError::Io { action, path, source }
    }

    pub(crate) fn motors(name: impl Into<String>, expected: impl Into<String>, got: impl ToString) -> Self {
        SynergyError::Motors { name: name.into(), expected: expected.into(), got: got.to_string() }
    }

    pub(crate) fn invalid(name: impl Into<String>, expected: impl Into<String>, got: impl ToString) -> Self {
        SynergyError::Invalid { name: name.into(), expected: expected.into(), got: got.to_string() }
    }
}
