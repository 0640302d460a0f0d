//! `metrics.csv`: one row for each evaluation. Every column is defined in docs/algorithms.md.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

use eigenhand_files::{cannot, write_atomically};
use eigenhand_synergy::Synergy;

use crate::checkpoint::Lost;
use crate::counters::Counters;
use crate::error::TrainError;
use crate::evaluation::Evaluation;

/// Name of the file in a run directory.
pub const METRICS: &str = "metrics.csv";

/// Least success of a policy whose postures are worth an analysis.
pub(crate) const TRUSTED: f64 = 0.2;

/// The first column; it identifies the row.
const EPISODE: &str = "episode";

/// One evaluation during training, with means over the updates since the evaluation before; `None` for a missing
/// number.
///
/// docs/algorithms.md defines each field under the name of its column.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MetricsRow {
    /// Training episodes so far.
    pub episode: u64,
    /// Control steps simulated in training.
    pub env_steps: Option<f64>,
    /// Updates of the learner, one for each minibatch.
    pub updates: Option<f64>,
    /// Wall time in s.
    pub wall_s: Option<f64>,
    /// Share of the evaluation's episodes that succeeded.
    pub success_rate: Option<f64>,
    /// Share of the same episodes that succeed when the commands are projected on the control synergy.
    pub success_with_components: Option<f64>,
    /// Success rate with each object, by its name.
    pub success_rate_per_object: BTreeMap<String, Option<f64>>,
    /// Mean distance between object and goal at the end, in m.
    pub mean_final_distance_m: Option<f64>,
    /// Deepest penetration between object and hand, averaged over the successes, in m.
    pub mean_penetration_m: Option<f64>,
    /// Share of the last noise-free training episodes that succeeded.
    pub train_success_rate: Option<f64>,
    /// Postures in the database.
    pub n_postures: Option<f64>,
    /// Contribution rate of each component, the first component first.
    pub contribution: Vec<Option<f64>>,
    /// Sum of the contribution rates.
    pub contribution_sum: Option<f64>,
    /// Mean approximation error of the evaluation's successes.
    pub mean_error_rad: Option<f64>,
    /// Mean loss of the critic.
    pub critic_loss: Option<f64>,
    /// Mean loss of the actor.
    pub actor_loss: Option<f64>,
    /// Mean value (Q) of the actions in the minibatches.
    pub q_mean: Option<f64>,
    /// Mean target.
    pub target_mean: Option<f64>,
    /// Mean share of the targets that were clipped.
    pub clipped_share: Option<f64>,
    /// Training episodes that diverged.
    pub diverged: Option<f64>,
    /// Training steps at which MuJoCo warned of a full contact or constraint buffer, or of a bad inertia.
    pub buffer_warnings: Option<f64>,
}

/// Beginning of the column name of an object's success rate; the object's name follows.
const OBJECT_PREFIX: &str = "success_rate_";
/// Beginning of the column name of a component's contribution rate; the component's number, from 1, follows.
const COMPONENT_PREFIX: &str = "contribution_";

impl MetricsRow {
    /// Makes the row of an evaluation; `components` is the number of contribution rates that the file has columns for.
    pub(crate) fn of(
        counters: &Counters,
        evaluation: &Evaluation,
        success_with_components: Option<f64>,
        synergy: Option<&Synergy>,
        components: usize,
    ) -> MetricsRow {
        let synergy = synergy.filter(|_| evaluation.success_rate() >= TRUSTED);
        let Counters { sums, .. } = counters;
        let postures: Vec<&[f64]> = evaluation.grasps.iter().map(|grasp| grasp.posture.as_slice()).collect();
        let error = synergy.filter(|_| !postures.is_empty()).map(|s| s.mean_error(&postures));
        let rates = evaluation.success_rate_per_object().into_iter();
        MetricsRow {
            episode: counters.episodes,
            env_steps: Some(counters.env_steps as f64),
            updates: Some(counters.updates as f64),
            wall_s: Some(counters.wall_s),
            success_rate: Some(evaluation.success_rate()),
            success_with_components,
            success_rate_per_object: rates.map(|(object, rate)| (object, Some(rate))).collect(),
            mean_final_distance_m: Some(evaluation.mean_final_distance),
            mean_penetration_m: Some(evaluation.mean_penetration),
            train_success_rate: counters.recent_success(),
            n_postures: Some(counters.postures as f64),
            contribution: (0..components).map(|i| synergy.map(|s| s.contribution()[i])).collect(),
            contribution_sum: synergy.map(Synergy::contribution_sum),
            mean_error_rad: error,
            critic_loss: sums.mean(sums.critic_loss),
            actor_loss: sums.mean(sums.actor_loss),
            q_mean: sums.mean(sums.q),
            target_mean: sums.mean(sums.target),
            clipped_share: sums.mean(sums.clipped),
            diverged: Some(counters.diverged as f64),
            buffer_warnings: Some(counters.buffer_warnings as f64),
        }
    }

    /// Lists columns and values, in the order of the file.
    pub fn cells(&self) -> Vec<(String, Option<f64>)> {
        let mut copy = self.clone();
        let named = |cells: Vec<(&str, &mut Option<f64>)>| -> Vec<(String, Option<f64>)> {
            cells.into_iter().map(|(name, value)| (name.to_owned(), *value)).collect()
        };
        let [progress, success, synergy, learner] = copy.fields();
        let mut cells = vec![(EPISODE.to_owned(), Some(self.episode as f64))];
        cells.extend(named(progress));
        let objects = &self.success_rate_per_object;
        cells.extend(objects.iter().map(|(object, rate)| (format!("{OBJECT_PREFIX}{object}"), *rate)));
        cells.extend(named(success));
        let components = self.contribution.iter().enumerate();
        cells.extend(components.map(|(i, rate)| (format!("{COMPONENT_PREFIX}{}", i + 1), *rate)));
        cells.extend(named(synergy));
        cells.extend(named(learner));
        cells
    }

    /// Sets the value of a column; ignores a column that this version does not have.
    fn set(&mut self, column: &str, value: Option<f64>) {
        if let Some((_, field)) = self.fields().into_iter().flatten().find(|(name, _)| *name == column) {
            *field = value;
        } else if let Some(object) = column.strip_prefix(OBJECT_PREFIX) {
            self.success_rate_per_object.insert(object.to_owned(), value);
        } else if let Some(number) = column.strip_prefix(COMPONENT_PREFIX).and_then(|n| n.parse::<u16>().ok()) {
            // 16 bits bound the memory that a damaged header can request.
            let number = usize::from(number);
            self.contribution.resize(self.contribution.len().max(number), None);
            if let Some(rate) = number.checked_sub(1).and_then(|i| self.contribution.get_mut(i)) {
                *rate = value;
            }
        }
    }

    /// Returns the columns with one value, in four groups. In the file, the objects' success rates follow the first
    /// group, and the components' contribution rates the second.
    fn fields(&mut self) -> [Vec<(&'static str, &mut Option<f64>)>; 4] {
        [
            vec![
                ("env_steps", &mut self.env_steps),
                ("updates", &mut self.updates),
                ("wall_s", &mut self.wall_s),
                ("success_rate", &mut self.success_rate),
                ("success_with_components", &mut self.success_with_components),
            ],
            vec![
                ("mean_final_distance_m", &mut self.mean_final_distance_m),
                ("mean_penetration_m", &mut self.mean_penetration_m),
                ("train_success_rate", &mut self.train_success_rate),
                ("n_postures", &mut self.n_postures),
            ],
            vec![("contribution_sum", &mut self.contribution_sum), ("mean_error_rad", &mut self.mean_error_rad)],
            vec![
                ("critic_loss", &mut self.critic_loss),
                ("actor_loss", &mut self.actor_loss),
                ("q_mean", &mut self.q_mean),
                ("target_mean", &mut self.target_mean),
                ("clipped_share", &mut self.clipped_share),
                ("diverged", &mut self.diverged),
                ("buffer_warnings", &mut self.buffer_warnings),
            ],
        ]
    }
}

/// `metrics.csv`, open for appending.
pub struct MetricsFile {
    path: PathBuf,
    writer: csv::Writer<File>,
    columns: Vec<String>,
}

impl MetricsFile {
    /// Opens the file and drops the rows after `episode`; a resumed run writes them again.
    ///
    /// # Errors
    /// [`TrainError::File`], or [`TrainError::Damaged`] when a row cannot be read.
    pub fn open(directory: &Path, episode: u64) -> Result<MetricsFile, TrainError> {
        let path = directory.join(METRICS);
        let columns = if path.exists() { truncate(&path, episode)? } else { Vec::new() };
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(cannot("open", &path))?;
        let writer = csv::WriterBuilder::new().has_headers(false).from_writer(file);
        Ok(MetricsFile { path, writer, columns })
    }

    /// Returns the number of rows up to `episode`.
    ///
    /// # Errors
    /// As [`read_metrics`].
    pub fn rows_up_to(directory: &Path, episode: u64) -> Result<u64, TrainError> {
        Ok(read_metrics(directory)?.iter().filter(|row| row.episode <= episode).count() as u64)
    }

    /// Returns the missing rows of a run at a checkpoint, if there are any: those up to `episode` are fewer than `expected`.
    ///
    /// # Errors
    /// As [`read_metrics`].
    pub fn lost(directory: &Path, episode: u64, expected: u64) -> Result<Option<Lost>, TrainError> {
        let found = Self::rows_up_to(directory, episode)?;
        let reason = format!("it has {found} rows up to episode {episode}, but the checkpoint counts {expected}");
        Ok((found < expected).then(|| Lost { path: directory.join(METRICS), reason }))
    }

    /// Appends a row, after the header if it is the first.
    ///
    /// A file keeps its header: a number without a column is left out, and a column without a number stays empty.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn append(&mut self, row: &MetricsRow) -> Result<(), TrainError> {
        let cells = row.cells();
        if self.columns.is_empty() {
            self.columns = cells.iter().map(|(name, _)| name.clone()).collect();
            self.writer.write_record(&self.columns).map_err(|e| csv_error(&self.path, e))?;
        }
        let field = |column: &String| {
            let found = cells.iter().find(|(name, _)| name == column).and_then(|(_, value)| *value);
            found.filter(|value| value.is_finite()).map_or_else(String::new, |value| value.to_string())
        };
        self.writer.write_record(self.columns.iter().map(field)).map_err(|e| csv_error(&self.path, e))?;
        Ok(self.writer.flush().map_err(cannot("write", &self.path))?)
    }

    /// Waits until the disk has all rows.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn sync(&self) -> Result<(), TrainError> {
        Ok(self.writer.get_ref().sync_all().map_err(cannot("write", &self.path))?)
    }
}

/// Reads the rows in a run directory, from top to bottom.
///
/// A run has no rows before its first evaluation. A last line without a line end is still being written, and is
/// ignored.
///
/// # Errors
/// [`TrainError::File`], or [`TrainError::Damaged`] with the line that cannot be read.
pub fn read_metrics(directory: &Path) -> Result<Vec<MetricsRow>, TrainError> {
    let path = directory.join(METRICS);
    let mut text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(cannot("read", &path)(error).into()),
    };
    text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
    let damaged = |line: usize, what: String| TrainError::Damaged {
        path: path.clone(),
        reason: format!("line {line}: {what}"),
        mend: "the policy and the postures are not affected: correct the line, or move the file away".to_owned(),
    };
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| damaged(1, error.to_string()))?.clone();
    if header.get(0).is_some_and(|first| first != EPISODE) {
        return Err(damaged(1, format!("the first column is {:?}; expected {EPISODE:?}", &header[0])));
    }
    let mut rows = Vec::new();
    for (i, record) in reader.records().enumerate() {
        let line = i + 2;
        let record = record.map_err(|error| damaged(line, error.to_string()))?;
        let wrong = |column: &str, cell: &str, expected: &str| {
            damaged(line, format!("{column} is {cell:?}; expected {expected}"))
        };
        let mut row = MetricsRow::default();
        for (cell, column) in record.iter().zip(&header) {
            if column == EPISODE {
                row.episode = cell.parse().map_err(|_| wrong(column, cell, "a whole number"))?;
                continue;
            }
            let value = match cell.parse::<f64>() {
                _ if cell.is_empty() => None,
                Ok(value) if value.is_finite() => Some(value),
                _ => return Err(wrong(column, cell, "a number")),
            };
            row.set(column, value);
        }
        rows.push(row);
    }
    Ok(rows)
}

/// Drops the rows after `episode`, and returns the header.
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
        mend: "the policy and the postures are not affected: move the file away, then continue the run with --resume"
            .to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(episode: u64, success_rate: Option<f64>) -> MetricsRow {
        MetricsRow {
            episode,
            success_rate,
            success_rate_per_object: BTreeMap::from([("cube".to_owned(), Some(0.5)), ("disc".to_owned(), None)]),
            contribution: vec![Some(0.25), Some(0.125)],
            updates: Some(40.0),
            ..MetricsRow::default()
        }
    }

    fn directory_with(text: &str) -> tempfile::TempDir {
        let directory = tempfile::tempdir().expect("a directory");
        std::fs::write(directory.path().join(METRICS), text).expect("writable");
        directory
    }

    fn read(text: &str) -> Result<Vec<MetricsRow>, TrainError> {
        read_metrics(directory_with(text).path())
    }

    #[test]
    fn a_resumed_file_holds_every_row_once() {
        let directory = tempfile::tempdir().expect("a directory");
        let mut file = MetricsFile::open(directory.path(), 0).expect("new");
        for episode in [100, 200, 300] {
            file.append(&row(episode, Some(f64::NAN))).expect("writable");
        }
        drop(file);
        let mut file = MetricsFile::open(directory.path(), 200).expect("existing");
        file.append(&row(300, Some(0.75))).expect("writable");
        let expected = [row(100, None), row(200, None), row(300, Some(0.75))];
        assert_eq!(read_metrics(directory.path()).expect("sound"), expected, "not a number is no number");
    }

    #[test]
    fn a_file_keeps_its_columns() {
        let directory = directory_with("episode,old,updates\n100,1,2.5\n");
        let mut file = MetricsFile::open(directory.path(), 100).expect("existing");
        file.append(&row(200, Some(0.5))).expect("writable");
        let text = std::fs::read_to_string(directory.path().join(METRICS)).expect("readable");
        assert_eq!(text, "episode,old,updates\n100,1,2.5\n200,,40\n");
    }

    #[test]
    fn rows_are_read_back_with_their_gaps() {
        let rows = read("episode,updates,contribution_2\n100,,\n200,0.5,0.25\n300,0.").expect("sound");
        let updates: Vec<_> = rows.iter().map(|row| (row.episode, row.updates)).collect();
        assert_eq!(updates, [(100, None), (200, Some(0.5))], "the last line is unfinished");
        assert_eq!(rows[1].contribution, [None, Some(0.25)]);
        let rows = read("episode,contribution_99999999999999\n100,1\n").expect("an unknown column");
        assert!(rows[0].contribution.is_empty());
    }

    #[test]
    fn a_file_without_rows_is_empty() {
        assert!(read("").expect("empty").is_empty());
        assert!(read("episode,x\n").expect("a header").is_empty());
        let directory = tempfile::tempdir().expect("a directory");
        assert!(read_metrics(directory.path()).expect("no file").is_empty());
    }

    #[test]
    fn a_damaged_line_is_named() {
        for (text, part) in [
            ("episode,x\n100,1\n200,abc\n", "line 3: x is \"abc\""),
            ("episode,x\n100\n", "line 2"),
            ("episode,x\n,1\n", "line 2: episode is \"\""),
            ("a,b\n1,2\n", "line 1"),
        ] {
            let error = read(text).expect_err(text).to_string();
            assert!(error.contains(part), "{error} does not say {part}");
        }
    }
}
