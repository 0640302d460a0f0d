//! Conclusions from the numbers, in plain sentences.

use std::collections::BTreeMap;

use eigenhand_train::config::differences;
use eigenhand_train::reproduce::VARIED;

use crate::records::{Analysis, DifferenceRecord, LambdaRecord, Quantity};
use crate::run::Run;
use crate::stats::{Contrast, FEWEST, SIGNIFICANT, Verdict};

/// With fewer runs, a sentence warns that an interval is too narrow.
const FEW: usize = 10;

/// Name and number format of a quantity.
pub(crate) struct Words {
    name: String,
    unit: &'static str,
    factor: f64,
    digits: usize,
}

impl Words {
    pub(crate) fn of(quantity: Quantity, components: Option<usize>) -> Words {
        let configured = components
            .map_or_else(|| "the configured components".to_owned(), |components| counted(components, "number"));
        let configured = format!("success with {configured}");
        let (name, unit, factor, digits) = match quantity {
            Quantity::SuccessRate => ("final success", "%", 100.0, 1),
            Quantity::OtherObjects => ("success with other objects", "%", 100.0, 1),
            Quantity::SuccessWithComponents => (configured.as_str(), "%", 100.0, 1),
            Quantity::SuccessWithOne => ("success with 1 number", "%", 100.0, 1),
            Quantity::SuccessWithTwo => ("success with 2 numbers", "%", 100.0, 1),
            Quantity::ContributionSum => ("the sum of the contribution rates", "%", 100.0, 1),
            Quantity::ContributionChange => ("the change of that sum along training", "points", 100.0, 1),
            Quantity::MeanErrorRad => ("the mean approximation error", "rad", 1.0, 3),
            Quantity::NPostures => ("the number of postures", "", 1.0, 0),
            Quantity::MeanPenetrationM => ("the mean penetration", "mm", 1000.0, 2),
            Quantity::MeanSelfPenetrationM => ("the mean penetration within the hand", "mm", 1000.0, 2),
            Quantity::WallS => ("wall time", "min", 1.0 / 60.0, 1),
        };
        Words { name: name.to_owned(), unit, factor, digits }
    }

    fn number(&self, value: f64) -> String {
        format!("{:.*}", self.digits, self.factor * value)
    }

    /// Writes a number with its sign, or without if it is rounded to zero. The minus is the typographic one.
    fn signed(&self, value: f64) -> String {
        let text = format!("{:+.*}", self.digits, self.factor * value);
        let nothing = !text.contains(|c: char| ('1'..='9').contains(&c));
        if nothing { text[1..].to_owned() } else { text.replace('-', "\u{2212}") }
    }

    /// Returns the unit of a difference.
    fn unit_of_difference(&self) -> &'static str {
        if self.unit == "%" { "percentage points" } else { self.unit }
    }
}

/// Says which conclusion a difference between two lambdas supports; `components` is the number that all runs have
/// configured.
pub fn difference(record: &DifferenceRecord, components: Option<usize>) -> String {
    let DifferenceRecord { baseline, lambda, contrast, n_runs, .. } = record;
    let sides = [format!("lambda {baseline}"), format!("lambda {lambda}")];
    conclusion(&Words::of(record.quantity, components), &sides, *n_runs, contrast)
}

/// Says which conclusion a difference between two groups of runs supports; `sides` names them.
pub(crate) fn conclusion(words: &Words, sides: &[String; 2], n_runs: [usize; 2], contrast: &Contrast) -> String {
    let ([baseline, other], [n_baseline, n]) = (sides, n_runs);
    let size = format!("{} {}", words.signed(contrast.difference), words.unit_of_difference());
    let head = format!(
        "From {baseline} ({}) to {other} ({}), {} differs by {size}",
        counted(n_baseline, "run"),
        counted(n, "run"),
        words.name
    );
    let Some([low, high]) = contrast.interval else {
        return format!(
            "{head}. With fewer than {FEWEST} runs on a side there is no interval, and nothing can be said about the \
             difference beyond these runs."
        );
    };
    let (low, high) = (words.signed(low), words.signed(high));
    let zero = if contrast.excludes_zero() == Some(true) { "excludes zero" } else { "contains zero" };
    let least = probability(contrast.permutation.least_p);
    let p = match probability(contrast.permutation.p) {
        small if small.starts_with('<') => format!("p {small}"),
        p => format!("p = {p}"),
    };
    let head = format!("{head}; the 95 % interval, {low} to {high}, {zero}");
    match contrast.verdict() {
        Verdict::TooFewForTest => format!(
            "{head}. More seeds are needed: with {n_baseline} against {} the permutation test cannot give a p below \
             {least} (here {p}), and {SIGNIFICANT} or more supports no difference.",
            counted(n, "run")
        ),
        Verdict::Greater => {
            format!("{head}, and the permutation test gives {p}: these runs support that it is greater with {other}.")
        }
        Verdict::Smaller => {
            format!("{head}, and the permutation test gives {p}: these runs support that it is smaller with {other}.")
        }
        Verdict::Open | Verdict::NoInterval => format!(
            "{head}, and the permutation test gives {p}: these runs do not show a difference, and do not show that \
             there is none."
        ),
        Verdict::Disagree if contrast.is_significant() && contrast.excludes_zero() == Some(true) => format!(
            "{head}, and the permutation test gives {p}, but the interquartile means and the means differ in \
             opposite directions: these runs do not settle which of the two is greater."
        ),
        Verdict::Disagree => format!(
            "{head}, but the permutation test gives {p}, {} {SIGNIFICANT}. The two disagree, so these runs do not \
             settle whether there is a difference; more seeds can.",
            if contrast.is_significant() { "below" } else { "not below" }
        ),
    }
}

/// Writes a probability with four decimals, without zeros at the end.
pub fn probability(p: f64) -> String {
    const LEAST: f64 = 0.0001;
    if p < LEAST {
        return format!("< {LEAST}");
    }
    let text = format!("{p:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Describes the results of each lambda, and the differences between lambdas.
pub fn all(analysis: &Analysis) -> Vec<String> {
    let few_numbers = |lambda: &LambdaRecord| Some(lambda.few_numbers.as_ref()?.statement.clone());
    let mut sentences: Vec<String> = analysis.lambdas.iter().filter_map(few_numbers).collect();
    sentences.extend(analysis.lambdas.iter().filter_map(level));
    sentences.extend(analysis.lambdas.iter().filter_map(|lambda| trend(analysis, lambda)));
    sentences.extend(analysis.lambdas.iter().filter_map(|lambda| Some(lambda.space.as_ref()?.statement.clone())));
    sentences.extend(analysis.differences.iter().map(|record| record.statement.clone()));
    let few = |lambda: &LambdaRecord| (FEWEST..FEW).contains(&lambda.n_complete);
    if analysis.lambdas.iter().any(few) {
        sentences.push(format!(
            "With fewer than {FEW} runs, a bootstrap interval is narrower than it should be. Therefore a difference counts \
             as supported only if the permutation test agrees with the interval."
        ));
    }
    sentences
}

fn level(lambda: &LambdaRecord) -> Option<String> {
    let words = Words::of(Quantity::SuccessRate, None);
    let estimate = lambda.quantities.get(Quantity::SuccessRate.key())?;
    let value = words.number(estimate.iqm);
    let head = format!("With lambda {}, final success is {value} %", lambda.lambda);
    if estimate.n == 1 {
        return Some(format!("{head} in one run; the variation between seeds is not known."));
    }
    let (least, most) = (words.number(estimate.min), words.number(estimate.max));
    let interval = match estimate.interval {
        Some([low, high]) => format!(", 95 % interval {} to {}", words.number(low), words.number(high)),
        None => String::new(),
    };
    Some(format!(
        "{head} (interquartile mean over {}{interval}); the runs lie between {least} and {most} %.",
        counted(estimate.n, "run")
    ))
}

/// Says whether the contribution rates rise or fall along training, which is the paper's other observation.
fn trend(analysis: &Analysis, lambda: &LambdaRecord) -> Option<String> {
    let changes: Vec<f64> = analysis
        .runs
        .iter()
        .filter(|run| run.lambda == lambda.lambda && run.is_complete())
        .filter_map(|run| run.contribution_change)
        .collect();
    if changes.is_empty() {
        return None;
    }
    let rising = changes.iter().filter(|change| **change > 0.0).count();
    let (n, falling) = (changes.len(), changes.len() - rising);
    let direction = match (rising, falling) {
        (1, 0) => "rises in the one run".to_owned(),
        (0, 1) => "falls in the one run".to_owned(),
        (_, 0) => format!("rises in all {n} runs"),
        (0, _) => format!("falls in all {n} runs"),
        _ => format!("rises in {rising} and falls in {falling} of {n} runs"),
    };
    let words = Words::of(Quantity::ContributionChange, None);
    let change = words.signed(lambda.quantities.get(Quantity::ContributionChange.key())?.iqm);
    Some(format!(
        "With lambda {}, the sum of the contribution rates {direction} from the first evaluation with enough postures for \
         feedback to the last ({change} points{}).",
        lambda.lambda,
        if n == 1 { "" } else { ", interquartile mean" }
    ))
}

/// Describes missing results and runs that do not fit together.
pub fn notes(runs: &[Run]) -> Vec<String> {
    let mut notes = Vec::new();
    for run in runs.iter().filter(|run| run.result().is_none()) {
        let done = run.metrics.last().map_or(0, |row| row.episode);
        notes.push(format!(
            "{} is not finished ({done} of {} episodes at its last evaluation): the report shows its curves, but its \
             results are missing.",
            run.name, run.episodes
        ));
    }
    for (run, error) in runs.iter().filter_map(|run| Some((run, run.control_error.as_ref()?))) {
        notes.push(format!("The control synergy of {} is left out: {error}.", run.name));
    }
    notes.extend(without_few_numbers(runs));
    let mut twins: BTreeMap<(String, u64), Vec<&str>> = BTreeMap::new();
    for run in runs {
        twins.entry((run.lambda.to_string(), run.seed)).or_default().push(&run.name);
    }
    for ((lambda, seed), names) in twins.into_iter().filter(|(_, names)| names.len() > 1) {
        notes.push(format!(
            "{} all have lambda {lambda} and seed {seed}: they are not independent runs.",
            names.join(", ")
        ));
    }
    let differing = differing_settings(runs);
    if !differing.is_empty() {
        let keys: Vec<&str> = differing.keys().map(String::as_str).collect();
        notes.push(format!(
            "The runs differ in more than lambda and seed ({}): a difference between lambdas may come from these settings.",
            keys.join(", ")
        ));
    }
    for (what, value) in [
        ("revisions of the source", (|run| &run.provenance.git_revision) as fn(&Run) -> &String),
        ("versions of the hand's files", |run| &run.provenance.hand_digest),
        ("versions of MuJoCo", |run| &run.provenance.mujoco_version),
    ] {
        let mut values: Vec<&String> = runs.iter().map(value).collect();
        values.sort();
        values.dedup();
        if values.len() > 1 {
            notes.push(format!("The runs were made with {} different {what}.", values.len()));
        }
    }
    notes
}

/// Names the complete runs without success with few numbers, or without an account of their grasps.
fn without_few_numbers(runs: &[Run]) -> Vec<String> {
    let mut notes = Vec::new();
    for run in runs {
        let Some(result) = run.result() else { continue };
        let name = &run.name;
        if run.is_earlier {
            let errors =
                if run.errors.is_empty() { ", and so does the distribution of the approximation error" } else { "" };
            notes.push(format!(
                "{name} was trained by an earlier version of this program, without success with few numbers: everything on \
                 few numbers and on what the grasps hold leaves it out{errors}."
            ));
            continue;
        }
        if result.success_with_components.is_empty() {
            notes.push(format!(
                "{name} has no success with few numbers, because it has too few successes for a control synergy: \
                 everything on few numbers leaves it out."
            ));
        }
        if result.content.is_none() {
            notes.push(format!(
                "{name} has too little success to say what its grasps hold: everything on that leaves it out."
            ));
        }
    }
    notes
}

/// Returns the settings that differ between runs, with the value of each run; without lambda, seed and workers.
pub fn differing_settings(runs: &[Run]) -> BTreeMap<String, Vec<String>> {
    let Some(first) = runs.first() else { return BTreeMap::new() };
    let keys = runs.iter().flat_map(|run| differences(&first.settings, &run.settings).into_iter().map(|(key, ..)| key));
    keys.filter(|key| !VARIED.contains(key))
        .map(|key| {
            let value = |run: &Run| run.settings.get(key).cloned().unwrap_or_else(|| "absent".to_owned());
            (key.to_owned(), runs.iter().map(value).collect())
        })
        .collect()
}

/// `1 run`, or `2 runs`.
pub fn counted(n: impl std::fmt::Display, what: &str) -> String {
    let n = n.to_string();
    let plural = if n == "1" { "" } else { "s" };
    format!("{n} {what}{plural}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::permutation::Permutation;
    use crate::stats::Contrast;

    /// Interval, difference of means, p, least p.
    type Numbers = (Option<[f64; 2]>, f64, f64, f64);

    fn statement(difference: f64, (interval, difference_of_means, p, least_p): Numbers) -> String {
        let permutation = Permutation { difference_of_means, p, least_p, n_relabellings: 252, exact: true };
        let contrast = Contrast { difference, interval, permutation };
        let record = DifferenceRecord {
            quantity: Quantity::SuccessRate,
            baseline: 0.0,
            lambda: 0.5,
            n_runs: [5, 1],
            contrast,
            verdict: contrast.verdict(),
            statement: String::new(),
        };
        super::difference(&record, None)
    }

    #[test]
    fn a_sentence_says_what_interval_and_test_support() {
        let head = "From lambda 0 (5 runs) to lambda 0.5 (1 run), final success differs by ";
        let (above, below, around) = (Some([0.01, 0.052]), Some([-0.05, -0.001]), Some([-0.01, 0.05]));
        let least = 0.007_936_5;
        for (difference, numbers, rest) in [
            (
                0.0312,
                (above, 0.03, least, least),
                "+3.1 percentage points; the 95 % interval, +1.0 to +5.2, excludes zero, and the permutation test gives \
                 p = 0.0079: these runs support that it is greater with lambda 0.5.",
            ),
            (
                -0.0312,
                (below, -0.03, 0.000_02, 0.000_01),
                "\u{2212}3.1 percentage points; the 95 % interval, \u{2212}5.0 to \u{2212}0.1, excludes zero, and the \
                 permutation test gives p < 0.0001: these runs support that it is smaller with lambda 0.5.",
            ),
            (
                0.0312,
                (around, 0.03, 0.3, least),
                "+3.1 percentage points; the 95 % interval, \u{2212}1.0 to +5.0, contains zero, and the permutation test \
                 gives p = 0.3: these runs do not show a difference, and do not show that there is none.",
            ),
            (
                0.0312,
                (above, 0.03, 0.0635, least),
                "+3.1 percentage points; the 95 % interval, +1.0 to +5.2, excludes zero, but the permutation test gives \
                 p = 0.0635, not below 0.05. The two disagree, so these runs do not settle whether there is a difference; \
                 more seeds can.",
            ),
            (
                0.0312,
                (around, 0.03, 0.04, least),
                "+3.1 percentage points; the 95 % interval, \u{2212}1.0 to +5.0, contains zero, but the permutation test \
                 gives p = 0.04, below 0.05. The two disagree, so these runs do not settle whether there is a difference; \
                 more seeds can.",
            ),
            (
                0.0312,
                (above, -0.03, 0.04, least),
                "+3.1 percentage points; the 95 % interval, +1.0 to +5.2, excludes zero, and the permutation test gives \
                 p = 0.04, but the interquartile means and the means differ in opposite directions: these runs do not \
                 settle which of the two is greater.",
            ),
            (
                0.0312,
                (above, 0.03, 0.1, 0.1),
                "+3.1 percentage points; the 95 % interval, +1.0 to +5.2, excludes zero. More seeds are needed: with 5 \
                 against 1 run the permutation test cannot give a p below 0.1 (here p = 0.1), and 0.05 or more supports \
                 no difference.",
            ),
            (
                0.0,
                (None, 0.0, 1.0, 1.0 / 6.0),
                "0.0 percentage points. With fewer than 3 runs on a side there is no interval, and nothing can be said \
                 about the difference beyond these runs.",
            ),
        ] {
            assert_eq!(statement(difference, numbers), format!("{head}{rest}"));
        }
    }

    #[test]
    fn probabilities_are_short() {
        for (p, text) in [(1.0, "1"), (0.1, "0.1"), (0.0476, "0.0476"), (2.0 / 252.0, "0.0079"), (0.00003, "< 0.0001")]
        {
            assert_eq!(probability(p), text);
        }
    }
}
