//! What can go wrong in a run.

use std::path::{Path, PathBuf};

use eigenhand_hands::HandError;
use eigenhand_rl::RlError;
use eigenhand_sim::SimError;
use eigenhand_synergy::SynergyError;

use crate::config::ConfigError;

/// Errors of training, evaluation and export.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The configuration is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The hand is wrong or unknown.
    #[error(transparent)]
    Hand(#[from] HandError),
    /// The simulator or the task.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The learner.
    #[error(transparent)]
    Rl(#[from] RlError),
    /// The posture database or the synergy.
    #[error(transparent)]
    Synergy(#[from] SynergyError),
    /// The system refused something.
    #[error("cannot {what}")]
    Io {
        /// What was tried.
        what: String,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A simulation thread ended.
    #[error("a simulation thread ended unexpectedly (its message is above); the run can be continued with --resume")]
    WorkerLost,
    /// A name that no hand can have.
    #[error(
        "a hand's name is of lower-case letters, digits, `-` and `_`, and begins with a letter or digit; got {got:?}"
    )]
    HandName {
        /// The name.
        got: String,
    },
    /// A hand's directory exists already.
    #[error("{} exists already and is not empty; name another directory with --out, or remove it", path.display())]
    HandExists {
        /// The directory.
        path: PathBuf,
    },
    /// A run directory exists already.
    #[error("{} exists already; name another with --out, or continue it with --resume {}", path.display(), path.display())]
    RunExists {
        /// The directory.
        path: PathBuf,
    },
    /// A directory is not a run.
    #[error("{} is not a run directory: {reason}", path.display())]
    NotARun {
        /// The directory.
        path: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// A file of a run is damaged.
    #[error("{} is damaged: {reason}\n{mend}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What does not fit.
        reason: String,
        /// What the user can do.
        mend: String,
    },
    /// Another process trains in the run directory.
    #[error("{} is in use by another process", path.display())]
    Locked {
        /// The directory.
        path: PathBuf,
    },
    /// No hand was named.
    #[error(
        "no hand is named: add --hand NAME, or a line hand = \"NAME\" to the configuration file; hands found: {known}"
    )]
    NoHand {
        /// Names of the hands that were found.
        known: String,
    },
    /// An option does not fit the others, or the run.
    #[error("{option}: {reason}")]
    Option {
        /// The option.
        option: String,
        /// What does not fit, and what to do.
        reason: String,
    },
    /// The hand is no longer the one that a run was made with.
    #[error(
        "the hand {hand} has changed since {} began: the digest of its files is {found}, and was {expected}\nput its files back to continue the run, or train again with another --out", run.display()
    )]
    HandChanged {
        /// Name of the hand.
        hand: String,
        /// The run's directory.
        run: PathBuf,
        /// Digest in the run's provenance.
        expected: String,
        /// Digest of the hand's files now.
        found: String,
    },
    /// A directory of runs was made with other settings than are asked for now.
    #[error("{} was made with other settings: {differences}\nname another directory with --out, or ask for the same settings again", run.display())]
    OtherSettings {
        /// The run that differs.
        run: PathBuf,
        /// Keys with both values.
        differences: String,
    },
    /// A directory holds something that an export would overwrite.
    #[error("{} is not empty and holds no earlier export: name another directory with --out", path.display())]
    ExportExists {
        /// The directory.
        path: PathBuf,
    },
    /// A measurement of another implementation failed.
    #[error("{what} failed: {reason}")]
    Bench {
        /// What was run.
        what: String,
        /// What it said.
        reason: String,
    },
    /// A file cannot be written in its format.
    #[error("cannot write {}: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
}

impl TrainError {
    /// Tells whether the command line was at fault, which ends with another exit status.
    pub fn is_usage(&self) -> bool {
        matches!(
            self,
            TrainError::Config(_)
                | TrainError::NoHand { .. }
                | TrainError::Option { .. }
                | TrainError::RunExists { .. }
                | TrainError::HandName { .. }
                | TrainError::HandExists { .. }
                | TrainError::OtherSettings { .. }
                | TrainError::ExportExists { .. }
                | TrainError::Hand(HandError::UnknownHand { .. } | HandError::NoPluginDirectory { .. })
                | TrainError::Sim(SimError::UnknownObject { .. })
        )
    }

    /// Tells whether no libmujoco could be opened, which installing it mends.
    pub fn is_missing_library(&self) -> bool {
        matches!(self, TrainError::Sim(SimError::LibraryMissing { .. }))
    }
}

/// Turns the system's reason into an error that says what was tried.
pub(crate) fn io_error(what: &str, path: &Path) -> impl FnOnce(std::io::Error) -> TrainError {
    let what = format!("{what} {}", path.display());
    move |source| TrainError::Io { what, source }
}
