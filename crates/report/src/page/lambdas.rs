//! The tables of results over the runs of each lambda, and of the differences between lambdas.

use maud::{Markup, html};

use super::{estimate, words};
use crate::permutation::MOST_RELABELLINGS;
use crate::records::{Analysis, DifferenceRecord, LambdaRecord, Quantity};
use crate::statements::{counted, probability};
use crate::stats::{Estimate, SIGNIFICANT, Verdict};

/// Returns the name with its unit, the factor from the files' unit, and the number of digits.
fn quantity(quantity: Quantity, components: Option<usize>) -> (String, f64, usize) {
    let (name, factor, digits) = match quantity {
        Quantity::SuccessRate => ("final success (%)", 100.0, 1),
        Quantity::OtherObjects => ("success with other objects (%)", 100.0, 1),
        Quantity::SuccessWithComponents => return (configured(components), 100.0, 1),
        Quantity::SuccessWithOne => ("success with 1 number (%)", 100.0, 1),
        Quantity::SuccessWithTwo => ("success with 2 numbers (%)", 100.0, 1),
        Quantity::ContributionSum => ("sum of contribution rates (%)", 100.0, 1),
        Quantity::ContributionChange => ("change of that sum along training (points)", 100.0, 1),
        Quantity::MeanErrorRad => ("mean approximation error (rad)", 1.0, 3),
        Quantity::NPostures => ("postures", 1.0, 0),
        Quantity::MeanPenetrationM => ("mean penetration (mm)", 1000.0, 2),
        Quantity::MeanSelfPenetrationM => ("mean penetration within the hand (mm)", 1000.0, 2),
        Quantity::WallS => ("wall time (min)", 1.0 / 60.0, 1),
    };
    (name.to_owned(), factor, digits)
}

/// `success with 5 numbers (%)`, or without the number if the runs do not agree.
pub fn configured(components: Option<usize>) -> String {
    let numbers = components.map_or_else(|| "the configured components".to_owned(), |k| counted(k, "number"));
    format!("success with {numbers} (%)")
}

/// Results of each lambda over its runs.
pub fn table(analysis: &Analysis) -> Markup {
    let rows = |which: Quantity| {
        let (name, factor, digits) = quantity(which, analysis.components);
        let mut row = vec![name];
        for lambda in &analysis.lambdas {
            row.extend(cells(lambda, lambda.quantities.get(which.key()), factor, digits));
        }
        row
    };
    let mut body: Vec<Vec<String>> = Quantity::ALL.map(rows).to_vec();
    let n_components = analysis.lambdas.iter().map(|lambda| lambda.contribution.len()).max().unwrap_or(0);
    for i in 0..n_components {
        let mut row = vec![format!("contribution rate {} (%)", i + 1)];
        for lambda in &analysis.lambdas {
            row.extend(cells(lambda, lambda.contribution.get(i), 100.0, 1));
        }
        body.push(row);
    }
    // What no run has measured is left out.
    body.retain(|row| row[1..].iter().any(|cell| !cell.is_empty() && cell != "-"));
    let mut header = vec![String::new()];
    for lambda in &analysis.lambdas {
        header.push(format!("\u{3bb} = {}, {}", lambda.lambda, counted(lambda.n_complete, "run")));
        if lambda.n_complete > 1 {
            header.push("lowest to highest".to_owned());
        }
    }
    let several = analysis.lambdas.iter().any(|lambda| lambda.n_complete > 1);
    html! {
        (super::table("Results over the runs", &header, &body))
        @if several {
            p.soft { "Interquartile mean over the complete runs, with its 95 % bootstrap interval in brackets." }
        }
    }
}

/// Returns the cells of a lambda in a row: the estimate, and, of several runs, their range.
fn cells(lambda: &LambdaRecord, found: Option<&Estimate>, factor: f64, digits: usize) -> Vec<String> {
    let range =
        found.map_or_else(String::new, |e| format!("{:.digits$} to {:.digits$}", factor * e.min, factor * e.max));
    let mut cells = vec![estimate(found, factor, digits)];
    cells.extend((lambda.n_complete > 1).then_some(range));
    cells
}

/// Differences between lambdas.
pub fn differences(analysis: &Analysis) -> Markup {
    if analysis.differences.is_empty() {
        return html! {};
    }
    let header = words(&[
        "difference",
        "from \u{3bb}",
        "to \u{3bb}",
        "by",
        "95 % interval",
        "excludes zero",
        "p",
        "least p",
        "supported",
    ]);
    let row = |record: &DifferenceRecord| {
        let (name, factor, digits) = quantity(record.quantity, analysis.components);
        let number = |value: f64| format!("{:+.digits$}", factor * value);
        let interval = record.contrast.interval;
        let excludes = record.contrast.excludes_zero().map(|excludes| if excludes { "yes" } else { "no" });
        vec![
            name,
            record.baseline.to_string(),
            record.lambda.to_string(),
            number(record.contrast.difference),
            interval.map_or_else(|| "-".to_owned(), |[low, high]| format!("{} to {}", number(low), number(high))),
            excludes.unwrap_or("-").to_owned(),
            probability(record.contrast.permutation.p),
            probability(record.contrast.permutation.least_p),
            supported(record.verdict).to_owned(),
        ]
    };
    let sampled = analysis.differences.iter().any(|record| !record.contrast.permutation.exact);
    html! {
        (super::table("Differences between lambdas", &header, &analysis.differences.iter().map(row).collect::<Vec<_>>()))
        p.soft {
            "p: two-sided permutation test of the difference of means. Least p: the smallest that this number of runs can "
            "give. A difference is supported if its interval excludes zero and p is below " (SIGNIFICANT) "."
            @if sampled { " p comes from " (MOST_RELABELLINGS) " random relabellings where there are more than these." }
        }
    }
}

pub(crate) fn supported(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Greater => "yes, greater",
        Verdict::Smaller => "yes, smaller",
        Verdict::Disagree => "no: interval and test disagree",
        Verdict::TooFewForTest | Verdict::NoInterval => "no: too few runs",
        Verdict::Open => "no",
    }
}
