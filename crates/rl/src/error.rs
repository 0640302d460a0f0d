//! Errors.

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RlError {
    /// A configuration value is outside its range.
    #[error("`{field}` must be {expected}, got {got}: correct it in the configuration")]
    Config {
        /// The field's name.
        field: &'static str,
        /// The accepted values.
        expected: &'static str,
        /// The given value.
        got: String,
    },
    /// An array does not have the length that follows from the sizes.
    #[error("`{name}` must hold {expected} values, got {got}")]
    Length {
        /// Name of the array.
        name: &'static str,
        /// Required length.
        expected: usize,
        /// Given length.
        got: usize,
    },
    /// An episode has another shape than the replay.
    #[error("the replay holds episodes of {expected:?}, got {got:?}: store this episode in another replay")]
    EpisodeShape {
        /// Shape of the replay's episodes.
        expected: Box<crate::EpisodeShape>,
        /// Shape of the new episode.
        got: Box<crate::EpisodeShape>,
    },
    /// An episode holds a number that is not finite.
    #[error("`{name}` of an episode holds {got} at index {index}: find the step that produced it; nothing was stored")]
    NotFinite {
        /// Name of the array.
        name: &'static str,
        /// Index in the flat array.
        index: usize,
        /// The value.
        got: f32,
    },
    /// A batch was requested from a replay without episodes.
    #[error("the replay holds no episode: push one before you sample a batch")]
    EmptyReplay,
    /// The bytes end inside an episode's record, as in a log whose last write was interrupted.
    #[error("the last episode has {got} of {expected} bytes: remove it from the end of the log")]
    EpisodeTruncated {
        /// Length of the record.
        expected: usize,
        /// Bytes from its beginning to the end.
        got: usize,
    },
    /// The bytes are not an episode's record of this version, or were altered.
    #[error(
        "not an episode record: {name} should be {expected}, got {got}: the file is damaged, or another version of this \
         program wrote it"
    )]
    EpisodeCorrupt {
        /// The wrong part of the record.
        name: &'static str,
        /// Its expected value.
        expected: String,
        /// Its value.
        got: String,
    },
    /// A tensor is missing.
    #[error(
        "tensor `{name}` is missing: the file is not a checkpoint, or was written with another configuration or version"
    )]
    TensorMissing {
        /// The tensor's name.
        name: String,
    },
    /// The file holds a tensor that the configuration does not need.
    #[error("tensor `{name}` is not expected: load the file with the configuration with which it was saved")]
    TensorUnexpected {
        /// The tensor's name.
        name: String,
    },
    /// A tensor has another shape.
    #[error(
        "tensor `{name}` should have shape {expected:?}, got {got:?}: load the file with the configuration with which it was \
         saved"
    )]
    TensorShape {
        /// The tensor's name.
        name: String,
        /// Expected shape.
        expected: Vec<usize>,
        /// Shape in the file.
        got: Vec<usize>,
    },
    /// A tensor has another element type.
    #[error("tensor `{name}` should hold {expected}, got {got}: the file is damaged, or another program wrote it")]
    TensorType {
        /// The tensor's name.
        name: String,
        /// Expected element type.
        expected: &'static str,
        /// Element type in the file.
        got: String,
    },
    /// A tensor holds a value that this version of the learner does not write.
    #[error(
        "tensor `{name}` should hold {expected}, got {got}: the file is damaged, or another version of this program wrote it"
    )]
    TensorValue {
        /// The tensor's name.
        name: String,
        /// The accepted values.
        expected: &'static str,
        /// The value in the file.
        got: String,
    },
    /// The bytes are not in the safetensors format.
    #[error("the bytes are not a complete safetensors file")]
    Format(#[source] safetensors::SafeTensorError),
}
