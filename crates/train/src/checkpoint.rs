//! Checkpoints: everything that a run needs to continue as if it had not stopped.
//!
//! Every episode is appended to `checkpoints/replay.bin`. A checkpoint records the length of this file; resuming drops
//! the bytes after it. Each checkpoint is a directory with the learner, the finalists and a record of counters and
//! digests. It is written under a temporary name and then renamed. Random streams need no state: they are functions of
//! the seed and of the counters in the record.

use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use eigenhand_files::{cannot, create_directory, sha256, write_atomically};
use eigenhand_rl::{EpisodeData, NormalizerConfig, Policy, TensorMap};
use serde::{Deserialize, Serialize};

use crate::counters::Counters;
use crate::error::TrainError;
use crate::finalists::Finalist;

const DIRECTORY: &str = "checkpoints";
const REPLAY: &str = "replay.bin";
const LEARNER: &str = "learner.safetensors";
const RECORD: &str = "state.toml";
/// Beginning of the record's first line; the SHA-256 of all lines below follows.
const DIGEST: &str = "digest = ";
const PREFIX: &str = "episode-";
const SCHEMA: u32 = 1;

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CheckpointRecord {
    schema: u32,
    counters: Counters,
    replay_bytes: u64,
    learner_sha256: String,
    #[serde(default)]
    finalists: Vec<FinalistRecord>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FinalistRecord {
    success_rate: f64,
    episode: u64,
    sha256: String,
}

fn finalist_file(episode: u64) -> String {
    format!("policy-{episode:08}.safetensors")
}

/// Contents of a checkpoint.
pub struct Restored {
    /// Counters at the checkpoint.
    pub counters: Counters,
    /// The learner.
    pub learner: TensorMap,
    /// Policies of the best evaluations so far, the best first.
    pub finalists: Vec<Finalist>,
    /// Every stored episode, oldest first.
    pub episodes: Vec<EpisodeData>,
}

/// The checkpoints of one run.
pub struct Checkpoints {
    directory: PathBuf,
    replay: File,
    replay_bytes: u64,
    kept: usize,
}

impl Checkpoints {
    /// Starts the checkpoints of a new run.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn create(run: &Path, kept: usize) -> Result<Checkpoints, TrainError> {
        let directory = run.join(DIRECTORY);
        create_directory(&directory)?;
        let path = directory.join(REPLAY);
        let replay = File::create(&path).map_err(cannot("write", &path))?;
        Ok(Checkpoints { directory, replay, replay_bytes: 0, kept })
    }

    /// Opens the checkpoints of a run and reads the newest checkpoint.
    ///
    /// # Errors
    /// [`TrainError::NotARun`] when there is no checkpoint, [`TrainError::Damaged`] when a file does not match its
    /// digest. The messages name the file and the next step. No file is changed before all files have been read.
    pub fn open(run: &Path, kept: usize, normalizer: &NormalizerConfig) -> Result<(Checkpoints, Restored), TrainError> {
        let directory = run.join(DIRECTORY);
        let existing = list(&directory)?;
        let Some((_, newest)) = existing.last() else {
            return Err(TrainError::NotARun {
                path: run.to_owned(),
                reason: "it holds no checkpoint to resume from; start a new run with another --out".to_owned(),
            });
        };
        let older = existing.len().checked_sub(2).and_then(|i| existing.get(i)).map(|(_, path)| path.as_path());
        let record = read_record(newest, older)?;
        let learner = read_tensors(&newest.join(LEARNER), &record.learner_sha256, newest, older)?;
        let mut finalists = Vec::with_capacity(record.finalists.len());
        for FinalistRecord { success_rate, episode, sha256 } in record.finalists {
            let path = newest.join(finalist_file(episode));
            let tensors = read_tensors(&path, &sha256, newest, older)?;
            let policy =
                Policy::import_tensors(&tensors, normalizer).map_err(|error| damaged(&path, error, newest, older))?;
            finalists.push(Finalist { success_rate, episode, policy });
        }
        let path = directory.join(REPLAY);
        let mut replay = OpenOptions::new().read(true).write(true).open(&path).map_err(cannot("open", &path))?;
        let episodes = read_replay(&mut replay, &path, record.replay_bytes)?;
        replay.set_len(record.replay_bytes).map_err(cannot("truncate", &path))?;
        replay.seek(SeekFrom::End(0)).map_err(cannot("write", &path))?;
        let checkpoints = Checkpoints { directory, replay, replay_bytes: record.replay_bytes, kept };
        Ok((checkpoints, Restored { counters: record.counters, learner, finalists, episodes }))
    }

    /// Appends an episode to the replay file; the next checkpoint includes it.
    ///
    /// # Errors
    /// [`TrainError::File`], [`TrainError::Rl`].
    pub fn append(&mut self, episode: &EpisodeData) -> Result<(), TrainError> {
        let bytes = episode.to_bytes()?;
        let path = self.directory.join(REPLAY);
        self.replay.write_all(&bytes).map_err(cannot("write", &path))?;
        self.replay_bytes += bytes.len() as u64;
        Ok(())
    }

    /// Writes a checkpoint and removes the oldest ones.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn save(&mut self, counters: &Counters, learner: &TensorMap, finalists: &[Finalist]) -> Result<(), TrainError> {
        let replay_path = self.directory.join(REPLAY);
        self.replay.sync_data().map_err(cannot("write", &replay_path))?;
        let learner = learner.save_bytes()?;
        let mut policies = Vec::with_capacity(finalists.len());
        for finalist in finalists {
            policies.push((finalist, finalist.policy.export_tensors().save_bytes()?));
        }
        let record = CheckpointRecord {
            schema: SCHEMA,
            counters: counters.clone(),
            replay_bytes: self.replay_bytes,
            learner_sha256: sha256(&learner),
            finalists: policies
                .iter()
                .map(|(finalist, bytes)| FinalistRecord {
                    success_rate: finalist.success_rate,
                    episode: finalist.episode,
                    sha256: sha256(bytes),
                })
                .collect(),
        };
        let name = format!("{PREFIX}{:08}", counters.episodes);
        let (partial, path) = (self.directory.join(format!(".{name}.partial")), self.directory.join(&name));
        if partial.exists() {
            fs::remove_dir_all(&partial).map_err(cannot("remove", &partial))?;
        }
        create_directory(&partial)?;
        write_atomically(&partial.join(LEARNER), &learner)?;
        for (finalist, bytes) in &policies {
            write_atomically(&partial.join(finalist_file(finalist.episode)), bytes)?;
        }
        let record = toml::to_string(&record)
            .map_err(|error| TrainError::Format { path: path.join(RECORD), reason: error.to_string() })?;
        let digest = sha256(record.as_bytes());
        write_atomically(&partial.join(RECORD), format!("{DIGEST}\"{digest}\"\n{record}").as_bytes())?;
        if path.exists() {
            fs::remove_dir_all(&path).map_err(cannot("replace", &path))?;
        }
        fs::rename(&partial, &path).map_err(cannot("write", &path))?;
        let existing = list(&self.directory)?;
        for (_, old) in existing.iter().take(existing.len().saturating_sub(self.kept)) {
            fs::remove_dir_all(old).map_err(cannot("remove", old))?;
        }
        Ok(())
    }
}

/// Returns the number of training episodes at the newest checkpoint of a run directory.
///
/// # Errors
/// [`TrainError::File`].
pub fn newest(run: &Path) -> Result<Option<u64>, TrainError> {
    Ok(list(&run.join(DIRECTORY))?.last().map(|(episode, _)| *episode))
}

/// Lists checkpoints by episode, oldest first.
fn list(directory: &Path) -> Result<Vec<(u64, PathBuf)>, TrainError> {
    let mut found = Vec::new();
    if directory.is_dir() {
        for entry in fs::read_dir(directory).map_err(cannot("read", directory))? {
            let path = entry.map_err(cannot("read", directory))?.path();
            let number = path
                .file_name()
                .and_then(|name| name.to_str())
                .and_then(|name| name.strip_prefix(PREFIX))
                .and_then(|number| number.parse().ok());
            if let Some(number) = number {
                found.push((number, path));
            }
        }
    }
    found.sort();
    Ok(found)
}

fn damaged(path: &Path, reason: impl ToString, checkpoint: &Path, older: Option<&Path>) -> TrainError {
    let mend = match older {
        Some(older) => format!(
            "remove the directory {}, then continue with --resume from the older checkpoint {}",
            checkpoint.display(),
            older.display()
        ),
        None => {
            "there is no older checkpoint: start a new run with another --out; the postures and the metrics of this run \
             can still be used"
                .to_owned()
        }
    };
    TrainError::Damaged { path: path.to_owned(), reason: reason.to_string(), mend }
}

fn read_record(checkpoint: &Path, older: Option<&Path>) -> Result<CheckpointRecord, TrainError> {
    let path = checkpoint.join(RECORD);
    let text = fs::read_to_string(&path).map_err(|error| damaged(&path, error, checkpoint, older))?;
    let (first, rest) = text.split_once('\n').unwrap_or_default();
    let found = sha256(rest.as_bytes());
    if first.strip_prefix(DIGEST).map(|digest| digest.trim_matches('"')) != Some(found.as_str()) {
        let reason = format!("its first line is {first:?}, but the SHA-256 of the other lines is {found}");
        return Err(damaged(&path, reason, checkpoint, older));
    }
    let record: CheckpointRecord = toml::from_str(rest).map_err(|error| damaged(&path, error, checkpoint, older))?;
    if record.schema != SCHEMA {
        let reason = format!("its schema is {}, but this version of the program reads schema {SCHEMA}", record.schema);
        return Err(damaged(&path, reason, checkpoint, older));
    }
    Ok(record)
}

fn read_tensors(path: &Path, digest: &str, checkpoint: &Path, older: Option<&Path>) -> Result<TensorMap, TrainError> {
    let bytes = fs::read(path).map_err(|error| damaged(path, error, checkpoint, older))?;
    let found = sha256(&bytes);
    if found != digest {
        let reason = format!("its SHA-256 is {found}, but the checkpoint records {digest}");
        return Err(damaged(path, reason, checkpoint, older));
    }
    TensorMap::load_bytes(&bytes).map_err(|error| damaged(path, error, checkpoint, older))
}

fn read_replay(file: &mut File, path: &Path, length: u64) -> Result<Vec<EpisodeData>, TrainError> {
    let damaged = |reason: String| TrainError::Damaged {
        path: path.to_owned(),
        reason,
        mend: "start a new run with another --out; the postures and the metrics of this run can still be used"
            .to_owned(),
    };
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).map_err(cannot("read", path))?;
    if bytes.len() as u64 != length {
        return Err(damaged(format!("it has {} bytes, but the checkpoint records {length}", bytes.len())));
    }
    let mut episodes = Vec::new();
    let mut rest = bytes.as_slice();
    while !rest.is_empty() {
        let (episode, after) =
            EpisodeData::read_prefix(rest).map_err(|error| damaged(format!("episode {}: {error}", episodes.len())))?;
        episodes.push(episode);
        rest = after;
    }
    Ok(episodes)
}
