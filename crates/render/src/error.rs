//! The errors of this crate.

use eigenhand_mujoco::MuJoCoError;
use eigenhand_sim::SimError;

/// Errors of pictures.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// Frames of different sizes, or none.
    #[error("a moving picture needs frames of one size")]
    Frames,
    /// A moving picture cannot be encoded.
    #[error("cannot encode a moving picture as GIF")]
    Movie(#[source] gif::EncodingError),
    /// The simulator.
    #[error(transparent)]
    MuJoCo(#[from] MuJoCoError),
    /// The task whose scenes are drawn.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// A picture cannot be encoded.
    #[error("cannot encode a picture of {width} x {height} pixels as PNG")]
    Picture {
        /// Its width.
        width: usize,
        /// Its height.
        height: usize,
        /// The encoder's error.
        #[source]
        source: png::EncodingError,
    },
}
