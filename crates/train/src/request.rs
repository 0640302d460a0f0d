//! Requests for a new or a resumed run.
//!
//! Every fault of a request is found before a run directory is made.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use eigenhand_files::write_atomically;
use eigenhand_hands::{Hand, ScriptedGrasps, SearchPath};
use eigenhand_mujoco::MuJoCo;
use serde::Serialize;

use crate::action_space::SynergySpace;
use crate::assignment::Assignment;
use crate::config::{Preset, RunConfig};
use crate::error::TrainError;
use crate::finished::FinishedRun;
use crate::hands::{check_contract, check_digest, hand_named};
use crate::logging::{Logged, RunLog};
use crate::progress::Progress;
use crate::provenance::Provenance;
use crate::run_dir::{CONFIG, RunDirectory, read_provenance};
use crate::start::Start;
use crate::summary::Summary;
use crate::task::{other_task_of, task_of};
use crate::trainer::Trainer;

mod resolve;

pub use resolve::resolve;

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
    /// The run whose settings this one has unless it names others, and whose networks it starts with.
    pub from: Option<PathBuf>,
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
    /// The run with whose networks it starts; none for fresh ones.
    pub from: Option<PathBuf>,
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
        let start = Start::of(&config, &hand, &task, space.as_ref())?;
        let provenance = Provenance::collect(&hand, &library);
        let run = RunDirectory::create(request.out.as_deref(), &config, &provenance)?;
        let assignment = Assignment { config, provenance, hand, task, other_task, space, start, run };
        Launch::begin(assignment, &library)
    }

    /// Begins the training of a run whose directory has its configuration and provenance.
    fn begin(assignment: Assignment, library: &MuJoCo) -> Result<Launch, TrainError> {
        let Assignment { config, hand, task, space, start, run, .. } = &assignment;
        if let Some(space) = space {
            space.keep(run.path())?;
        }
        if let Some(start) = start {
            start.keep(run.path(), task, hand)?;
        }
        let log = RunLog::start(run.path())?;
        let plan = Plan::of(config, hand, library, run.path());
        Ok(Launch { plan, work: Work::Training(Box::new(Trainer::create(assignment)?), log) })
    }

    /// Prepares to continue a run from its newest checkpoint.
    ///
    /// # Errors
    /// [`TrainError::NotARun`], [`TrainError::Locked`], [`TrainError::HandChanged`] and [`TrainError::Damaged`]. With
    /// these errors no file has been changed.
    pub fn resume(request: &ResumedRun) -> Result<Launch, TrainError> {
        let run = RunDirectory::open(&request.run)?;
        run.check_config()?;
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
        // The run was stopped before its first checkpoint.
        if run.begin_again(&stored)? {
            let space = SynergySpace::of(&config, &hand, &task)?;
            let start = Start::of(&config, &hand, &task, space.as_ref())?;
            let assignment = Assignment { config, provenance, hand, task, other_task, space, start, run };
            return Launch::begin(assignment, &library);
        }
        let log = RunLog::start(run.path())?;
        let mut plan = Plan::of(&config, &hand, &library, run.path());
        let space = SynergySpace::resume(run.path(), &config, &hand, &task)?;
        let start = Start::resume(&config, run.path())?;
        let assignment = Assignment { config, provenance, hand, task, other_task, space, start, run };
        let trainer = Trainer::resume(assignment)?;
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
            from: (!config.from.is_empty()).then(|| PathBuf::from(&config.from)),
            episodes_done: 0,
            workers: config.worker_count(),
            mujoco_version: library.version(),
            mujoco_library: library.origin().to_owned(),
        }
    }
}
