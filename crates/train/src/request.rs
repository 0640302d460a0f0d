//! Requests for a new or a resumed run.
//!
//! Every fault of a request is found before a run directory is made.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use eigenhand_files::write_atomically;
use eigenhand_hands::{Hand, Registry, ScriptedGrasps, SearchPath};
use eigenhand_mujoco::MuJoCo;
use serde::Serialize;
use toml::Value;

use crate::action_space::SynergySpace;
use crate::assignment::Assignment;
use crate::config::{ConfigError, Layers, Preset, RunConfig, parse_settings, read_layer};
use crate::error::TrainError;
use crate::finished::FinishedRun;
use crate::hands::{check_contract, check_digest, hand_named};
use crate::logging::{Logged, RunLog};
use crate::progress::Progress;
use crate::provenance::Provenance;
use crate::run_dir::{CONFIG, RunDirectory, read_provenance};
use crate::summary::Summary;
use crate::task::{other_task_of, task_of};
use crate::trainer::Trainer;

/// Request for a new run. A field that is absent keeps the value of the layer below.
#[derive(Clone, Debug, Default)]
pub struct NewRun {
    /// Name or directory of the hand.
    pub hand: Option<String>,
    /// Whether a request that names no hand means the hand of the default configuration. Otherwise it is
    /// [`TrainError::NoHand`].
    pub default_hand: bool,
    /// Preset; if absent, the preset in the file, or else the default.
    pub preset: Option<Preset>,
    /// Configuration file.
    pub file: Option<PathBuf>,
    /// Assignments `key=value` with dotted keys.
    pub assignments: Vec<String>,
    /// How far the policy is confined to its synergy.
    pub lambda: Option<f64>,
    /// Seed.
    pub seed: Option<u64>,
    /// Training episodes.
    pub episodes: Option<u64>,
    /// Names of the objects.
    pub objects: Option<Vec<String>>,
    /// Threads that simulate.
    pub workers: Option<usize>,
    /// Whether event files for TensorBoard are written.
    pub tensorboard: Option<bool>,
    /// The run directory; if absent, a new one under `runs/`.
    pub out: Option<PathBuf>,
    /// Whether a hand is trained that fails the hand contract.
    pub force: bool,
    /// Places that are searched for hands.
    pub hands: SearchPath,
}

/// Request to continue a run.
#[derive(Clone, Debug, Default)]
pub struct ResumedRun {
    /// The run directory.
    pub run: PathBuf,
    /// Training episodes in all; if absent, as before.
    pub episodes: Option<u64>,
    /// Threads that simulate; if absent, as before.
    pub workers: Option<usize>,
    /// Whether event files for TensorBoard are written; if absent, as before.
    pub tensorboard: Option<bool>,
    /// Places that are searched for hands.
    pub hands: SearchPath,
}

/// Overview of a run before it starts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// The run directory.
    pub run: PathBuf,
    /// Name of the hand.
    pub hand: String,
    /// Joints of its posture.
    pub n_joints: usize,
    /// Its actuators.
    pub n_actuators: usize,
    /// Its fingers.
    pub n_fingers: usize,
    /// What became of scripted grasps when the hand was made, if that is known.
    pub scripted_grasps: Option<ScriptedGrasps>,
    /// Names of the objects.
    pub objects: Vec<String>,
    /// Preset.
    pub preset: Preset,
    /// How far the policy is confined to its synergy.
    pub lambda: f64,
    /// Seed.
    pub seed: u64,
    /// Training episodes in all.
    pub episodes: u64,
    /// Components of its synergy.
    pub components: usize,
    /// Number of newest postures that the synergy covers; 0 means all.
    pub window: usize,
    /// Training episodes that are done already.
    pub episodes_done: u64,
    /// Threads that simulate.
    pub workers: usize,
    /// Version of MuJoCo.
    pub mujoco_version: String,
    /// File or soname that MuJoCo was loaded from.
    pub mujoco_library: String,
}

/// A run that is ready to train.
pub struct Launch {
    plan: Plan,
    work: Work,
}

/// What is left to do.
enum Work {
    /// The log is written while it lives.
    Training(Box<Trainer>, #[expect(dead_code, reason = "held")] RunLog),
    /// Nothing: these are the results.
    Complete(Box<Summary>),
}

impl Launch {
    /// Prepares a new run in a directory of its own.
    ///
    /// # Errors
    /// The first fault of the configuration, the hand, the library or the directory. [`TrainError::HandContract`] for a
    /// hand that fails the hand contract, unless the request forces it.
    pub fn start(request: &NewRun) -> Result<Launch, TrainError> {
        let (config, hand) = resolve(request)?;
        let library = MuJoCo::load()?;
        let task = task_of(&config, &hand, &library)?;
        if !request.force {
            check_contract(&config.hand, &hand, &library)?;
        }
        let other_task = other_task_of(&config, &hand, &library, &task)?;
        let space = SynergySpace::of(&config, &hand, &task)?;
        let provenance = Provenance::collect(&hand, &library);
        let run = RunDirectory::create(request.out.as_deref(), &config, &provenance)?;
        if let Some(space) = &space {
            space.keep(run.path())?;
        }
        let log = RunLog::start(run.path())?;
        let mut plan = Plan::of(&config, &hand, &library, run.path());
        let trainer = Trainer::create(Assignment { config, provenance, hand, task, other_task, space, run })?;
        plan.episodes_done = trainer.counters.episodes;
        Ok(Launch { plan, work: Work::Training(Box::new(trainer), log) })
    }

    /// Prepares to continue a run from its newest checkpoint.
    ///
    /// # Errors
    /// [`TrainError::NotARun`], [`TrainError::Locked`], [`TrainError::HandChanged`] and [`TrainError::Damaged`]. With
    /// these errors no file has been changed.
    pub fn resume(request: &ResumedRun) -> Result<Launch, TrainError> {
        let run = RunDirectory::open(&request.run)?;
        let mut stored = run.config()?;
        let provenance = read_provenance(run.path())?;
        let hand = hand_named(&stored.hand, &request.hands)?;
        check_digest(run.path(), &hand, &provenance)?;
        stored.episodes = request.episodes.unwrap_or(stored.episodes);
        stored.tensorboard = request.tensorboard.unwrap_or(stored.tensorboard);
        let mut config = stored.clone();
        config.workers = request.workers.unwrap_or(config.workers);
        config.validate().map_err(|invalid| TrainError::Option {
            option: format!("--{}", invalid.key),
            reason: invalid.to_string(),
        })?;
        let library = MuJoCo::load()?;
        let results = Summary::read(run.path())?;
        // Results that cannot be read are written again.
        let are_sound =
            || FinishedRun::open(&request.run, &request.hands, &[]).and_then(|run| run.control_synergy()).is_ok();
        let complete = |results: &Summary| results.is_complete() && results.episodes == config.episodes && are_sound();
        if let Some(summary) = results.filter(complete) {
            let plan = Plan { episodes_done: summary.episodes, ..Plan::of(&config, &hand, &library, run.path()) };
            return Ok(Launch { plan, work: Work::Complete(Box::new(summary)) });
        }
        let task = task_of(&config, &hand, &library)?;
        let other_task = other_task_of(&config, &hand, &library, &task)?;
        let log = RunLog::start(run.path())?;
        let mut plan = Plan::of(&config, &hand, &library, run.path());
        let space = SynergySpace::resume(run.path(), &config, &hand, &task)?;
        let trainer = Trainer::resume(Assignment { config, provenance, hand, task, other_task, space, run })?;
        plan.episodes_done = trainer.counters.episodes;
        if plan.episodes < plan.episodes_done {
            return Err(TrainError::Option {
                option: format!("--episodes {}", plan.episodes),
                reason: format!("the run has trained {} episodes already; give a larger number", plan.episodes_done),
            });
        }
        if request.episodes.is_some() || request.tensorboard.is_some() {
            write_atomically(&request.run.join(CONFIG), stored.to_toml()?.as_bytes())?;
        }
        Ok(Launch { plan, work: Work::Training(Box::new(trainer), log) })
    }

    /// Returns the overview of the run.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Trains, evaluates and exports. A run that is complete stays as it is, if its results can be read.
    ///
    /// # Errors
    /// As [`Trainer::run`]; the error is also written to the run's log.
    pub fn run(self, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary, TrainError> {
        let Plan { hand, episodes, episodes_done, workers, mujoco_version, .. } = &self.plan;
        let trainer = match self.work {
            Work::Training(trainer, _) => trainer,
            Work::Complete(summary) => {
                progress.finish();
                progress.note("the run is complete, and stays as it is; more --episodes continue it");
                return Ok(*summary);
            }
        };
        tracing::info!(
            "training {hand}: episodes {episodes_done} to {episodes}, {workers} workers, MuJoCo {mujoco_version}"
        );
        let outcome = trainer.run(stop, &mut Logged::new(&self.plan.run, progress));
        match &outcome {
            Ok(summary) => tracing::info!(
                "stopped by {}: {} episodes, success {}, {} postures, {} diverged, {} full buffers",
                summary.stopped_by.name(),
                summary.episodes,
                summary
                    .success_rate
                    .map_or_else(|| "not evaluated".to_owned(), |rate| format!("{:.1} %", 100.0 * rate)),
                summary.n_postures,
                summary.diverged_episodes,
                summary.buffer_warnings
            ),
            Err(error) => tracing::error!("{error}"),
        }
        outcome
    }
}

impl Plan {
    fn of(config: &RunConfig, hand: &Hand, library: &MuJoCo, run: &Path) -> Plan {
        Plan {
            run: run.to_owned(),
            hand: hand.manifest.name.clone(),
            n_joints: hand.posture.len(),
            n_actuators: hand.actuators.len() + 1,
            n_fingers: hand.fingertips.len(),
            scripted_grasps: hand.manifest.scripted_grasps,
            objects: config.objects.clone(),
            preset: config.preset,
            lambda: config.lambda,
            seed: config.seed,
            episodes: config.episodes,
            components: config.synergy.components,
            window: config.synergy.window,
            episodes_done: 0,
            workers: config.worker_count(),
            mujoco_version: library.version(),
            mujoco_library: library.origin().to_owned(),
        }
    }
}

/// Resolves a request into complete settings and the hand.
///
/// # Errors
/// The first fault of the configuration or the hand.
pub fn resolve(request: &NewRun) -> Result<(RunConfig, Hand), TrainError> {
    let registry = Registry::discover(&request.hands)?;
    let (mut config, components) = sum_layers(request, &registry)?;
    let hand = registry.get(&config.hand)?;
    let directions = hand.actuators.len();
    if config.synergy.components > directions {
        match components {
            // The default is for hands with more.
            None => config.synergy.components = directions,
            Some(origin) => {
                let reason = format!(
                    "synergy.components = {} is not allowed: for the hand {}, expected at most {directions}, one for each \
                     actuator without the slide",
                    config.synergy.components, hand.manifest.name
                );
                return Err(ConfigError::Value { origin, reason }.into());
            }
        }
    }
    Ok((named_by_path(config, &hand, &registry), hand))
}

/// Names a hand that the registry does not list by its path.
fn named_by_path(mut config: RunConfig, hand: &Hand, registry: &Registry) -> RunConfig {
    if !registry.list().iter().any(|entry| entry.name == config.hand) {
        // Only an absolute path leads to the hand from every working directory.
        let complete = hand.directory.canonicalize().unwrap_or_else(|_| hand.directory.clone());
        config.hand = complete.display().to_string();
    }
    config
}

/// Combines the layers of a request: default, preset, file, assignments, options. Also returns what set the number of
/// components; none for the default.
fn sum_layers(request: &NewRun, registry: &Registry) -> Result<(RunConfig, Option<String>), TrainError> {
    let file = match &request.file {
        Some(path) => Some((path.display().to_string(), read_layer(path)?)),
        None => None,
    };
    let written = match &file {
        Some((origin, text)) => preset_in(origin, text)?,
        None => None,
    };
    let preset = request.preset.or(written).unwrap_or_default();
    let mut layers = Layers::new(preset)?;
    if let Some((origin, text)) = &file {
        layers.add_text(origin, text)?;
    }
    for assignment in &request.assignments {
        layers.add_assignment(assignment)?;
    }
    if layers.origin("preset").is_some_and(|origin| origin.starts_with("--set ")) {
        return Err(TrainError::Option {
            option: "--set preset".to_owned(),
            reason: "a preset is a layer of its own: choose it with --preset".to_owned(),
        });
    }
    let whole = |n: u64| Value::Integer(i64::try_from(n).unwrap_or(i64::MAX));
    let options = [
        ("preset", Some(Value::String(preset.name().to_owned()))),
        ("hand", request.hand.clone().map(Value::String)),
        ("lambda", request.lambda.map(Value::Float)),
        ("seed", request.seed.map(whole)),
        ("episodes", request.episodes.map(whole)),
        ("workers", request.workers.map(|n| whole(n as u64))),
        ("tensorboard", request.tensorboard.map(Value::Boolean)),
        ("objects", request.objects.clone().map(|names| Value::Array(names.into_iter().map(Value::String).collect()))),
    ];
    for (key, value) in options {
        if let Some(value) = value {
            layers.set(key, value, &format!("--{key}"))?;
        }
    }
    if layers.origin("hand").is_none() && !request.default_hand {
        let names: Vec<&str> = registry.list().iter().map(|entry| entry.name.as_str()).collect();
        let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        return Err(TrainError::NoHand { known });
    }
    let components = layers.origin("synergy.components").map(str::to_owned);
    Ok((layers.resolve()?, components))
}

/// Returns the preset that a configuration file names, if it names one.
fn preset_in(origin: &str, text: &str) -> Result<Option<Preset>, ConfigError> {
    let Some(name) = parse_settings(origin, text)?.remove("preset") else { return Ok(None) };
    match Preset::ALL.into_iter().find(|preset| name.trim_matches(['"', '\'']) == preset.name()) {
        Some(preset) => Ok(Some(preset)),
        None => {
            let known = Preset::ALL.map(Preset::name).join(", ");
            let reason = format!("preset = {name} is not allowed: expected one of {known}");
            Err(ConfigError::Value { origin: origin.to_owned(), reason })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request() -> NewRun {
        NewRun { hand: Some("some-hand".to_owned()), ..NewRun::default() }
    }

    fn resolved(request: &NewRun) -> Result<RunConfig, TrainError> {
        Ok(sum_layers(request, &Registry::discover(&SearchPath::from_environment(&[]))?)?.0)
    }

    /// A file that lives as long as the test.
    fn file(text: &str) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("writable");
        file
    }

    fn with_file(file: &tempfile::NamedTempFile) -> NewRun {
        NewRun { file: Some(file.path().to_owned()), ..request() }
    }

    #[test]
    fn each_layer_overrides_the_one_before() {
        let file = file("lambda = 2.0\nseed = 5\nepisodes = 10\n[learner]\ngamma = 0.9\n");
        let quick = resolved(&NewRun { preset: Some(Preset::Quick), ..request() }).expect("valid");
        let config = resolved(&NewRun {
            preset: Some(Preset::Quick),
            assignments: vec!["seed=6".to_owned(), "episodes=11".to_owned()],
            episodes: Some(12),
            ..with_file(&file)
        })
        .expect("valid");
        assert_eq!(config.objects, quick.objects, "from the preset");
        assert_eq!((config.lambda, config.learner.gamma), (2.0, 0.9), "from the file");
        assert_eq!(config.seed, 6, "from --set");
        assert_eq!(config.episodes, 12, "from the option");
        assert_eq!(config.hand, "some-hand");
    }

    #[test]
    fn a_preset_in_the_file_brings_its_settings() {
        let file = file("preset = \"quick\"\n");
        let quick = resolved(&NewRun { preset: Some(Preset::Quick), ..request() }).expect("valid");
        assert_eq!(resolved(&with_file(&file)).expect("valid"), quick);
        let paper = resolved(&NewRun { preset: Some(Preset::Paper), ..with_file(&file) }).expect("valid");
        let expected = resolved(&NewRun { preset: Some(Preset::Paper), ..request() }).expect("valid");
        assert_eq!(paper, expected, "the option is above the file");
    }

    #[test]
    fn a_hand_has_to_be_named_somewhere() {
        let error = resolved(&NewRun::default()).expect_err("no hand");
        assert!(error.is_usage() && error.to_string().contains("--hand"), "{error}");
        let file = file("hand = \"from-file\"\n");
        let named = resolved(&NewRun { hand: None, ..with_file(&file) }).expect("named in the file");
        assert_eq!(named.hand, "from-file");
        let assigned = NewRun { assignments: vec!["hand = assigned".to_owned()], ..NewRun::default() };
        assert_eq!(resolved(&assigned).expect("named with --set").hand, "assigned");
    }

    #[test]
    fn wrong_requests_say_where_they_are_wrong() {
        let assigning = |text: &str| NewRun { assignments: vec![text.to_owned()], ..request() };
        let bad_preset = file("preset = \"quik\"\n");
        let bad_key = file("[learner]\ngama = 0.9\n");
        let no_toml = file("= 3\n");
        let nowhere = tempfile::tempdir().expect("a directory");
        let cases = [
            (assigning("preset=quick"), "--preset"),
            (assigning("learner.gama=0.9"), "did you mean \"learner.gamma\""),
            (assigning("nonsense"), "key=value"),
            (NewRun { lambda: Some(-1.0), ..request() }, "lambda = -1"),
            (NewRun { objects: Some(Vec::new()), ..request() }, "objects"),
            (with_file(&bad_preset), "expected one of default, quick, paper"),
            (with_file(&bad_key), "did you mean \"learner.gamma\""),
            (with_file(&no_toml), "line 1"),
            (NewRun { file: Some(nowhere.path().join("run.toml")), ..request() }, "run.toml"),
        ];
        for (request, part) in cases {
            let error = resolved(&request).expect_err(part);
            assert!(error.is_usage(), "{error}");
            assert!(error.to_string().contains(part), "{error} does not say {part}");
        }
    }
}
