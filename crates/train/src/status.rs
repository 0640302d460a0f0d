//! `status.json`: a run's progress, for other processes that watch it.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eigenhand_files::{FileError, cannot, write_whole};

use crate::progress::Status;

/// Name of the file in a run directory.
pub const STATUS: &str = "status.json";
/// Shortest time between two writes.
const EVERY: Duration = Duration::from_millis(500);

/// Writer of a run's status file.
pub(crate) struct StatusFile {
    path: PathBuf,
    written: Option<Instant>,
}

impl StatusFile {
    /// Prepares to write the file of a run directory.
    pub fn new(run: &Path) -> StatusFile {
        StatusFile { path: run.join(STATUS), written: None }
    }

    /// Writes the state, unless the last write is very recent. The final state is always written.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn write(&mut self, status: &Status) -> Result<(), FileError> {
        let due = self.written.is_none_or(|written| written.elapsed() >= EVERY) || status.episodes >= status.total;
        if !due {
            return Ok(());
        }
        self.written = Some(Instant::now());
        let text = serde_json::to_string(status).map_err(std::io::Error::other);
        write_whole(&self.path, text.map_err(cannot("write", &self.path))?.as_bytes())
    }
}

/// Reads the status in a run directory; none if the file is missing or cannot be read.
pub fn read_status(run: &Path) -> Option<Status> {
    serde_json::from_slice(&std::fs::read(run.join(STATUS)).ok()?).ok()
}

/// Removes the status file of an earlier process of the run.
///
/// # Errors
/// [`FileError`].
pub(crate) fn remove_status(run: &Path) -> Result<(), FileError> {
    let path = run.join(STATUS);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(cannot("remove", &path)(error)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_is_read_back_and_the_last_one_is_always_written() {
        let run = tempfile::tempdir().expect("a directory");
        assert_eq!(read_status(run.path()), None);
        let mut file = StatusFile::new(run.path());
        let at = |episodes| Status { episodes, total: 3, recent_success: Some(0.25), ..Status::default() };
        for (episodes, expected) in [(1, 1), (2, 1), (3, 3)] {
            file.write(&at(episodes)).expect("writable");
            assert_eq!(read_status(run.path()), Some(at(expected)));
        }
        remove_status(run.path()).expect("removable");
        assert_eq!(read_status(run.path()), None);
        remove_status(run.path()).expect("it is gone already");
    }
}
