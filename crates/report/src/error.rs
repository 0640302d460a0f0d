//! Errors of a report.

use std::path::PathBuf;

use eigenhand_files::FileError;
use eigenhand_train::TrainError;

/// Errors of reading runs and of writing a report on them.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file of a run is missing or damaged.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// A file of the report cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A directory is neither a run nor holds runs.
    #[error("{} is not a run directory and holds no run directories: name a directory that `train` or `reproduce` wrote", path.display())]
    NoRuns {
        /// The directory.
        path: PathBuf,
    },
    /// No run has an evaluation yet.
    #[error("{runs} no evaluation yet: wait for the first one, or train on with --resume")]
    NothingYet {
        /// The runs, with the verb.
        runs: String,
    },
    /// The runs train different hands.
    #[error("{} trains the hand {first}, and {} the hand {second}: name runs of one hand only", first_run.display(), second_run.display())]
    MixedHands {
        /// A run.
        first_run: PathBuf,
        /// Its hand.
        first: String,
        /// A run of another hand.
        second_run: PathBuf,
        /// That hand.
        second: String,
    },
    /// The directory for the report holds other files.
    #[error("{} is not empty and holds no earlier report: choose another directory with --out", path.display())]
    OutExists {
        /// The directory.
        path: PathBuf,
    },
    /// A figure or a table could not be made.
    #[error("cannot make {name}: {reason}")]
    Draw {
        /// Figure or file.
        name: String,
        /// The library's message.
        reason: String,
    },
}

impl ReportError {
    /// Tells whether the command line is wrong; such an error has an exit status of its own.
    pub fn is_usage(&self) -> bool {
        match self {
            ReportError::Train(error) => error.is_usage(),
            ReportError::MixedHands { .. } | ReportError::OutExists { .. } => true,
            ReportError::File(_)
            | ReportError::NoRuns { .. }
            | ReportError::NothingYet { .. }
            | ReportError::Draw { .. } => false,
        }
    }

    /// Turns a library's error into one that names the figure or file.
    pub(crate) fn draw(name: &str) -> impl Fn(String) -> ReportError {
        let name = name.to_owned();
        move |reason| ReportError::Draw { name: name.clone(), reason }
    }
}
