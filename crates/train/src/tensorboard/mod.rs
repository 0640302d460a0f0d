//! Event files for TensorBoard: the rows of `metrics.csv` as curves over the training episodes, the settings, and the
//! pictures of the result.
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
use prost::Message;
use record::{
    Event, Hparams, Image, Metadata, PluginData, SessionStart, Setting, SettingValue, Summary, Value, write_event,
};

use crate::config::Settings;
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
/// Settings that say nothing of what is learned.
const WITHOUT_EFFECT: [&str; 3] = ["schema", "tensorboard", "workers"];
/// Channels of the pictures: red, green, blue.
const CHANNELS: i32 = 3;

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
    /// `started` is the time at which the run began, in seconds since 1970; `settings` are its settings by their keys, as
    /// TOML.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn create(run: &Path, started: u64, settings: &Settings, rows: &[MetricsRow]) -> Result<EventFile, TrainError> {
        let older = event_files(run)?;
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |elapsed| elapsed.as_secs());
        // TensorBoard reads the files of a directory in the order of their names.
        let number = older.iter().map(|(number, _)| number + 1).max().map_or(now, |next| next.max(now));
        let path = run.join(format!("{PREFIX}{number:010}"));
        let started = started as f64;
        let mut bytes = Vec::new();
        let version = Event { wall_time: started, file_version: Some(VERSION.to_owned()), ..Event::default() };
        write_event(&mut bytes, &version);
        write_event(&mut bytes, &settings_event(settings, started));
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

/// Adds pictures, PNG files, to the event file of a run: each with its name, at an episode. A run without an event file
/// stays without.
///
/// # Errors
/// [`TrainError::File`]; [`TrainError::Damaged`] for a file that is no PNG.
pub fn add_pictures(run: &Path, episode: u64, pictures: &[PathBuf]) -> Result<(), TrainError> {
    let Some((_, path)) = event_files(run)?.into_iter().max() else { return Ok(()) };
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |elapsed| elapsed.as_secs_f64());
    let value = pictures.iter().map(|picture| picture_value(picture)).collect::<Result<_, _>>()?;
    let summary = Some(Summary { value });
    let mut bytes = Vec::new();
    write_event(&mut bytes, &Event { wall_time: now, step: episode as i64, summary, ..Event::default() });
    let mut file = OpenOptions::new().append(true).open(&path).map_err(cannot("open", &path))?;
    Ok(file.write_all(&bytes).map_err(cannot("write", &path))?)
}

fn picture_value(picture: &Path) -> Result<Value, TrainError> {
    let encoded = fs::read(picture).map_err(cannot("read", picture))?;
    let [width, height] = png_size(&encoded).ok_or_else(|| TrainError::Damaged {
        path: picture.to_owned(),
        reason: "it is no PNG file".to_owned(),
        mend: "draw it again with render".to_owned(),
    })?;
    let name = picture.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let image = Some(Image { height, width, colorspace: CHANNELS, encoded });
    Ok(Value { tag: format!("pictures/{name}"), image, ..Value::default() })
}

/// (bytes of a PNG file) => width and height, which its first chunk holds
fn png_size(bytes: &[u8]) -> Option<[i32; 2]> {
    let header = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n")?.get(8..16)?;
    let (width, height) = header.split_first_chunk::<4>()?;
    Some([i32::from_be_bytes(*width), i32::from_be_bytes(height.try_into().ok()?)])
}

/// (settings as TOML, start of the run) => the event with which TensorBoard's table of settings begins
fn settings_event(settings: &Settings, started: f64) -> Event {
    let hparams = settings.iter().filter(|(key, _)| !WITHOUT_EFFECT.contains(&key.as_str()));
    let hparams = hparams.map(|(key, value)| (key.clone(), setting(value))).collect();
    let session_start_info = Some(SessionStart { hparams, start_time_secs: started });
    let content = Hparams { session_start_info }.encode_to_vec();
    let plugin_data = Some(PluginData { plugin_name: "hparams".to_owned(), content });
    let metadata = Some(Metadata { plugin_data });
    let value = vec![Value { tag: "_hparams_/session_start_info".to_owned(), metadata, ..Value::default() }];
    Event { wall_time: started, summary: Some(Summary { value }), ..Event::default() }
}

/// (a value as TOML) => the same for TensorBoard, which has no lists
fn setting(text: &str) -> Setting {
    let value = match (text.parse::<f64>(), text.parse::<bool>()) {
        (Ok(number), _) if number.is_finite() => SettingValue::Number(number),
        (_, Ok(truth)) => SettingValue::Bool(truth),
        _ => SettingValue::Text(text.trim_matches('"').to_owned()),
    };
    Setting { value: Some(value) }
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
    let values =
        present.map(|(tag, value)| Value { tag, simple_value: Some(value as f32), ..Value::default() }).collect();
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
        assert_eq!(events.remove(0).summary.expect("values").value[0].tag, "_hparams_/session_start_info");
        let values = |event: Event| event.summary.expect("values").value;
        let named = |value: Value| (value.tag, value.simple_value.expect("a scalar"));
        events.into_iter().map(|e| (e.step, e.wall_time, values(e).into_iter().map(named).collect())).collect()
    }

    #[test]
    fn a_row_becomes_an_event_with_the_values_that_exist() {
        let directory = tempfile::tempdir().expect("a directory");
        let mut file = EventFile::create(directory.path(), 1000, &Settings::new(), &[]).expect("writable");
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
    fn settings_and_pictures_have_the_form_that_tensorboard_reads() {
        let directory = tempfile::tempdir().expect("a directory");
        let settings = [("lambda", "0.5"), ("hand", "\"x\""), ("task.observe_id", "true"), ("workers", "2")];
        let settings: Settings = settings.map(|(key, value)| (key.to_owned(), value.to_owned())).into();
        EventFile::create(directory.path(), 9, &settings, &[]).expect("writable");
        let picture = directory.path().join("grasps.png");
        // Signature, and the beginning of the first chunk: 3 x 2 pixels.
        let header = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x03\0\0\0\x02";
        fs::write(&picture, header).expect("writable");
        add_pictures(directory.path(), 400, std::slice::from_ref(&picture)).expect("writable");
        let (_, path) = event_files(directory.path()).expect("readable").remove(0);
        let events = read_events(&fs::read(&path).expect("readable"));
        let metadata = |event: &Event| event.summary.clone().and_then(|s| s.value[0].metadata.clone());
        let data = metadata(&events[1]).and_then(|metadata| metadata.plugin_data).expect("settings");
        let start = Hparams::decode(data.content.as_slice()).expect("a message").session_start_info.expect("a start");
        let value = |key: &str| start.hparams.get(key).and_then(|setting| setting.value.clone());
        assert_eq!(value("lambda"), Some(SettingValue::Number(0.5)));
        assert_eq!(value("hand"), Some(SettingValue::Text("x".to_owned())));
        assert_eq!(value("task.observe_id"), Some(SettingValue::Bool(true)));
        assert_eq!((value("workers"), start.start_time_secs), (None, 9.0));
        let shown = events[2].summary.clone().expect("a picture").value.remove(0);
        let image = shown.image.expect("a picture");
        assert_eq!((shown.tag.as_str(), image.width, image.height, events[2].step), ("pictures/grasps", 3, 2, 400));
        assert_eq!(image.encoded, header);
        fs::write(&picture, "no picture").expect("writable");
        let error = add_pictures(directory.path(), 1, &[picture]).expect_err("no PNG").to_string();
        assert!(error.contains("grasps.png"), "{error}");
    }

    #[test]
    fn a_file_that_is_written_anew_holds_the_kept_rows_once() {
        let rows = [(200, 10.0, 2000.0, 1.0), (400, 15.0, 4000.0, 0.5), (600, 17.0, 6000.0, 0.25)]
            .map(|(episode, wall_s, steps, loss)| row(episode, wall_s, steps, Some(loss)));
        let whole = tempfile::tempdir().expect("a directory");
        let mut file = EventFile::create(whole.path(), 7, &Settings::new(), &[]).expect("writable");
        rows.iter().for_each(|row| file.append(row).expect("writable"));
        let resumed = tempfile::tempdir().expect("a directory");
        let mut file = EventFile::create(resumed.path(), 7, &Settings::new(), &[]).expect("writable");
        rows.iter().for_each(|row| file.append(row).expect("writable"));
        drop(file);
        // A kill can leave a half-written event at the end.
        let (first, path) = event_files(resumed.path()).expect("readable").remove(0);
        let bytes = fs::read(&path).expect("readable");
        fs::write(&path, &bytes[..bytes.len() - 5]).expect("writable");
        let mut file = EventFile::create(resumed.path(), 7, &Settings::new(), &rows[..1]).expect("writable");
        rows[1..].iter().for_each(|row| file.append(row).expect("writable"));
        assert_eq!(read(whole.path()), read(resumed.path()));
        assert!(event_files(resumed.path()).expect("readable")[0].0 > first, "the new name is later");
    }
}
