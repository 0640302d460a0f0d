//! `log.txt`: what a run noted, warned of and failed from, with the time.

use std::fs::OpenOptions;
use std::path::Path;
use std::sync::Mutex;

use tracing::subscriber::DefaultGuard;

use crate::TrainError;
use crate::error::io_error;
use crate::progress::{Progress, Status};

/// Name of the file in a run directory.
pub const LOG: &str = "log.txt";

/// Sends what this thread logs to the run's file, until it is dropped.
pub(crate) struct RunLog {
    _guard: DefaultGuard,
}

impl RunLog {
    /// Opens the file for appending.
    ///
    /// # Errors
    /// [`TrainError::Io`].
    pub fn start(run: &Path) -> Result<RunLog, TrainError> {
        let path = run.join(LOG);
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(io_error("open", &path))?;
        let subscriber =
            tracing_subscriber::fmt().with_writer(Mutex::new(file)).with_ansi(false).with_target(false).finish();
        Ok(RunLog { _guard: tracing::subscriber::set_default(subscriber) })
    }
}

/// Passes progress on, and logs its notes.
pub(crate) struct Logged<'a>(pub &'a mut dyn Progress);

impl Progress for Logged<'_> {
    fn update(&mut self, status: &Status) {
        self.0.update(status);
    }

    fn note(&mut self, line: &str) {
        tracing::info!("{line}");
        self.0.note(line);
    }

    fn finish(&mut self) {
        self.0.finish();
    }
}
