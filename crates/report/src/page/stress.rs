//! What the grasps endure.

use eigenhand_train::StressRow;
use maud::{Markup, html};

use super::{heading, number, table, words};
use crate::curves::BandPoint;
use crate::records::Analysis;
use crate::statements::counted;

/// One row for each change; the runs of `eval --stress` alone.
pub fn section(analysis: &Analysis) -> Markup {
    let rows_of = |lambda: f64| {
        let runs = analysis.runs.iter().filter(move |run| run.lambda == lambda);
        runs.filter_map(|run| Some(run.stress.as_ref()?.rows.as_slice())).collect::<Vec<_>>()
    };
    let measured: Vec<(f64, Vec<&[StressRow]>)> = analysis
        .lambdas
        .iter()
        .map(|lambda| (lambda.lambda, rows_of(lambda.lambda)))
        .filter(|(_, runs)| !runs.is_empty())
        .collect();
    let mut changes: Vec<(&str, &str)> = Vec::new();
    for row in measured.iter().flat_map(|(_, runs)| runs).copied().flatten() {
        if !changes.contains(&(&row.group, &row.change)) {
            changes.push((&row.group, &row.change));
        }
    }
    if changes.is_empty() {
        return html! {};
    }
    let mut header = words(&["changed", "to"]);
    for (lambda, runs) in &measured {
        header.push(format!("success (%), \u{3bb} = {lambda}, {}", counted(runs.len(), "run")));
        header.push("lowest to highest".to_owned());
    }
    let row = |(group, change): &(&str, &str)| {
        let mut cells = words(&[group, change]);
        for (_, runs) in &measured {
            let same = |row: &&StressRow| row.group == *group && row.change == *change;
            let rates: Vec<f64> =
                runs.iter().filter_map(|rows| rows.iter().find(same)).map(|row| row.success_rate).collect();
            let found = BandPoint::of(0.0, rates);
            cells.push(number(found.map(|p| p.median), 100.0, 1));
            cells.push(found.map_or_else(String::new, |p| format!("{:.1} to {:.1}", 100.0 * p.min, 100.0 * p.max)));
        }
        cells
    };
    let mut numbers: Vec<u64> = analysis.runs.iter().filter_map(|run| Some(run.stress.as_ref()?.episodes)).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let episodes = numbers.iter().map(u64::to_string).collect::<Vec<_>>().join(" or ");
    html! {
        (heading("What the grasps endure"))
        (table("Success in changed scenes", &header, &changes.iter().map(row).collect::<Vec<_>>()))
        p.soft {
            "Median over the runs, each in " (episodes) " episodes a row. In each row one thing is changed, and the episodes "
            "are the same (eval --stress)."
        }
    }
}

#[cfg(test)]
mod tests {
    use eigenhand_train::Stress;

    use super::*;
    use crate::analyse;
    use crate::made_up::complete;

    #[test]
    fn the_table_has_a_row_for_each_change() {
        let row = |group: &str, change: &str, success_rate: f64| StressRow {
            group: group.to_owned(),
            change: change.to_owned(),
            success_rate,
            interval: [0.0, 1.0],
        };
        let run = |lambda: f64, seed: u64, rows: Vec<StressRow>| {
            let mut run = complete(lambda, seed, 0.9, &[0.1, 0.9], Some(1));
            run.stress = Some(Stress { episodes: 70, seed: 0, rows });
            run
        };
        let runs = [
            run(0.0, 1, vec![row("nothing", "", 0.9)]),
            run(1.0, 1, vec![row("nothing", "", 0.95), row("friction", "0.7", 0.5)]),
            run(1.0, 2, vec![row("nothing", "", 0.97), row("friction", "0.7", 0.7)]),
            complete(1.0, 3, 0.9, &[0.1, 0.9], Some(1)),
        ];
        let text = section(&analyse(&runs)).into_string();
        let friction =
            "<tr><th scope=\"row\">friction</th><td>0.7</td><td>-</td><td></td><td>60.0</td><td>50.0 to 70.0</td></tr>";
        assert!(
            text.contains(friction) && text.contains("1, 2 runs") && text.contains("in 70 episodes a row"),
            "{text}"
        );
        assert_eq!(section(&analyse(&runs[3..])).into_string(), "");
    }
}
