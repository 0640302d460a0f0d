//! `metrics.csv`: one row for each evaluation. Every column is defined in docs/algorithms.md.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

use crate::TrainError;
use crate::error::io_error;
use crate::files::write_atomically;

/// Name of the file in a run directory.
pub const METRICS: &str = "metrics.csv";

/// The column that comes first and that tells the rows apart.
const EPISODE: &str = "episode";

/// One row, as columns with values; the columns are the same in every row of a run.
pub type Row = Vec<(String, f64)>;

/// (row, name of a column) => the value there; 0 where the row has no such column.
pub fn value(row: &Row, column: &str) -> f64 {
    row.iter().find(|(name, _)| name == column).map_or(0.0, |(_, value)| *value)
}

/// The open file.
pub struct MetricsFile {
    path: PathBuf,
    writer: csv::Writer<File>,
    columns: Vec<String>,
}

impl MetricsFile {
    /// Opens the file and drops the rows of episodes after `episode`, which a resumed run writes again.
    ///
    /// # Errors
    /// [`TrainError::Io`], or [`TrainError::Damaged`] when a row cannot be read.
    pub fn open(directory: &Path, episode: u64) -> Result<MetricsFile, TrainError> {
        let path = directory.join(METRICS);
        let columns = if path.exists() { truncate(&path, episode)? } else { Vec::new() };
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(io_error("open", &path))?;
        let writer = csv::WriterBuilder::new().has_headers(false).from_writer(file);
        Ok(MetricsFile { path, writer, columns })
    }

    /// Appends a row, after the header if it is the first.
    ///
    /// The header that a file has stays: a column that it lacks is left out of the row, and one that the row lacks is
    /// left empty.
    ///
    /// # Errors
    /// [`TrainError::Io`].
    pub fn append(&mut self, row: &Row) -> Result<(), TrainError> {
        if self.columns.is_empty() {
            self.columns = row.iter().map(|(name, _)| name.clone()).collect();
            self.writer.write_record(&self.columns).map_err(|e| csv_error(&self.path, e))?;
        }
        let field = |column: &String| {
            let found = row.iter().find(|(name, value)| name == column && value.is_finite());
            found.map_or_else(String::new, |(_, value)| value.to_string())
        };
        self.writer.write_record(self.columns.iter().map(field)).map_err(|e| csv_error(&self.path, e))?;
        self.writer.flush().map_err(io_error("write", &self.path))
    }
}

/// The rows of a `metrics.csv`, read back.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MetricsTable {
    columns: Vec<String>,
    rows: Vec<Vec<Option<f64>>>,
}

impl MetricsTable {
    /// Reads the file in a run directory. A run that has not evaluated yet has none, which is an empty table; a last line
    /// without its end is one that is being written, and is left out.
    ///
    /// # Errors
    /// [`TrainError::Io`], or [`TrainError::Damaged`] with the line that cannot be read.
    pub fn read(directory: &Path) -> Result<MetricsTable, TrainError> {
        let path = directory.join(METRICS);
        let mut text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(MetricsTable::default()),
            Err(error) => return Err(io_error("read", &path)(error)),
        };
        text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
        let damaged = |line: usize, what: String| TrainError::Damaged {
            path: path.clone(),
            reason: format!("line {line}: {what}"),
            mend: "the policy and the postures are not affected: mend the line, or move the file away".to_owned(),
        };
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let header = reader.headers().map_err(|error| damaged(1, error.to_string()))?;
        let columns: Vec<String> = header.iter().map(str::to_owned).collect();
        if !columns.is_empty() && columns.first().is_none_or(|first| first != EPISODE) {
            return Err(damaged(1, format!("the first column is {:?}; expected {EPISODE:?}", columns[0])));
        }
        let mut rows = Vec::new();
        for (i, record) in reader.records().enumerate() {
            let record = record.map_err(|error| damaged(i + 2, error.to_string()))?;
            let number = |(cell, column): (&str, &String)| match cell.parse::<f64>() {
                _ if cell.is_empty() && column != EPISODE => Ok(None),
                Ok(value) if value.is_finite() => Ok(Some(value)),
                _ => Err(damaged(i + 2, format!("{column} is {cell:?}; expected a number"))),
            };
            rows.push(record.iter().zip(&columns).map(number).collect::<Result<_, _>>()?);
        }
        Ok(MetricsTable { columns, rows })
    }

    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Tells whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Returns the rows from top to bottom; what does not exist is not a number.
    pub fn rows(&self) -> Vec<Row> {
        let row = |values: &Vec<Option<f64>>| {
            self.columns.iter().cloned().zip(values.iter().map(|value| value.unwrap_or(f64::NAN))).collect()
        };
        self.rows.iter().map(row).collect()
    }

    /// Returns a column from top to bottom, `None` where a number does not exist; of no length when there is no such
    /// column.
    pub fn column(&self, name: &str) -> Vec<Option<f64>> {
        let position = self.columns.iter().position(|column| column == name);
        position.map_or_else(Vec::new, |i| self.rows.iter().map(|row| row.get(i).copied().flatten()).collect())
    }
}

/// Drops the rows of episodes after `episode`, and returns the header.
fn truncate(path: &Path, episode: u64) -> Result<Vec<String>, TrainError> {
    let mut columns = Vec::new();
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(path).map_err(|e| csv_error(path, e))?;
    let mut kept = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    for (number, record) in reader.records().enumerate() {
        let record = record.map_err(|e| csv_error(path, e))?;
        let row_episode = record.get(0).and_then(|value| value.parse::<f64>().ok());
        if number > 0 && row_episode.is_none_or(|e| e > episode as f64) {
            break;
        }
        if number == 0 {
            columns = record.iter().map(str::to_owned).collect();
        }
        kept.write_record(&record).map_err(|e| csv_error(path, e))?;
    }
    let bytes =
        kept.into_inner().map_err(|error| TrainError::Format { path: path.to_owned(), reason: error.to_string() })?;
    write_atomically(path, &bytes)?;
    Ok(columns)
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

    #[test]
    fn a_file_keeps_its_columns_and_gives_back_its_rows() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join(METRICS);
        std::fs::write(&path, "episode,old,x\n100,1,2.5\n").expect("writable");
        let mut file = MetricsFile::open(directory.path(), 100).expect("existing");
        let row = [("episode", 200.0), ("x", 7.5), ("new", 1.0)].map(|(name, value)| (name.to_owned(), value));
        file.append(&row.to_vec()).expect("writable");
        assert_eq!(std::fs::read_to_string(&path).expect("readable"), "episode,old,x\n100,1,2.5\n200,,7.5\n");
        let rows = MetricsTable::read(directory.path()).expect("sound").rows();
        assert_eq!((value(&rows[0], "old"), value(&rows[1], "x")), (1.0, 7.5));
        assert!(value(&rows[1], "old").is_nan());
        assert_eq!(value(&rows[1], "new"), 0.0);
    }

    fn table(text: &str) -> Result<MetricsTable, TrainError> {
        let directory = tempfile::tempdir().expect("a directory");
        std::fs::write(directory.path().join(METRICS), text).expect("writable");
        MetricsTable::read(directory.path())
    }

    #[test]
    fn columns_are_read_back_with_their_gaps() {
        let read = table("episode,x\n100,\n200,0.5\n300,0.").expect("sound");
        assert_eq!((read.len(), read.column("episode")), (2, vec![Some(100.0), Some(200.0)]), "the last is unfinished");
        assert_eq!((read.column("x"), read.column("y")), (vec![None, Some(0.5)], vec![]));
    }

    #[test]
    fn a_file_without_rows_is_an_empty_table() {
        assert!(table("").expect("empty").is_empty());
        assert!(table("episode,x\n").expect("a header").is_empty());
        let directory = tempfile::tempdir().expect("a directory");
        assert!(MetricsTable::read(directory.path()).expect("no file").is_empty());
    }

    #[test]
    fn a_damaged_line_is_named() {
        for (text, part) in [
            ("episode,x\n100,1\n200,abc\n", "line 3: x is \"abc\""),
            ("episode,x\n100\n", "line 2"),
            ("episode,x\n,1\n", "line 2: episode is \"\""),
            ("a,b\n1,2\n", "line 1"),
        ] {
            let error = table(text).expect_err(text).to_string();
            assert!(error.contains(part), "{error} does not say {part}");
        }
    }
}
