//! The page: one file with everything in it.

mod content;
mod few_numbers;
mod layout;
mod spaces;
mod stress;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use eigenhand_train::config::Settings;
use maud::{Markup, html};

use crate::figures::{FEW_NUMBERS, Figure};
use crate::permutation::MOST_RELABELLINGS;
use crate::records::{Analysis, DifferenceRecord, LEVELS, LambdaRecord, Quantity, RunRecord};
use crate::run::{Run, best};
use crate::statements::{counted, differing_settings, probability};
use crate::stats::{Estimate, FEWEST, RESAMPLES, SIGNIFICANT, Verdict};

pub(crate) use layout::{document, drawing, heading, notes, table, words};

/// Renders the page.
pub fn render(runs: &[Run], analysis: &Analysis, figures: &[Figure]) -> String {
    document(
        &title(analysis),
        &html! {
            p.soft { (subtitle(analysis)) }
            (notes(&analysis.notes))
            (pictures(runs))
            (heading("Results"))
            @for figure in figures.iter().filter(|figure| figure.name == FEW_NUMBERS) { (drawing(figure)) }
            @if analysis.statements.is_empty() { p { "No run is complete yet." } }
            ul { @for statement in &analysis.statements { li { (statement) } } }
            (few_numbers::table(analysis))
            (lambda_table(analysis))
            (differences_table(analysis))
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
            (settings(runs))
            (heading("How it is computed"))
            (method())
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
                "The run " (run.name) ": a grasp, and the hand at both ends of its first numbers. The command " code { "explore" }
                " with this run makes a page in which you move the numbers yourself."
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
         commands every joint, with 1 it commands nothing but the numbers of the synergy. All numbers are in runs.csv, \
         lambdas.csv and report.json.",
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
fn configured(components: Option<usize>) -> String {
    let numbers = components.map_or_else(|| "the configured components".to_owned(), |k| counted(k, "number"));
    format!("success with {numbers} (%)")
}

fn lambda_table(analysis: &Analysis) -> Markup {
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
        (table(&header, &body))
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

fn differences_table(analysis: &Analysis) -> Markup {
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
        (table(&header, &analysis.differences.iter().map(row).collect::<Vec<_>>()))
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
    html! { (heading("Success for each object")) (table(&header, &rows)) }
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
    html! {
        (heading("How soon"))
        (table(&words(&["", "success", "runs that reached it", "median episodes", "median wall time (min)"]), &rows))
        p.soft {
            "Time of the first evaluation during training that reached this success. A run that never reached it "
            "counts as later than all others. There is no median if half of the runs or more never reached it."
        }
    }
}

fn runs_table(analysis: &Analysis) -> Markup {
    let mut header = words(&["run", "\u{3bb}", "seed", "state", "success (%)", "95 % interval (%)"]);
    header.push(configured(analysis.components));
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
        (table(&header, &rows))
        p.soft { "95 % interval: the interval of Wilson (1927) for a share, over the episodes of the final evaluation." }
    }
}

fn settings(runs: &[Run]) -> Markup {
    let differing = differing_settings(runs);
    let common: Vec<(&String, &String)> = runs.first().map_or_else(Vec::new, |run| {
        let of_all =
            |key: &String| !differing.contains_key(key) && !["lambda", "seed", "workers"].contains(&key.as_str());
        run.settings.iter().filter(|(key, _)| of_all(key)).collect()
    });
    let header: Vec<String> =
        std::iter::once("setting".to_owned()).chain(runs.iter().map(|run| run.name.clone())).collect();
    let rows: Vec<Vec<String>> =
        differing.into_iter().map(|(key, values)| std::iter::once(key).chain(values).collect()).collect();
    html! {
        @if !rows.is_empty() {
            p { "The runs differ in these settings:" }
            (table(&header, &rows))
        }
        (provenance(runs))
        details {
            summary { (common.len()) " settings that all runs share" }
            (common_table(&common.into_iter().map(|(k, v)| (k.clone(), v.clone())).collect()))
        }
    }
}

pub(crate) fn common_table(settings: &Settings) -> Markup {
    html! {
        div.scroll {
            table {
                tbody {
                    @for (key, value) in settings {
                        tr { th scope="row" { code { (key) } } td.word { code { (value) } } }
                    }
                }
            }
        }
    }
}

/// One row for all runs with the same versions, machine and hand.
pub(crate) fn provenance(runs: &[Run]) -> Markup {
    let header = words(&["runs", "program", "revision", "MuJoCo", "platform", "processors", "hand's digest"]);
    let start = |text: &str| text.chars().take(12).collect::<String>();
    let mut rows: Vec<Vec<String>> = Vec::new();
    for run in runs {
        let made = &run.provenance;
        let with = vec![
            made.eigenhand_version.clone(),
            format!("{}{}", start(&made.git_revision), if made.git_revision.ends_with('+') { "+" } else { "" }),
            made.mujoco_version.clone(),
            made.platform.clone(),
            made.processors.to_string(),
            start(&made.hand_digest),
        ];
        match rows.iter_mut().find(|row| row[1..] == with[..]) {
            Some(row) => row[0].push_str(&format!(", {}", run.name)),
            None => rows.push(std::iter::once(run.name.clone()).chain(with).collect()),
        }
    }
    table(&header, &rows)
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
            !one.contains("lowest to highest")
                && !one.contains("Interquartile mean over")
                && !one.contains("Median over")
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
            ..complete(1.0, seed, success, &[0.1, 0.9], Some(1))
        };
        let page = page(&[drawn(1, 0.7, 1), drawn(2, 0.9, 2), drawn(3, 0.9, 3)]);
        assert!(page.contains("data:image/png;base64,Ag==") && page.contains("The run l1-s2"), "the first of the best");
        assert!(!page.contains("base64,AQ==") && !page.contains("base64,Aw=="));
    }
}
