//! Runs in numbers: each by itself, together for each lambda, and the lambdas against one another.

use std::collections::BTreeMap;

use eigenhand_train::wilson_interval;
use serde::Serialize;

use crate::run::Run;
use crate::statements;
use crate::stats::{Bootstrap, Contrast, Estimate, median};

/// Version of the keys of `report.json`.
const SCHEMA: u32 = 1;
/// Success rates of which it is said when a run first reached them.
pub const LEVELS: [f64; 3] = [0.5, 0.7, 0.9];

/// What a report says, as `report.json` has it.
#[derive(Clone, Debug, Serialize)]
pub struct Analysis {
    /// Version of these keys.
    pub schema: u32,
    /// Name of the hand.
    pub hand: String,
    /// Every run, by lambda and seed.
    pub runs: Vec<RunRecord>,
    /// The runs of each lambda together.
    pub lambdas: Vec<LambdaRecord>,
    /// Each other lambda against the least.
    pub differences: Vec<DifferenceRecord>,
    /// What the numbers support, in words.
    pub statements: Vec<String>,
    /// What a reader has to know before trusting them.
    pub notes: Vec<String>,
}

/// One run.
#[derive(Clone, Debug, Serialize)]
pub struct RunRecord {
    /// Name of its directory.
    pub run: String,
    /// Weight of the synergy's feedback.
    pub lambda: f64,
    /// Seed.
    pub seed: u64,
    /// `complete`, `interrupted` or `unfinished`.
    pub state: &'static str,
    /// Training episodes so far.
    pub episodes: u64,
    /// Wall time so far in s.
    pub wall_s: Option<f64>,
    /// Success rate of the final evaluation.
    pub success_rate: Option<f64>,
    /// Its 95 % interval (Wilson 1927), over the episodes of that evaluation.
    pub success_interval: Option<[f64; 2]>,
    /// Episodes of that evaluation.
    pub eval_episodes: u64,
    /// The same for each object.
    pub success_rate_per_object: BTreeMap<String, f64>,
    /// Contribution rate of each component.
    pub contribution: Vec<f64>,
    /// Their sum.
    pub contribution_sum: Option<f64>,
    /// What the sum gained from the first evaluation with enough postures for feedback to the last.
    pub contribution_change: Option<f64>,
    /// Mean approximation error over the postures that the synergy is of, in rad.
    pub mean_error_rad: Option<f64>,
    /// Postures in the database.
    pub n_postures: u64,
    /// Mean penetration in the final evaluation's successes, in m.
    pub mean_penetration_m: Option<f64>,
    /// Training episodes before the policy that is the result.
    pub policy_episode: Option<u64>,
    /// First evaluation that reached each of [`LEVELS`].
    pub reached: Vec<Option<Reached>>,
}

/// An evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Reached {
    /// Training episodes before it.
    pub episodes: f64,
    /// Wall time before it, in s.
    pub wall_s: f64,
}

/// The runs of one lambda.
#[derive(Clone, Debug, Serialize)]
pub struct LambdaRecord {
    /// Weight of the synergy's feedback.
    pub lambda: f64,
    /// Runs.
    pub n_runs: usize,
    /// Those that are complete; all that follows is over them.
    pub n_complete: usize,
    /// By the name of the quantity.
    pub quantities: BTreeMap<&'static str, Estimate>,
    /// Contribution rate of each component.
    pub contribution: Vec<Estimate>,
    /// Success rate for each object.
    pub objects: BTreeMap<String, Estimate>,
    /// For each of [`LEVELS`].
    pub levels: Vec<LevelRecord>,
}

/// When the runs of a lambda first reached a success rate.
#[derive(Clone, Debug, Serialize)]
pub struct LevelRecord {
    /// The success rate.
    pub success_rate: f64,
    /// Complete runs that reached it.
    pub n_reached: usize,
    /// Median of the training episodes before, where more than half of the runs reached it.
    pub median_episodes: Option<f64>,
    /// The same of wall time in s.
    pub median_wall_s: Option<f64>,
}

/// A quantity at one lambda against another.
#[derive(Clone, Debug, Serialize)]
pub struct DifferenceRecord {
    /// The quantity.
    pub quantity: Quantity,
    /// The least lambda.
    pub baseline: f64,
    /// The other.
    pub lambda: f64,
    /// Complete runs of both.
    pub n_runs: [usize; 2],
    /// How much more the other has.
    #[serde(flatten)]
    pub contrast: Contrast,
    /// What that supports, in words.
    pub statement: String,
}

/// What is estimated over the complete runs of a lambda.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Success rate of the final evaluation.
    SuccessRate,
    /// Sum of the contribution rates.
    ContributionSum,
    /// Change of that sum along training.
    ContributionChange,
    /// Mean approximation error over the postures that the synergy is of.
    MeanErrorRad,
    /// Postures in the database.
    NPostures,
    /// Mean penetration.
    MeanPenetrationM,
    /// Wall time.
    WallS,
}

impl Quantity {
    /// All of them.
    pub const ALL: [Quantity; 7] = [
        Quantity::SuccessRate,
        Quantity::ContributionSum,
        Quantity::ContributionChange,
        Quantity::MeanErrorRad,
        Quantity::NPostures,
        Quantity::MeanPenetrationM,
        Quantity::WallS,
    ];
    /// Those in which lambdas are compared.
    pub const COMPARED: [Quantity; 4] =
        [Quantity::SuccessRate, Quantity::ContributionSum, Quantity::ContributionChange, Quantity::MeanErrorRad];

    /// Returns the name in files.
    pub fn key(self) -> &'static str {
        match self {
            Quantity::SuccessRate => "success_rate",
            Quantity::ContributionSum => "contribution_sum",
            Quantity::ContributionChange => "contribution_change",
            Quantity::MeanErrorRad => "mean_error_rad",
            Quantity::NPostures => "n_postures",
            Quantity::MeanPenetrationM => "mean_penetration_m",
            Quantity::WallS => "wall_s",
        }
    }

    /// Returns a run's value.
    pub fn of(self, run: &RunRecord) -> Option<f64> {
        match self {
            Quantity::SuccessRate => run.success_rate,
            Quantity::ContributionSum => run.contribution_sum,
            Quantity::ContributionChange => run.contribution_change,
            Quantity::MeanErrorRad => run.mean_error_rad,
            Quantity::NPostures => Some(run.n_postures as f64),
            Quantity::MeanPenetrationM => run.mean_penetration_m,
            Quantity::WallS => run.wall_s,
        }
    }
}

impl Analysis {
    /// Computes everything that a report says in numbers and words.
    pub fn of(runs: &[Run]) -> Analysis {
        let records: Vec<RunRecord> = runs.iter().map(RunRecord::of).collect();
        let lambdas = lambdas(&records);
        let groups: Vec<Vec<&RunRecord>> = lambdas
            .iter()
            .map(|lambda| records.iter().filter(|run| run.lambda == *lambda && run.is_complete()).collect())
            .collect();
        let bootstraps = Quantity::ALL.map(|quantity| (quantity, over(&groups, |run| quantity.of(run))));
        let mut summary: Vec<LambdaRecord> = lambdas
            .iter()
            .enumerate()
            .map(|(i, lambda)| LambdaRecord {
                lambda: *lambda,
                n_runs: records.iter().filter(|run| run.lambda == *lambda).count(),
                n_complete: groups[i].len(),
                quantities: bootstraps.iter().filter_map(|(q, b)| Some((q.key(), b.estimate(i)?))).collect(),
                contribution: Vec::new(),
                objects: BTreeMap::new(),
                levels: (0..LEVELS.len()).map(|level| LevelRecord::of(&groups[i], level)).collect(),
            })
            .collect();
        let n_components = records.iter().map(|run| run.contribution.len()).max().unwrap_or(0);
        for component in 0..n_components {
            let bootstrap = over(&groups, |run| run.contribution.get(component).copied());
            summary.iter_mut().enumerate().for_each(|(i, l)| l.contribution.extend(bootstrap.estimate(i)));
        }
        for object in objects(&records) {
            let bootstrap = over(&groups, |run| run.success_rate_per_object.get(&object).copied());
            summary.iter_mut().enumerate().for_each(|(i, l)| {
                l.objects.extend(bootstrap.estimate(i).map(|estimate| (object.clone(), estimate)));
            });
        }
        let mut differences = Vec::new();
        for (i, lambda) in lambdas.iter().enumerate().skip(1) {
            for (quantity, bootstrap) in bootstraps.iter().filter(|(q, _)| Quantity::COMPARED.contains(q)) {
                let Some(contrast) = bootstrap.contrast(0, i) else { continue };
                let n = |group: usize| groups[group].iter().filter(|run| quantity.of(run).is_some()).count();
                let mut record = DifferenceRecord {
                    quantity: *quantity,
                    baseline: lambdas[0],
                    lambda: *lambda,
                    n_runs: [n(0), n(i)],
                    contrast,
                    statement: String::new(),
                };
                record.statement = statements::difference(&record);
                differences.push(record);
            }
        }
        let mut analysis = Analysis {
            schema: SCHEMA,
            hand: runs.first().map(|run| run.provenance.hand.clone()).unwrap_or_default(),
            runs: records,
            lambdas: summary,
            differences,
            statements: Vec::new(),
            notes: statements::notes(runs),
        };
        analysis.statements = statements::all(&analysis);
        analysis
    }

    /// Returns the names of the objects that the runs evaluated.
    pub fn objects(&self) -> Vec<String> {
        objects(&self.runs)
    }
}

impl RunRecord {
    fn of(run: &Run) -> RunRecord {
        let summary = run.summary.as_ref();
        let result = run.result();
        let last = |column: &str| run.metrics.column(column).last().copied().flatten();
        RunRecord {
            run: run.name.clone(),
            lambda: run.lambda,
            seed: run.seed,
            state: match (result, summary) {
                (Some(_), _) => "complete",
                (None, Some(_)) => "interrupted",
                (None, None) => "unfinished",
            },
            episodes: summary.map(|s| s.episodes).or(last("episode").map(|e| e as u64)).unwrap_or(0),
            wall_s: summary.map(|s| s.wall_s).or(last("wall_s")),
            success_rate: result.and_then(|s| s.success_rate),
            success_interval: result.and_then(|s| {
                let successes = (s.success_rate? * s.eval_episodes as f64).round() as u64;
                (s.eval_episodes > 0).then(|| wilson_interval(successes, s.eval_episodes))
            }),
            eval_episodes: result.map_or(0, |s| s.eval_episodes),
            success_rate_per_object: result.map(|s| s.success_rate_per_object.clone()).unwrap_or_default(),
            contribution: summary.map(|s| s.contribution.clone()).unwrap_or_default(),
            contribution_sum: summary.map_or_else(|| last("contribution_sum"), |s| s.contribution_sum),
            contribution_change: contribution_change(run),
            mean_error_rad: summary.and_then(|s| s.mean_error_rad),
            n_postures: summary.map(|s| s.n_postures).or(last("n_postures").map(|n| n as u64)).unwrap_or(0),
            mean_penetration_m: result.and_then(|s| s.mean_penetration_m),
            policy_episode: result.map(|s| s.policy_episode),
            reached: LEVELS.iter().map(|level| reached(run, *level)).collect(),
        }
    }

    /// Tells whether the run was trained and evaluated to its end.
    pub fn is_complete(&self) -> bool {
        self.state == "complete"
    }
}

impl LevelRecord {
    fn of(group: &[&RunRecord], level: usize) -> LevelRecord {
        let reached: Vec<Option<Reached>> = group.iter().map(|run| run.reached.get(level).copied().flatten()).collect();
        // A run that never reached it took longer than any that did.
        let middle = |value: fn(Reached) -> f64| {
            let times: Vec<f64> = reached.iter().map(|r| r.map_or(f64::INFINITY, value)).collect();
            median(&times).filter(|time| time.is_finite())
        };
        LevelRecord {
            success_rate: LEVELS[level],
            n_reached: reached.iter().flatten().count(),
            median_episodes: middle(|r| r.episodes),
            median_wall_s: middle(|r| r.wall_s),
        }
    }
}

fn over(groups: &[Vec<&RunRecord>], value: impl Fn(&RunRecord) -> Option<f64>) -> Bootstrap {
    Bootstrap::new(groups.iter().map(|group| group.iter().filter_map(|run| value(run)).collect()).collect())
}

/// Returns the lambdas, ascending.
fn lambdas(runs: &[RunRecord]) -> Vec<f64> {
    let mut lambdas: Vec<f64> = runs.iter().map(|run| run.lambda).collect();
    lambdas.sort_by(f64::total_cmp);
    lambdas.dedup();
    lambdas
}

fn objects(runs: &[RunRecord]) -> Vec<String> {
    let mut objects: Vec<String> = runs.iter().flat_map(|run| run.success_rate_per_object.keys().cloned()).collect();
    objects.sort();
    objects.dedup();
    objects
}

fn reached(run: &Run, level: f64) -> Option<Reached> {
    let position = run.metrics.column("success_rate").iter().position(|rate| rate.is_some_and(|r| r >= level))?;
    let at = |column: &str| run.metrics.column(column).get(position).copied().flatten();
    Some(Reached { episodes: at("episode")?, wall_s: at("wall_s")? })
}

fn contribution_change(run: &Run) -> Option<f64> {
    let first = run.start_after as f64;
    let sums: Vec<f64> =
        run.curve("n_postures", "contribution_sum").into_iter().filter(|(n, _)| *n > first).map(|(_, s)| s).collect();
    (sums.len() > 1).then(|| sums[sums.len() - 1] - sums[0])
}
