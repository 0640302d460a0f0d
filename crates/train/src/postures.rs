//! The postures and motions of a run's successes: in the database and in memory, and the synergy of the postures.

use eigenhand_sim::GraspTask;
use eigenhand_synergy::{JointInfo, MotionRecord, PostureDatabase, PostureRecord, Source, Synergy, newest};

use crate::actuators::HandActuators;
use crate::config::{RunConfig, SynergyConfig};
use crate::counters::Counters;
use crate::error::TrainError;
use crate::rollout::Episode;
use crate::run_dir::{DATABASE, RunDirectory};

/// The postures of the successes so far.
pub(crate) struct Postures {
    database: PostureDatabase,
    joints: Vec<JointInfo>,
    /// Those that the policy reached.
    all: Vec<Vec<f64>>,
    config: SynergyConfig,
    lambda: f64,
    seed: u64,
}

impl Postures {
    /// Opens the database of a run. Postures that it holds already are ignored until they are
    /// [restored](Self::restore).
    ///
    /// # Errors
    /// [`TrainError::Synergy`] for the database.
    pub fn open(
        run: &RunDirectory,
        config: &RunConfig,
        task: &GraspTask,
        actuators: &HandActuators,
    ) -> Result<Postures, TrainError> {
        let joints = task.posture_joints.clone();
        let database = PostureDatabase::open(run.file(DATABASE), &joints, &actuators.coordinates)?;
        let RunConfig { synergy, lambda, seed, .. } = config.clone();
        Ok(Postures { database, joints, all: Vec::new(), config: synergy, lambda, seed })
    }

    /// Checks that the database of a run holds what a checkpoint counts. It changes nothing.
    ///
    /// # Errors
    /// [`TrainError::Damaged`] when it holds other postures, [`TrainError::Synergy`] when it cannot be read.
    pub fn check(run: &RunDirectory, counters: &Counters) -> Result<(), TrainError> {
        let Counters { episodes, postures, postures_sha256, .. } = counters;
        let database = PostureDatabase::open_existing(run.file(DATABASE))?;
        database.check_integrity()?;
        let found = database.len_before(*episodes)?;
        let reason = if found != *postures {
            format!("it holds {found} postures up to episode {episodes}, but the checkpoint counts {postures}")
        } else if !postures_sha256.is_empty() && database.digest_before(*episodes)? != *postures_sha256 {
            format!("its rows up to episode {episodes} are not those that the run wrote")
        } else {
            return Ok(());
        };
        Err(TrainError::Damaged {
            path: run.file(DATABASE),
            reason,
            mend: "restore this file, or start a new run with another --out".to_owned(),
        })
    }

    /// Restores the state at a checkpoint, after the first `episodes` episodes, and returns the motions.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn restore(&mut self, episodes: u64) -> Result<Vec<MotionRecord>, TrainError> {
        self.database.truncate_from_episode(episodes)?;
        self.all = self.database.policy_postures()?;
        Ok(self.database.motions()?)
    }

    /// Returns the SHA-256 of all rows.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn sha256(&self) -> Result<String, TrainError> {
        Ok(self.database.digest_before(u64::MAX)?)
    }

    /// Waits until the disk has all that was stored.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn sync(&self) -> Result<(), TrainError> {
        Ok(self.database.sync()?)
    }

    /// Makes the database one file that can be read anywhere.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn finish(&self) -> Result<(), TrainError> {
        Ok(self.database.finish()?)
    }

    /// Stores the postures of the episodes that succeeded, and returns their number. Also stores their motions.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn store(
        &mut self,
        episodes: &[Episode],
        task: &GraspTask,
        motions: &[MotionRecord],
    ) -> Result<u64, TrainError> {
        let successes = episodes.iter().filter(|episode| episode.success && !episode.diverged);
        let records: Vec<PostureRecord> = successes.map(|episode| self.record(episode, task)).collect();
        if !records.is_empty() {
            self.database.insert_all(&records)?;
        }
        if !motions.is_empty() {
            self.database.insert_motions(motions)?;
        }
        let stored = records.len() as u64;
        let of_the_policy = records.into_iter().filter(|record| record.source != Source::Script);
        self.all.extend(of_the_policy.map(|record| record.posture));
        Ok(stored)
    }

    fn record(&self, episode: &Episode, task: &GraspTask) -> PostureRecord {
        let goal = &episode.data.desired_goal;
        PostureRecord {
            posture: episode.posture.clone(),
            object: task.scenes[episode.scene].object.name.to_owned(),
            episode: episode.index,
            lambda: self.lambda,
            seed: self.seed,
            goal: [f64::from(goal[0]), f64::from(goal[1]), f64::from(goal[2])],
            step: episode.data.shape.n_steps as u32,
            source: episode.source,
        }
    }

    /// Computes the synergy of the newest postures; none while they are too few.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn fit(&self) -> Result<Option<Synergy>, TrainError> {
        Ok(Synergy::fit_newest(&self.joints, &self.all, self.config.components, self.config.window)?)
    }

    /// Returns the postures that the synergy covers.
    pub fn newest(&self) -> &[Vec<f64>] {
        newest(&self.all, self.config.window)
    }

    /// Returns the posture's joints.
    pub fn joints(&self) -> &[JointInfo] {
        &self.joints
    }
}
