//! `eigenhand report`

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use eigenhand_report::{Analysis, Report, Study, StudyAnalysis, StudyReport, read_runs, write, write_study};
use serde::Serialize;

use crate::output::{Outcome, percent, print, print_json, table};

/// Name of a report's directory by default.
pub const DIRECTORY: &str = "report";

const EXAMPLES: &str = "\
Runs may be unfinished: the report shows their curves so far, and says that their results are missing.

Examples:
  eigenhand report runs/shadow-default-l1-s1-1 runs/shadow-default-l0-s1-1 --out lambda
  eigenhand report runs/reproduce-shadow-default";

/// Writes an HTML page with figures, tables and statistics of runs
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Run directories, or directories that contain run directories
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Directory for the report [default: report, inside RUN if there is only one]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Prints the report as JSON on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Printed<'a> {
    page: &'a Path,
    #[serde(flatten)]
    analysis: &'a Analysis,
}

#[derive(Serialize)]
struct PrintedStudy<'a> {
    page: &'a Path,
    #[serde(flatten)]
    analysis: &'a StudyAnalysis,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    if let [only] = args.runs.as_slice()
        && Study::is_in(only)
    {
        let out = args.out.clone().unwrap_or_else(|| only.join(DIRECTORY));
        show_study(only, &out, args.json)?;
        return Ok(Outcome::Done);
    }
    let runs = read_runs(&args.runs)?;
    let out = match (&args.out, args.runs.as_slice()) {
        (Some(out), _) => out.clone(),
        (None, [only]) => only.join(DIRECTORY),
        (None, _) => PathBuf::from(DIRECTORY),
    };
    let report = write(&runs, &out)?;
    show(&report, args.json)?;
    Ok(Outcome::Done)
}

/// Writes the report of a directory of runs into this directory.
pub fn of_directory(directory: &Path) -> anyhow::Result<Report> {
    Ok(write(&read_runs(&[directory.to_owned()])?, &directory.join(DIRECTORY))?)
}

/// Writes the report of a study, and prints its results.
pub fn show_study(directory: &Path, out: &Path, json: bool) -> anyhow::Result<()> {
    let report = write_study(&Study::read(directory)?, out)?;
    if json { print_json(&printed(&report)) } else { print(&study(&report)) }
}

/// Writes the reports of several studies into them, and prints their results.
pub fn show_studies(directories: &[PathBuf], json: bool) -> anyhow::Result<()> {
    let report = |directory: &PathBuf| Ok(write_study(&Study::read(directory)?, &directory.join(DIRECTORY))?);
    let reports = directories.iter().map(report).collect::<anyhow::Result<Vec<StudyReport>>>()?;
    if json {
        return print_json(&BTreeMap::from([("studies", reports.iter().map(printed).collect::<Vec<_>>())]));
    }
    let text = reports.iter().map(|report| format!("hand {}\n{}", report.analysis.hand, study(report)));
    print(&text.collect::<Vec<_>>().join("\n"))
}

fn printed(StudyReport { page, analysis }: &StudyReport) -> PrintedStudy<'_> {
    PrintedStudy { page, analysis }
}

fn study(StudyReport { page, analysis }: &StudyReport) -> String {
    let heads = [&analysis.varies, "runs", "success", "other objects", "episodes to 70 %"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    for variant in &analysis.variants {
        let share = |key: &str| variant.quantities.get(key).map_or_else(|| "-".to_owned(), |e| percent(e.iqm));
        let seventy = variant.levels.iter().find(|level| level.success_rate == 0.7).and_then(|l| l.median_episodes);
        rows.push(vec![
            variant.title.clone(),
            format!("{} of {}", variant.n_complete, variant.n_runs),
            share("success_rate"),
            share("other_objects_success_rate"),
            seventy.map_or_else(|| "-".to_owned(), |episodes| format!("{episodes:.0}")),
        ]);
    }
    let mut text = table(&rows);
    for sentence in analysis.notes.iter().chain(&analysis.statements) {
        text.push_str(&format!("- {sentence}\n"));
    }
    text.push_str(&format!("report: {}\n", page.display()));
    text
}

/// Prints the results of a report.
pub fn show(report: &Report, json: bool) -> anyhow::Result<()> {
    if json {
        return print_json(&Printed { page: &report.page, analysis: &report.analysis });
    }
    let mut text = runs(&report.analysis);
    for sentence in report.analysis.notes.iter().chain(&report.analysis.statements) {
        text.push_str(&format!("- {sentence}\n"));
    }
    text.push_str(&format!("report: {}\n", report.page.display()));
    print(&text)
}

fn runs(analysis: &Analysis) -> String {
    let heads = ["run", "lambda", "seed", "state", "success", "contribution", "error (rad)", "postures", "minutes"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    for run in &analysis.runs {
        let share = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), percent);
        rows.push(vec![
            run.run.clone(),
            run.lambda.to_string(),
            run.seed.to_string(),
            run.state.to_owned(),
            share(run.success_rate),
            share(run.contribution_sum),
            run.mean_error_rad.map_or_else(|| "-".to_owned(), |error| format!("{error:.3}")),
            run.n_postures.to_string(),
            run.wall_s.map_or_else(|| "-".to_owned(), |seconds| format!("{:.1}", seconds / 60.0)),
        ]);
    }
    table(&rows)
}
