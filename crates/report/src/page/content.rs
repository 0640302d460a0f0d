//! What the grasps hold.

use maud::{Markup, html};

use super::{heading, number, table};
use crate::content::{NUMBERS, Number};
use crate::records::Analysis;
use crate::statements::counted;

/// One row for each number of what the grasps hold.
pub fn section(analysis: &Analysis) -> Markup {
    if analysis.lambdas.iter().all(|lambda| lambda.content.is_empty()) {
        return html! {};
    }
    let mut header = vec![String::new()];
    for lambda in &analysis.lambdas {
        let n = lambda.content.get(NUMBERS[0].key).map_or(0, |estimate| estimate.n);
        header.push(format!("\u{3bb} = {}, {}", lambda.lambda, counted(n, "run")));
        if n > 1 {
            header.push("lowest to highest".to_owned());
        }
    }
    let row = |held: &Number| {
        let mut row = vec![held.name.to_owned()];
        for lambda in &analysis.lambdas {
            let found = lambda.content.get(held.key);
            let digits = held.digits;
            row.push(number(found.map(|e| e.median), held.factor, digits));
            let range = found.map_or_else(String::new, |e| {
                format!("{:.digits$} to {:.digits$}", held.factor * e.min, held.factor * e.max)
            });
            row.extend((lambda.content.get(NUMBERS[0].key).map_or(0, |e| e.n) > 1).then_some(range));
        }
        row
    };
    html! {
        (heading("What the grasps hold"))
        p {
            "A high contribution rate says little of postures that hardly vary, because one posture would then do as well. "
            "The total variance and the share between objects tell how much the components have to express."
        }
        (table("The end postures of the successes", &header, &NUMBERS.iter().map(row).collect::<Vec<_>>()))
        @if analysis.lambdas.iter().any(|lambda| lambda.n_complete > 1) {
            p.soft { "Median over the complete runs that have these numbers." }
        }
        ul { @for held in &NUMBERS { li { strong { (without_unit(held.name)) } ": " (held.meaning) } } }
    }
}

fn without_unit(name: &str) -> &str {
    name.split_once(" (").map_or(name, |(name, _)| name)
}
