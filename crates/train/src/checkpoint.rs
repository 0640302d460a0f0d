//! Checkpoints: everything that a run needs to continue as if it had not stopped.
//!
//! Every episode is appended to `checkpoints/replay.bin`. A checkpoint records the length of this file; resuming drops
//! the bytes after it. Each checkpoint is a directory with the learner, the finalists and a record of counters and
//! digests. It is written under a temporary name and then renamed. Random streams need no state: they are functions of
//! the seed and of the counters in the record.

use std::fs::{self, File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use eigenhand_files::{cannot, create_directory, sha256, sync_directory, write_atomically};
use eigenhand_rl::{EpisodeData, NormalizerConfig, TensorMap};

use crate::counters::Counters;
use crate::error::TrainError;
use crate::finalists::Finalist;

mod state;
mod stored_replay;
use state::{CheckpointRecord, FinalistRecord, State, finalist_file};
use stored_replay::StoredReplay;

const DIRECTORY: &str = "checkpoints";
const REPLAY: &str = "replay.bin";
const LEARNER: &str = "learner.safetensors";
const RECORD: &str = "state.toml";
/// Beginning of the record's first line; the SHA-256 of all lines below follows.
const DIGEST: &str = "digest = ";
const PREFIX: &str = "episode-";
/// Beginning of the name of a checkpoint that cannot be used.
const ASIDE: &str = "damaged-";
const SCHEMA: u32 = 1;

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

    /// Opens the checkpoints of a run and reads the newest one that is whole, and with which the run's other data agree.
    ///
    /// `agrees` compares counters with these data: an error [`TrainError::Damaged`] says that the checkpoint is ahead of them.
    /// Checkpoints that cannot be used are set aside, and `notes` say why. If none is whole because the replay file is damaged or
    /// the rows of `metrics.csv` are missing, the newest goes on without what is lost.
    ///
    /// # Errors
    /// [`TrainError::NotARun`] when there is no checkpoint, [`TrainError::Damaged`] when none can be used. No file is changed
    /// before all files have been read.
    pub fn open(
        run: &Path,
        kept: usize,
        normalizer: &NormalizerConfig,
        agrees: impl Fn(&Counters) -> Result<Option<Lost>, TrainError>,
    ) -> Result<Opened, TrainError> {
        let directory = run.join(DIRECTORY);
        let candidates = newest_first(run)?;
        let path = directory.join(REPLAY);
        let replay = StoredReplay::read(&path)?;
        let (mut unusable, mut chosen, mut mended): (Vec<(PathBuf, TrainError)>, Option<Found>, Option<Found>) =
            (Vec::new(), None, None);
        for checkpoint in candidates {
            let contents = State::read(&checkpoint).and_then(|state| {
                let finalists = state.finalists(normalizer)?;
                let lost = agrees(&state.record.counters)?;
                Ok((state, finalists, lost))
            });
            let (state, finalists, lost) = match contents {
                Ok(contents) => contents,
                Err(error @ TrainError::Damaged { .. }) => {
                    unusable.push((checkpoint, error));
                    continue;
                }
                Err(error) => return Err(error),
            };
            let n_episodes = replay.episodes_up_to(state.record.replay_bytes);
            let fault = replay.fault_before(&path, state.record.replay_bytes).or_else(|| Some(lost?.into_error()));
            let found = Found { checkpoint, state, finalists, n_episodes };
            match fault {
                None => {
                    chosen = Some(found);
                    break;
                }
                Some(error) => {
                    unusable.push((found.checkpoint.clone(), error));
                    mended.get_or_insert(found);
                }
            }
        }
        let mut notes = Vec::new();
        let Some(found) = chosen.or(mended) else {
            let first = unusable.into_iter().next().map(|(_, error)| error);
            return Err(first.unwrap_or_else(|| no_checkpoint(run)));
        };
        // Those that are older than what is found stay as they are.
        let newer = unusable.iter().take_while(|(checkpoint, _)| checkpoint >= &found.checkpoint);
        for (checkpoint, error) in newer {
            let reason = error.to_string().lines().next().unwrap_or_default().to_owned();
            if *checkpoint == found.checkpoint {
                notes.push(format!(
                    "{reason}; the run goes on without what is lost, so it ends otherwise than without the damage"
                ));
                continue;
            }
            let aside = set_aside(checkpoint)?;
            notes.push(format!(
                "{reason}; the checkpoint {} is set aside as {}, and the run goes on from an older one",
                checkpoint.display(),
                aside.display()
            ));
        }
        let Found { state: State { record, learner, .. }, finalists, n_episodes, .. } = found;
        let StoredReplay { mut episodes, ends, .. } = replay;
        let replay_bytes = n_episodes.checked_sub(1).map_or(0, |last| ends[last]);
        episodes.truncate(n_episodes);
        let mut options = OpenOptions::new();
        let mut file = options.create(true).truncate(false).write(true).open(&path).map_err(cannot("open", &path))?;
        file.set_len(replay_bytes).map_err(cannot("truncate", &path))?;
        file.seek(SeekFrom::End(0)).map_err(cannot("write", &path))?;
        let checkpoints = Checkpoints { directory, replay: file, replay_bytes, kept };
        Ok(Opened {
            checkpoints,
            restored: Restored { counters: record.counters, learner, finalists, episodes },
            notes,
        })
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
        fs::create_dir(&partial).map_err(cannot("create the directory", &partial))?;
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
        sync_directory(&self.directory)?;
        let existing = list(&self.directory)?;
        for (_, old) in existing.iter().take(existing.len().saturating_sub(self.kept)) {
            fs::remove_dir_all(old).map_err(cannot("remove", old))?;
        }
        Ok(())
    }
}

/// The open checkpoints of a run, and what the one holds from which it goes on.
pub struct Opened {
    /// The checkpoints.
    pub checkpoints: Checkpoints,
    /// What the run goes on with.
    pub restored: Restored,
    /// What was damaged, and what became of it.
    pub notes: Vec<String>,
}

/// Data that a checkpoint counts, and that a run can go on without.
pub struct Lost {
    /// The file in which they should be.
    pub path: PathBuf,
    /// What is missing.
    pub reason: String,
}

impl Lost {
    fn into_error(self) -> TrainError {
        damaged(&self.path, self.reason)
    }
}

/// A checkpoint that can be used.
struct Found {
    checkpoint: PathBuf,
    state: State,
    finalists: Vec<Finalist>,
    /// Episodes of the replay file that it counts, as far as they can be read.
    n_episodes: usize,
}

/// Returns the counters and the state of the learner at the newest checkpoint of a run directory that is whole. It changes no
/// file.
///
/// # Errors
/// [`TrainError::NotARun`] without a checkpoint, [`TrainError::Damaged`] if none can be read.
pub fn newest_learner(run: &Path) -> Result<(Counters, TensorMap), TrainError> {
    let mut first = None;
    for checkpoint in newest_first(run)? {
        match State::read(&checkpoint) {
            Ok(state) => return Ok((state.record.counters, state.learner)),
            Err(error) => first = first.or(Some(error)),
        }
    }
    Err(first.unwrap_or_else(|| no_checkpoint(run)))
}

fn no_checkpoint(run: &Path) -> TrainError {
    TrainError::NotARun {
        path: run.to_owned(),
        reason: "it holds no checkpoint to start from; start a new run with another --out".to_owned(),
    }
}

/// Renames a checkpoint so that it is none any more, and returns its new path.
fn set_aside(checkpoint: &Path) -> Result<PathBuf, TrainError> {
    let mut name = std::ffi::OsString::from(ASIDE);
    name.push(checkpoint.file_name().unwrap_or_default());
    let aside = checkpoint.with_file_name(name);
    if aside.exists() {
        fs::remove_dir_all(&aside).map_err(cannot("remove", &aside))?;
    }
    fs::rename(checkpoint, &aside).map_err(cannot("rename", checkpoint))?;
    Ok(aside)
}

/// Lists the checkpoints of a run directory, the newest first.
fn newest_first(run: &Path) -> Result<Vec<PathBuf>, TrainError> {
    let found: Vec<PathBuf> = list(&run.join(DIRECTORY))?.into_iter().rev().map(|(_, path)| path).collect();
    if found.is_empty() { Err(no_checkpoint(run)) } else { Ok(found) }
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

fn damaged(path: &Path, reason: impl ToString) -> TrainError {
    TrainError::Damaged {
        path: path.to_owned(),
        reason: reason.to_string(),
        mend: "no checkpoint of this run can be used: start a new run with another --out; the postures and the metrics of this \
               run can still be used"
            .to_owned(),
    }
}
