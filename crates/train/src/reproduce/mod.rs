//! Experiments of several runs: the same training for several lambdas or action spaces, and several seeds.
//!
//! A [`Comparison`] says what the runs differ in. [`Reproduction`] lists the runs and their state.

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::config::{RunConfig, Settings, differences};
use crate::request::{NewRun, resolve};
use crate::run_dir::{is_run, lock, read_config, read_provenance};
use crate::runs::{Job, runs_in};
use crate::{TrainError, json_file};
use eigenhand_files::create_directory;
use eigenhand_hands::Hand;

mod spaces;
mod variant;

use variant::run_name;
pub use variant::{Comparison, Directions, Numbers, STUDY, StudyFile, StudyVariant, Variant};

/// Keys in which the runs of one reproduction may differ: lambda and seed, and `workers`, which does not affect
/// results.
pub const VARIED: [&str; 3] = ["lambda", "seed", "workers"];
/// Setting of a run that acts in few numbers: how it does with still fewer is no question of the study.
pub const ALL_NUMBERS: &str = "evaluation.few_numbers=false";
/// Largest number of differing keys that an error lists.
const LISTED: usize = 5;

/// Request for a reproduction.
#[derive(Clone, Debug)]
pub struct Request {
    /// Settings of every run; their lambda, seed, workers and directory are ignored.
    pub settings: NewRun,
    /// What the runs differ in.
    pub comparison: Comparison,
    /// Seeds.
    pub seeds: Vec<u64>,
    /// Directory of the runs; if absent, `runs/reproduce-<hand>-<preset>` or `runs/study-<hand>-<preset>`.
    pub out: Option<PathBuf>,
}

/// One run of a reproduction.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// The run, `<variant>-s<seed>`.
    pub job: Job,
    /// What it differs in.
    pub variant: Variant,
    /// Seed.
    pub seed: u64,
    /// The synergy in which its policy acts; none if it commands every joint.
    pub synergy: Option<PathBuf>,
}

/// A directory of runs, locked for this process.
pub struct Reproduction {
    /// The directory.
    pub directory: PathBuf,
    /// The hand.
    pub hand: Hand,
    /// Settings of the first run.
    pub config: RunConfig,
    /// The runs, in the order in which they are trained: the first seed of every variant, then the second.
    pub members: Vec<Member>,
    _lock: File,
}

impl Reproduction {
    /// Resolves the settings, locks the directory, and finds the state of its runs. No run is changed.
    ///
    /// # Errors
    /// The first fault of the settings or the hand; for a study, a hand that does not say which actuators close it is a fault
    /// too. [`TrainError::OtherSettings`] and [`TrainError::HandChanged`] when a run in the directory has other settings or
    /// another version of the hand; [`TrainError::Locked`].
    pub fn prepare(request: &Request) -> Result<Reproduction, TrainError> {
        refuse_varied(&request.settings)?;
        let seeds = distinct(&request.seeds);
        let comparison = match &request.comparison {
            Comparison::Lambdas(lambdas) => Comparison::Lambdas(distinct(lambdas)),
            other => other.clone(),
        };
        for (option, missing) in
            [("--lambda", comparison == Comparison::Lambdas(Vec::new())), ("--seeds", seeds.is_empty())]
        {
            if missing {
                let reason = "expected at least one value".to_owned();
                return Err(TrainError::Option { option: option.to_owned(), reason });
            }
        }
        let (config, hand) = resolve(&request.settings)?;
        let name = hand.manifest.name.clone();
        let kind = if comparison == Comparison::ControlStudy { "study" } else { "reproduce" };
        let default = || Path::new("runs").join(format!("{kind}-{name}-{}", config.preset.name()));
        let directory = request.out.clone().unwrap_or_else(default);
        if is_run(&directory) {
            return Err(TrainError::RunExists { path: directory });
        }
        if comparison == Comparison::ControlStudy && hand.manifest.closing.is_empty() {
            return Err(TrainError::Option {
                option: "--study control".to_owned(),
                reason: format!(
                    "the hand {name} has no [closing] in hand.toml, so no number can be made by hand; add it (docs/hands.md)"
                ),
            });
        }
        // A synergy has at most as many components as the hand has actuators, without the slide.
        let variants = comparison.variants(config.synergy.components.min(hand.actuators.len()));
        let mut members = Vec::new();
        for (&seed, variant) in seeds.iter().flat_map(|seed| variants.iter().map(move |variant| (seed, variant))) {
            // The settings of each run are checked before any run starts.
            let (config, _) = resolve(&NewRun {
                lambda: Some(variant.lambda),
                seed: Some(seed),
                episodes: Some(variant.episodes(config.episodes)),
                assignments: [request.settings.assignments.clone(), assignments(variant, &directory, seed)].concat(),
                ..request.settings.clone()
            })?;
            let member = Member::of(variant, &config, &directory)?;
            if is_run(&member.job.run) {
                check_settings(&member.job.run, &config.settings()?, &comparison.free())?;
            }
            members.push(member);
        }
        create_directory(&directory)?;
        let lock = lock(&directory)?;
        let settings = config.settings()?;
        for run in runs_in(&directory)? {
            check_settings(&run, &settings, &comparison.varied())?;
            let provenance = read_provenance(&run)?;
            if provenance.hand_digest != hand.digest {
                let (expected, found) = (provenance.hand_digest, hand.digest);
                return Err(TrainError::HandChanged { hand: name, run, expected, found });
            }
        }
        if comparison == Comparison::ControlStudy {
            write_study(&variants, &seeds, &directory)?;
        }
        Ok(Reproduction { directory, hand, config, members, _lock: lock })
    }

    /// Returns the runs, in the order of the members.
    pub fn jobs(&self) -> Vec<Job> {
        self.members.iter().map(|member| member.job.clone()).collect()
    }

    /// Makes the space in which a member's policy acts, if the study makes it.
    ///
    /// # Errors
    /// [`TrainError::NoMotions`] for a run without a synergy, [`TrainError::File`].
    pub fn make_space(&self, member: &Member) -> Result<(), TrainError> {
        let (Some(path), Some(numbers)) = (&member.synergy, &member.variant.space) else { return Ok(()) };
        match (&numbers.directions, &member.job.needs) {
            (Directions::Random(_), Some(run)) => spaces::write_random(run, numbers.components, member.seed, path),
            (Directions::Closing, _) => spaces::write_closing(&self.hand, &self.config, path),
            _ => Ok(()),
        }
    }
}

/// Returns a variant's settings as assignments.
fn assignments(variant: &Variant, directory: &Path, seed: u64) -> Vec<String> {
    let (Some(numbers), Some(path)) = (&variant.space, variant.synergy_path(directory, seed)) else {
        return Vec::new();
    };
    let file = toml::Value::String(path.display().to_string());
    vec![
        "action_space=synergy".to_owned(),
        format!("synergy.file={file}"),
        format!("synergy.components={}", numbers.components),
        ALL_NUMBERS.to_owned(),
    ]
}

/// Writes which runs belong to which variant, for the report.
fn write_study(variants: &[Variant], seeds: &[u64], directory: &Path) -> Result<(), TrainError> {
    let entry = |variant: &Variant| StudyVariant {
        name: variant.name.clone(),
        title: variant.title.clone(),
        runs: seeds.iter().map(|&seed| variant.run_name(seed)).collect(),
    };
    let (varies, subject) = (variant::commands(), variant::space());
    let file = StudyFile { schema: 1, varies, subject, variants: variants.iter().map(entry).collect() };
    json_file::write(&directory.join(STUDY), &file)
}

impl Member {
    fn of(variant: &Variant, config: &RunConfig, directory: &Path) -> Result<Member, TrainError> {
        let mut job = Job::new(directory, variant.run_name(config.seed), config.episodes);
        job.refresh()?;
        let needs = variant.needs().map(|needed| directory.join(run_name(needed, config.seed)));
        Ok(Member {
            job: Job { needs, ..job },
            variant: variant.clone(),
            seed: config.seed,
            synergy: variant.synergy_path(directory, config.seed),
        })
    }
}

pub(crate) fn check_settings(run: &Path, asked: &Settings, varied: &[&str]) -> Result<(), TrainError> {
    let made = read_config(run)?.settings()?;
    let found: Vec<String> = differences(&made, asked)
        .into_iter()
        .filter(|(key, ..)| !varied.contains(key))
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
pub(crate) fn distinct<T: PartialEq + Copy>(values: &[T]) -> Vec<T> {
    let mut kept = Vec::new();
    for value in values {
        if !kept.contains(value) {
            kept.push(*value);
        }
    }
    kept
}
