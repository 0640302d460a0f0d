//! Event files for TensorBoard: the rows of `metrics.csv` as curves over the training episodes.
//!
//! An event file is computed from `metrics.csv` and the start time of the run. A resumed run writes a new file from the
//! rows that it keeps, and removes the old file. So no event appears twice, and none belongs to an episode that is
//! simulated again. The new file has a later name, so that a running TensorBoard notices it.

mod record;

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use eigenhand_files::{cannot, write_atomically};
use record::{Event, Summary, Value, write_event};

use crate::error::TrainError;
use crate::metrics::MetricsRow;

/// Beginning of an event file's name; the time of writing in seconds follows.
const PREFIX: &str = "events.out.tfevents.";
/// Version of the format.
const VERSION: &str = "brain.Event:2";

/// Groups of curves, each with its columns of `metrics.csv`. A name that ends with `*` stands for every column with
/// this beginning. The columns of the axes, `episode` and `wall_s`, are in no group and have no curve.
const GROUPS: [(&str, &[&str]); 4] = [
    ("evaluation", &["success_rate*", "success_with_components", "mean_final_distance_m", "mean_penetration_m"]),
    ("synergy", &["n_postures", "contribution_*", "mean_error_rad"]),
    ("learner", &["critic_loss", "actor_loss", "q_mean", "target_mean", "clipped_share"]),
    ("training", &["train_success_rate", "env_steps", "updates", "diverged", "buffer_warnings"]),
];
/// A count; its increase per second is a curve too.
type Count = fn(&MetricsRow) -> Option<f64>;

const SPEEDS: [(Count, &str); 2] =
    [(|row| row.env_steps, "training/env_steps_per_s"), (|row| row.updates, "training/updates_per_s")];

/// The event file of a run, open for appending.
pub struct EventFile {
    path: PathBuf,
    file: File,
    started: f64,
    previous: MetricsRow,
}

impl EventFile {
    /// Writes a new event file from the rows of a run's `metrics.csv`, and removes older event files.
    ///
    /// `started` is the time at which the run began, in seconds since 1970.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn create(run: &Path, started: u64, rows: &[MetricsRow]) -> Result<EventFile, TrainError> {
        let older = event_files(run)?;
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |elapsed| elapsed.as_secs());
        // TensorBoard reads the files of a directory in the order of their names.
        let number = older.iter().map(|(number, _)| number + 1).max().map_or(now, |next| next.max(now));
        let path = run.join(format!("{PREFIX}{number:010}"));
        let started = started as f64;
        let mut bytes = Vec::new();
        let version = Event { wall_time: started, file_version: Some(VERSION.to_owned()), ..Event::default() };
        write_event(&mut bytes, &version);
        let first = MetricsRow::default();
        let mut previous = &first;
        for row in rows {
            write_event(&mut bytes, &event(row, previous, started));
            previous = row;
        }
        write_atomically(&path, &bytes)?;
        for (_, old) in &older {
            fs::remove_file(old).map_err(cannot("remove", old))?;
        }
        let file = OpenOptions::new().append(true).open(&path).map_err(cannot("open", &path))?;
        Ok(EventFile { path, file, started, previous: previous.clone() })
    }

    /// Appends a row.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn append(&mut self, row: &MetricsRow) -> Result<(), TrainError> {
        let mut bytes = Vec::new();
        write_event(&mut bytes, &event(row, &self.previous, self.started));
        self.file.write_all(&bytes).map_err(cannot("write", &self.path))?;
        self.previous.clone_from(row);
        Ok(())
    }
}

/// Lists the event files of a directory with the numbers in their names.
fn event_files(directory: &Path) -> Result<Vec<(u64, PathBuf)>, TrainError> {
    let mut found = Vec::new();
    for entry in fs::read_dir(directory).map_err(cannot("read", directory))? {
        let path = entry.map_err(cannot("read", directory))?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        if let Some(number) = name.and_then(|name| name.strip_prefix(PREFIX)).and_then(|number| number.parse().ok()) {
            found.push((number, path));
        }
    }
    Ok(found)
}

/// (row, the row before it, start of the run) => the event of the row.
fn event(row: &MetricsRow, previous: &MetricsRow, started: f64) -> Event {
    let curves = row.cells().into_iter().filter_map(|(column, value)| Some((tag(&column)?, value?)));
    let grown = |count: Count| count(row).unwrap_or(0.0) - count(previous).unwrap_or(0.0);
    let seconds = grown(|row| row.wall_s);
    let speeds = SPEEDS
        .iter()
        .map(|(count, tag)| ((*tag).to_owned(), if seconds > 0.0 { grown(*count) / seconds } else { f64::NAN }));
    let present = curves.chain(speeds).filter(|(_, value)| value.is_finite());
    let values = present.map(|(tag, value)| Value { tag, simple_value: Some(value as f32) }).collect();
    Event {
        wall_time: started + row.wall_s.unwrap_or(0.0).max(0.0),
        step: row.episode as i64,
        file_version: None,
        summary: Some(Summary { value: values }),
    }
}

/// (column of `metrics.csv`) => its name in TensorBoard.
fn tag(column: &str) -> Option<String> {
    let is = |pattern: &str| match pattern.strip_suffix('*') {
        Some(start) => column.starts_with(start),
        None => column == pattern,
    };
    let group = GROUPS.iter().find(|(_, patterns)| patterns.iter().any(|pattern| is(pattern)));
    group.map(|(name, _)| format!("{name}/{column}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::tests::read_events;

    fn row(episode: u64, wall_s: f64, env_steps: f64, critic_loss: Option<f64>) -> MetricsRow {
        MetricsRow {
            episode,
            env_steps: Some(env_steps),
            wall_s: Some(wall_s),
            success_rate: Some(0.5),
            success_rate_per_object: [("cube".to_owned(), Some(0.25))].into(),
            contribution: vec![Some(0.75)],
            critic_loss,
            ..MetricsRow::default()
        }
    }

    /// Step, time, and values by name.
    type Point = (i64, f64, Vec<(String, f32)>);

    /// Reads the one event file of a directory.
    fn read(directory: &Path) -> Vec<Point> {
        let files = event_files(directory).expect("readable");
        let [(_, path)] = files.as_slice() else { panic!("{files:?} is not one file") };
        let mut events = read_events(&fs::read(path).expect("readable"));
        assert_eq!(events.remove(0).file_version.as_deref(), Some(VERSION));
        let values = |event: Event| event.summary.expect("values").value;
        let named = |value: Value| (value.tag, value.simple_value.expect("a scalar"));
        events.into_iter().map(|e| (e.step, e.wall_time, values(e).into_iter().map(named).collect())).collect()
    }

    #[test]
    fn a_row_becomes_an_event_with_the_values_that_exist() {
        let directory = tempfile::tempdir().expect("a directory");
        let mut file = EventFile::create(directory.path(), 1000, &[]).expect("writable");
        file.append(&row(200, 10.0, 2000.0, None)).expect("writable");
        file.append(&row(400, 15.0, 4000.0, Some(0.125))).expect("writable");
        let read = read(directory.path());
        let value = |event: usize, tag: &str| read[event].2.iter().find(|(t, _)| t == tag).map(|(_, value)| *value);
        assert_eq!((read[0].0, read[0].1), (200, 1010.0));
        assert_eq!((read[1].0, read[1].1), (400, 1015.0));
        assert_eq!(value(0, "evaluation/success_rate"), Some(0.5));
        assert_eq!(value(0, "evaluation/success_rate_cube"), Some(0.25));
        assert_eq!(value(0, "synergy/contribution_1"), Some(0.75));
        assert_eq!(value(0, "learner/critic_loss"), None);
        assert_eq!(value(1, "learner/critic_loss"), Some(0.125));
        assert_eq!(value(1, "training/env_steps"), Some(4000.0));
        assert_eq!(value(1, "training/env_steps_per_s"), Some(400.0));
        assert!(read[1].2.iter().all(|(tag, _)| !tag.contains("episode") && !tag.contains("wall_s")));
    }

    #[test]
    fn a_file_that_is_written_anew_holds_the_kept_rows_once() {
        let rows = [(200, 10.0, 2000.0, 1.0), (400, 15.0, 4000.0, 0.5), (600, 17.0, 6000.0, 0.25)]
            .map(|(episode, wall_s, steps, loss)| row(episode, wall_s, steps, Some(loss)));
        let whole = tempfile::tempdir().expect("a directory");
        let mut file = EventFile::create(whole.path(), 7, &[]).expect("writable");
        rows.iter().for_each(|row| file.append(row).expect("writable"));
        let resumed = tempfile::tempdir().expect("a directory");
        let mut file = EventFile::create(resumed.path(), 7, &[]).expect("writable");
        rows.iter().for_each(|row| file.append(row).expect("writable"));
        drop(file);
        // A kill can leave a half-written event at the end.
        let (first, path) = event_files(resumed.path()).expect("readable").remove(0);
        let bytes = fs::read(&path).expect("readable");
        fs::write(&path, &bytes[..bytes.len() - 5]).expect("writable");
        let mut file = EventFile::create(resumed.path(), 7, &rows[..1]).expect("writable");
        rows[1..].iter().for_each(|row| file.append(row).expect("writable"));
        assert_eq!(read(whole.path()), read(resumed.path()));
        assert!(event_files(resumed.path()).expect("readable")[0].0 > first, "the new name is later");
    }
}
