//! The table of success with few numbers.

use maud::{Markup, html};

use super::{number, words};
use crate::few_numbers::FewNumbers;
use crate::records::Analysis;
use crate::statements::counted;
use crate::stats::Estimate;

/// One row for each lambda: success with 0, 1, 2... numbers and with all joints.
pub fn table(analysis: &Analysis) -> Markup {
    let found: Vec<(f64, &FewNumbers)> =
        analysis.lambdas.iter().filter_map(|lambda| Some((lambda.lambda, lambda.few_numbers.as_ref()?))).collect();
    let most = found.iter().map(|(_, few)| few.success.len()).max().unwrap_or(0);
    if most == 0 {
        return html! {};
    }
    let mut header = words(&["success (%) with"]);
    header.extend((0..most).map(|k| if k == 0 { "0 (constant)".to_owned() } else { k.to_string() }));
    header.extend(words(&["all joints", "enough"]));
    let row = |(lambda, few): &(f64, &FewNumbers)| {
        let median = |estimate: Option<&Estimate>| number(estimate.map(|e| e.median), 100.0, 1);
        let mut row = vec![format!("\u{3bb} = {lambda}, {}", counted(few.n_runs, "run"))];
        row.extend((0..most).map(|k| median(few.success.get(k))));
        row.push(median(Some(&few.all_joints)));
        row.push(few.k_for_95.map_or_else(|| "-".to_owned(), |k| k.to_string()));
        row
    };
    html! {
        (super::table("Success against how many numbers command the hand", &header, &found.iter().map(row).collect::<Vec<_>>()))
        p.soft {
            @if found.iter().all(|(_, few)| few.n_runs == 1) {
                "Enough: the fewest numbers that are within 5 points of all joints."
            } @else {
                "Median over the complete runs. Enough: the fewest numbers that are within 5 points of all joints in more than "
                "half of the runs."
            }
        }
    }
}
