//! The CSV files of a report: one with a row for each run, one with a row for each quantity of each lambda.

use crate::ReportError;
use crate::content::NUMBERS;
use crate::records::{Analysis, LEVELS, RunRecord};
use crate::stats::Estimate;

/// Name of the file with one row for each run.
pub const RUNS: &str = "runs.csv";
/// Name of the file with the estimates for each lambda.
pub const LAMBDAS: &str = "lambdas.csv";

/// Writes one row for each run; missing numbers are left empty.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn runs(analysis: &Analysis) -> Result<Vec<u8>, ReportError> {
    let n_components = analysis.runs.iter().map(|run| run.contribution.len()).max().unwrap_or(0);
    let n_few = analysis.runs.iter().map(|run| run.success_with_components.len()).max().unwrap_or(0);
    let objects = analysis.objects();
    let mut header: Vec<String> = [
        "lambda",
        "seed",
        "success_rate",
        "contribution_sum",
        "n_postures",
        "episodes",
        "wall_s",
        "run",
        "state",
        "success_rate_low",
        "success_rate_high",
        "eval_episodes",
        "mean_error_rad",
        "contribution_change",
        "mean_penetration_m",
        "policy_episode",
        "components",
        "k_for_95",
        "mean_self_penetration_m",
        "other_objects_success_rate",
        "other_objects_success_with_components",
    ]
    .map(str::to_owned)
    .to_vec();
    header.extend((1..=n_components).map(|i| format!("contribution_{i}")));
    header.extend((0..n_few).map(|k| format!("success_with_{k}")));
    header.extend(NUMBERS.iter().map(|number| format!("content_{}", number.key)));
    header.extend(objects.iter().map(|object| format!("success_rate_{object}")));
    for level in LEVELS {
        let percent = 100.0 * level;
        header.extend([format!("episodes_to_{percent:.0}_percent"), format!("wall_s_to_{percent:.0}_percent")]);
    }
    let row = |run: &RunRecord| {
        let number = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
        let mut row = vec![
            run.lambda.to_string(),
            run.seed.to_string(),
            number(run.success_rate),
            number(run.contribution_sum),
            run.n_postures.to_string(),
            run.episodes.to_string(),
            number(run.wall_s),
            run.run.clone(),
            run.state.to_owned(),
            number(run.success_interval.map(|[low, _]| low)),
            number(run.success_interval.map(|[_, high]| high)),
            run.eval_episodes.to_string(),
            number(run.mean_error_rad),
            number(run.contribution_change),
            number(run.mean_penetration_m),
            run.policy_episode.map(|episode| episode.to_string()).unwrap_or_default(),
            run.components.to_string(),
            run.k_for_95.map(|k| k.to_string()).unwrap_or_default(),
            number(run.mean_self_penetration_m),
            number(run.other_objects_success_rate),
            number(run.other_objects_success_with_components),
        ];
        row.extend((0..n_components).map(|i| number(run.contribution.get(i).copied())));
        row.extend((0..n_few).map(|k| number(run.success_with_components.get(k).copied())));
        row.extend(NUMBERS.iter().map(|held| number(run.content.as_ref().and_then(held.of))));
        row.extend(objects.iter().map(|object| number(run.success_rate_per_object.get(object).copied())));
        for reached in &run.reached {
            row.extend([number(reached.map(|r| r.episodes)), number(reached.map(|r| r.wall_s))]);
        }
        row
    };
    write(RUNS, &header, analysis.runs.iter().map(row))
}

/// Writes one row for each quantity of each lambda.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn lambdas(analysis: &Analysis) -> Result<Vec<u8>, ReportError> {
    let header = ["lambda", "quantity", "n_runs", "interquartile_mean", "low", "high", "median", "min", "max"];
    let mut rows = Vec::new();
    for lambda in &analysis.lambdas {
        let mut add = |quantity: &str, estimate: &Estimate| {
            let [low, high] = estimate.interval.map_or_else(Default::default, |i| i.map(|end| end.to_string()));
            let mut row = vec![lambda.lambda.to_string(), quantity.to_owned(), estimate.n.to_string()];
            row.extend([estimate.iqm.to_string(), low, high]);
            row.extend([estimate.median, estimate.min, estimate.max].map(|value| value.to_string()));
            rows.push(row);
        };
        lambda.quantities.iter().for_each(|(quantity, estimate)| add(quantity, estimate));
        lambda.contribution.iter().enumerate().for_each(|(i, e)| add(&format!("contribution_{}", i + 1), e));
        let few_numbers = lambda.few_numbers.iter().flat_map(|few| few.success.iter().enumerate());
        few_numbers.for_each(|(k, e)| add(&format!("success_with_{k}"), e));
        lambda.content.iter().for_each(|(key, e)| add(&format!("content_{key}"), e));
        lambda.objects.iter().for_each(|(object, e)| add(&format!("success_rate_{object}"), e));
    }
    write(LAMBDAS, &header.map(str::to_owned), rows)
}

pub(crate) fn write(
    name: &str,
    header: &[String],
    rows: impl IntoIterator<Item = Vec<String>>,
) -> Result<Vec<u8>, ReportError> {
    let failed = ReportError::draw(name);
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header).map_err(|error| failed(error.to_string()))?;
    for row in rows {
        writer.write_record(row).map_err(|error| failed(error.to_string()))?;
    }
    writer.into_inner().map_err(|error| failed(error.to_string()))
}
