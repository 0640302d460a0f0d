//! Errors of a configuration.

use std::path::PathBuf;

/// Errors of a configuration.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// A file could not be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A layer is not TOML.
    #[error("{origin}: {reason}")]
    Syntax {
        /// File or option.
        origin: String,
        /// Position and fault.
        reason: String,
    },
    /// A key does not exist.
    #[error("{origin}: unknown key {key:?}{}", nearest.as_ref().map_or_else(String::new, |near| format!("; did you mean {near:?}?")))]
    UnknownKey {
        /// File with line, or option.
        origin: String,
        /// Dotted key.
        key: String,
        /// Nearest key that exists.
        nearest: Option<String>,
    },
    /// A value has the wrong type or is out of range.
    #[error("{origin}: {reason}")]
    Value {
        /// File with line, or option, that set the value.
        origin: String,
        /// The key, the expected value and the given value.
        reason: String,
    },
}

/// A setting that is out of range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{key} = {got} is not allowed: expected {expected}")]
pub struct InvalidSetting {
    /// Dotted key.
    pub key: String,
    /// Other keys on which the expected range depends.
    pub related: &'static [&'static str],
    /// The expected range.
    pub expected: String,
    /// The given value.
    pub got: String,
}
