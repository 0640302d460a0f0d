//! What can go wrong.

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RlError {
    /// A configuration value is outside its range.
    #[error("`{field}` must be {expected}, got {got}: correct it in the configuration")]
    Config {
        /// The field's name.
        field: &'static str,
        /// The values that are accepted.
        expected: &'static str,
        /// The value found.
        got: String,
    },
    /// A slice has another length than its shape says.
    #[error("`{name}` must hold {expected} values, got {got}")]
    Length {
        /// Name of the array.
        name: &'static str,
        /// Length that the shape asks for.
        expected: usize,
        /// Length found.
        got: usize,
    },
    /// An episode has another shape than the replay it is pushed to.
    #[error(
        "the replay holds episodes of {expected:?}, got {got:?}: episodes of different shape need different replays"
    )]
    EpisodeShape {
        /// Shape of the episodes in the replay.
        expected: Box<crate::EpisodeShape>,
        /// Shape of the episode found.
        got: Box<crate::EpisodeShape>,
    },
    /// An episode holds a number that is not finite.
    #[error("`{name}` of an episode holds {got} at index {index}: find the step that produced it, nothing was stored")]
    NotFinite {
        /// Name of the array.
        name: &'static str,
        /// Index in the flat array.
        index: usize,
        /// The value found.
        got: f32,
    },
    /// A batch is asked from a replay without episodes.
    #[error("the replay holds no episode yet: push one before sampling a batch")]
    EmptyReplay,
    /// Bytes end before the episode that they announce; the end of a log that was cut while being written.
    #[error("an episode of {expected} bytes is cut after {got}: drop the tail of the log")]
    EpisodeTruncated {
        /// Bytes needed.
        expected: usize,
        /// Bytes found.
        got: usize,
    },
    /// Bytes are not an episode, or were altered.
    #[error("not a valid episode record: {name} should be {expected}, got {got}")]
    EpisodeCorrupt {
        /// The part of the record that is wrong.
        name: &'static str,
        /// What it should be.
        expected: String,
        /// What it is.
        got: String,
    },
    /// A tensor is absent.
    #[error("tensor `{name}` is missing: the file was written with another configuration or is no checkpoint")]
    TensorMissing {
        /// The tensor's name.
        name: String,
    },
    /// A tensor is present that the configuration does not ask for.
    #[error("tensor `{name}` is not expected: the file was written with another configuration")]
    TensorUnexpected {
        /// The tensor's name.
        name: String,
    },
    /// A tensor has another shape.
    #[error(
        "tensor `{name}` should have shape {expected:?}, got {got:?}: load it with the configuration it was saved with"
    )]
    TensorShape {
        /// The tensor's name.
        name: String,
        /// Shape asked for.
        expected: Vec<usize>,
        /// Shape found.
        got: Vec<usize>,
    },
    /// A tensor has another element type.
    #[error("tensor `{name}` should hold {expected}, got {got}")]
    TensorType {
        /// The tensor's name.
        name: String,
        /// Element type asked for.
        expected: &'static str,
        /// Element type found.
        got: String,
    },
    /// A tensor holds a value that the learner cannot have written.
    #[error("tensor `{name}` should hold {expected}, got {got}")]
    TensorValue {
        /// The tensor's name.
        name: String,
        /// The values that are accepted.
        expected: &'static str,
        /// The value found.
        got: String,
    },
    /// The bytes are not in the safetensors format.
    #[error("the bytes are not a safetensors file")]
    Format(#[source] safetensors::SafeTensorError),
}
