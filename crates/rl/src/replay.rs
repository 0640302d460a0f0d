//! The replay, a ring of whole episodes.

use crate::{EpisodeData, EpisodeShape, RlError};

/// Episodes of one shape. When it is full, each new episode replaces the oldest.
#[derive(Clone, Debug)]
pub struct Replay {
    shape: EpisodeShape,
    capacity: usize,
    episodes: Vec<EpisodeData>,
    next: usize,
}

impl Replay {
    /// Makes an empty replay for at most `capacity` episodes. Each episode allocates its memory when it is pushed.
    ///
    /// # Errors
    /// [`RlError::Config`] if the capacity, the number of steps, or the size of observation, goal or action is 0.
    pub fn new(capacity: usize, shape: EpisodeShape) -> Result<Self, RlError> {
        let sizes = [
            ("capacity", capacity),
            ("n_steps", shape.n_steps),
            ("obs_dim", shape.obs_dim),
            ("goal_dim", shape.goal_dim),
            ("act_dim", shape.act_dim),
        ];
        for (field, n) in sizes {
            if n == 0 {
                return Err(RlError::Config { field, expected: "at least 1", got: n.to_string() });
            }
        }
        Ok(Self { shape, capacity, episodes: Vec::new(), next: 0 })
    }

    /// Adds an episode. It replaces the oldest if the replay is full.
    ///
    /// # Errors
    /// [`RlError::EpisodeShape`] if the episode has another shape. Also as [`EpisodeData::validate`]. After an error, nothing
    /// is stored.
    pub fn push(&mut self, episode: EpisodeData) -> Result<(), RlError> {
        if episode.shape != self.shape {
            return Err(RlError::EpisodeShape { expected: Box::new(self.shape), got: Box::new(episode.shape) });
        }
        episode.validate()?;
        if self.episodes.len() < self.capacity {
            self.episodes.push(episode);
        } else {
            self.episodes[self.next] = episode;
        }
        self.next = (self.next + 1) % self.capacity;
        Ok(())
    }

    /// Returns the stored episodes in the order of the ring, which is not that of time.
    pub fn episodes(&self) -> &[EpisodeData] {
        &self.episodes
    }

    /// Returns the number of stored episodes.
    pub fn len(&self) -> usize {
        self.episodes.len()
    }

    /// Returns whether no episode is stored.
    pub fn is_empty(&self) -> bool {
        self.episodes.is_empty()
    }

    /// Returns the shape of the episodes.
    pub fn shape(&self) -> EpisodeShape {
        self.shape
    }
}
