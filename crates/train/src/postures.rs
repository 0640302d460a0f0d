//! The postures and motions of a run's successes: in the database and in memory, and the synergy of the postures.

use eigenhand_sim::GraspTask;
use eigenhand_synergy::{JointInfo, MotionRecord, PostureDatabase, PostureRecord, Source, Synergy, newest};

use crate::actuators::HandActuators;
use crate::config::{RunConfig, SynergyConfig};
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

    /// Restores the state at a checkpoint: `expected` postures of the first `episodes` episodes. Returns their motions.
    ///
    /// # Errors
    /// [`TrainError::Damaged`] when the database holds fewer or more.
    pub fn restore(
        &mut self,
        run: &RunDirectory,
        episodes: u64,
        expected: u64,
    ) -> Result<Vec<MotionRecord>, TrainError> {
        self.database.truncate_from_episode(episodes)?;
        self.all = self.database.policy_postures()?;
        let found = self.database.len()?;
        if found as u64 == expected {
            return Ok(self.database.motions()?);
        }
        Err(TrainError::Damaged {
            path: run.file(DATABASE),
            reason: format!("it holds {found} postures up to episode {episodes}, but the checkpoint counts {expected}"),
            mend: "restore this file, or start a new run with another --out".to_owned(),
        })
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
