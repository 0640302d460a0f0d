//! The replay: a ring of whole episodes.

use crate::{EpisodeData, EpisodeShape, RlError};

/// Episodes of one shape; when full, the oldest makes room for the newest.
#[derive(Clone, Debug)]
pub struct Replay {
    shape: EpisodeShape,
    capacity: usize,
    episodes: Vec<EpisodeData>,
    next: usize,
    n_pushed: u64,
}

impl Replay {
    /// Makes an empty replay of at most `capacity` episodes. Memory is taken as episodes arrive.
    ///
    /// # Errors
    /// [`RlError::Config`] when the capacity, the steps or the sizes of observation, goal or action are 0.
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
        Ok(Self { shape, capacity, episodes: Vec::new(), next: 0, n_pushed: 0 })
    }

    /// Adds an episode, in place of the oldest when the replay is full.
    ///
    /// # Errors
    /// [`RlError::EpisodeShape`] when the episode has another shape, and as [`EpisodeData::validate`]; nothing is stored then.
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
        self.n_pushed += 1;
        Ok(())
    }

    /// Returns the episodes held; the order is the ring's, not that of time.
    pub fn episodes(&self) -> &[EpisodeData] {
        &self.episodes
    }

    /// Returns the episodes held, oldest first.
    pub fn iter_by_age(&self) -> impl Iterator<Item = &EpisodeData> {
        let oldest = if self.episodes.len() < self.capacity { 0 } else { self.next };
        let (newer, older) = self.episodes.split_at(oldest);
        older.iter().chain(newer)
    }

    /// Returns the number of episodes held.
    pub fn len(&self) -> usize {
        self.episodes.len()
    }

    /// Returns whether no episode is held.
    pub fn is_empty(&self) -> bool {
        self.episodes.is_empty()
    }

    /// Returns the largest number of episodes held.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Returns the number of transitions held.
    pub fn n_transitions(&self) -> usize {
        self.len() * self.shape.n_steps
    }

    /// Returns the number of episodes ever pushed.
    pub fn n_pushed(&self) -> u64 {
        self.n_pushed
    }

    /// Returns the shape of the episodes.
    pub fn shape(&self) -> EpisodeShape {
        self.shape
    }
}
