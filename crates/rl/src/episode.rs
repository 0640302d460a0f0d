//! One whole episode as flat arrays, and its bytes.

use sha2::{Digest, Sha256};

use crate::RlError;

/// Sizes of an episode's arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EpisodeShape {
    /// Number of steps, T.
    pub n_steps: usize,
    /// Numbers in an observation.
    pub obs_dim: usize,
    /// Numbers in a goal.
    pub goal_dim: usize,
    /// Numbers in an action.
    pub act_dim: usize,
    /// Numbers that each step stores for the reward alone.
    pub fact_dim: usize,
}

/// The observations, goals and actions of one episode, and the facts from which its rewards are computed.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeData {
    /// Sizes of the arrays below.
    pub shape: EpisodeShape,
    /// Observations, (T + 1) x obs_dim.
    pub observations: Vec<f32>,
    /// Achieved goals, (T + 1) x goal_dim.
    pub achieved_goals: Vec<f32>,
    /// Desired goal, goal_dim.
    pub desired_goal: Vec<f32>,
    /// Actions, T x act_dim.
    pub actions: Vec<f32>,
    /// Inputs of the reward besides goals and observation, T x fact_dim. Only the caller knows their meaning.
    pub facts: Vec<f32>,
}

const MAGIC: &[u8; 8] = b"EHEPISOD";
const SCHEMA: u32 = 2;
const N_DIMS: usize = 5;
const HEADER: usize = MAGIC.len() + size_of::<u32>() * (1 + N_DIMS);
const CHECKSUM: usize = 8;

impl EpisodeShape {
    /// Returns the lengths of the arrays in the order in which they are written, or `None` if one overflows.
    fn lengths(&self) -> Option<[usize; 5]> {
        let rows = self.n_steps.checked_add(1)?;
        Some([
            rows.checked_mul(self.obs_dim)?,
            rows.checked_mul(self.goal_dim)?,
            self.goal_dim,
            self.n_steps.checked_mul(self.act_dim)?,
            self.n_steps.checked_mul(self.fact_dim)?,
        ])
    }

    fn record_len(&self) -> Option<usize> {
        let n = self.lengths()?.iter().try_fold(0usize, |sum, n| sum.checked_add(*n))?;
        n.checked_mul(size_of::<f32>())?.checked_add(HEADER + CHECKSUM)
    }
}

impl EpisodeData {
    /// Makes an episode of zeros, for the caller to fill in.
    pub fn zeros(shape: EpisodeShape) -> Self {
        let rows = shape.n_steps + 1;
        Self {
            shape,
            observations: vec![0.0; rows * shape.obs_dim],
            achieved_goals: vec![0.0; rows * shape.goal_dim],
            desired_goal: vec![0.0; shape.goal_dim],
            actions: vec![0.0; shape.n_steps * shape.act_dim],
            facts: vec![0.0; shape.n_steps * shape.fact_dim],
        }
    }

    /// Returns the observation before step `t`, `t <= T`.
    pub fn observation(&self, t: usize) -> &[f32] {
        row(&self.observations, t, self.shape.obs_dim)
    }

    /// Returns the goal that was achieved before step `t`, `t <= T`.
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

    /// Checks that every array has the length that follows from the shape, and that every number is finite.
    ///
    /// # Errors
    /// [`RlError::Length`] or [`RlError::NotFinite`], which name the array.
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

    /// Returns the episode's record: a header, the arrays and a checksum, all little-endian.
    ///
    /// # Errors
    /// As [`validate`](Self::validate), and [`RlError::Length`] if a size does not fit 32 bits.
    pub fn to_bytes(&self) -> Result<Vec<u8>, RlError> {
        self.validate()?;
        let EpisodeShape { n_steps, obs_dim, goal_dim, act_dim, fact_dim } = self.shape;
        let mut dims = [0u32; N_DIMS];
        for (dim, n) in dims.iter_mut().zip([n_steps, obs_dim, goal_dim, act_dim, fact_dim]) {
            let too_long = RlError::Length { name: "episode", expected: u32::MAX as usize, got: n };
            *dim = u32::try_from(n).map_err(|_| too_long)?;
        }
        let mut out = Vec::with_capacity(self.shape.record_len().unwrap_or(0));
        out.extend_from_slice(MAGIC);
        out.extend_from_slice(&SCHEMA.to_le_bytes());
        out.extend(dims.iter().flat_map(|n| n.to_le_bytes()));
        for (_, array) in self.arrays() {
            out.extend(array.iter().flat_map(|x| x.to_le_bytes()));
        }
        let sum = checksum(&out);
        out.extend_from_slice(&sum);
        Ok(out)
    }

    /// Reads the record with which `bytes` begin. Returns the episode and the bytes after the record.
    ///
    /// # Errors
    /// [`RlError::EpisodeTruncated`] if the bytes end before the record does. [`RlError::EpisodeCorrupt`] if they are not a
    /// record of this version, or were altered. Also as [`validate`](Self::validate).
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
        let [observations, achieved_goals, desired_goal, actions, facts] = lengths.map(|n| {
            let (array, after) = payload.split_at(n * size_of::<f32>());
            payload = after;
            array.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect::<Vec<f32>>()
        });
        let episode = Self { shape, observations, achieved_goals, desired_goal, actions, facts };
        episode.validate()?;
        Ok((episode, rest))
    }

    fn arrays(&self) -> [(&'static str, &[f32]); 5] {
        [
            ("observations", &self.observations),
            ("achieved_goals", &self.achieved_goals),
            ("desired_goal", &self.desired_goal),
            ("actions", &self.actions),
            ("facts", &self.facts),
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
