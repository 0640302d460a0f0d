//! The errors of this crate.

use std::path::PathBuf;

use eigenhand_mujoco::MuJoCoError;

/// Errors of scenes and of the grasp task.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// The simulator.
    #[error(transparent)]
    MuJoCo(#[from] MuJoCoError),
    /// A file of a model cannot be read.
    #[error("cannot read {}", path.display())]
    ReadAsset {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A file of an object, or of its mesh, is wrong.
    #[error("{}: {reason}", path.display())]
    ObjectFile {
        /// The file.
        path: PathBuf,
        /// The key, and what is expected.
        reason: String,
    },
    /// A word is no object, no set, no directory and no file of an object.
    #[error(
        "unknown object {name:?}; expected an object or a set that comes with the program, a directory of objects or \
         an object's .toml file; the sets with their objects are: {known}"
    )]
    UnknownObject {
        /// The name.
        name: String,
        /// All sets with their objects.
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
        /// The reason, and what to change.
        reason: String,
    },
    /// The simulation produced values that are not finite or too large.
    #[error("the simulation diverged at step {step} of the episode{}", joint.as_ref().map(|name| format!(", at the joint {name}")).unwrap_or_default())]
    Diverged {
        /// Control step.
        step: usize,
        /// The joint whose state was not finite or too large, if MuJoCo names it.
        joint: Option<String>,
    },
}
