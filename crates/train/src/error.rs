//! Errors of a run.

use std::path::PathBuf;

use eigenhand_files::FileError;
use eigenhand_hands::HandError;
use eigenhand_mujoco::MuJoCoError;
use eigenhand_rl::{DdpgConfig, RlError, UpdateStats};
use eigenhand_sim::SimError;
use eigenhand_synergy::SynergyError;

use crate::config::ConfigError;

/// When a learner has diverged, the error suggests its learning rates divided by this.
const SMALLER: f32 = 10.0;

/// Errors of training, evaluation and export.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The configuration is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The hand is wrong or unknown.
    #[error(transparent)]
    Hand(#[from] HandError),
    /// The hand fails the hand contract.
    #[error(
        "{hand} fails the hand contract:\n{faults}\ncorrect the hand (`hands check {hand}` checks and draws it), or train it all the same with --force"
    )]
    HandContract {
        /// Name or directory of the hand.
        hand: String,
        /// The conditions that do not hold, one a line.
        faults: String,
    },
    /// MuJoCo is missing or does not work.
    #[error(transparent)]
    MuJoCo(#[from] MuJoCoError),
    /// The scene or the task is wrong, or a simulation failed.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The learner refused its settings or data.
    #[error(transparent)]
    Rl(#[from] RlError),
    /// The posture database or the synergy failed.
    #[error(transparent)]
    Synergy(#[from] SynergyError),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The synergy in which a policy should act cannot be used.
    #[error("cannot act in the synergy {}: {reason}\ngive the run, the export or the synergy.toml of this hand with --synergy", path.display())]
    ActionSpace {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A run's policy hardly ever succeeds, so its commands have no synergy.
    #[error("the policy of {} succeeded in none of the episodes that show how it moves, so there is no synergy; train longer", run.display())]
    NoMotions {
        /// The run's directory.
        run: PathBuf,
    },
    /// A thread could not be started.
    #[error("cannot start a thread")]
    Thread {
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// The learner's numbers are not finite, or absurd.
    #[error(
        "the learner diverged at update {update}: critic loss {critic_loss}, actor loss {actor_loss}, mean value {q_mean}\n\
         the run's last checkpoint was written before this update. Start a new run with smaller learning rates, such as \
         --set learner.actor_lr={suggested_actor_lr:.0e} --set learner.critic_lr={suggested_critic_lr:.0e}"
    )]
    LearnerDiverged {
        /// Number of the update.
        update: u64,
        /// The critic's loss there.
        critic_loss: f32,
        /// The actor's loss there.
        actor_loss: f32,
        /// Mean value of the batch's actions there.
        q_mean: f32,
        /// A smaller learning rate of the actor.
        suggested_actor_lr: f32,
        /// A smaller learning rate of the critic.
        suggested_critic_lr: f32,
    },
    /// Most episodes diverge.
    #[error(
        "the simulation diverged in {diverged} of the last {of} episodes, most often {place}, with the object {object}\n\
         the run is saved, but it would learn nothing. Look at this joint with `hands check {hand}`: it may need more damping or \
         armature, or its servo a lower stiffness (kp) or a force limit. A smaller simulation step may help too: --set \
         physics.timestep={timestep}"
    )]
    EpisodesDiverge {
        /// Episodes that diverged.
        diverged: usize,
        /// Episodes in all.
        of: usize,
        /// The object with which most did.
        object: String,
        /// Where most did.
        place: String,
        /// Name or directory of the hand.
        hand: String,
        /// A smaller simulation step in s.
        timestep: f64,
    },
    /// The simulation was told to stop.
    #[error("stopped")]
    Stopped,
    /// A simulation thread ended.
    #[error("a simulation thread ended unexpectedly (its message is above); continue the run with --resume")]
    WorkerLost,
    /// A run directory exists already.
    #[error("{} exists already: choose another directory with --out, or continue this run with --resume {}", path.display(), path.display())]
    RunExists {
        /// The directory.
        path: PathBuf,
    },
    /// A directory is not a run.
    #[error("{} is not a run directory: {reason}", path.display())]
    NotARun {
        /// The directory.
        path: PathBuf,
        /// The part that is missing.
        reason: String,
    },
    /// A run directory is not where it was.
    #[error(
        "{} was moved or removed while the run trained in it, so the run has stopped without another checkpoint\nif you have moved it, `train --resume` with its new place continues from the newest checkpoint", path.display()
    )]
    Moved {
        /// Where it was.
        path: PathBuf,
    },
    /// The configuration of a run is not the one with which it began.
    #[error(
        "{} has changed since the run began: {key} was {before}, and is now {now}\nput it back to continue the run, or start a new run with another --out", path.display()
    )]
    ConfigChanged {
        /// The file.
        path: PathBuf,
        /// The first key that differs.
        key: String,
        /// Its value when the run began.
        before: String,
        /// Its value now.
        now: String,
    },
    /// A file of a run is damaged.
    #[error("{} is damaged: {reason}\n{mend}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The fault in it.
        reason: String,
        /// The user's next step.
        mend: String,
    },
    /// Another process trains in the run directory.
    #[error("{} is in use by another process: wait until that process ends, or stop it", path.display())]
    Locked {
        /// The directory.
        path: PathBuf,
    },
    /// No hand was named.
    #[error(
        "no hand is named: add --hand NAME, or a line hand = \"NAME\" to the configuration file; hands found: {known}"
    )]
    NoHand {
        /// Names of the hands that were found.
        known: String,
    },
    /// An option does not fit the others, or the run.
    #[error("{option}: {reason}")]
    Option {
        /// The option.
        option: String,
        /// The conflict, and the next step.
        reason: String,
    },
    /// The hand's files have changed since the run began.
    #[error(
        "the hand {hand} has changed since the run {} began: the digest of its files was {expected}, and is now {found}\nrestore these files to continue the run, or start a new run with another --out", run.display()
    )]
    HandChanged {
        /// Name of the hand.
        hand: String,
        /// The run's directory.
        run: PathBuf,
        /// Digest in the run's provenance.
        expected: String,
        /// Digest of the hand's files now.
        found: String,
    },
    /// A run in the directory has other settings than this reproduction.
    #[error("{} was made with other settings: {differences}\nchoose another directory with --out, or give the settings of this run", run.display())]
    OtherSettings {
        /// The run that differs.
        run: PathBuf,
        /// Keys with both values.
        differences: String,
    },
    /// An export would overwrite other files in a directory.
    #[error("{} is not empty and holds no earlier export: choose another directory with --out", path.display())]
    ExportExists {
        /// The directory.
        path: PathBuf,
    },
    /// Data cannot be written in a file's format.
    #[error("cannot write {}: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
}

impl TrainError {
    /// (number of the update, its statistics, settings of the learner) => the error of a diverged learner
    pub(crate) fn diverged(update: u64, stats: &UpdateStats, learner: &DdpgConfig) -> TrainError {
        TrainError::LearnerDiverged {
            update,
            critic_loss: stats.critic_loss,
            actor_loss: stats.actor_loss,
            q_mean: stats.q_mean,
            suggested_actor_lr: learner.actor_lr / SMALLER,
            suggested_critic_lr: learner.critic_lr / SMALLER,
        }
    }

    /// Tells whether the command line is wrong; such an error has an exit status of its own.
    pub fn is_usage(&self) -> bool {
        matches!(
            self,
            TrainError::Config(_)
                | TrainError::NoHand { .. }
                | TrainError::Option { .. }
                | TrainError::RunExists { .. }
                | TrainError::OtherSettings { .. }
                | TrainError::ExportExists { .. }
                | TrainError::Hand(HandError::UnknownHand { .. } | HandError::NoPluginDirectory { .. })
                | TrainError::Sim(SimError::UnknownObject { .. })
        )
    }
}
