//! Reading runs from their directories, for a report.

use std::path::{Path, PathBuf};

use eigenhand_synergy::{Import, PostureDatabase, Synergy, SynergyError, newest};
use eigenhand_train::config::{ConfigError, Settings};
use eigenhand_train::{
    DATABASE, MetricsRow, PICTURES, Provenance, SYNERGY, Stress, Summary, TrainError, is_run, read_metrics,
    read_provenance, read_settings, runs,
};

use crate::ReportError;

/// The page in which the numbers of a run are moved, as `explore` names it.
pub(crate) const EXPLORER: &str = "explore.html";
/// A small picture of a run's grasps, as `render` names it.
const PICTURE: &str = "overview.png";

/// A run, finished or not.
#[derive(Clone, Debug)]
pub struct Run {
    /// Its directory.
    pub path: PathBuf,
    /// The directory's own name.
    pub name: String,
    /// How far training confined the policy to its synergy.
    pub lambda: f64,
    /// Seed.
    pub seed: u64,
    /// Training episodes in all.
    pub episodes: u64,
    /// Principal components of its synergy.
    pub components: usize,
    /// The synergy's feedback starts above this number of postures.
    pub start_after: u64,
    /// All its settings.
    pub settings: Settings,
    /// Versions, machine and hand at its start.
    pub provenance: Provenance,
    /// Its results; none before it has ended or was interrupted.
    pub summary: Option<Summary>,
    /// Whether an earlier version trained the run, so that its results lack success with few numbers, or its postures
    /// cannot be read.
    pub is_earlier: bool,
    /// What its grasps endure; none before `eval --stress`.
    pub stress: Option<Stress>,
    /// Its evaluations during training.
    pub metrics: Vec<MetricsRow>,
    /// Its control synergy, and the commands to which it was fitted; none if it has none.
    pub control: Option<Import>,
    /// Why its control synergy cannot be read, if there is one that cannot.
    pub control_error: Option<String>,
    /// Share of the variance of its end postures in the first component, in the first two, and so on; empty like
    /// [`errors`](Self::errors).
    pub end_variance: Vec<f64>,
    /// A picture of its grasps as PNG; none if it was not drawn.
    pub picture: Option<Vec<u8>>,
    /// The page that `explore` made of it; none if it was not made.
    pub explorer: Option<Vec<u8>>,
    /// Approximation error of every posture that its synergy covers, ascending; empty if an earlier version stored them.
    pub errors: Vec<f64>,
}

impl Run {
    /// Reads the run in a directory.
    ///
    /// # Errors
    /// [`ReportError::Train`] when a file is missing or damaged.
    pub fn read(path: &Path) -> Result<Run, ReportError> {
        let settings = read_settings(path)?;
        let episodes = setting(path, &settings, "episodes")?;
        let components = setting(path, &settings, "synergy.components")?;
        let (summary, is_earlier) = read_summary(path, components)?;
        let metrics = read_metrics(path)?;
        let complete = summary.as_ref().is_some_and(Summary::is_complete);
        if complete && metrics.is_empty() && episodes >= setting::<u64>(path, &settings, "evaluation.every")? {
            return Err(ReportError::Train(TrainError::Damaged {
                path: path.join("metrics.csv"),
                reason: "the run is complete, but this file holds no evaluation".to_owned(),
                mend: "restore this file, or leave the run out of the report".to_owned(),
            }));
        }
        let window = setting(path, &settings, "synergy.window")?;
        let (Ends { errors, variance }, is_earlier) = match ends(&path.join(DATABASE), components, window) {
            Err(error) if is_of_earlier_version(&error) => (Ends::default(), true),
            ends => (ends.map_err(TrainError::from)?, is_earlier),
        };
        let directory = path.join(SYNERGY);
        let (control, control_error) = match directory.is_dir().then(|| eigenhand_synergy::import(&directory)) {
            None => (None, None),
            Some(Ok(control)) => (Some(control), None),
            Some(Err(error)) => (None, Some(error.to_string())),
        };
        let name = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        Ok(Run {
            name: name.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
            provenance: read_provenance(path)?,
            path: path.to_owned(),
            lambda: setting(path, &settings, "lambda")?,
            seed: setting(path, &settings, "seed")?,
            episodes,
            components,
            start_after: setting(path, &settings, "synergy.start_after")?,
            settings,
            summary,
            is_earlier,
            stress: Stress::read(path)?,
            metrics,
            control,
            control_error,
            end_variance: variance,
            picture: std::fs::read(path.join(PICTURES).join(PICTURE)).ok(),
            explorer: std::fs::read(path.join(EXPLORER)).ok(),
            errors,
        })
    }

    /// Returns the results of the run, if it was trained and evaluated to its end.
    pub fn result(&self) -> Option<&Summary> {
        self.summary.as_ref().filter(|summary| summary.is_complete())
    }

    /// Returns a curve over the evaluations during training, such as the success rate over the episodes. Evaluations
    /// without one of the two numbers are left out.
    pub fn curve(
        &self,
        x: impl Fn(&MetricsRow) -> Option<f64>,
        y: impl Fn(&MetricsRow) -> Option<f64>,
    ) -> Vec<(f64, f64)> {
        self.metrics.iter().filter_map(|row| x(row).zip(y(row))).collect()
    }
}

/// Reads the results of a run, and tells whether an earlier version wrote them.
fn read_summary(run: &Path, components: usize) -> Result<(Option<Summary>, bool), TrainError> {
    match Summary::read(run) {
        Err(error) => earlier_summary(run, components).map(|summary| (Some(summary), true)).ok_or(error),
        Ok(summary) => Ok((summary, false)),
    }
}

/// Reads results that lack success with few numbers and are otherwise sound.
fn earlier_summary(run: &Path, components: usize) -> Option<Summary> {
    let text = std::fs::read_to_string(run.join("summary.json")).ok()?;
    let mut value: serde_json::Value = serde_json::from_str(&text).ok()?;
    let keys = value.as_object_mut()?;
    keys.entry("components").or_insert_with(|| components.into());
    keys.entry("success_with_components").or_insert_with(|| Vec::<f64>::new().into());
    serde_json::from_value(value).ok()
}

fn setting<T: std::str::FromStr>(run: &Path, settings: &Settings, key: &str) -> Result<T, TrainError> {
    let value = settings.get(key);
    value.and_then(|value| value.parse().ok()).ok_or_else(|| {
        let reason = format!("{key} is {}; expected a number", value.map_or("absent", String::as_str));
        TrainError::Config(ConfigError::Value { origin: run.join("config.toml").display().to_string(), reason })
    })
}

/// Reads runs. Each path is a run directory, or a directory that contains run directories.
///
/// # Errors
/// [`ReportError::NoRuns`] for a path that is neither, [`ReportError::MixedHands`], and those of [`Run::read`].
pub fn read_runs(paths: &[PathBuf]) -> Result<Vec<Run>, ReportError> {
    let mut directories = Vec::new();
    for path in paths {
        if is_run(path) {
            directories.push(path.clone());
            continue;
        }
        let found = if path.is_dir() { runs::runs_in(path)? } else { Vec::new() };
        if found.is_empty() {
            return Err(ReportError::NoRuns { path: path.clone() });
        }
        directories.extend(found);
    }
    let mut seen = Vec::new();
    directories.retain(|path| {
        let complete = path.canonicalize().unwrap_or_else(|_| path.clone());
        let new = !seen.contains(&complete);
        seen.push(complete);
        new
    });
    let mut runs = directories.iter().map(|path| Run::read(path)).collect::<Result<Vec<_>, _>>()?;
    runs.sort_by(|a, b| a.lambda.total_cmp(&b.lambda).then(a.seed.cmp(&b.seed)).then(a.name.cmp(&b.name)));
    check_hands(&runs)?;
    if runs.iter().all(|run| run.metrics.is_empty() && run.result().is_none()) {
        let verb = if runs.len() == 1 { "the run has" } else { "the runs have" };
        return Err(ReportError::NothingYet { runs: verb.to_owned() });
    }
    Ok(runs)
}

fn check_hands(runs: &[Run]) -> Result<(), ReportError> {
    let Some(first) = runs.first() else { return Ok(()) };
    match runs.iter().find(|run| run.provenance.hand != first.provenance.hand) {
        None => Ok(()),
        Some(second) => Err(ReportError::MixedHands {
            first_run: first.path.clone(),
            first: first.provenance.hand.clone(),
            second_run: second.path.clone(),
            second: second.provenance.hand.clone(),
        }),
    }
}

/// Tells whether a file cannot be read because an earlier version wrote it.
fn is_of_earlier_version(error: &SynergyError) -> bool {
    match error {
        SynergyError::InFile { source, .. } => is_of_earlier_version(source),
        SynergyError::Schema { expected, got, .. } => got < expected,
        _ => false,
    }
}

/// Returns the complete run that succeeds most; of equal ones, the first.
pub(crate) fn best(runs: &[Run]) -> Option<&Run> {
    let success = |run: &&Run| run.result().and_then(|summary| summary.success_rate);
    let complete = runs.iter().filter(|run| success(run).is_some());
    complete.rev().max_by(|a, b| success(a).partial_cmp(&success(b)).unwrap_or(std::cmp::Ordering::Equal))
}

/// What the end postures of a run say.
#[derive(Default)]
struct Ends {
    /// The approximation error of each posture that the synergy covers, ascending.
    errors: Vec<f64>,
    /// Share of the variance in the first component, in the first two, and so on.
    variance: Vec<f64>,
}

/// Analyses the postures that the run's synergy covers; nothing while there is no synergy.
fn ends(database: &Path, components: usize, window: usize) -> Result<Ends, SynergyError> {
    if !database.exists() {
        return Ok(Ends::default());
    }
    let database = PostureDatabase::open_existing(database)?;
    let postures = database.policy_postures()?;
    let synergy = Synergy::fit_newest(database.joints(), &postures, components, window)?;
    let Some(synergy) = synergy else { return Ok(Ends::default()) };
    let mut errors: Vec<f64> = newest(&postures, window).iter().map(|posture| synergy.error(posture)).collect();
    errors.sort_by(f64::total_cmp);
    let (total, mut so_far) = (synergy.total_variance(), 0.0);
    let share = |eigenvalue: &f64| {
        so_far += eigenvalue / total;
        so_far
    };
    // Postures that do not vary have no shares.
    let variance = if total > 0.0 { synergy.eigenvalues().iter().map(share).collect() } else { Vec::new() };
    Ok(Ends { errors, variance })
}
