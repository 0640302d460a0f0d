//! The page: one file with everything in it.

mod content;
mod few_numbers;
mod lambdas;
mod layout;
mod settings;
mod spaces;
mod stress;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};

use crate::figures::{FEW_NUMBERS, Figure};
use crate::records::{Analysis, LEVELS, Quantity, RunRecord};
use crate::run::{EXPLORER, Run, best};
use crate::stats::{Estimate, FEWEST, RESAMPLES, SIGNIFICANT};
use crate::tables;
use crate::write::JSON;

pub(crate) use lambdas::supported;
pub(crate) use layout::{document, drawing, heading, notes, table, words};
pub(crate) use settings::{common_table, provenance};

/// Renders the page.
pub fn render(runs: &[Run], analysis: &Analysis, figures: &[Figure]) -> String {
    document(
        &title(analysis),
        &html! {
            p.soft {
                (subtitle(analysis)) " All numbers are in " a href=(tables::RUNS) { (tables::RUNS) } ", "
                a href=(tables::LAMBDAS) { (tables::LAMBDAS) } " and " a href=(JSON) { (JSON) } "."
            }
            (notes(&analysis.notes))
            (pictures(runs))
            (heading("Results"))
            @for figure in figures.iter().filter(|figure| figure.name == FEW_NUMBERS) { (drawing(figure)) }
            @if analysis.statements.is_empty() { p { "No run is complete yet." } }
            ul { @for statement in &analysis.statements { li { (statement) } } }
            (few_numbers::table(analysis))
            (lambdas::table(analysis))
            (lambdas::differences(analysis))
            (spaces::section(analysis))
            (content::section(analysis))
            (stress::section(analysis))
            (heading("Figures"))
            @for figure in figures.iter().filter(|figure| figure.name != FEW_NUMBERS && !figure.is_repeated) {
                (drawing(figure))
            }
            (objects_table(analysis))
            (levels_table(analysis))
            (heading("Runs"))
            (runs_table(analysis))
            (heading("Settings"))
            (settings::section(runs))
            @if runs.len() > 1 { (heading("How it is computed")) (method()) }
        },
    )
}

/// The picture of the best run, and where its explorer is.
fn pictures(runs: &[Run]) -> Markup {
    let Some((run, png)) = best(runs).and_then(|run| Some((run, run.picture.as_ref()?))) else { return html! {} };
    let source = format!("data:image/png;base64,{}", STANDARD.encode(png));
    html! {
        figure {
            img src=(source) alt={ "A grasp of " (run.name) ", and the hand at both ends of its first numbers" };
            figcaption {
                "The run " (run.name) ": a grasp, and the hand at both ends of its first numbers. "
                @if run.explorer.is_some() {
                    a href=(EXPLORER) { "Move the numbers yourself" } "."
                } @else {
                    "The command " code { "explore" } " with this run makes a page in which you move the numbers yourself; the next \
                     report links it."
                }
            }
        }
    }
}

fn title(analysis: &Analysis) -> String {
    let lambdas: Vec<String> = analysis.lambdas.iter().map(|lambda| lambda.lambda.to_string()).collect();
    let trainings = match analysis.runs.len() {
        1 => "Training".to_owned(),
        n => format!("{n} trainings"),
    };
    format!("{trainings} of the hand {}, lambda {}", analysis.hand, lambdas.join(" and "))
}

fn subtitle(analysis: &Analysis) -> String {
    let complete = analysis.runs.iter().filter(|run| run.is_complete()).count();
    let runs = if analysis.runs.len() == 1 { "run" } else { "runs" };
    format!(
        "{} {runs}, {complete} complete. Lambda says how far training confines the policy to the synergy of its hand: with 0 it \
         commands every joint, with 1 it commands nothing but the numbers of the synergy.",
        analysis.runs.len()
    )
}

/// `93.1 (91.0 to 95.2)`
pub(crate) fn estimate(estimate: Option<&Estimate>, factor: f64, digits: usize) -> String {
    let number = |value: f64| format!("{:.digits$}", factor * value);
    match estimate {
        None => "-".to_owned(),
        Some(Estimate { iqm, interval: Some([low, high]), .. }) => {
            format!("{} ({} to {})", number(*iqm), number(*low), number(*high))
        }
        Some(Estimate { iqm, .. }) => number(*iqm),
    }
}

pub(crate) fn number(value: Option<f64>, factor: f64, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{:.digits$}", factor * value))
}

fn objects_table(analysis: &Analysis) -> Markup {
    let rows: Vec<Vec<String>> = analysis
        .objects()
        .into_iter()
        .map(|object| {
            let cells = analysis.lambdas.iter().map(|lambda| estimate(lambda.objects.get(&object), 100.0, 1));
            std::iter::once(object.clone()).chain(cells).collect()
        })
        .collect();
    if rows.is_empty() {
        return html! {};
    }
    let mut header = words(&["object"]);
    header.extend(analysis.lambdas.iter().map(|lambda| format!("success (%), \u{3bb} = {}", lambda.lambda)));
    html! { (heading("Success for each object")) (table("Success in the final evaluation", &header, &rows)) }
}

fn levels_table(analysis: &Analysis) -> Markup {
    let mut rows = Vec::new();
    for lambda in analysis.lambdas.iter().filter(|lambda| lambda.n_complete > 0) {
        for level in &lambda.levels {
            rows.push(vec![
                format!("\u{3bb} = {}", lambda.lambda),
                format!("{:.0} %", 100.0 * level.success_rate),
                format!("{} of {}", level.n_reached, lambda.n_complete),
                number(level.median_episodes, 1.0, 0),
                number(level.median_wall_s, 1.0 / 60.0, 1),
            ]);
        }
    }
    if rows.is_empty() {
        return html! {};
    }
    let several = analysis.runs.len() > 1;
    let times = if several { ["median episodes", "median wall time (min)"] } else { ["episodes", "wall time (min)"] };
    html! {
        (heading("How soon"))
        (table(
            "First evaluation during training that reached a success",
            &words(&["", "success", "runs that reached it", times[0], times[1]]),
            &rows,
        ))
        @if several {
            p.soft {
                "A run that never reached it counts as later than all others. There is no median if half of the runs or more "
                "never reached it."
            }
        }
    }
}

fn runs_table(analysis: &Analysis) -> Markup {
    let mut header = words(&["run", "\u{3bb}", "seed", "state", "success (%)", "95 % interval (%)"]);
    header.push(lambdas::configured(analysis.components));
    header.push("numbers within 5 points".to_owned());
    header.extend(words(&["sum of contribution (%)", "mean error (rad)", "postures", "episodes", "wall time (min)"]));
    header.extend(LEVELS.map(|level| format!("episodes to {:.0} %", 100.0 * level)));
    let row = |run: &RunRecord| {
        let interval = run.success_interval.map(|[low, high]| format!("{:.1} to {:.1}", 100.0 * low, 100.0 * high));
        let mut row = vec![
            run.run.clone(),
            run.lambda.to_string(),
            run.seed.to_string(),
            run.state.to_owned(),
            number(run.success_rate, 100.0, 1),
            interval.unwrap_or_else(|| "-".to_owned()),
            number(Quantity::SuccessWithComponents.of(run), 100.0, 1),
            run.k_for_95.map_or_else(|| "-".to_owned(), |k| k.to_string()),
            number(run.contribution_sum, 100.0, 1),
            number(run.mean_error_rad, 1.0, 3),
            run.n_postures.to_string(),
            run.episodes.to_string(),
            number(run.wall_s, 1.0 / 60.0, 1),
        ];
        row.extend(run.reached.iter().map(|reached| number(reached.map(|r| r.episodes), 1.0, 0)));
        row
    };
    let rows: Vec<Vec<String>> = analysis.runs.iter().map(row).collect();
    html! {
        (table("Every run", &header, &rows))
        p.soft { "95 % interval: the interval of Wilson (1927) for a share, over the episodes of the final evaluation." }
    }
}

fn method() -> Markup {
    html! {
        p {
            "The interquartile mean leaves out the lowest and the highest quarter of the runs, rounded down to whole runs. Its "
            "interval is the middle 95 % of " (RESAMPLES) " bootstrap resamples. Each resample draws runs of the same lambda, "
            "with replacement (Agarwal et al. 2021). The interval of a difference comes from the resampled differences. With "
            "fewer than " (FEWEST) " runs there is no interval. All random numbers come from a fixed seed, so the same runs "
            "give the same page."
        }
        p {
            "The permutation test exchanges the lambdas of the runs in every way that keeps their numbers (Fisher 1935). p is "
            "the share of these relabellings whose means differ by as much as the real ones, or more. It does not assume any "
            "distribution. There is no correction for the number of comparisons: of twenty differences that do not exist, one "
            "has p below " (SIGNIFICANT) " on average."
        }
        p {
            "In figures along training, a line is the median over the runs that have reached this point, and a band extends "
            "from the lowest of these runs to the highest."
        }
    }
}

#[cfg(test)]
mod tests {
    use super::layout::HEADING;
    use super::*;
    use crate::analysis::analyse;
    use crate::figures::all;
    use crate::made_up::complete;

    fn page(runs: &[Run]) -> String {
        let analysis = analyse(runs);
        render(runs, &analysis, &all(runs, &analysis).expect("drawn"))
    }

    #[test]
    fn a_page_of_one_run_speaks_of_one_run() {
        let one = page(&[complete(1.0, 1, 0.9, &[0.1, 0.9], Some(1))]);
        assert!(one.contains("<h1>Training of the hand claw, lambda 1</h1>"));
        assert!(
            !one.contains("lowest to highest") && !one.contains("Interquartile mean over") && !one.contains("edian")
        );
        let two = page(&[complete(0.0, 1, 0.9, &[0.1, 0.9], Some(1)), complete(0.0, 2, 0.8, &[0.1, 0.7], None)]);
        assert!(two.contains("<h1>2 trainings of the hand claw, lambda 0</h1>") && two.contains("lowest to highest"));
    }

    #[test]
    fn the_contents_lead_to_every_heading_and_each_figure_is_there_once() {
        let runs = [complete(0.0, 1, 0.9, &[0.1, 0.9], Some(1)), complete(1.0, 1, 0.8, &[0.1, 0.7], None)];
        let analysis = analyse(&runs);
        let figures = all(&runs, &analysis).expect("drawn");
        let page = render(&runs, &analysis, &figures);
        assert!(page.matches(HEADING[0]).count() > 4);
        for rest in page.split(HEADING[0]).skip(1) {
            let (id, _) = rest.split_once(HEADING[1]).expect("an id");
            assert_eq!(page.matches(&format!("<a href=\"#{id}\">")).count(), 1, "{id}");
        }
        for figure in &figures {
            let shown = page.matches(&format!("href=\"figures/{}.csv\"", figure.name)).count();
            assert_eq!(shown, usize::from(!figure.is_repeated), "{}", figure.name);
        }
    }

    #[test]
    fn the_best_run_is_shown() {
        let drawn = |seed, success, byte| Run {
            picture: Some(vec![byte]),
            explorer: (byte == 1).then(|| b"page".to_vec()),
            ..complete(1.0, seed, success, &[0.1, 0.9], Some(1))
        };
        let page = page(&[drawn(1, 0.7, 1), drawn(2, 0.9, 2), drawn(3, 0.9, 3)]);
        assert!(!page.contains("href=\"explore.html\""), "the best run has no explorer");
        let explored = self::page(&[drawn(1, 0.95, 1), drawn(2, 0.9, 2)]);
        assert!(explored.contains("href=\"explore.html\""), "the best run has one");
        assert!(page.contains("data:image/png;base64,Ag==") && page.contains("The run l1-s2"), "the first of the best");
        assert!(!page.contains("base64,AQ==") && !page.contains("base64,Aw=="));
    }
}
