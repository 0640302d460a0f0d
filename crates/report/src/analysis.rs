//! Statistics of each run, of the runs of each lambda, and of the differences between lambdas.

use std::collections::BTreeMap;

use eigenhand_train::{MetricsRow, wilson_interval};

use crate::content::NUMBERS;
use crate::few_numbers::FewNumbers;
use crate::records::{
    Analysis, DifferenceRecord, LEVELS, LambdaRecord, LevelRecord, Quantity, Reached, RunRecord, objects,
};
use crate::run::Run;
use crate::spaces::SharedSpace;
use crate::statements;
use crate::stats::{Bootstrap, median};

/// Version of the keys of `report.json`.
const SCHEMA: u32 = 1;

/// Computes all numbers and sentences of a report.
pub fn analyse(runs: &[Run]) -> Analysis {
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
            few_numbers: FewNumbers::of(*lambda, i, &groups),
            content: BTreeMap::new(),
            quantities: bootstraps.iter().filter_map(|(q, b)| Some((q.key(), b.estimate(i)?))).collect(),
            contribution: Vec::new(),
            objects: BTreeMap::new(),
            levels: (0..LEVELS.len()).map(|level| LevelRecord::of(&groups[i], level)).collect(),
            space: SharedSpace::of(*lambda, &runs.iter().filter(|run| run.lambda == *lambda).collect::<Vec<_>>()),
        })
        .collect();
    let n_components = records.iter().map(|run| run.contribution.len()).max().unwrap_or(0);
    for component in 0..n_components {
        let bootstrap = over(&groups, |run| run.contribution.get(component).copied());
        summary.iter_mut().enumerate().for_each(|(i, l)| l.contribution.extend(bootstrap.estimate(i)));
    }
    for number in &NUMBERS {
        let bootstrap = over(&groups, |run| (number.of)(run.content.as_ref()?));
        summary.iter_mut().enumerate().for_each(|(i, l)| {
            l.content.extend(bootstrap.estimate(i).map(|estimate| (number.key, estimate)));
        });
    }
    for object in objects(&records) {
        let bootstrap = over(&groups, |run| run.success_rate_per_object.get(&object).copied());
        summary.iter_mut().enumerate().for_each(|(i, l)| {
            l.objects.extend(bootstrap.estimate(i).map(|estimate| (object.clone(), estimate)));
        });
    }
    let components = components(&records);
    let compared: Vec<(Quantity, Bootstrap)> = Quantity::COMPARED
        .into_iter()
        .filter(|quantity| !quantity.is_repeated(components))
        .map(|quantity| (quantity, over(&groups, |run| quantity.of(run))))
        .collect();
    let mut differences = Vec::new();
    for (i, lambda) in lambdas.iter().enumerate().skip(1) {
        for (quantity, bootstrap) in &compared {
            let Some(contrast) = bootstrap.contrast(0, i) else { continue };
            let n = |group: usize| groups[group].iter().filter(|run| quantity.of(run).is_some()).count();
            let mut record = DifferenceRecord {
                quantity: *quantity,
                baseline: lambdas[0],
                lambda: *lambda,
                n_runs: [n(0), n(i)],
                contrast,
                verdict: contrast.verdict(),
                statement: String::new(),
            };
            record.statement = statements::difference(&record, components);
            differences.push(record);
        }
    }
    let mut analysis = Analysis {
        schema: SCHEMA,
        hand: runs.first().map(|run| run.provenance.hand.clone()).unwrap_or_default(),
        components,
        runs: records,
        lambdas: summary,
        differences,
        statements: Vec::new(),
        notes: statements::notes(runs),
    };
    analysis.statements = statements::all(&analysis);
    analysis
}

impl RunRecord {
    pub(crate) fn of(run: &Run) -> RunRecord {
        let summary = run.summary.as_ref();
        let result = run.result();
        let last = |value: fn(&MetricsRow) -> Option<f64>| run.metrics.last().and_then(value);
        RunRecord {
            run: run.name.clone(),
            lambda: run.lambda,
            seed: run.seed,
            state: match (result, summary) {
                (Some(_), _) => "complete",
                (None, Some(_)) => "interrupted",
                (None, None) => "unfinished",
            },
            episodes: summary.map(|s| s.episodes).or(run.metrics.last().map(|row| row.episode)).unwrap_or(0),
            wall_s: summary.map(|s| s.wall_s).or(last(|row| row.wall_s)),
            success_rate: result.and_then(|s| s.success_rate),
            success_interval: result
                .and_then(|s| (s.eval_episodes > 0).then_some(wilson_interval(s.eval_successes?, s.eval_episodes))),
            eval_episodes: result.map_or(0, |s| s.eval_episodes),
            success_rate_per_object: result.map(|s| s.success_rate_per_object.clone()).unwrap_or_default(),
            components: run.components,
            success_with_components: result.map(|s| s.success_with_components.clone()).unwrap_or_default(),
            k_for_95: result.and_then(|s| s.k_for_95),
            other_objects_success_rate: result.and_then(|s| Some(s.other_objects.as_ref()?.success_rate)),
            other_objects_success_with_components: result
                .and_then(|s| s.other_objects.as_ref()?.success_with_components),
            contribution: summary.map(|s| s.contribution.clone()).unwrap_or_default(),
            contribution_sum: summary.map_or_else(|| last(|row| row.contribution_sum), |s| s.contribution_sum),
            contribution_change: contribution_change(run),
            mean_error_rad: summary.and_then(|s| s.mean_error_rad),
            n_postures: summary.map(|s| s.n_postures).or(last(|row| row.n_postures).map(|n| n as u64)).unwrap_or(0),
            mean_penetration_m: result.and_then(|s| s.mean_penetration_m),
            mean_self_penetration_m: result.and_then(|s| s.mean_self_penetration_m),
            content: result.and_then(|s| s.content.clone()),
            stress: run.stress.clone(),
            policy_episode: result.map(|s| s.policy_episode),
            reached: LEVELS.iter().map(|level| reached(run, *level)).collect(),
        }
    }
}

impl LevelRecord {
    pub(crate) fn of(group: &[&RunRecord], level: usize) -> LevelRecord {
        let reached: Vec<Option<Reached>> = group.iter().map(|run| run.reached.get(level).copied().flatten()).collect();
        // A run that never reached the level counts as slower than all that did.
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

pub(crate) fn over(groups: &[Vec<&RunRecord>], value: impl Fn(&RunRecord) -> Option<f64>) -> Bootstrap {
    Bootstrap::new(groups.iter().map(|group| group.iter().filter_map(|run| value(run)).collect()).collect())
}

/// Returns the configured number of components, if all runs agree.
fn components(runs: &[RunRecord]) -> Option<usize> {
    let first = runs.first()?.components;
    runs.iter().all(|run| run.components == first).then_some(first)
}

/// Returns the lambdas, ascending.
fn lambdas(runs: &[RunRecord]) -> Vec<f64> {
    let mut lambdas: Vec<f64> = runs.iter().map(|run| run.lambda).collect();
    lambdas.sort_by(f64::total_cmp);
    lambdas.dedup();
    lambdas
}

fn reached(run: &Run, level: f64) -> Option<Reached> {
    let row = run.metrics.iter().find(|row| row.success_rate.is_some_and(|rate| rate >= level))?;
    Some(Reached { episodes: row.episode as f64, wall_s: row.wall_s? })
}

fn contribution_change(run: &Run) -> Option<f64> {
    let first = run.start_after as f64;
    let enough = run.metrics.iter().filter(|row| row.n_postures.is_some_and(|n| n > first));
    let sums: Vec<f64> = enough.filter_map(|row| row.contribution_sum).collect();
    (sums.len() > 1).then(|| sums[sums.len() - 1] - sums[0])
}
