//! What can go wrong in this crate.

use std::path::PathBuf;

use crate::ffi::LIBRARY_VARIABLE;

/// Errors of the simulator and the grasp task.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// No libmujoco could be opened.
    #[error(
        "cannot load MuJoCo (tried {tried}): {reason}\n{}",
        if *.overridden {
            format!("{LIBRARY_VARIABLE} names that file: correct it, or unset it to use Debian's package libmujoco2.2.2")
        } else {
            format!("install Debian's package: apt-get install libmujoco2.2.2, or set {LIBRARY_VARIABLE} to a libmujoco.so.2.2.2")
        }
    )]
    LibraryMissing {
        /// Names and paths that were tried.
        tried: String,
        /// Whether the override variable named the library.
        overridden: bool,
        /// The loader's messages.
        reason: String,
    },
    /// A library opened, but it is not MuJoCo.
    #[error(
        "{origin} is not a libmujoco: {reason}\nset {LIBRARY_VARIABLE} to a libmujoco.so.2.2.2, or unset it and install Debian's package libmujoco2.2.2"
    )]
    NotMuJoCo {
        /// File or soname.
        origin: String,
        /// What is missing in it.
        reason: String,
    },
    /// A MuJoCo of another version was found.
    #[error(
        "{origin} is MuJoCo {found}, but {required} is required (struct layouts differ between versions)\ninstall Debian's package libmujoco2.2.2, or set {LIBRARY_VARIABLE} to a libmujoco.so.{required}"
    )]
    LibraryVersion {
        /// File or soname.
        origin: String,
        /// Version found.
        found: String,
        /// Version required.
        required: String,
    },
    /// MuJoCo refused a model.
    #[error("MuJoCo refuses the model: {message}")]
    Compile {
        /// MuJoCo's own message.
        message: String,
    },
    /// A file of a model cannot be handed to MuJoCo.
    #[error("model file {name}: {reason}")]
    Asset {
        /// The file's name.
        name: String,
        /// Why not.
        reason: &'static str,
    },
    /// A file of a model cannot be read.
    #[error("cannot read {}", path.display())]
    ReadAsset {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A name is not in the compiled model.
    #[error("the model has no {what} named {name:?}")]
    Unresolved {
        /// Kind of element.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// MuJoCo could not allocate the simulation state.
    #[error("MuJoCo could not allocate the simulation state (out of memory)")]
    OutOfMemory,
    /// Two states of different models were mixed.
    #[error("the two simulation states belong to different models")]
    OtherModel,
    /// An object's name is not in the catalogue.
    #[error("unknown object {name:?}; the objects are {known}")]
    UnknownObject {
        /// The name.
        name: String,
        /// All names.
        known: String,
    },
    /// A setting is outside its range.
    #[error("{name} = {got} is not allowed: expected {expected}")]
    Setting {
        /// Name of the configuration key.
        name: &'static str,
        /// What is allowed.
        expected: &'static str,
        /// What was given.
        got: String,
    },
    /// The hand does not fit the scene or the task.
    #[error("hand {hand}: {reason}")]
    Hand {
        /// Name of the hand.
        hand: String,
        /// What does not fit, and what to change.
        reason: String,
    },
    /// A hand that nobody has described could not be made out.
    #[error("the hand cannot be made out: {reason}")]
    Survey {
        /// What was found, and what to do.
        reason: String,
    },
    /// A picture cannot be encoded.
    #[error("cannot encode a picture of {width} x {height} pixels as PNG")]
    Picture {
        /// Its width.
        width: usize,
        /// Its height.
        height: usize,
        /// What the encoder says.
        #[source]
        source: png::EncodingError,
    },
    /// The simulation produced values that are not finite or too large.
    #[error("the simulation diverged at step {step} of the episode")]
    Diverged {
        /// Control step.
        step: usize,
    },
}
