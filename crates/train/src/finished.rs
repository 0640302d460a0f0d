//! A finished run: read from its directory, evaluated and exported.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use eigenhand_hands::{Hand, SearchPath};
use eigenhand_mujoco::MuJoCo;
use eigenhand_rl::{Policy, TensorMap};
use eigenhand_sim::{GraspEnv, GraspTask};
use eigenhand_synergy::{Import, PostureDatabase, Synergy, SynergyFile, newest};

use crate::actuators::HandActuators;
use crate::assessment::{Assessment, ObjectScore, wilson_interval};
use crate::config::{ConfigError, Layers, RunConfig};
use crate::control_product::ControlProduct;
use crate::digests;
use crate::drive::{Drive, Driven, Driver, Freedom, is_nearly};
use crate::error::TrainError;
use crate::evaluation::{EvaluationStream, Tally, evaluate};
use crate::hands::{check_digest, hand_named};
use crate::products::{POLICY, POLICY_TEXT, Products, SYNERGY, write_products};
use crate::provenance::Provenance;
use crate::rollout::{Behaviour, EpisodeJob, Workers, run_episode};
use crate::run_dir::{CONFIG, DATABASE, read_provenance, require_run};
use crate::summary::Summary;
use crate::task::{task_of, task_with_objects};

/// A file of every export, and of no run.
const MANIFEST: &str = "manifest.json";
/// Keys that describe the scene and the meaning of success. An evaluation may change them, and no others.
const SCENE_KEYS: [&str; 11] = [
    "objects",
    "physics.",
    "reward.success_distance",
    "task.closed_start",
    "task.final_steps",
    "task.goal_height",
    "task.object_range",
    "task.object_scale",
    "task.orientation",
    "task.settle_time",
    "task.steps",
];

/// A run that has a policy.
pub struct FinishedRun {
    /// Its directory.
    pub directory: PathBuf,
    /// Its configuration, with the requested changes.
    pub config: RunConfig,
    /// The requested changes, as `key=value`.
    pub changed: Vec<String>,
    /// Versions, machine and hand at its start.
    pub provenance: Provenance,
    /// Its hand.
    pub hand: Hand,
    /// Its task.
    pub task: Arc<GraspTask>,
    /// Its policy.
    pub policy: Policy,
}

impl FinishedRun {
    /// Reads a run and its hand. Each of `changes` is a `key=value` that changes the scene.
    ///
    /// # Errors
    /// [`TrainError::NotARun`] when there is no policy yet, [`TrainError::Damaged`] when a file cannot be read,
    /// [`TrainError::HandChanged`] when the hand's files have changed, and [`ConfigError`] for a change that is not
    /// valid or that has no effect on an evaluation.
    pub fn open(directory: &Path, hands: &SearchPath, changes: &[String]) -> Result<FinishedRun, TrainError> {
        require_run(directory)?;
        let config = changed_config(directory, changes)?;
        let provenance = read_provenance(directory)?;
        let hand = hand_named(&config.hand, hands)?;
        check_digest(directory, &hand, &provenance)?;
        digests::check(directory)?;
        let task = task_with_known_ids(directory, &config, &hand)?;
        let policy = read_policy(directory, &config, &hand, &task)?;
        let (directory, changed) = (directory.to_owned(), changes.to_vec());
        Ok(FinishedRun { directory, config, changed, provenance, hand, task, policy })
    }

    /// Runs `episodes` episodes of the policy without exploration.
    ///
    /// The episodes depend only on `seed`, and come from random streams that no training uses.
    ///
    /// # Errors
    /// [`TrainError::Sim`], or [`TrainError::WorkerLost`].
    pub fn evaluate(&self, episodes: u64, seed: u64, workers: impl Into<Workers>) -> Result<Assessment, TrainError> {
        let mut pool = workers.into().start(&self.task)?;
        let found = evaluate(&mut pool, &self.task, &self.policy, seed, EvaluationStream::Separate, 0..episodes)?;
        let Tally { episodes, successes } = found.all;
        Ok(Assessment {
            run: self.directory.clone(),
            hand: self.hand.manifest.name.clone(),
            lambda: self.config.lambda,
            seed,
            changed: self.changed.clone(),
            episodes,
            successes,
            success_rate: found.success_rate(),
            interval: wilson_interval(successes, episodes),
            objects: found.objects.iter().map(|(object, tally)| ObjectScore::of(object, *tally)).collect(),
            mean_final_distance_m: found.mean_final_distance,
            mean_penetration_m: found.mean_penetration,
            mean_self_penetration_m: found.mean_self_penetration,
            diverged: found.diverged,
            warnings: found.warnings,
        })
    }

    /// Measures the success of the policy when its commands are projected on few numbers.
    ///
    /// The space is fitted to the samples of the export, with all of its components, and without the actuators that are
    /// `free`.
    ///
    /// # Errors
    /// [`TrainError::Option`] for an actuator that the hand does not have, [`TrainError::NoMotions`] for a policy that
    /// does not succeed, [`TrainError::Sim`], or [`TrainError::WorkerLost`].
    pub fn drive(
        &self,
        components: RangeInclusive<usize>,
        free: &Freedom,
        episodes: u64,
        seed: u64,
        workers: impl Into<Workers>,
        mut each: impl FnMut(&Driven),
    ) -> Result<Drive, TrainError> {
        let actuators = HandActuators::of(&self.hand, &self.task).without(&free.actuators)?;
        let mut pool = workers.into().start(&self.task)?;
        let no_motions = || TrainError::NoMotions { run: self.directory.clone() };
        let exported = self.directory.join(SYNERGY);
        let Import { file, samples } =
            if exported.exists() { eigenhand_synergy::import(exported)? } else { return Err(no_motions()) };
        let known = file.synergy.joints();
        let kept: Vec<usize> = (0..known.len()).filter(|&i| actuators.coordinates.contains(&known[i])).collect();
        let samples: Vec<Vec<f64>> = samples.iter().map(|command| kept.iter().map(|&i| command[i]).collect()).collect();
        let space = Synergy::fit_newest(&actuators.coordinates, &samples, kept.len(), 0)?.ok_or_else(no_motions)?;
        let (most, asked) = (space.n_components(), *components.end());
        if asked > most {
            let reason = format!("expected at most {most}, one for each actuator that is neither the slide nor free");
            return Err(TrainError::Option { option: format!("--components {}..{asked}", components.start()), reason });
        }
        // Without some of the actuators, the space is not the one in which the policy has learned.
        let numbers = if free.actuators.is_empty() { file.synergy.n_components() } else { 0 };
        let Self { task, policy, .. } = self;
        let driver = Driver { task, policy, actuators: &actuators, space: &space, numbers, free_steps: free.steps };
        let mut rows = Vec::new();
        for k in components {
            let row = driver.measure(&mut pool, k, seed, EvaluationStream::Separate, episodes, true)?;
            each(&row);
            rows.push(row);
        }
        let unprojected = evaluate(&mut pool, &self.task, &self.policy, seed, EvaluationStream::Separate, 0..episodes)?;
        let nearly = |row: &&Driven| row.components > 0 && is_nearly(row.success_rate, unprojected.success_rate());
        Ok(Drive {
            episodes,
            seed,
            free: free.clone(),
            k_for_95: rows.iter().find(nearly).map(|row| row.components),
            rows,
            success_rate: unprojected.success_rate(),
            interval: wilson_interval(unprojected.all.successes, unprojected.all.episodes),
        })
    }

    /// Runs episodes of the policy in a scene until one succeeds, at most `tries`, and returns the environment at the
    /// end of this episode; none if no episode succeeded.
    ///
    /// # Errors
    /// [`TrainError::Sim`].
    pub fn successful_grasp(&self, scene: usize, tries: u64) -> Result<Option<GraspEnv>, TrainError> {
        let mut env = GraspEnv::new(&self.task)?;
        let mut scratch = self.policy.scratch();
        for index in 0..tries {
            if run_episode(&mut env, &mut scratch, &self.pictured(scene, self.config.seed, index))?.success {
                return Ok(Some(env));
            }
        }
        Ok(None)
    }

    /// Runs episode `index` of the policy in a scene. `each` sees the environment at the start and after every step. Returns
    /// whether the episode succeeded. Of an episode that diverges, `each` sees nothing.
    ///
    /// # Errors
    /// [`TrainError::Sim`].
    pub fn watch(
        &self,
        scene: usize,
        seed: u64,
        index: u64,
        mut each: impl FnMut(&GraspEnv),
    ) -> Result<bool, TrainError> {
        let mut env = GraspEnv::new(&self.task)?;
        let job = self.pictured(scene, seed, index);
        let episode = run_episode(&mut env, &mut self.policy.scratch(), &job)?;
        if episode.diverged {
            return Ok(false);
        }
        // The same start, and the same actions.
        env.reset(scene, &mut job.start())?;
        each(&env);
        for action in episode.data.actions.chunks_exact(self.task.action_len()) {
            env.step(action)?;
            each(&env);
        }
        Ok(episode.success)
    }

    /// Returns the job of an episode to draw.
    fn pictured(&self, scene: usize, seed: u64, index: u64) -> EpisodeJob {
        EpisodeJob {
            seed,
            stream: "picture",
            index,
            scene: Some(scene),
            policy: self.policy.clone(),
            behaviour: Behaviour::Greedy,
            fewer_numbers: false,
            confinement: None,
            disturbance: None,
        }
    }

    /// Computes the synergy of the run's postures, with the postures that it covers; none while they are too few.
    ///
    /// # Errors
    /// [`TrainError::Synergy`] for the posture database.
    pub fn synergy(&self) -> Result<(Option<Synergy>, Vec<Vec<f64>>), TrainError> {
        let postures = PostureDatabase::open_existing(self.directory.join(DATABASE))?.policy_postures()?;
        let config = &self.config.synergy;
        let joints = &self.task.posture_joints;
        let synergy = Synergy::fit_newest(joints, &postures, config.components, config.window)?;
        Ok((synergy, newest(&postures, config.window).to_vec()))
    }

    /// Reads the control synergy that the run exported; none if it has none.
    ///
    /// # Errors
    /// [`TrainError::Synergy`] for a file that is damaged.
    pub fn control_synergy(&self) -> Result<Option<SynergyFile>, TrainError> {
        let directory = self.directory.join(SYNERGY);
        if !directory.exists() {
            return Ok(None);
        }
        let mut file = eigenhand_synergy::import(directory)?.file;
        if let Some(joint_map) = &mut file.joint_map {
            // Earlier versions did not write them.
            joint_map.free = self.free_joints(&file.synergy);
        }
        Ok(Some(file))
    }

    fn free_joints(&self, synergy: &Synergy) -> Vec<String> {
        self.hand.joints_free_of(synergy.joints().iter().map(|joint| joint.name.as_str()))
    }

    /// Checks that an export may be written into a directory: it must be new, empty or an earlier export.
    ///
    /// # Errors
    /// [`TrainError::ExportExists`] for any other directory.
    pub fn check_export(&self, out: &Path) -> Result<(), TrainError> {
        let occupied = out.read_dir().is_ok_and(|mut entries| entries.next().is_some());
        // An export that was interrupted may have one of them alone.
        let marked = [POLICY_TEXT, MANIFEST].iter().any(|name| out.join(name).is_file());
        let exported = marked && !out.join(CONFIG).exists();
        if out.is_file() || (occupied && !exported) {
            return Err(TrainError::ExportExists { path: out.to_owned() });
        }
        Ok(())
    }

    /// Writes the synergies, the policy and the scenes into a directory.
    ///
    /// # Errors
    /// [`TrainError::Synergy`] for the posture database, [`TrainError::File`].
    pub fn export(&self, out: &Path) -> Result<(), TrainError> {
        let (synergy, postures) = self.synergy()?;
        let control = self.directory.join(SYNERGY);
        let mut control = if control.exists() { Some(ControlProduct::read(&control)?) } else { None };
        if let Some(ControlProduct { synergy, joint_map, .. }) = &mut control {
            joint_map.free = self.free_joints(synergy);
        }
        let products = Products {
            hand: &self.hand,
            task: &self.task,
            config: &self.config,
            provenance: &self.provenance,
            policy: &self.policy,
            policy_episode: Summary::read(&self.directory)?.map(|summary| summary.policy_episode),
            control,
            synergy: synergy.as_ref(),
            postures: &postures,
        };
        write_products(&products, out)
    }
}

fn changed_config(directory: &Path, changes: &[String]) -> Result<RunConfig, ConfigError> {
    let mut layers = Layers::of_run(&directory.join(CONFIG))?;
    for change in changes {
        layers.add_assignment(change)?;
        let key = change.split('=').next().unwrap_or_default().trim();
        if !SCENE_KEYS.iter().any(|known| key == *known || (known.ends_with('.') && key.starts_with(known))) {
            let origin = format!("--set {change}");
            let keys = SCENE_KEYS.join(", ").replace("physics.", "physics.*");
            let reason = format!("an evaluation can change only these settings: {keys}");
            return Err(ConfigError::Value { origin, reason });
        }
    }
    layers.resolve()
}

/// Builds the task of an evaluation, in which the policy observes only numbers of objects that its training had.
fn task_with_known_ids(run: &Path, config: &RunConfig, hand: &Hand) -> Result<Arc<GraspTask>, TrainError> {
    let library = MuJoCo::load()?;
    let trained = RunConfig::read(&run.join(CONFIG))?;
    if trained.objects == config.objects {
        return task_of(config, hand, &library);
    }
    let known = GraspTask::new(&library, hand, &trained.setting())?;
    task_with_objects(&config.objects, config, hand, &library, &known)
}

fn read_policy(run: &Path, config: &RunConfig, hand: &Hand, task: &GraspTask) -> Result<Policy, TrainError> {
    let path = run.join(POLICY);
    let damaged = |reason: String| TrainError::Damaged {
        path: path.clone(),
        reason,
        mend: format!("write it again with: train --resume {}", run.display()),
    };
    if !path.is_file() {
        let reason = format!("it holds no {POLICY} yet; finish the run with: train --resume {}", run.display());
        return Err(TrainError::NotARun { path: run.to_owned(), reason });
    }
    let bytes = std::fs::read(&path).map_err(|error| damaged(error.to_string()))?;
    let tensors = TensorMap::load_bytes(&bytes).map_err(|error| damaged(error.to_string()))?;
    let policy =
        Policy::import_tensors(&tensors, &config.learner.normalizer).map_err(|error| damaged(error.to_string()))?;
    let expected = (task.observation_len(), GraspTask::GOAL_LEN, task.action_len());
    let found = (policy.obs_dim(), policy.goal_dim(), policy.act_dim());
    if expected == found {
        return Ok(policy);
    }
    Err(damaged(format!(
        "it has {} inputs for the observation, {} for the goal and {} outputs, but the hand {} needs {}, {} and {}",
        found.0, found.1, found.2, hand.manifest.name, expected.0, expected.1, expected.2
    )))
}
