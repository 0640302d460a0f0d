//! The errors of this crate.

/// Errors of the simulator.
#[derive(Debug, thiserror::Error)]
pub enum MuJoCoError {
    /// No libmujoco could be opened.
    #[error(
        "cannot load MuJoCo (tried {tried}): {reason}\n{}",
        if *.overridden {
            "EIGENHAND_MUJOCO_LIB names that file: correct it, or unset it to use Debian's package libmujoco2.2.2 or the library from PyPI"
        } else {
            "commands that need MuJoCo install it, unless --no-install or EIGENHAND_NO_INSTALL forbids it: Debian's package libmujoco2.2.2, or the library from PyPI; to use a library of your own, set EIGENHAND_MUJOCO_LIB to a libmujoco.so.2.2.2"
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
        "{origin} is not a libmujoco: {reason}\nset EIGENHAND_MUJOCO_LIB to a libmujoco.so.2.2.2, or unset it and install Debian's package libmujoco2.2.2"
    )]
    NotMuJoCo {
        /// File or soname.
        origin: String,
        /// The loader's message about the missing symbol.
        reason: String,
    },
    /// A MuJoCo of another version was found.
    #[error(
        "{origin} is MuJoCo {found}, but {required} is required (struct layouts differ between versions)\ninstall Debian's package libmujoco2.2.2, or set EIGENHAND_MUJOCO_LIB to a libmujoco.so.{required}"
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
    /// MuJoCo cannot take a file of a model.
    #[error("model file {name}: {reason}")]
    Asset {
        /// The file's name.
        name: String,
        /// The reason.
        reason: String,
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
    /// A model that others may use was to be changed.
    #[error("the model of the simulation is shared, so it cannot be changed")]
    SharedModel,
    /// Two states of different models were mixed.
    #[error("the two simulation states belong to different models")]
    OtherModel,
}
