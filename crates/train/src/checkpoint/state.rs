//! The record, the learner and the finalists of a checkpoint, each with its digest.

use std::fs;
use std::path::{Path, PathBuf};

use eigenhand_files::sha256;
use eigenhand_rl::{NormalizerConfig, Policy, TensorMap};
use serde::{Deserialize, Serialize};

use super::{DIGEST, LEARNER, RECORD, SCHEMA, damaged};
use crate::counters::Counters;
use crate::error::TrainError;
use crate::finalists::Finalist;

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckpointRecord {
    pub schema: u32,
    pub counters: Counters,
    pub replay_bytes: u64,
    pub learner_sha256: String,
    #[serde(default)]
    pub finalists: Vec<FinalistRecord>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FinalistRecord {
    pub success_rate: f64,
    pub episode: u64,
    pub sha256: String,
}

pub fn finalist_file(episode: u64) -> String {
    format!("policy-{episode:08}.safetensors")
}

/// What a checkpoint holds beside the replay and the finalists.
pub struct State {
    checkpoint: PathBuf,
    pub record: CheckpointRecord,
    pub learner: TensorMap,
}

impl State {
    pub fn read(checkpoint: &Path) -> Result<State, TrainError> {
        let record = read_record(checkpoint)?;
        let learner = read_tensors(&checkpoint.join(LEARNER), &record.learner_sha256)?;
        Ok(State { checkpoint: checkpoint.to_owned(), record, learner })
    }

    pub fn finalists(&self, normalizer: &NormalizerConfig) -> Result<Vec<Finalist>, TrainError> {
        let finalist = |FinalistRecord { success_rate, episode, sha256 }: &FinalistRecord| {
            let path = self.checkpoint.join(finalist_file(*episode));
            let tensors = read_tensors(&path, sha256)?;
            let policy = Policy::import_tensors(&tensors, normalizer).map_err(|error| damaged(&path, error))?;
            Ok(Finalist { success_rate: *success_rate, episode: *episode, policy })
        };
        self.record.finalists.iter().map(finalist).collect()
    }
}

fn read_record(checkpoint: &Path) -> Result<CheckpointRecord, TrainError> {
    let path = checkpoint.join(RECORD);
    let text = fs::read_to_string(&path).map_err(|error| damaged(&path, error))?;
    let (first, rest) = text.split_once('\n').unwrap_or_default();
    let found = sha256(rest.as_bytes());
    if first.strip_prefix(DIGEST).map(|digest| digest.trim_matches('"')) != Some(found.as_str()) {
        let reason = format!("its first line is {first:?}, but the SHA-256 of the other lines is {found}");
        return Err(damaged(&path, reason));
    }
    let record: CheckpointRecord = toml::from_str(rest).map_err(|error| damaged(&path, error))?;
    if record.schema != SCHEMA {
        let reason = format!("its schema is {}, but this version of the program reads schema {SCHEMA}", record.schema);
        return Err(damaged(&path, reason));
    }
    Ok(record)
}

fn read_tensors(path: &Path, digest: &str) -> Result<TensorMap, TrainError> {
    let bytes = fs::read(path).map_err(|error| damaged(path, error))?;
    let found = sha256(&bytes);
    if found != digest {
        let reason = format!("its SHA-256 is {found}, but the checkpoint records {digest}");
        return Err(damaged(path, reason));
    }
    TensorMap::load_bytes(&bytes).map_err(|error| damaged(path, error))
}
