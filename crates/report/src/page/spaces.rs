//! Whether the runs of each lambda find the same space.

use maud::{Markup, html};

use super::{heading, table, words};
use crate::records::Analysis;
use crate::spaces::SharedSpace;
use crate::statements::counted;

/// One row for each lambda with several spaces.
pub fn section(analysis: &Analysis) -> Markup {
    let found: Vec<_> = analysis.lambdas.iter().filter_map(|l| Some((l.lambda, l.space.as_ref()?))).collect();
    if found.is_empty() {
        return html! {};
    }
    let header = words(&[
        "",
        "squared cosine",
        "of random directions",
        "own space (%)",
        "space of another run (%)",
        "random directions (%)",
    ]);
    let row = |(lambda, space): &(f64, &SharedSpace)| {
        let percent = |share: f64| format!("{:.1}", 100.0 * share);
        vec![
            format!("\u{3bb}\u{a0}=\u{a0}{lambda}, {}", counted(space.n_runs, "run").replace(' ', "\u{a0}")),
            format!("{:.2}", space.squared_cosine),
            format!("{:.2}", space.chance),
            percent(space.own),
            percent(space.other),
            percent(space.chance),
        ]
    };
    html! {
        (heading("Do the runs find the same space?"))
        (table("The synergies of two seeds", &header, &found.iter().map(row).collect::<Vec<_>>()))
        p.soft {
            "Medians over all pairs of runs. Squared cosine: mean over the principal angles between the control synergies of two "
            "runs, 1 for the same space. The last columns say how much of the variance of a run's commands each space holds."
        }
    }
}
