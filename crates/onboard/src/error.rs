//! The errors of this crate.

use std::path::PathBuf;

use eigenhand_files::FileError;
use eigenhand_hands::HandError;
use eigenhand_mujoco::MuJoCoError;
use eigenhand_render::RenderError;
use eigenhand_sim::SimError;

/// Errors of importing and checking a hand.
#[derive(Debug, thiserror::Error)]
pub enum OnboardError {
    /// The hand's files are wrong, or the hand is unknown.
    #[error(transparent)]
    Hand(#[from] HandError),
    /// The simulator.
    #[error(transparent)]
    MuJoCo(#[from] MuJoCoError),
    /// The scene or the task.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The picture.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The system refused to read or write something.
    #[error(transparent)]
    File(#[from] FileError),
    /// The survey did not identify the hand.
    #[error("could not identify the palm or the fingers: {reason}")]
    Survey {
        /// The reason, and what to do.
        reason: String,
    },
    /// A name that no hand can have.
    #[error(
        "{got:?} is not a name for a hand: use lower-case letters, digits, `-` and `_`, and begin with a letter or a digit"
    )]
    HandName {
        /// The name.
        got: String,
    },
    /// A hand's directory exists already.
    #[error("{} exists already and is not empty: name another directory with --out, or remove this one", path.display())]
    HandExists {
        /// The directory.
        path: PathBuf,
    },
}

impl OnboardError {
    /// Tells whether the command line is at fault; such errors have an exit status of their own.
    pub fn is_usage(&self) -> bool {
        matches!(
            self,
            OnboardError::HandName { .. }
                | OnboardError::HandExists { .. }
                | OnboardError::Hand(HandError::UnknownHand { .. } | HandError::NoPluginDirectory { .. })
        )
    }
}

/// Makes the error that ends a survey, with its reason.
pub(crate) fn refuse(reason: impl Into<String>) -> OnboardError {
    OnboardError::Survey { reason: reason.into() }
}
