//! One whole episode as flat arrays, and its bytes.

use sha2::{Digest, Sha256};

use crate::RlError;

/// Sizes of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EpisodeShape {
    /// Steps, T.
    pub n_steps: usize,
    /// Numbers in an observation.
    pub obs_dim: usize,
    /// Numbers in a goal.
    pub goal_dim: usize,
    /// Numbers in an action.
    pub act_dim: usize,
    /// Numbers a step carries for the reward alone.
    pub fact_dim: usize,
}

/// An episode: what was seen, done and earned, step by step.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeData {
    /// Sizes of the arrays below.
    pub shape: EpisodeShape,
    /// Observations, (T + 1) x obs_dim.
    pub observations: Vec<f32>,
    /// Goals that were achieved, (T + 1) x goal_dim.
    pub achieved_goals: Vec<f32>,
    /// The goal that was desired, goal_dim.
    pub desired_goal: Vec<f32>,
    /// Actions, T x act_dim.
    pub actions: Vec<f32>,
    /// What the reward needs beside goals and observation, T x fact_dim; opaque here.
    pub facts: Vec<f32>,
    /// Rewards as they were earned with the desired goal, T.
    pub rewards: Vec<f32>,
}

const MAGIC: &[u8; 8] = b"EHEPISOD";
const SCHEMA: u32 = 1;
const N_DIMS: usize = 5;
const HEADER: usize = MAGIC.len() + size_of::<u32>() * (1 + N_DIMS);
const CHECKSUM: usize = 8;

impl EpisodeShape {
    /// Lengths of the six arrays in the order in which they are written, `None` when one overflows.
    fn lengths(&self) -> Option<[usize; 6]> {
        let rows = self.n_steps.checked_add(1)?;
        Some([
            rows.checked_mul(self.obs_dim)?,
            rows.checked_mul(self.goal_dim)?,
            self.goal_dim,
            self.n_steps.checked_mul(self.act_dim)?,
            self.n_steps.checked_mul(self.fact_dim)?,
            self.n_steps,
        ])
    }

    fn record_len(&self) -> Option<usize> {
        let n = self.lengths()?.iter().try_fold(0usize, |sum, n| sum.checked_add(*n))?;
        n.checked_mul(size_of::<f32>())?.checked_add(HEADER + CHECKSUM)
    }
}

impl EpisodeData {
    /// Makes an episode of zeros, to be filled in.
    pub fn zeros(shape: EpisodeShape) -> Self {
        let rows = shape.n_steps + 1;
        Self {
            shape,
            observations: vec![0.0; rows * shape.obs_dim],
            achieved_goals: vec![0.0; rows * shape.goal_dim],
            desired_goal: vec![0.0; shape.goal_dim],
            actions: vec![0.0; shape.n_steps * shape.act_dim],
            facts: vec![0.0; shape.n_steps * shape.fact_dim],
            rewards: vec![0.0; shape.n_steps],
        }
    }

    /// Returns the observation before step `t`, `t <= T`.
    pub fn observation(&self, t: usize) -> &[f32] {
        row(&self.observations, t, self.shape.obs_dim)
    }

    /// Returns the goal achieved before step `t`, `t <= T`.
    pub fn achieved_goal(&self, t: usize) -> &[f32] {
        row(&self.achieved_goals, t, self.shape.goal_dim)
    }

    /// Returns the action of step `t`, `t < T`.
    pub fn action(&self, t: usize) -> &[f32] {
        row(&self.actions, t, self.shape.act_dim)
    }

    /// Returns the facts of step `t`, `t < T`.
    pub fn facts_at(&self, t: usize) -> &[f32] {
        row(&self.facts, t, self.shape.fact_dim)
    }

    /// Checks that every array is as long as the shape says and every number is finite.
    ///
    /// # Errors
    /// [`RlError::Length`] or [`RlError::NotFinite`], with the name of the array.
    pub fn validate(&self) -> Result<(), RlError> {
        let overflow = RlError::Length { name: "episode", expected: usize::MAX, got: 0 };
        let lengths = self.shape.lengths().ok_or(overflow)?;
        for ((name, array), expected) in self.arrays().into_iter().zip(lengths) {
            if array.len() != expected {
                return Err(RlError::Length { name, expected, got: array.len() });
            }
            if let Some(index) = array.iter().position(|x| !x.is_finite()) {
                return Err(RlError::NotFinite { name, index, got: array[index] });
            }
        }
        Ok(())
    }

    /// Appends the episode's record to `out`: header, arrays and a checksum, all little-endian.
    ///
    /// # Errors
    /// As [`validate`](Self::validate), and [`RlError::Length`] when a size does not fit 32 bits; `out` is then unchanged.
    pub fn write_bytes(&self, out: &mut Vec<u8>) -> Result<(), RlError> {
        self.validate()?;
        let EpisodeShape { n_steps, obs_dim, goal_dim, act_dim, fact_dim } = self.shape;
        let mut dims = [0u32; N_DIMS];
        for (dim, n) in dims.iter_mut().zip([n_steps, obs_dim, goal_dim, act_dim, fact_dim]) {
            let too_long = RlError::Length { name: "episode", expected: u32::MAX as usize, got: n };
            *dim = u32::try_from(n).map_err(|_| too_long)?;
        }
        let start = out.len();
        out.extend_from_slice(MAGIC);
        out.extend_from_slice(&SCHEMA.to_le_bytes());
        out.extend(dims.iter().flat_map(|n| n.to_le_bytes()));
        for (_, array) in self.arrays() {
            out.extend(array.iter().flat_map(|x| x.to_le_bytes()));
        }
        let sum = checksum(&out[start..]);
        out.extend_from_slice(&sum);
        Ok(())
    }

    /// Returns the episode's record; see [`write_bytes`](Self::write_bytes).
    ///
    /// # Errors
    /// As [`write_bytes`](Self::write_bytes).
    pub fn to_bytes(&self) -> Result<Vec<u8>, RlError> {
        let mut out = Vec::with_capacity(self.shape.record_len().unwrap_or(0));
        self.write_bytes(&mut out)?;
        Ok(out)
    }

    /// Reads one record and nothing after it.
    ///
    /// # Errors
    /// As [`read_prefix`](Self::read_prefix), and [`RlError::EpisodeCorrupt`] when bytes follow the record.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, RlError> {
        let (episode, rest) = Self::read_prefix(bytes)?;
        if rest.is_empty() {
            return Ok(episode);
        }
        Err(corrupt("length", bytes.len() - rest.len(), bytes.len()))
    }

    /// Reads the record at the front of `bytes`; returns it and the bytes that follow.
    ///
    /// # Errors
    /// [`RlError::EpisodeTruncated`] when the bytes end early, [`RlError::EpisodeCorrupt`] when they are no record or were
    /// altered, and as [`validate`](Self::validate).
    pub fn read_prefix(bytes: &[u8]) -> Result<(Self, &[u8]), RlError> {
        let known = bytes.len().min(MAGIC.len());
        if bytes[..known] != MAGIC[..known] {
            return Err(corrupt("magic", format!("{MAGIC:?}"), format!("{:?}", &bytes[..known])));
        }
        let cut = |expected| RlError::EpisodeTruncated { expected, got: bytes.len() };
        let (header, _) = bytes.split_at_checked(HEADER).ok_or_else(|| cut(HEADER))?;
        let mut words = header[MAGIC.len()..].chunks_exact(4).map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]]));
        let mut word = || words.next().map_or(0, |w| w as usize);
        let schema = word();
        if schema != SCHEMA as usize {
            return Err(corrupt("schema", SCHEMA, schema));
        }
        let shape =
            EpisodeShape { n_steps: word(), obs_dim: word(), goal_dim: word(), act_dim: word(), fact_dim: word() };
        let impossible = || corrupt("shape", "addressable", format!("{shape:?}"));
        let lengths = shape.lengths().ok_or_else(impossible)?;
        let record_len = shape.record_len().ok_or_else(impossible)?;
        let (record, rest) = bytes.split_at_checked(record_len).ok_or_else(|| cut(record_len))?;
        let (content, stored) = record.split_at(record_len - CHECKSUM);
        let sum = checksum(content);
        if stored != sum {
            return Err(corrupt("checksum", format!("{sum:02x?}"), format!("{stored:02x?}")));
        }
        let mut payload = &content[HEADER..];
        let [observations, achieved_goals, desired_goal, actions, facts, rewards] = lengths.map(|n| {
            let (array, after) = payload.split_at(n * size_of::<f32>());
            payload = after;
            array.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect::<Vec<f32>>()
        });
        let episode = Self { shape, observations, achieved_goals, desired_goal, actions, facts, rewards };
        episode.validate()?;
        Ok((episode, rest))
    }

    fn arrays(&self) -> [(&'static str, &[f32]); 6] {
        [
            ("observations", &self.observations),
            ("achieved_goals", &self.achieved_goals),
            ("desired_goal", &self.desired_goal),
            ("actions", &self.actions),
            ("facts", &self.facts),
            ("rewards", &self.rewards),
        ]
    }
}

fn row(array: &[f32], index: usize, width: usize) -> &[f32] {
    &array[index * width..(index + 1) * width]
}

fn checksum(bytes: &[u8]) -> [u8; CHECKSUM] {
    let digest: [u8; 32] = Sha256::digest(bytes).into();
    let mut sum = [0; CHECKSUM];
    sum.copy_from_slice(&digest[..CHECKSUM]);
    sum
}

fn corrupt(name: &'static str, expected: impl ToString, got: impl ToString) -> RlError {
    RlError::EpisodeCorrupt { name, expected: expected.to_string(), got: got.to_string() }
}
