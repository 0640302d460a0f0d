//! Sweeps: hands, lambdas, seeds and settings in every combination, trained here or as a job array of Slurm.
//!
//! A [`SweepFile`] says what varies. [`Sweep`] lists the runs; with [`Halving`], only the best variants go on after each stage.

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};

use eigenhand_files::{create_directory, sha256};

use crate::config::Preset;
use crate::error::TrainError;
use crate::json_file;
use crate::metrics::read_metrics;
use crate::reproduce::{STUDY, StudyFile, StudyVariant, check_settings};
use crate::request::{NewRun, resolve};
use crate::run_dir::{is_run, lock};
use crate::runs::{Job, runs_in};

mod file;
pub mod slurm;

pub use file::{Assignments, Distribution, Halving, Search, Slurm, SweepFile};

/// Runs that differ in their seed alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// Its name, with which the names of its runs begin.
    pub name: String,
    /// In what it differs from the others, in words.
    pub title: String,
    /// Name of its hand.
    pub hand: String,
    /// Its lambda.
    pub lambda: f64,
    /// The settings in which it differs from others.
    pub assignments: Assignments,
}

/// A run of a sweep.
#[derive(Clone, Debug)]
pub struct Member {
    /// The run, `<hand>/<variant>-s<seed>`.
    pub job: Job,
    /// Position of its variant.
    pub variant: usize,
    /// Seed.
    pub seed: u64,
    /// What trains it.
    pub request: NewRun,
}

/// A directory of runs.
#[derive(Debug)]
pub struct Sweep {
    /// The directory.
    pub directory: PathBuf,
    /// What varies.
    pub file: SweepFile,
    /// The variants.
    pub variants: Vec<Variant>,
    /// The runs: all variants with the first seed, then with the second.
    pub members: Vec<Member>,
}

impl Sweep {
    /// Resolves the settings of every run, and finds the state of the runs. Nothing is written.
    ///
    /// `base` has what the file does not: places of hands, settings below those of the file. With `only`, the run at this
    /// position alone is looked at: others may be in training.
    ///
    /// # Errors
    /// The first fault of the settings or of a hand; [`TrainError::OtherSettings`] when a run in the directory has other
    /// settings.
    pub fn prepare(
        file: &SweepFile,
        base: &NewRun,
        directory: &Path,
        only: Option<usize>,
    ) -> Result<Sweep, TrainError> {
        if is_run(directory) {
            return Err(TrainError::RunExists { path: directory.to_owned() });
        }
        let mut sweep = Sweep::list(file, base, directory)?;
        for (position, member) in sweep.members.iter_mut().enumerate() {
            if only.is_some_and(|only| only != position) {
                continue;
            }
            member.job.refresh()?;
            if is_run(&member.job.run) {
                let (config, _) = resolve(&member.request)?;
                check_settings(&member.job.run, &config.settings()?, &["workers", "tensorboard"])?;
            }
        }
        Ok(sweep)
    }

    /// Makes the directories, and writes which runs belong to which variant, for the reports.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn write_studies(&self) -> Result<(), TrainError> {
        for study in self.studies() {
            create_directory(&study)?;
            json_file::write(&study.join(STUDY), &self.study(&study))?;
        }
        Ok(())
    }

    /// Returns the directory of each hand, which is a study.
    pub fn studies(&self) -> Vec<PathBuf> {
        let hands: BTreeSet<&String> = self.variants.iter().map(|variant| &variant.hand).collect();
        hands.into_iter().map(|hand| self.directory.join(hand)).collect()
    }

    /// Says which runs in the directory of a hand belong to which variant.
    fn study(&self, directory: &Path) -> StudyFile {
        let variant = |(i, variant): (usize, &Variant)| StudyVariant {
            name: variant.name.clone(),
            title: variant.title.clone(),
            runs: self
                .members
                .iter()
                .filter(|member| member.variant == i)
                .map(|member| format!("{}-s{}", variant.name, member.seed))
                .collect(),
        };
        let own =
            self.variants.iter().enumerate().filter(|(_, variant)| self.directory.join(&variant.hand) == directory);
        let (varies, subject) = ("settings".to_owned(), "what its settings reach".to_owned());
        StudyFile { schema: 1, varies, subject, variants: own.map(variant).collect() }
    }

    fn list(file: &SweepFile, base: &NewRun, directory: &Path) -> Result<Sweep, TrainError> {
        let wrong = |key: &str, reason: String| TrainError::Option { option: format!("sweep file, {key}"), reason };
        let preset = match &file.preset {
            None => None,
            Some(name) => match Preset::ALL.into_iter().find(|preset| preset.name() == name) {
                Some(preset) => Some(preset),
                None => {
                    let names = Preset::ALL.map(|preset| preset.name()).join(", ");
                    return Err(wrong("preset", format!("expected one of {names}, got {name:?}")));
                }
            },
        };
        let assignment = |(key, value): (&String, &toml::Value)| format!("{key}={value}");
        let fixed: Vec<String> = file.settings.iter().map(assignment).collect();
        let combinations = file.combinations();
        let optional = |values: &[f64]| -> Vec<Option<f64>> {
            if values.is_empty() { vec![None] } else { values.iter().copied().map(Some).collect() }
        };
        let hands: Vec<Option<&String>> =
            if file.hands.is_empty() { vec![None] } else { file.hands.iter().map(Some).collect() };
        let (mut variants, mut requests) = (Vec::new(), Vec::new());
        for hand in hands {
            for lambda in optional(&file.lambdas) {
                for assignments in &combinations {
                    let own = assignments.iter().map(|(key, value)| assignment((key, value)));
                    let request = NewRun {
                        hand: hand.cloned().or_else(|| base.hand.clone()),
                        default_hand: true,
                        preset: preset.or(base.preset),
                        lambda,
                        episodes: file.episodes.or(base.episodes),
                        assignments: base.assignments.iter().chain(&fixed).cloned().chain(own).collect(),
                        ..base.clone()
                    };
                    let (config, hand) = resolve(&request)?;
                    let hand = hand.manifest.name.clone();
                    variants.push(Variant::of(hand, config.lambda, assignments));
                    requests.push(request);
                }
            }
        }
        let mut members = Vec::new();
        for &seed in &file.seeds {
            for (variant, request) in requests.iter().enumerate() {
                let name = format!("{}-s{seed}", variants[variant].name);
                let directory = directory.join(&variants[variant].hand);
                if members.iter().any(|member: &Member| member.job.run == directory.join(&name)) {
                    return Err(wrong("hands", format!("two of them have the name {}", variants[variant].hand)));
                }
                let request = NewRun { seed: Some(seed), out: Some(directory.join(&name)), ..request.clone() };
                let (config, _) = resolve(&request)?;
                check_stages(file, config.evaluation.every, config.episodes)
                    .map_err(|reason| wrong("halving", reason))?;
                let shown = format!("{}/{name}", variants[variant].hand);
                let job = Job { name: shown, ..Job::new(&directory, name, config.episodes) };
                members.push(Member { job, variant, seed, request });
            }
        }
        Ok(Sweep { directory: directory.to_owned(), file: file.clone(), variants, members })
    }

    /// Locks the directory, so that one process at a time trains its runs.
    ///
    /// # Errors
    /// [`TrainError::Locked`], [`TrainError::File`].
    pub fn lock(&self) -> Result<File, TrainError> {
        lock(&self.directory)
    }

    /// Number of stages; only the last trains runs to their end.
    pub fn stages(&self) -> usize {
        1 + self.file.halving.as_ref().map_or(0, |halving| halving.episodes.len())
    }

    /// Returns the runs of a stage that go on in it, each to the end of the stage, with their positions among the members.
    ///
    /// # Errors
    /// Those of the runs' files.
    pub fn jobs(&self, stage: usize) -> Result<Vec<(usize, Job)>, TrainError> {
        let going_on = self.going_on(stage)?;
        let going_on = |position: &usize| going_on[self.members[*position].variant];
        (0..self.members.len()).filter(going_on).map(|position| Ok((position, self.job_of(stage, position)?))).collect()
    }

    /// Returns the run at a position, to the end of a stage; none if it does not go on in it.
    ///
    /// # Errors
    /// Those of its files, and of the metrics of the runs with which it competes.
    pub fn job(&self, stage: usize, position: usize) -> Result<Option<Job>, TrainError> {
        let goes_on = self.going_on(stage)?[self.members[position].variant];
        goes_on.then(|| self.job_of(stage, position)).transpose()
    }

    fn job_of(&self, stage: usize, position: usize) -> Result<Job, TrainError> {
        let until = self.file.halving.as_ref().and_then(|halving| halving.episodes.get(stage).copied());
        let mut job = Job { until, ..self.members[position].job.clone() };
        job.refresh()?;
        Ok(job)
    }

    /// Tells for each variant whether it goes on in a stage: in each stage before, it was among the best of its hand.
    fn going_on(&self, stage: usize) -> Result<Vec<bool>, TrainError> {
        let mut going_on = vec![true; self.variants.len()];
        let Some(halving) = &self.file.halving else { return Ok(going_on) };
        for &episodes in halving.episodes.iter().take(stage) {
            let scores = self.scores(episodes)?;
            let hands: BTreeSet<&String> = self.variants.iter().map(|variant| &variant.hand).collect();
            for hand in hands {
                let mut rivals: Vec<usize> =
                    (0..scores.len()).filter(|i| going_on[*i] && self.variants[*i].hand == *hand).collect();
                // The sort is stable, so the first of equals goes on.
                rivals.sort_by(|a, b| scores[*b].total_cmp(&scores[*a]));
                let kept = (halving.keep * rivals.len() as f64).ceil() as usize;
                rivals.iter().skip(kept.max(1)).for_each(|i| going_on[*i] = false);
            }
        }
        Ok(going_on)
    }

    /// Returns the mean success of each variant's runs at the last evaluation up to `episodes`; below 0 without one.
    fn scores(&self, episodes: u64) -> Result<Vec<f64>, TrainError> {
        let mut sums = vec![(0.0, 0_u32); self.variants.len()];
        for member in &self.members {
            let rows = read_metrics(&member.job.run)?;
            let last = rows.iter().rev().find(|row| row.episode <= episodes).and_then(|row| row.success_rate);
            let (sum, count) = &mut sums[member.variant];
            *sum += last.unwrap_or(-1.0);
            *count += 1;
        }
        Ok(sums.into_iter().map(|(sum, count)| sum / f64::from(count.max(1))).collect())
    }

    /// Returns runs in the directory that are none of this sweep.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn others(&self) -> Result<Vec<PathBuf>, TrainError> {
        let own = |run: &PathBuf| self.members.iter().any(|member| member.job.run == *run);
        let mut others = Vec::new();
        for study in self.studies() {
            others.extend(runs_in(&study)?.into_iter().filter(|run| !own(run)));
        }
        Ok(others)
    }
}

/// Tells why the stages do not fit a run; an evaluation has to be made in each.
fn check_stages(file: &SweepFile, every: u64, episodes: u64) -> Result<(), String> {
    let Some(halving) = &file.halving else { return Ok(()) };
    let first = halving.episodes.first().copied().unwrap_or(0);
    if every == 0 || first < every {
        return Err(format!(
            "the first stage ends after {first} episodes; expected an evaluation before (evaluation.every is {every})"
        ));
    }
    match halving.episodes.last() {
        Some(&last) if last >= episodes => {
            Err(format!("the last stage ends after {last} episodes; expected fewer than those of a run, {episodes}"))
        }
        _ => Ok(()),
    }
}

impl Variant {
    fn of(hand: String, lambda: f64, assignments: &Assignments) -> Variant {
        let settings: String = assignments.iter().map(|(key, value)| format!(", {key} {value}")).collect();
        Variant {
            name: format!("l{lambda}{}", name_of(assignments)),
            title: format!("lambda {lambda}{settings}"),
            hand,
            lambda,
            assignments: assignments.clone(),
        }
    }
}

/// `[("learner.gamma", 0.95)]` => `-gamma0.95`; what is too long or no part of a file's name ends with a digest
fn name_of(assignments: &Assignments) -> String {
    const LONGEST: usize = 60;
    const DIGITS: usize = 6;
    let one = |(key, value): &(String, toml::Value)| format!("-{}{value}", key.rsplit('.').next().unwrap_or(key));
    let whole: String = assignments.iter().map(one).collect();
    let is_plain = |c: &char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    let plain: String = whole.chars().filter(is_plain).take(LONGEST).collect();
    if plain == whole { plain } else { format!("{plain}-{}", &sha256(whole.as_bytes())[..DIGITS]) }
}

#[cfg(test)]
mod tests {
    use toml::Value;

    use super::name_of;

    #[test]
    fn a_variant_is_named_by_its_settings() {
        let of = |settings: &[(&str, Value)]| {
            name_of(&settings.iter().map(|(key, value)| ((*key).to_owned(), value.clone())).collect())
        };
        assert_eq!(of(&[]), "");
        assert_eq!(
            of(&[("learner.gamma", Value::Float(0.95)), ("synergy.components", Value::Integer(3))]),
            "-gamma0.95-components3"
        );
        let list = |name: &str| Value::Array(vec![Value::String(name.to_owned())]);
        let [cube, sphere] = ["cube", "sphere"].map(|name| of(&[("objects", list(name))]));
        assert!(cube.starts_with("-objectscube-") && sphere.starts_with("-objectssphere-"), "{cube} {sphere}");
        let long = of(&[("a", Value::String("x".repeat(300)))]);
        assert!(long.len() < 80, "{long}");
    }
}
