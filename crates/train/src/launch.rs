//! Starting, continuing, evaluating and exporting a run as a user asks for it.
//!
//! Everything that can be wrong with a request is found before a run directory is made.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use eigenhand_hands::{Hand, Registry};
use eigenhand_sim::ffi::MuJoCo;
use serde::Serialize;
use toml::Value;

use crate::catalogue::{hand_named, registry};
use crate::config::{ConfigError, Layers, Preset, RunConfig};
use crate::files::write_atomically;
use crate::logging::{Logged, RunLog};
use crate::progress::Progress;
use crate::run_dir::{CONFIG, read_provenance, require_run};
use crate::trainer::task_of;
use crate::{LoadedRun, Provenance, RunDirectory, Summary, TrainError, Trainer};

/// A new run, as it is asked for. What is absent keeps the value of the layer below it.
#[derive(Clone, Debug, Default)]
pub struct NewRun {
    /// Name or directory of the hand.
    pub hand: Option<String>,
    /// Preset; absent: the file's, or the default.
    pub preset: Option<Preset>,
    /// Configuration file.
    pub file: Option<PathBuf>,
    /// Assignments `key=value` with dotted keys.
    pub assignments: Vec<String>,
    /// Weight of the synergy's feedback.
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
    /// The run directory; absent: a new one under `runs/`.
    pub out: Option<PathBuf>,
    /// Further directories of plugins.
    pub plugins: Vec<PathBuf>,
}

/// A run to be continued.
#[derive(Clone, Debug, Default)]
pub struct ResumedRun {
    /// The run directory.
    pub run: PathBuf,
    /// Training episodes in all; absent: as many as before.
    pub episodes: Option<u64>,
    /// Threads that simulate; absent: as before.
    pub workers: Option<usize>,
    /// Whether event files for TensorBoard are written; absent: as before.
    pub tensorboard: Option<bool>,
    /// Further directories of plugins.
    pub plugins: Vec<PathBuf>,
}

/// What a run is about to do.
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
    /// Names of the objects.
    pub objects: Vec<String>,
    /// Preset.
    pub preset: Preset,
    /// Weight of the synergy's feedback.
    pub lambda: f64,
    /// Seed.
    pub seed: u64,
    /// Training episodes in all.
    pub episodes: u64,
    /// Newest postures that the synergy is of; 0 is all.
    pub window: usize,
    /// Training episodes that are done already.
    pub episodes_done: u64,
    /// Threads that simulate.
    pub workers: usize,
    /// Version of MuJoCo.
    pub mujoco_version: String,
    /// File or soname MuJoCo was loaded from.
    pub mujoco_library: String,
}

/// A run that is ready to train.
pub struct Launch {
    plan: Plan,
    trainer: Trainer,
    _log: RunLog,
}

impl Launch {
    /// Prepares a new run in a directory of its own.
    ///
    /// # Errors
    /// Whatever is wrong with the configuration, the hand, the library or the directory.
    pub fn start(request: &NewRun) -> Result<Launch, TrainError> {
        let (config, hand) = resolve(request)?;
        let library = MuJoCo::load()?;
        let task = task_of(&config, &hand, &library)?;
        let provenance = Provenance::collect(&hand, &library);
        let run = RunDirectory::create(request.out.as_deref(), &config, &provenance)?;
        let log = RunLog::start(run.path())?;
        let mut plan = Plan::of(&config, &hand, &library, run.path());
        let trainer = Trainer::create(config, provenance, hand, task, run)?;
        plan.episodes_done = trainer.episodes();
        Ok(Launch { plan, trainer, _log: log })
    }

    /// Prepares to continue a run from its newest checkpoint.
    ///
    /// # Errors
    /// [`TrainError::NotARun`], [`TrainError::Locked`], [`TrainError::HandChanged`], [`TrainError::Damaged`]; nothing
    /// has been changed on disk then.
    pub fn resume(request: &ResumedRun) -> Result<Launch, TrainError> {
        let run = RunDirectory::open(&request.run)?;
        let mut stored = run.config()?;
        let provenance = read_provenance(run.path())?;
        let hand = hand_named(&stored.hand, &request.plugins)?;
        check_digest(run.path(), &hand, &provenance)?;
        if let Some(episodes) = request.episodes {
            stored.episodes = episodes;
        }
        if let Some(tensorboard) = request.tensorboard {
            stored.tensorboard = tensorboard;
        }
        stored.validate()?;
        let mut config = stored.clone();
        if let Some(workers) = request.workers {
            config.workers = workers;
            config.validate()?;
        }
        let library = MuJoCo::load()?;
        let task = task_of(&config, &hand, &library)?;
        let log = RunLog::start(run.path())?;
        let mut plan = Plan::of(&config, &hand, &library, run.path());
        let trainer = Trainer::resume(config, provenance, hand, task, run)?;
        plan.episodes_done = trainer.episodes();
        if plan.episodes < plan.episodes_done {
            return Err(TrainError::Option {
                option: format!("--episodes {}", plan.episodes),
                reason: format!("the run has trained {} episodes already; ask for more", plan.episodes_done),
            });
        }
        if request.episodes.is_some() || request.tensorboard.is_some() {
            write_atomically(&request.run.join(CONFIG), stored.to_toml()?.as_bytes())?;
        }
        Ok(Launch { plan, trainer, _log: log })
    }

    /// Returns what the run is about to do.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Trains, evaluates and exports.
    ///
    /// # Errors
    /// As [`Trainer::run`]; the error is in the run's log too.
    pub fn run(self, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary, TrainError> {
        let Plan { hand, episodes, episodes_done, workers, mujoco_version, .. } = &self.plan;
        tracing::info!(
            "training {hand}: episodes {episodes_done} to {episodes}, {workers} workers, MuJoCo {mujoco_version}"
        );
        let outcome = self.trainer.run(stop, &mut Logged(progress));
        match &outcome {
            Ok(summary) => tracing::info!(
                "stopped by {}: {} episodes, success {:?}, {} postures, {} diverged, {} full buffers",
                summary.stopped_by.name(),
                summary.episodes,
                summary.success_rate,
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
            objects: config.objects.clone(),
            preset: config.preset,
            lambda: config.lambda,
            seed: config.seed,
            episodes: config.episodes,
            window: config.synergy.window,
            episodes_done: 0,
            workers: config.worker_count(),
            mujoco_version: library.version(),
            mujoco_library: library.origin().to_owned(),
        }
    }
}

/// Returns the settings that a request comes to, with their hand.
///
/// # Errors
/// Whatever is wrong with the configuration or the hand.
pub fn resolve(request: &NewRun) -> Result<(RunConfig, Hand), TrainError> {
    let registry = registry(&request.plugins)?;
    let mut config = sum_layers(request, &registry)?;
    let hand = registry.get(&config.hand)?;
    if !registry.list().iter().any(|entry| entry.name == config.hand) {
        // A path is found again from another directory only when it is complete.
        let complete = hand.directory.canonicalize().unwrap_or_else(|_| hand.directory.clone());
        config.hand = complete.display().to_string();
    }
    Ok((config, hand))
}

/// Sums the layers of a request: default, preset, file, assignments, options.
fn sum_layers(request: &NewRun, registry: &Registry) -> Result<RunConfig, TrainError> {
    let file = match &request.file {
        Some(path) => Some(read_table(path)?),
        None => None,
    };
    let written = |key: &str| file.as_ref().and_then(|table| table.get(key));
    let preset = match (request.preset, written("preset")) {
        (Some(preset), _) => preset,
        (None, Some(value)) => value.clone().try_into().map_err(|_| {
            let path = request.file.as_deref().unwrap_or(Path::new("")).display().to_string();
            let reason = format!("preset = {value} is not allowed: expected default, quick or paper");
            ConfigError::Value { origin: path, reason }
        })?,
        (None, None) => Preset::default(),
    };
    let mut layers = Layers::new(preset)?;
    if let Some(path) = &request.file {
        layers.add_file(path)?;
    }
    let assigns = |key: &str| {
        request.assignments.iter().any(|a| a.split_once('=').is_some_and(|(written, _)| written.trim() == key))
    };
    if assigns("preset") {
        return Err(TrainError::Option {
            option: "--set preset".to_owned(),
            reason: "a preset is a layer of its own: choose it with --preset".to_owned(),
        });
    }
    for assignment in &request.assignments {
        layers.add_assignment(assignment)?;
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
    if request.hand.is_none() && written("hand").is_none() && !assigns("hand") {
        let names: Vec<&str> = registry.list().iter().map(|entry| entry.name.as_str()).collect();
        let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        return Err(TrainError::NoHand { known });
    }
    Ok(layers.resolve()?)
}

fn read_table(path: &Path) -> Result<toml::Table, ConfigError> {
    let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
    text.parse().map_err(|error: toml::de::Error| ConfigError::Syntax {
        origin: path.display().to_string(),
        reason: error.to_string().trim().to_owned(),
    })
}

fn check_digest(run: &Path, hand: &Hand, provenance: &Provenance) -> Result<(), TrainError> {
    if hand.digest == provenance.hand_digest {
        return Ok(());
    }
    Err(TrainError::HandChanged {
        hand: hand.manifest.name.clone(),
        run: run.to_owned(),
        expected: provenance.hand_digest.clone(),
        found: hand.digest.clone(),
    })
}

/// Keys of the configuration that say where a policy acts and what counts as success, not how it learned.
const SCENE_KEYS: [&str; 8] = [
    "physics.",
    "reward.success_distance",
    "task.final_steps",
    "task.goal_height",
    "task.object_range",
    "task.orientation",
    "task.settle_time",
    "task.steps",
];

/// Reads a run and the hand it was made with; each of `assignments` is a `key=value` that changes its scene.
///
/// # Errors
/// As [`LoadedRun::read`], [`TrainError::HandChanged`] when the hand's files are no longer the same, and
/// [`ConfigError`] for an assignment that cannot be used or that no evaluation would notice.
pub fn load(run: &Path, plugins: &[PathBuf], assignments: &[String]) -> Result<LoadedRun, TrainError> {
    require_run(run)?;
    let mut layers = Layers::of_run(&run.join(CONFIG))?;
    for assignment in assignments {
        layers.add_assignment(assignment)?;
        let key = assignment.split('=').next().unwrap_or_default().trim();
        if !SCENE_KEYS.iter().any(|known| key == *known || (known.ends_with('.') && key.starts_with(known))) {
            let origin = format!("--set {assignment}");
            let reason =
                format!("an evaluation depends only on {}", SCENE_KEYS.join(", ").replace("physics.", "physics.*"));
            return Err(ConfigError::Value { origin, reason }.into());
        }
    }
    let config = layers.resolve()?;
    let provenance = read_provenance(run)?;
    let hand = hand_named(&config.hand, plugins)?;
    check_digest(run, &hand, &provenance)?;
    let library: Arc<MuJoCo> = MuJoCo::load()?;
    LoadedRun::read(run, config, hand, &library)
}

/// Exports a run into a directory that is new, empty or an earlier export, and lists the files in it.
///
/// # Errors
/// [`TrainError::ExportExists`] for any other directory; as [`LoadedRun::export`].
pub fn export(run: &LoadedRun, directory: &Path, out: &Path) -> Result<Vec<PathBuf>, TrainError> {
    let occupied = out.read_dir().is_ok_and(|mut entries| entries.next().is_some());
    let exported = out.join(crate::export::POLICY_TEXT).is_file() && !out.join(CONFIG).exists();
    if out.is_file() || (occupied && !exported) {
        return Err(TrainError::ExportExists { path: out.to_owned() });
    }
    run.export(directory, out)?;
    let mut files = Vec::new();
    list_files(out, &mut files)?;
    files.sort();
    Ok(files)
}

fn list_files(directory: &Path, files: &mut Vec<PathBuf>) -> Result<(), TrainError> {
    let read = |error| crate::error::io_error("read", directory)(error);
    for entry in directory.read_dir().map_err(read)? {
        let path = entry.map_err(read)?.path();
        if path.is_dir() { list_files(&path, files)? } else { files.push(path) }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request() -> NewRun {
        NewRun { hand: Some("some-hand".to_owned()), ..NewRun::default() }
    }

    fn resolved(request: &NewRun) -> Result<RunConfig, TrainError> {
        sum_layers(request, &registry(&[])?)
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
        let cases = [
            (assigning("preset=quick"), "--preset"),
            (assigning("learner.gama=0.9"), "did you mean \"learner.gamma\""),
            (assigning("nonsense"), "key=value"),
            (NewRun { lambda: Some(-1.0), ..request() }, "lambda = -1"),
            (NewRun { objects: Some(Vec::new()), ..request() }, "objects"),
            (with_file(&bad_preset), "expected default, quick or paper"),
            (with_file(&bad_key), "did you mean \"learner.gamma\""),
            (with_file(&no_toml), "line 1"),
            (NewRun { file: Some("/nonexistent/run.toml".into()), ..request() }, "/nonexistent/run.toml"),
        ];
        for (request, part) in cases {
            let error = resolved(&request).expect_err(part);
            assert!(error.is_usage(), "{error}");
            assert!(error.to_string().contains(part), "{error} does not say {part}");
        }
    }
}
