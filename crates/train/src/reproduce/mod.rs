//! The experiment of the paper: the same training for several lambdas and seeds, one run directory each.
//!
//! [`Reproduction`] lists the runs and their state; [`children`] trains them, one process for each run.

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::config::{RunConfig, Settings, differences};
use crate::request::{NewRun, resolve};
use crate::run_dir::{LOCK, is_run, lock, read_config, read_provenance};
use crate::{Summary, TrainError, checkpoint};
use eigenhand_files::{cannot, create_directory};

pub mod children;
mod overview;

pub use overview::{Overview, OverviewBars, OverviewDisplay, OverviewLines, Progressing, Silent};

/// Keys in which the runs of one reproduction may differ: lambda and seed, and `workers`, which does not affect
/// results.
pub const VARIED: [&str; 3] = ["lambda", "seed", "workers"];
/// Largest number of differing keys that an error lists.
const LISTED: usize = 5;

/// Request for a reproduction.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// Settings of every run; their lambda, seed, workers and directory are ignored.
    pub settings: NewRun,
    /// How far the policies are confined to their synergies.
    pub lambdas: Vec<f64>,
    /// Seeds.
    pub seeds: Vec<u64>,
    /// Directory of the runs; if absent, `runs/reproduce-<hand>-<preset>`.
    pub out: Option<PathBuf>,
}

/// State of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// It has no checkpoint.
    New,
    /// It can be resumed from its newest checkpoint.
    Interrupted {
        /// Training episodes before that checkpoint.
        episodes: u64,
    },
    /// It was trained and evaluated to its end.
    Complete,
}

/// One run of a reproduction.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// `l<lambda>-s<seed>`.
    pub name: String,
    /// How far the policy is confined to its synergy.
    pub lambda: f64,
    /// Seed.
    pub seed: u64,
    /// Training episodes in all.
    pub episodes: u64,
    /// The run directory.
    pub run: PathBuf,
    /// File with the output of its process.
    pub log: PathBuf,
    /// Its state.
    pub state: State,
}

/// A directory of runs, locked for this process.
pub struct Reproduction {
    /// The directory.
    pub directory: PathBuf,
    /// Name of the hand.
    pub hand: String,
    /// Settings of the first run.
    pub config: RunConfig,
    /// The runs, in the order in which they are trained: the first seed of every lambda, then the second.
    pub members: Vec<Member>,
    _lock: File,
}

impl Reproduction {
    /// Resolves the settings, locks the directory, and finds the state of its runs. No run is changed.
    ///
    /// # Errors
    /// The first fault of the settings or the hand; [`TrainError::OtherSettings`] and [`TrainError::HandChanged`] when
    /// a run in the directory has other settings or another version of the hand; [`TrainError::Locked`].
    pub fn prepare(request: &Request) -> Result<Reproduction, TrainError> {
        refuse_varied(&request.settings)?;
        let (lambdas, seeds) = (distinct(&request.lambdas), distinct(&request.seeds));
        for (option, missing) in [("--lambda", lambdas.is_empty()), ("--seeds", seeds.is_empty())] {
            if missing {
                let reason = "expected at least one value".to_owned();
                return Err(TrainError::Option { option: option.to_owned(), reason });
            }
        }
        let (mut configs, mut hand) = (Vec::new(), None);
        for (&seed, &lambda) in seeds.iter().flat_map(|seed| lambdas.iter().map(move |lambda| (seed, lambda))) {
            let one = NewRun { lambda: Some(lambda), seed: Some(seed), ..request.settings.clone() };
            let (config, found) = resolve(&one)?;
            configs.push(config);
            hand = Some(found);
        }
        let (Some(config), Some(hand)) = (configs.first().cloned(), hand) else {
            return Err(TrainError::Option {
                option: "--seeds".to_owned(),
                reason: "expected at least one value".to_owned(),
            });
        };
        let name = hand.manifest.name.clone();
        let default = || Path::new("runs").join(format!("reproduce-{name}-{}", config.preset.name()));
        let directory = request.out.clone().unwrap_or_else(default);
        if is_run(&directory) {
            return Err(TrainError::RunExists { path: directory });
        }
        create_directory(&directory)?;
        let lock = lock(&directory)?;
        let settings = config.settings()?;
        for run in runs_in(&directory)? {
            check_settings(&run, &settings)?;
            let provenance = read_provenance(&run)?;
            if provenance.hand_digest != hand.digest {
                let (expected, found) = (provenance.hand_digest, hand.digest);
                return Err(TrainError::HandChanged { hand: name, run, expected, found });
            }
        }
        let members =
            configs.iter().map(|config| Member::of(config, &directory)).collect::<Result<Vec<_>, TrainError>>()?;
        Ok(Reproduction { directory, hand: name, config, members, _lock: lock })
    }
}

impl Member {
    fn of(config: &RunConfig, directory: &Path) -> Result<Member, TrainError> {
        let name = format!("l{}-s{}", config.lambda, config.seed);
        let run = directory.join(&name);
        Ok(Member {
            lambda: config.lambda,
            seed: config.seed,
            episodes: config.episodes,
            log: directory.join(format!("{name}.log")),
            state: state_of(&run)?,
            run,
            name,
        })
    }

    /// Returns the number of training episodes that are done.
    pub fn episodes_done(&self) -> u64 {
        match self.state {
            State::New => 0,
            State::Interrupted { episodes } => episodes,
            State::Complete => self.episodes,
        }
    }

    /// Removes the directory of a run without a checkpoint, so that the run can start again.
    ///
    /// # Errors
    /// [`TrainError::NotARun`] when the directory holds other files, [`TrainError::Locked`] when another process still
    /// trains there, [`TrainError::File`].
    pub(crate) fn clear(&self) -> Result<(), TrainError> {
        let foreign = |entry: &std::fs::DirEntry| {
            let name = entry.file_name();
            name != LOCK && !name.to_string_lossy().ends_with(".partial")
        };
        let Ok(entries) = self.run.read_dir() else { return Ok(()) };
        if !is_run(&self.run) && entries.flatten().any(|entry| foreign(&entry)) {
            let reason = "it holds other files; move them away".to_owned();
            return Err(TrainError::NotARun { path: self.run.clone(), reason });
        }
        let _held = lock(&self.run)?;
        Ok(std::fs::remove_dir_all(&self.run).map_err(cannot("remove", &self.run))?)
    }
}

/// Lists the run directories in a directory, by name.
///
/// # Errors
/// [`TrainError::File`].
pub fn runs_in(directory: &Path) -> Result<Vec<PathBuf>, TrainError> {
    let mut runs = Vec::new();
    for entry in directory.read_dir().map_err(cannot("read", directory))? {
        let path = entry.map_err(cannot("read", directory))?.path();
        if is_run(&path) {
            runs.push(path);
        }
    }
    runs.sort();
    Ok(runs)
}

fn state_of(run: &Path) -> Result<State, TrainError> {
    if Summary::read(run)?.is_some_and(|summary| summary.is_complete()) {
        return Ok(State::Complete);
    }
    Ok(checkpoint::newest(run)?.map_or(State::New, |episodes| State::Interrupted { episodes }))
}

fn check_settings(run: &Path, asked: &Settings) -> Result<(), TrainError> {
    let made = read_config(run)?.settings()?;
    let found: Vec<String> = differences(&made, asked)
        .into_iter()
        .filter(|(key, ..)| !VARIED.contains(key))
        .map(|(key, made, asked)| {
            let value = |side: Option<&str>| side.unwrap_or("absent").to_owned();
            format!("{key} is {} there and {} here", value(made), value(asked))
        })
        .collect();
    if found.is_empty() {
        return Ok(());
    }
    let mut text = found.iter().take(LISTED).cloned().collect::<Vec<_>>().join(", ");
    if found.len() > LISTED {
        text.push_str(&format!(", and {} more", found.len() - LISTED));
    }
    Err(TrainError::OtherSettings { run: run.to_owned(), differences: text })
}

/// Refuses settings that a reproduction varies itself.
fn refuse_varied(settings: &NewRun) -> Result<(), TrainError> {
    let assigned = |key: &str| {
        settings.assignments.iter().any(|a| a.split_once('=').is_some_and(|(written, _)| written.trim() == key))
    };
    for (key, option) in [("lambda", "--lambda"), ("seed", "--seeds"), ("workers", "--jobs")] {
        if assigned(key) {
            let reason = format!("reproduce sets this for each run: use {option}");
            return Err(TrainError::Option { option: format!("--set {key}"), reason });
        }
    }
    Ok(())
}

/// Removes repeated values.
fn distinct<T: PartialEq + Copy>(values: &[T]) -> Vec<T> {
    let mut kept = Vec::new();
    for value in values {
        if !kept.contains(value) {
            kept.push(*value);
        }
    }
    kept
}
