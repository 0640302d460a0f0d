//! The configuration of a run, in layers: default <- preset <- file <- `--set key=value` <- options.
//!
//! This file is the schema. Each of the [`Layers`] is a TOML table that may hold only keys of the default. The combined
//! layers are [checked](RunConfig::validate) and written, fully resolved, into the run directory. Only
//! `presets/default.toml` holds the numbers of the defaults.

use std::path::Path;

pub use eigenhand_rl::ActorChoice;
use eigenhand_rl::{DdpgConfig, ExplorationConfig, HerConfig};
use eigenhand_sim::{PhysicsConfig, RewardConfig, Setting, TaskConfig};
use serde::{Deserialize, Serialize};

use crate::action_space::ActionSpace;
use crate::feedback::{Feedback, Penalty};

mod error;
mod layers;
mod settings;
mod validate;

pub use validate::MOST_EVALUATED;

pub use error::{ConfigError, InvalidSetting};
pub use layers::Layers;
pub(crate) use layers::read_layer;
pub(crate) use settings::parse_settings;
pub use settings::{Settings, differences};

const DEFAULT: &str = include_str!("../presets/default.toml");
const QUICK: &str = include_str!("../presets/quick.toml");
const PAPER: &str = include_str!("../presets/paper.toml");

/// Version of the configuration's keys.
pub const SCHEMA: u32 = 1;

/// A named set of deviations from the default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// The settings that learn best.
    #[default]
    Default,
    /// One object and a small range, for a first try.
    Quick,
    /// The constants of the paper and of OpenAI baselines.
    Paper,
}

impl Preset {
    /// Every preset.
    pub const ALL: [Preset; 3] = [Preset::Default, Preset::Quick, Preset::Paper];

    /// Returns the name for `--preset`.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Default => "default",
            Preset::Quick => "quick",
            Preset::Paper => "paper",
        }
    }

    /// Returns one line that describes the preset.
    pub fn meaning(self) -> &'static str {
        match self {
            Preset::Default => "The settings that learn best",
            Preset::Quick => "One object and a small range: learns in minutes",
            Preset::Paper => "The constants of the paper and of OpenAI baselines",
        }
    }

    pub(super) fn text(self) -> Option<&'static str> {
        match self {
            Preset::Default => None,
            Preset::Quick => Some(QUICK),
            Preset::Paper => Some(PAPER),
        }
    }
}

/// Everything that determines a run's result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunConfig {
    /// Version of these keys.
    pub schema: u32,
    /// Name of the hand, or the path of its plugin directory.
    pub hand: String,
    /// Preset the run started from.
    pub preset: Preset,
    /// Seed of all random numbers.
    pub seed: u64,
    /// How far training confines the policy to its synergy. With 1, the policy ends inside the control synergy, with 0 it stays
    /// free; it is also the weight of `synergy.penalty` (paper, section 2.2).
    pub lambda: f64,
    /// The run whose networks this one starts with; empty: fresh networks.
    pub from: String,
    /// What the policy commands.
    pub action_space: ActionSpace,
    /// Training episodes.
    pub episodes: u64,
    /// Names of the objects, drawn uniformly.
    pub objects: Vec<String>,
    /// Threads that simulate; 0 means one for each core. The same number of threads shares each update of the learner.
    /// The result does not depend on this number.
    pub workers: usize,
    /// Whether event files for TensorBoard are written into the run directory.
    pub tensorboard: bool,
    /// The training loop.
    pub training: TrainingConfig,
    /// Evaluations.
    pub evaluation: EvaluationConfig,
    /// The synergy space and its feedback.
    pub synergy: SynergyConfig,
    /// Success and reward.
    pub reward: RewardConfig,
    /// Episodes of the task.
    pub task: TaskConfig,
    /// Simulation.
    pub physics: PhysicsConfig,
    /// Networks and their updates.
    pub learner: DdpgConfig,
    /// Hindsight.
    pub her: HerConfig,
    /// Noise on training actions.
    pub exploration: ExplorationConfig,
}

/// The training loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingConfig {
    /// Episodes simulated between two rounds of updates.
    pub episodes_per_cycle: usize,
    /// Minibatches for each episode.
    pub updates_per_episode: f64,
    /// First episodes, with random actions; updates begin after them.
    pub warmup_episodes: u64,
    /// If fewer steps than this hold the object (mean of the last [`HELD_WINDOW`] episodes), every other episode is a
    /// scripted grasp; needs `closing` in `hand.toml`.
    pub least_held_steps: f64,
    /// Random actions of the slide are held this many times longer than those of the fingers; at least 1.
    pub slide_hold: f32,
    /// Share of training after which learning rates fall linearly to `final_learning_rate`; 1 means never.
    pub decay_start: f64,
    /// Factor on both learning rates at the end of training.
    pub final_learning_rate: f64,
    /// Shares of training between which the exploration noise falls linearly to `final_noise`.
    pub noise_decay: [f64; 2],
    /// Factor on the noise's standard deviation and on the probability of random actions at the end of training.
    pub final_noise: f64,
    /// Episodes that replay holds.
    pub replay_episodes: usize,
    /// Episodes between two checkpoints.
    pub checkpoint_every: u64,
    /// Number of newest checkpoints that are kept.
    pub checkpoints_kept: usize,
}

/// Episodes over which held steps are averaged.
pub const HELD_WINDOW: usize = 100;

/// Evaluations without exploration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Training episodes between two evaluations.
    pub every: u64,
    /// Episodes of an evaluation during training.
    pub episodes: u64,
    /// Episodes of the final evaluation; no other evaluation uses the same episodes.
    pub final_episodes: u64,
    /// Actor that is evaluated and exported: online, target or average.
    pub actor: ActorChoice,
    /// Number of policies with the best evaluations. They are compared again at the end, and the best becomes the
    /// result. With 0, the last policy becomes the result.
    pub finalists: usize,
    /// Episodes of this comparison, for each of these policies.
    pub selection_episodes: u64,
    /// Objects or sets that only the final evaluation sees, beside those of the training.
    pub other_objects: Vec<String>,
    /// Whether the evaluation at the end also measures success with few numbers.
    pub few_numbers: bool,
}

/// The synergy space and its feedback into the learner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SynergyConfig {
    /// Principal components (paper, section 3.1).
    pub components: usize,
    /// Number of newest postures that the analysis covers; 0 means all.
    pub window: usize,
    /// The feedback starts when the analysis covers more postures than this (paper, section 4).
    pub start_after: usize,
    /// Penalty on the reward of a success.
    pub penalty: Penalty,
    /// The synergy in which the policy acts if `action_space` is `synergy`: a run, an export or a synergy file; otherwise
    /// empty.
    pub file: String,
    /// Newest motions (successes without noise) to whose commands the control synergy is fitted. It is settled once there are
    /// as many.
    pub motions: usize,
    /// Share of training after which the control synergy is settled and the policy begins anew in its numbers; 1: never.
    pub settle: f64,
}

impl RunConfig {
    /// Returns the default configuration.
    ///
    /// # Errors
    /// None in practice: the text is compiled in, and the tests read it.
    pub fn default_preset() -> Result<RunConfig, ConfigError> {
        Layers::new(Preset::Default)?.resolve()
    }

    /// Reads the resolved configuration of a run directory.
    ///
    /// # Errors
    /// [`ConfigError`] names the file and the key.
    pub fn read(path: &Path) -> Result<RunConfig, ConfigError> {
        Layers::of_run(path)?.resolve()
    }

    /// Writes the configuration as TOML.
    ///
    /// # Errors
    /// [`ConfigError::Value`] when a number has no TOML form.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        toml::to_string(self)
            .map_err(|error| ConfigError::Value { origin: "configuration".to_owned(), reason: error.to_string() })
    }

    /// Returns every setting by its dotted key.
    ///
    /// # Errors
    /// As [`RunConfig::to_toml`].
    pub fn settings(&self) -> Result<Settings, ConfigError> {
        settings::parse_settings("configuration", &self.to_toml()?)
    }

    /// Returns the part that determines the grasp task.
    pub fn setting(&self) -> Setting {
        Setting {
            objects: self.objects.clone(),
            task: self.task.clone(),
            physics: self.physics.clone(),
            reward: self.reward.clone(),
        }
    }

    /// Returns the synergy's feedback; it has no synergy yet.
    pub fn feedback(&self) -> Feedback {
        let SynergyConfig { penalty, start_after, .. } = self.synergy;
        Feedback::new(self.lambda, penalty, start_after)
    }

    /// Returns whether training confines the policy to its control synergy.
    pub fn confines(&self) -> bool {
        // A policy that acts in a synergy has a space of its own.
        self.action_space == ActionSpace::Joints && self.lambda > 0.0 && self.synergy.settle < 1.0
    }

    /// Returns the number of threads that simulate.
    pub fn worker_count(&self) -> usize {
        worker_count(self.workers)
    }

    /// Returns the number of threads that share an update.
    pub fn learner_thread_count(&self) -> usize {
        self.worker_count().min(self.learner.most_threads())
    }
}

/// (0, or a number of threads) => the number of threads, where 0 means one for each core.
pub fn worker_count(asked: usize) -> usize {
    match asked {
        0 => std::thread::available_parallelism().map_or(1, |n| n.get()),
        n => n,
    }
}
