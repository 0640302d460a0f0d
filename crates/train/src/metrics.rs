//! `metrics.csv`: one row for each evaluation. Every column is defined in docs/algorithms.md.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

use crate::TrainError;
use crate::error::io_error;
use crate::files::write_atomically;

/// Name of the file in a run directory.
pub const METRICS: &str = "metrics.csv";

/// One row, as columns with values; the columns are the same in every row of a run.
pub type Row = Vec<(String, f64)>;

/// The open file.
pub struct MetricsFile {
    path: PathBuf,
    writer: csv::Writer<File>,
    started: bool,
}

impl MetricsFile {
    /// Opens the file and drops the rows of episodes after `episode`, which a resumed run writes again.
    ///
    /// # Errors
    /// [`TrainError::Io`], or [`TrainError::Damaged`] when a row cannot be read.
    pub fn open(directory: &Path, episode: u64) -> Result<MetricsFile, TrainError> {
        let path = directory.join(METRICS);
        let started = path.exists();
        if started {
            truncate(&path, episode)?;
        }
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(io_error("open", &path))?;
        let writer = csv::WriterBuilder::new().has_headers(false).from_writer(file);
        Ok(MetricsFile { path, writer, started })
    }

    /// Appends a row, after the header if it is the first.
    ///
    /// # Errors
    /// [`TrainError::Io`].
    pub fn append(&mut self, row: &Row) -> Result<(), TrainError> {
        if !self.started {
            let header = row.iter().map(|(name, _)| name.as_str());
            self.writer.write_record(header).map_err(|e| csv_error(&self.path, e))?;
            self.started = true;
        }
        let values = row.iter().map(|(_, value)| if value.is_finite() { value.to_string() } else { String::new() });
        self.writer.write_record(values).map_err(|e| csv_error(&self.path, e))?;
        self.writer.flush().map_err(io_error("write", &self.path))
    }
}

fn truncate(path: &Path, episode: u64) -> Result<(), TrainError> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(path).map_err(|e| csv_error(path, e))?;
    let mut kept = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    for (number, record) in reader.records().enumerate() {
        let record = record.map_err(|e| csv_error(path, e))?;
        let row_episode = record.get(0).and_then(|value| value.parse::<f64>().ok());
        if number > 0 && row_episode.is_none_or(|e| e > episode as f64) {
            break;
        }
        kept.write_record(&record).map_err(|e| csv_error(path, e))?;
    }
    let bytes =
        kept.into_inner().map_err(|error| TrainError::Format { path: path.to_owned(), reason: error.to_string() })?;
    write_atomically(path, &bytes)
}

fn csv_error(path: &Path, error: csv::Error) -> TrainError {
    TrainError::Damaged {
        path: path.to_owned(),
        reason: error.to_string(),
        mend: "the policy and the postures are not affected: move the file away and resume".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resumed_file_holds_every_row_once() {
        let directory = tempfile::tempdir().expect("a directory");
        let row = |episode: f64, value: f64| vec![("episode".to_owned(), episode), ("x".to_owned(), value)];
        let mut file = MetricsFile::open(directory.path(), 0).expect("new");
        for episode in [100.0, 200.0, 300.0] {
            file.append(&row(episode, f64::NAN)).expect("writable");
        }
        drop(file);
        let mut file = MetricsFile::open(directory.path(), 200).expect("existing");
        file.append(&row(300.0, 7.5)).expect("writable");
        let text = std::fs::read_to_string(directory.path().join(METRICS)).expect("readable");
        assert_eq!(text, "episode,x\n100,\n200,\n300,7.5\n");
    }
}
