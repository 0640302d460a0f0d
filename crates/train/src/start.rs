//! What a run takes over from the run with which it starts: the networks, and the space in which they act.

use std::path::Path;

use eigenhand_hands::Hand;
use eigenhand_rl::Ddpg;
use eigenhand_sim::GraspTask;
use eigenhand_synergy::{MotionRecord, PostureDatabase};

use crate::action_space::SynergySpace;
use crate::actuators::HandActuators;
use crate::assignment::dimensions;
use crate::checkpoint;
use crate::config::RunConfig;
use crate::control::Control;
use crate::error::TrainError;
use crate::run_dir::{DATABASE, read_config, read_provenance};

/// Copy of the motions in the run directory, so that the run can be resumed without the other.
const MOTIONS: &str = "start.sqlite";

/// What a run starts with.
#[derive(Clone, Debug, Default)]
pub struct Start {
    /// The learner; none for a run that is resumed, whose checkpoints have its own.
    pub learner: Option<Ddpg>,
    /// The motions to which the settled space was fitted in which the networks act; none if they act in none.
    pub motions: Vec<MotionRecord>,
}

impl Start {
    /// Reads the run that a new run's configuration names; none if it names none.
    ///
    /// # Errors
    /// [`TrainError::Option`] for a run of another hand, or with networks that do not fit the configuration;
    /// [`TrainError::NotARun`], and the errors of the run's files.
    pub fn of(
        config: &RunConfig,
        hand: &Hand,
        task: &GraspTask,
        space: Option<&SynergySpace>,
    ) -> Result<Option<Start>, TrainError> {
        if config.from.is_empty() {
            return Ok(None);
        }
        let run = Path::new(&config.from);
        let trained = read_provenance(run)?;
        if trained.hand_digest != hand.digest {
            let (other, name) = (&trained.hand, &hand.manifest.name);
            let reason = if other == name {
                format!("the files of the hand {name} have changed since this run; start without --from")
            } else {
                format!("this run trained the hand {other}, not {name}")
            };
            return Err(TrainError::Option { option: format!("--from {}", run.display()), reason });
        }
        let (counters, networks) = checkpoint::newest_learner(run)?;
        let motions = match Start::kept(run)? {
            Some(motions) => motions,
            None => match counters.settled_at {
                None => Vec::new(),
                Some(episode) => {
                    let mut control = Control::new(&read_config(run)?, HandActuators::of(hand, task));
                    control.add(PostureDatabase::open_existing(run.join(DATABASE))?.motions()?);
                    control.newest(episode).to_vec()
                }
            },
        };
        let mut control = Control::new(config, HandActuators::of(hand, task));
        control.settle_on(0, motions.clone())?;
        let settled = control.outputs(config, hand, task)?;
        let outputs = settled.as_ref().or(space.map(|space| &space.outputs));
        let learner = Ddpg::from_tensors(config.learner.clone(), dimensions(task, outputs), &networks).map_err(|error| {
            TrainError::Option {
                option: format!("--from {}", run.display()),
                reason: format!(
                    "its networks do not fit these settings: {error}; leave lambda, synergy.components, learner.hidden, \
                     learner.critic_layer_norm and the observation (task.observe_*) as they are there"
                ),
            }
        })?;
        Ok(Some(Start { learner: Some(learner.with_fresh_optimisers()), motions }))
    }

    /// Reads the copy in the directory of a resumed run; none for a run that started with no other.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn resume(config: &RunConfig, run: &Path) -> Result<Option<Start>, TrainError> {
        if config.from.is_empty() {
            return Ok(None);
        }
        Ok(Some(Start { learner: None, motions: Start::kept(run)?.unwrap_or_default() }))
    }

    /// Writes the copy into a run directory.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn keep(&self, run: &Path, task: &GraspTask, hand: &Hand) -> Result<(), TrainError> {
        if self.motions.is_empty() {
            return Ok(());
        }
        let actuators = HandActuators::of(hand, task);
        let mut database = PostureDatabase::open(run.join(MOTIONS), &task.posture_joints, &actuators.coordinates)?;
        Ok(database.insert_motions(&self.motions)?)
    }

    fn kept(run: &Path) -> Result<Option<Vec<MotionRecord>>, TrainError> {
        let path = run.join(MOTIONS);
        if !path.is_file() {
            return Ok(None);
        }
        Ok(Some(PostureDatabase::open_existing(path)?.motions()?))
    }
}
