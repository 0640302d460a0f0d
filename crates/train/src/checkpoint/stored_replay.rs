//! The episodes in the replay file of a run.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use eigenhand_files::cannot;
use eigenhand_rl::EpisodeData;

use super::damaged;
use crate::error::TrainError;

/// The episodes of a replay file up to its end, or to the first that cannot be read.
pub struct StoredReplay {
    /// The episodes, oldest first.
    pub episodes: Vec<EpisodeData>,
    /// Length of the file up to the end of each episode.
    pub ends: Vec<u64>,
    /// Length of the file.
    length: u64,
    /// Why the next episode cannot be read.
    fault: String,
}

impl StoredReplay {
    /// Reads the file; one that is gone holds no episode.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn read(path: &Path) -> Result<StoredReplay, TrainError> {
        let bytes = match fs::read(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Vec::new(),
            read => read.map_err(cannot("read", path))?,
        };
        let length = bytes.len() as u64;
        let (mut episodes, mut ends, mut fault) = (Vec::new(), Vec::new(), String::new());
        let mut rest = bytes.as_slice();
        while !rest.is_empty() {
            match EpisodeData::read_prefix(rest) {
                Ok((episode, after)) => {
                    episodes.push(episode);
                    ends.push(length - after.len() as u64);
                    rest = after;
                }
                Err(error) => {
                    fault = format!("episode {}: {error}", episodes.len());
                    break;
                }
            }
        }
        Ok(StoredReplay { episodes, ends, length, fault })
    }

    /// (length of the file) => the number of episodes up to there
    pub fn episodes_up_to(&self, length: u64) -> usize {
        self.ends.partition_point(|end| *end <= length)
    }

    /// Returns why the file does not hold what a checkpoint counts; none if it does.
    pub fn fault_before(&self, path: &Path, length: u64) -> Option<TrainError> {
        if length == 0 || self.ends.binary_search(&length).is_ok() {
            return None;
        }
        let reason = if length > self.length {
            format!("it has {} bytes, but the checkpoint records {length}", self.length)
        } else if self.fault.is_empty() {
            format!("no episode ends after {length} bytes, as the checkpoint records")
        } else {
            self.fault.clone()
        };
        Some(damaged(path, reason))
    }
}
