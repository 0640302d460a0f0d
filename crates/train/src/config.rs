//! The configuration of a run, in layers: default <- preset <- file <- `--set key=value`.
//!
//! Every layer is a TOML table that may hold only keys of the default; the sum is read into
//! [`RunConfig`] and written, fully resolved, into the run directory.

use std::path::{Path, PathBuf};

use eigenhand_rl::{DdpgConfig, ExplorationConfig, HerConfig};
use eigenhand_sim::{PhysicsConfig, RewardConfig, TaskConfig};
use eigenhand_synergy::{PenaltyConfig, PenaltyForm};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::settings;

const DEFAULT: &str = include_str!("presets/default.toml");
const QUICK: &str = include_str!("presets/quick.toml");
const PAPER: &str = include_str!("presets/paper.toml");

/// Version of the configuration's keys.
pub const SCHEMA: u32 = 1;
/// Largest weight of a feedback, which single precision squares without overflow.
const LARGEST_WEIGHT: f64 = 1e6;

/// A named set of deviations from the default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// The settings that learn best.
    #[default]
    Default,
    /// One object and a small range: what a newcomer tries.
    Quick,
    /// The constants of the paper and of OpenAI baselines.
    Paper,
}

impl Preset {
    /// Returns the name as `--preset` takes it.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Default => "default",
            Preset::Quick => "quick",
            Preset::Paper => "paper",
        }
    }

    fn text(self) -> Option<&'static str> {
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
    /// Weight of the synergy's feedback into the learner; in the reward that of the approximation error (paper, section 2.2).
    pub lambda: f64,
    /// Training episodes.
    pub episodes: u64,
    /// Names of the objects, drawn uniformly.
    pub objects: Vec<String>,
    /// Threads that simulate; 0 means one for each core. As many share each update of the learner. The result does not
    /// depend on it.
    pub workers: usize,
    /// Whether the run directory gets event files for TensorBoard.
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
    /// First episodes, which act at random; no update before them.
    pub warmup_episodes: u64,
    /// Mean number of an episode's steps at which an object is held off the plane, over the last [`HELD_WINDOW`] episodes,
    /// below which every second episode of a hand that says what closes it attempts a grasp.
    pub least_held_steps: f64,
    /// Factor on the time that random actions of the slide are held, against those of the fingers; at least 1.
    pub slide_hold: f32,
    /// Networks that act in training episodes: online, target or average.
    pub rollout_actor: ActorChoice,
    /// Share of training after which learning rates fall linearly to `final_learning_rate`; 1 is never.
    pub decay_start: f64,
    /// Factor on both learning rates at the end of training.
    pub final_learning_rate: f64,
    /// Shares of training between which the exploration noise falls linearly to `final_noise`.
    pub noise_decay: [f64; 2],
    /// Factor on the noise's standard deviation and on the probability of random actions in the end.
    pub final_noise: f64,
    /// Episodes that replay holds.
    pub replay_episodes: usize,
    /// Episodes between two checkpoints.
    pub checkpoint_every: u64,
    /// Checkpoints kept.
    pub checkpoints_kept: usize,
}

/// Episodes over which held steps are averaged.
pub const HELD_WINDOW: usize = 100;

impl TrainingConfig {
    /// (episode, mean number of steps at which an object was held in the last ones) => whether it attempts a grasp: after
    /// warm-up and while objects are held seldom, every second one.
    pub fn attempts(&self, episode: u64, held_steps: f64) -> bool {
        episode >= self.warmup_episodes && held_steps < self.least_held_steps && episode % 2 == 1
    }

    /// (share of training that is done) => the factor on the learning rates
    pub fn learning_rate_factor(&self, done: f64) -> f64 {
        fall(done, [self.decay_start, 1.0], self.final_learning_rate)
    }

    /// (share of training that is done) => the factor on the exploration noise
    pub fn noise_factor(&self, done: f64) -> f64 {
        fall(done, self.noise_decay, self.final_noise)
    }
}

/// Falls linearly from 1 to `last` between two shares of training.
fn fall(done: f64, [from, to]: [f64; 2], last: f64) -> f64 {
    if done >= to { last } else { 1.0 - (1.0 - last) * ((done - from) / (to - from)).max(0.0) }
}

/// Which of the learner's actors acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ActorChoice {
    /// The one that is trained.
    Online,
    /// The target that follows it.
    Target,
    /// Its average over many updates.
    Average,
}

/// Evaluations without exploration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Training episodes between two evaluations.
    pub every: u64,
    /// Episodes of an evaluation during training.
    pub episodes: u64,
    /// Episodes of the final evaluation, on seeds of its own.
    pub final_episodes: u64,
    /// Networks that act: online, target or average.
    pub actor: ActorChoice,
    /// Policies of the best evaluations that are compared again at the end, where the best of them becomes the result;
    /// 0 takes the last policy instead.
    pub finalists: usize,
    /// Episodes of that comparison, for each finalist.
    pub selection_episodes: u64,
}

/// The synergy space and its feedback into the learner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SynergyConfig {
    /// Principal components. Default 5 (paper, section 3.1).
    pub components: usize,
    /// Newest postures that the analysis covers; 0 is all.
    pub window: usize,
    /// There is no feedback until the analysis covers more postures than this. Default 100 (paper, section 4).
    pub start_after: usize,
    /// Form of the penalty on the reward.
    pub penalty: PenaltyForm,
    /// Weight, times lambda, of the squared distance from an action's command to those of the synergy, in the actor's
    /// loss for transitions that succeed, in 1/rad^2.
    pub command_weight: f64,
}

/// Errors of a configuration.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// A file could not be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A layer is not TOML.
    #[error("{origin}: {reason}")]
    Syntax {
        /// File or option.
        origin: String,
        /// Position and reason.
        reason: String,
    },
    /// A key does not exist.
    #[error("{origin}: unknown key {key:?}{}", nearest.as_ref().map_or_else(String::new, |near| format!("; did you mean {near:?}?")))]
    UnknownKey {
        /// File or option.
        origin: String,
        /// Dotted key.
        key: String,
        /// Nearest key that exists.
        nearest: Option<String>,
    },
    /// A value has the wrong type or is out of range.
    #[error("{origin}: {reason}")]
    Value {
        /// File, option, or the layers' sum.
        origin: String,
        /// What is expected and what was given.
        reason: String,
    },
}

/// Layers of configuration, each checked against the keys of the default as it is added.
#[derive(Clone, Debug)]
pub struct Layers {
    merged: Table,
    origins: Vec<String>,
}

impl Layers {
    /// Starts from the default and a preset.
    ///
    /// # Errors
    /// None in a build whose tests pass: the texts are compiled in.
    pub fn new(preset: Preset) -> Result<Layers, ConfigError> {
        let merged = parse("the default configuration", DEFAULT)?;
        let mut layers = Layers { merged, origins: Vec::new() };
        if let Some(text) = preset.text() {
            let origin = format!("preset {}", preset.name());
            layers.add(&origin, parse(&origin, text)?)?;
        }
        layers.set("preset", Value::String(preset.name().to_owned()), "--preset")?;
        Ok(layers)
    }

    /// Starts from a resolved configuration, as a run directory holds it.
    ///
    /// # Errors
    /// [`ConfigError`] names the file and the key, also one that it lacks: a run goes on as it began, whatever the
    /// defaults have become.
    pub fn of_run(path: &Path) -> Result<Layers, ConfigError> {
        let mut layers = Layers::new(Preset::Default)?;
        let required = RunConfig::settings(&layers.resolve()?)?;
        layers.add_file(path)?;
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        let origin = path.display().to_string();
        let written = settings::parse(&origin, &text)?;
        let replaced = |key: &str| WHOLE.iter().any(|whole| key.starts_with(whole));
        match required.into_keys().find(|key| !written.contains_key(key) && !replaced(key)) {
            Some(key) => Err(ConfigError::Value {
                origin,
                reason: format!("{key} is absent: another version wrote it; use that version, or train again"),
            }),
            None => Ok(layers),
        }
    }

    /// Adds a file.
    ///
    /// # Errors
    /// [`ConfigError`] names the file and the key.
    pub fn add_file(&mut self, path: &Path) -> Result<(), ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        let origin = path.display().to_string();
        self.add(&origin, parse(&origin, &text)?)
    }

    /// Adds a `key=value` with a dotted key; the value is TOML, or text when it is not.
    ///
    /// # Errors
    /// [`ConfigError`] names the key.
    pub fn add_assignment(&mut self, assignment: &str) -> Result<(), ConfigError> {
        let Some((key, value)) = assignment.split_once('=') else {
            return Err(ConfigError::Syntax {
                origin: format!("--set {assignment}"),
                reason: "expected key=value, such as --set learner.gamma=0.95".to_owned(),
            });
        };
        let (key, value) = (key.trim(), value.trim());
        let parsed = format!("value = {value}")
            .parse::<Table>()
            .ok()
            .and_then(|mut table| table.remove("value"))
            .unwrap_or_else(|| Value::String(value.to_owned()));
        self.set(key, parsed, &format!("--set {assignment}"))
    }

    /// Sets one dotted key; `origin` is the option that an error names.
    ///
    /// # Errors
    /// [`ConfigError`] names the option and the key.
    pub fn set(&mut self, key: &str, value: impl Into<Value>, origin: &str) -> Result<(), ConfigError> {
        let mut value = value.into();
        for part in key.rsplit('.') {
            let mut table = Table::new();
            table.insert(part.to_owned(), value);
            value = Value::Table(table);
        }
        match value {
            Value::Table(table) => self.add(origin, table),
            _ => Ok(()),
        }
    }

    /// Reads the sum of the layers.
    ///
    /// # Errors
    /// [`ConfigError::Value`] when a value has the wrong type or is out of range.
    pub fn resolve(&self) -> Result<RunConfig, ConfigError> {
        let origin = self.origins.last().cloned().unwrap_or_else(|| "the default configuration".to_owned());
        let config: RunConfig = Value::Table(self.merged.clone()).try_into().map_err(|error: toml::de::Error| {
            ConfigError::Value { origin: origin.clone(), reason: error.to_string() }
        })?;
        config.validate()?;
        Ok(config)
    }

    fn add(&mut self, origin: &str, layer: Table) -> Result<(), ConfigError> {
        merge(&mut self.merged, layer, "", origin)?;
        // A value of the wrong type is reported with the layer that brought it.
        if let Err(error) = Value::Table(self.merged.clone()).try_into::<RunConfig>() {
            return Err(ConfigError::Value { origin: origin.to_owned(), reason: error.to_string().trim().to_owned() });
        }
        self.origins.push(origin.to_owned());
        Ok(())
    }
}

impl RunConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// [`ConfigError::Value`] names the first key that is out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let value = |reason: String| ConfigError::Value { origin: "configuration".to_owned(), reason };
        let expect = |good: bool, key: &str, expected: &str, got: String| {
            if good { Ok(()) } else { Err(value(format!("{key} = {got} is not allowed: expected {expected}"))) }
        };
        let share =
            |key: &str, got: f64| expect((0.0..=1.0).contains(&got), key, "a number from 0 to 1", got.to_string());
        let positive = |key: &str, got: u64| expect(got > 0, key, "a whole number above 0", got.to_string());
        expect(self.schema == SCHEMA, "schema", &SCHEMA.to_string(), self.schema.to_string())?;
        expect(
            self.lambda >= 0.0 && self.lambda.is_finite(),
            "lambda",
            "a number of at least 0",
            self.lambda.to_string(),
        )?;
        expect(!self.objects.is_empty(), "objects", "at least one object", "[]".to_owned())?;
        expect(self.workers <= 1024, "workers", "at most 1024", self.workers.to_string())?;
        positive("episodes", self.episodes)?;
        let t = &self.training;
        positive("training.episodes_per_cycle", t.episodes_per_cycle as u64)?;
        positive("training.replay_episodes", t.replay_episodes as u64)?;
        positive("training.checkpoint_every", t.checkpoint_every)?;
        positive("training.checkpoints_kept", t.checkpoints_kept as u64)?;
        expect(
            t.updates_per_episode >= 0.0 && t.updates_per_episode <= 1e6,
            "training.updates_per_episode",
            "a number from 0 to 1e6",
            t.updates_per_episode.to_string(),
        )?;
        expect(
            t.slide_hold >= 1.0 && t.slide_hold.is_finite(),
            "training.slide_hold",
            "a number of at least 1",
            t.slide_hold.to_string(),
        )?;
        share("training.decay_start", t.decay_start)?;
        share("training.final_learning_rate", t.final_learning_rate)?;
        share("training.final_noise", t.final_noise)?;
        let [from, to] = t.noise_decay;
        expect(
            (0.0..=1.0).contains(&from) && (from..=1.0).contains(&to),
            "training.noise_decay",
            "two rising numbers of 0 to 1",
            format!("{:?}", t.noise_decay),
        )?;
        positive("evaluation.every", self.evaluation.every)?;
        positive("evaluation.episodes", self.evaluation.episodes)?;
        expect(
            self.evaluation.finalists <= 100,
            "evaluation.finalists",
            "at most 100",
            self.evaluation.finalists.to_string(),
        )?;
        positive("evaluation.selection_episodes", self.evaluation.selection_episodes)?;
        positive("evaluation.final_episodes", self.evaluation.final_episodes)?;
        let synergy = &self.synergy;
        positive("synergy.components", synergy.components as u64)?;
        let least = synergy.components.max(synergy.start_after);
        expect(
            synergy.window == 0 || synergy.window > least,
            "synergy.window",
            &format!("0 or a number above {least}, as synergy.components and synergy.start_after need"),
            synergy.window.to_string(),
        )?;
        let weight = |key: &str, got: f64| {
            expect((0.0..=LARGEST_WEIGHT).contains(&got), key, "a number from 0 to 1e6", got.to_string())
        };
        weight("lambda", self.lambda)?;
        weight("synergy.command_weight", synergy.command_weight)?;
        expect(
            synergy.command_weight == 0.0 || synergy.penalty != PenaltyForm::Literal {},
            "synergy.command_weight",
            "0 beside a literal penalty, which can make a success earn less than a failure",
            synergy.command_weight.to_string(),
        )?;
        self.penalty()
            .validate(self.reward.success, self.reward.failure)
            .map_err(|error| value(format!("synergy.penalty: {error}")))?;
        self.learner.validate().map_err(|error| value(format!("learner: {error}")))?;
        self.her.validate().map_err(|error| value(format!("her: {error}")))?;
        self.exploration
            .validate(self.exploration.hold_scale.len())
            .map_err(|error| value(format!("exploration: {error}")))?;
        self.task.validate().map_err(|error| value(error.to_string()))?;
        self.physics.validate().map_err(|error| value(error.to_string()))?;
        self.reward.validate().map_err(|error| value(error.to_string()))
    }

    /// Returns the penalty's settings.
    pub fn penalty(&self) -> PenaltyConfig {
        PenaltyConfig { lambda: self.lambda, form: self.synergy.penalty, start_after: self.synergy.start_after }
    }

    /// Returns the number of threads that simulate.
    pub fn worker_count(&self) -> usize {
        worker_count(self.workers)
    }

    /// Returns the number of threads that share an update.
    pub fn learner_thread_count(&self) -> usize {
        self.worker_count().min(self.learner.most_threads())
    }

    /// Writes the configuration as TOML.
    ///
    /// # Errors
    /// [`ConfigError::Value`] when a number has no TOML form.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        toml::to_string(self)
            .map_err(|error| ConfigError::Value { origin: "configuration".to_owned(), reason: error.to_string() })
    }

    /// Reads a resolved configuration, as a run directory holds it.
    ///
    /// # Errors
    /// [`ConfigError`] names the file and the key.
    pub fn read(path: &Path) -> Result<RunConfig, ConfigError> {
        Layers::of_run(path)?.resolve()
    }
}

/// (0, or a number of threads) => the number of threads, where 0 means one for each core.
pub fn worker_count(asked: usize) -> usize {
    match asked {
        0 => std::thread::available_parallelism().map_or(1, |n| n.get()),
        n => n,
    }
}

fn parse(origin: &str, text: &str) -> Result<Table, ConfigError> {
    text.parse()
        .map_err(|error: toml::de::Error| ConfigError::Syntax { origin: origin.to_owned(), reason: error.to_string() })
}

/// Tables whose keys depend on a `kind` and replace one another as a whole.
const WHOLE: [&str; 1] = ["synergy.penalty"];

fn merge(base: &mut Table, layer: Table, prefix: &str, origin: &str) -> Result<(), ConfigError> {
    for (key, value) in layer {
        let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match (base.get_mut(&key), value) {
            (None, _) => {
                let nearest = base
                    .keys()
                    .map(|known| (strsim::jaro_winkler(known, &key), known))
                    .filter(|(score, _)| *score > 0.7)
                    .max_by(|a, b| a.0.total_cmp(&b.0))
                    .map(|(_, known)| if prefix.is_empty() { known.clone() } else { format!("{prefix}.{known}") });
                return Err(ConfigError::UnknownKey { origin: origin.to_owned(), key: path, nearest });
            }
            (Some(Value::Table(inner)), Value::Table(layer)) if !WHOLE.contains(&path.as_str()) => {
                merge(inner, layer, &path, origin)?;
            }
            // TOML writes 1 where a float is meant.
            (Some(slot @ Value::Float(_)), Value::Integer(whole)) => *slot = Value::Float(whole as f64),
            (Some(slot), value) => *slot = value,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn default() -> Layers {
        Layers::new(Preset::Default).expect("compiled in")
    }

    #[test]
    fn every_second_episode_after_warmup_is_an_attempt_while_little_is_held() {
        let of = |preset| Layers::new(preset).and_then(|l| l.resolve()).expect("compiled in").training;
        let training = TrainingConfig { warmup_episodes: 10, least_held_steps: 5.0, ..of(Preset::Default) };
        assert!((0..10).all(|episode| !training.attempts(episode, 0.0)));
        assert!((10..20).all(|episode| !training.attempts(episode, 5.0)));
        assert_eq!((10..20).filter(|&episode| training.attempts(episode, 4.0)).count(), 5);
        assert_eq!(of(Preset::Paper).least_held_steps, 0.0);
    }

    #[test]
    fn every_preset_resolves_and_survives_writing() {
        for preset in [Preset::Default, Preset::Quick, Preset::Paper] {
            let config = Layers::new(preset).and_then(|l| l.resolve()).expect("compiled in");
            assert_eq!(config.preset, preset);
            let text = config.to_toml().expect("TOML");
            let directory = tempfile::tempdir().expect("a directory");
            let path = directory.path().join("config.toml");
            std::fs::write(&path, text).expect("writable");
            assert_eq!(RunConfig::read(&path).expect("its own text"), config);
        }
    }

    #[test]
    fn an_unknown_key_is_answered_with_origin_and_nearest() {
        let error = default().add_assignment("learner.gama=0.9").expect_err("no such key");
        assert_eq!(
            error.to_string(),
            "--set learner.gama=0.9: unknown key \"learner.gama\"; did you mean \"learner.gamma\"?"
        );
        let error = default().add_assignment("lamda=1").expect_err("no such key");
        assert!(error.to_string().contains("\"lambda\""), "{error}");
    }

    #[test]
    fn layers_override_in_order() {
        let mut layers = Layers::new(Preset::Quick).expect("compiled in");
        layers.add_assignment("episodes = 7").expect("known");
        layers.add_assignment("lambda=1").expect("an integer is a float");
        layers.add_assignment("objects=[\"cube\", \"disc\"]").expect("known");
        let config = layers.resolve().expect("valid");
        assert_eq!((config.episodes, config.lambda), (7, 1.0));
        assert_eq!(config.objects, ["cube", "disc"]);
    }

    #[test]
    fn rates_and_noise_fall_between_two_shares_of_training() {
        for (done, expected) in [(0.0, 1.0), (0.6, 1.0), (0.75, 0.6), (0.9, 0.2), (1.0, 0.2)] {
            assert!((fall(done, [0.6, 0.9], 0.2) - expected).abs() < 1e-12, "{done}");
        }
        assert_eq!([0.0, 0.999, 1.0].map(|done| fall(done, [1.0, 1.0], 0.2)), [1.0, 1.0, 0.2]);
        let training = default().resolve().expect("compiled in").training;
        assert_eq!(training.noise_factor(1.0), training.final_noise);
        assert_eq!(training.learning_rate_factor(training.decay_start), 1.0);
    }

    #[test]
    fn a_runs_configuration_is_complete() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("config.toml");
        let text = default().resolve().and_then(|config| config.to_toml()).expect("compiled in");
        let without: Vec<&str> = text.lines().filter(|line| !line.starts_with("window")).collect();
        assert!(without.len() < text.lines().count());
        std::fs::write(&path, without.join("\n")).expect("writable");
        let message = RunConfig::read(&path).expect_err("incomplete").to_string();
        assert!(message.contains("synergy.window is absent"), "{message}");
    }

    #[test]
    fn values_are_checked() {
        for (assignment, part) in [
            ("lambda=-1", "lambda = -1"),
            ("objects=[]", "objects"),
            ("task.goal_height=[0.2, 0.1]", "task.goal_height"),
            ("physics.timestep=0", "physics.timestep"),
            ("learner.gamma=2", "gamma"),
            ("lambda=1e300", "lambda"),
            ("synergy.command_weight=inf", "synergy.command_weight"),
            ("synergy.penalty={ kind = \"literal\" }", "synergy.command_weight"),
            ("synergy.window=100", "synergy.window"),
            ("training.noise_decay=[0.9, 0.6]", "training.noise_decay"),
            ("training.final_noise=2", "training.final_noise"),
        ] {
            let mut layers = default();
            layers.add_assignment(assignment).expect("known");
            let message = layers.resolve().expect_err(assignment).to_string();
            assert!(message.contains(part), "{message}");
        }
        let message = default().add_assignment("seed=abc").expect_err("not a number").to_string();
        assert!(message.contains("--set seed=abc") && message.contains("u64"), "{message}");
    }
}
