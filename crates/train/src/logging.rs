//! `log.txt`: a run's notes, warnings and errors, with the time of each.

use std::fs::OpenOptions;
use std::path::Path;
use std::sync::Mutex;

use eigenhand_files::cannot;
use tracing::subscriber::DefaultGuard;

use crate::error::TrainError;
use crate::progress::{Progress, Status};
use crate::rollout::Counting;
use crate::status::StatusFile;

/// Name of the file in a run directory.
pub const LOG: &str = "log.txt";

/// Sends this thread's log messages to the run's file until this value is dropped.
pub(crate) struct RunLog {
    _guard: DefaultGuard,
}

impl RunLog {
    /// Opens the file for appending.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn start(run: &Path) -> Result<RunLog, TrainError> {
        let path = run.join(LOG);
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(cannot("open", &path))?;
        let subscriber =
            tracing_subscriber::fmt().with_writer(Mutex::new(file)).with_ansi(false).with_target(false).finish();
        Ok(RunLog { _guard: tracing::subscriber::set_default(subscriber) })
    }
}

/// Passes progress on, logs its notes, and writes the run's status file.
pub(crate) struct Logged<'a> {
    shown: &'a mut dyn Progress,
    file: StatusFile,
}

impl<'a> Logged<'a> {
    /// Passes the progress of the run in a directory on to `shown`.
    pub fn new(run: &Path, shown: &'a mut dyn Progress) -> Logged<'a> {
        Logged { shown, file: StatusFile::new(run) }
    }
}

impl Progress for Logged<'_> {
    fn update(&mut self, status: &Status) {
        // The file only shows progress to other processes, so the run continues without it.
        if let Err(error) = self.file.write(status) {
            tracing::warn!("{error}: {}", error.source);
        }
        self.shown.update(status);
    }

    fn note(&mut self, line: &str) {
        tracing::info!("{line}");
        self.shown.note(line);
    }

    fn warn(&mut self, line: &str) {
        tracing::warn!("{line}");
        self.shown.warn(line);
    }

    fn counting(&mut self) -> Option<Counting> {
        self.shown.counting()
    }

    fn finish(&mut self) {
        self.shown.finish();
    }
}
