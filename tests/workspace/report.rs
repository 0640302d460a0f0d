//! Reports on real runs, and on faulty runs.

use std::path::{Path, PathBuf};

use eigenhand_report::{ReportError, analyse, interquartile_mean, read_runs, write};
use tempfile::TempDir;

use crate::support::{Run, gripper, tiny};

/// Trains a tiny run with a lambda and a seed.
fn trained(lambda: f64, seed: u64) -> Run {
    let run = Run::new(gripper());
    run.train(&tiny(&[&format!("lambda={lambda}"), &format!("seed={seed}")]));
    run
}

/// Trains tiny runs in joint space until one succeeds often enough for an analysis of its grasps.
fn analysed() -> Run {
    let train = |seed: u64| {
        let run = Run::new(gripper());
        run.train(&tiny(&["lambda=1", "episodes=48", "synergy.settle=1", &format!("seed={seed}")]));
        run
    };
    let is_analysed = |run: &Run| read(run).unwrap()[0].summary.as_ref().unwrap().content.is_some();
    (8..28).map(train).find(is_analysed).expect("one of twenty runs succeeds often enough")
}

fn read(run: &Run) -> Result<Vec<eigenhand_report::Run>, ReportError> {
    read_runs(std::slice::from_ref(&run.path))
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Returns the rows of a CSV file, split into cells; the header is the first row.
fn rows(path: &Path) -> Vec<Vec<String>> {
    text(path).lines().map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

fn files(directory: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found
}

#[test]
fn a_report_has_a_page_that_needs_nothing_else_and_the_numbers_of_every_figure() {
    let all: Vec<Run> = [(0.0, 1), (0.0, 2), (1.0, 1), (1.0, 2), (1.0, 3)].map(|(l, s)| trained(l, s)).into();
    let paths: Vec<PathBuf> = all.iter().map(|run| run.path.clone()).collect();
    let runs = read_runs(&paths).unwrap();
    let out = TempDir::new().unwrap();
    let report = write(&runs, out.path()).unwrap();

    let page = text(&report.page);
    let resources = ["<script", "<link", "@import", "url("];
    resources.iter().for_each(|word| assert!(!page.contains(word), "the page has {word}"));
    // Pictures are in the page, and links lead within it or to the numbers of a figure.
    assert!(page.split("src=\"").skip(1).all(|rest| rest.starts_with("data:")));
    for target in page.split("href=\"").skip(1).map(|rest| rest.split_once('"').unwrap().0) {
        assert!(target.starts_with('#') || out.path().join(target).is_file(), "{target}");
    }
    assert!(page.contains("prefers-color-scheme: dark") && page.matches("<svg").count() > 3);
    assert!(report.analysis.statements.iter().all(|sentence| page.contains(sentence.as_str())));

    // Every figure is there as drawing, picture and numbers.
    let figures = files(&out.path().join("figures"));
    assert_eq!(figures.len() % 3, 0, "{figures:?}");
    for path in figures.iter().filter(|path| path.extension().is_some_and(|e| e == "svg")) {
        // The parts of one figure are on the page as figures of their own.
        let shown = usize::from(!path.ends_with("figures/contribution.svg"));
        let found = page.matches(text(path).split_once("<svg").unwrap().1).count();
        assert_eq!(found, shown, "{} in the page", path.display());
        assert!(std::fs::read(path.with_extension("png")).unwrap().starts_with(b"\x89PNG"));
        assert!(rows(&path.with_extension("csv")).len() > 1, "{}", path.display());
    }

    // The plotted success of lambda 0 is the median of the values that its two runs logged.
    let plotted = rows(&out.path().join("figures/success-episodes.csv"));
    let logged = |run: &Run, i: usize| run.metrics()[i]["success_rate"].parse::<f64>().unwrap();
    for (i, row) in plotted.iter().skip(1).filter(|row| row[0] == "0").enumerate() {
        let median = (logged(&all[0], i) + logged(&all[1], i)) / 2.0;
        assert!((row[2].parse::<f64>().unwrap() - median).abs() < 1e-12, "{row:?}");
        assert_eq!(row[5], "2");
    }

    // The first figure is success against the numbers that command the hand: the median over the runs of a lambda.
    let first = page.split_once("<figure").unwrap().1;
    assert!(first.contains("aria-label=\"Success against how many numbers command the hand\""));
    let plotted = rows(&out.path().join("figures/success-numbers.csv"));
    assert_eq!(plotted[0], ["lambda", "numbers", "median", "min", "max", "n_runs"]);
    let summaries: Vec<_> = runs.iter().map(|run| run.summary.as_ref().unwrap()).collect();
    for row in plotted.iter().skip(1).filter(|row| row[0] == "0" && row[5] == "2") {
        let of = |i: usize| match row[1].as_str() {
            "all" => summaries[i].success_rate.unwrap(),
            k => summaries[i].success_with_components[k.parse::<usize>().unwrap()],
        };
        assert!((row[2].parse::<f64>().unwrap() - (of(0) + of(1)) / 2.0).abs() < 1e-12, "{row:?}");
    }
    for lambda in &report.analysis.lambdas {
        let found = lambda.few_numbers.as_ref().unwrap();
        let measured =
            |s: &&&eigenhand_train::Summary| s.lambda == lambda.lambda && !s.success_with_components.is_empty();
        assert_eq!(found.n_runs, summaries.iter().filter(measured).count());
        assert!(report.analysis.statements.contains(&found.statement));
    }

    // One row for each run, with the values of its summary.
    let table = rows(&out.path().join("runs.csv"));
    assert_eq!(
        table[0][..7],
        ["lambda", "seed", "success_rate", "contribution_sum", "n_postures", "episodes", "wall_s"]
    );
    for (row, run) in table[1..].iter().zip(&all) {
        let summary: serde_json::Value = serde_json::from_slice(&run.bytes("summary.json")).unwrap();
        assert_eq!(row[2].parse::<f64>().unwrap(), summary["success_rate"].as_f64().unwrap());
        assert_eq!(row[4], summary["n_postures"].to_string());
    }

    // Too few runs for an interval of the difference: the statement says so.
    let difference = report.analysis.differences.iter().find(|d| d.quantity.key() == "success_rate").unwrap();
    assert!(difference.contrast.interval.is_none() && difference.statement.contains("no interval"), "{difference:?}");
    let json: serde_json::Value = serde_json::from_str(&text(&out.path().join("report.json"))).unwrap();
    let stored = json["differences"].as_array().unwrap().iter().find(|d| d["quantity"] == "success_rate").unwrap();
    assert_eq!((&stored["verdict"], &stored["permutation"]["exact"]), (&"no_interval".into(), &true.into()));
    assert_eq!(
        (&stored["permutation"]["n_relabellings"], &stored["permutation"]["least_p"]),
        (&10.into(), &0.1.into())
    );
    let p = difference.contrast.permutation.p;
    assert_eq!(stored["permutation"]["p"], p);
    assert!((0.1..=1.0).contains(&p), "two against three runs have ten relabellings: {p}");
    assert!(page.contains("<th scope=\"col\">least p</th>") && page.contains("no: too few runs"));
    let of_one: Vec<f64> =
        report.analysis.runs.iter().filter(|r| r.lambda == 1.0).filter_map(|r| r.success_rate).collect();
    let estimate = &report.analysis.lambdas[1].quantities["success_rate"];
    assert_eq!(Some(estimate.iqm), interquartile_mean(&of_one));
    assert!(estimate.interval.is_some());

    // A second report with fewer runs replaces the first, and outdated files are gone.
    write(&runs[..2], out.path()).unwrap();
    assert!(!out.path().join("figures/contribution-l1.svg").exists());
    assert_eq!(rows(&out.path().join("runs.csv")).len(), 3);
}

#[test]
fn one_run_and_an_unfinished_one_are_worth_a_report() {
    let run = analysed();
    let runs = read(&run).unwrap();
    let summary = runs[0].summary.clone().unwrap();
    let mean = runs[0].errors.iter().sum::<f64>() / runs[0].errors.len() as f64;
    assert!(
        (mean - summary.mean_error_rad.unwrap()).abs() < 1e-9,
        "the mean of the errors is the one in the run's summary"
    );
    assert_eq!(runs[0].errors.len(), (summary.n_postures as usize).min(tiny(&[]).synergy.window));
    let report = write(&runs, &run.path.join("report")).unwrap();
    assert!(report.analysis.notes.is_empty() && report.analysis.differences.is_empty());
    let statements = &report.analysis.statements;
    assert!(statements[0].starts_with("With ") && statements[0].contains("(one run)"), "{statements:?}");
    assert!(statements[1].contains("in one run"), "{statements:?}");
    let content = summary.content.as_ref().unwrap();
    assert_eq!(report.analysis.lambdas[0].content["total_variance"].median, content.total_variance);
    assert!(text(&report.page).contains("What the grasps hold"));
    // The explorer's page comes along, so that the report can be moved.
    std::fs::write(run.file("explore.html"), "sliders").unwrap();
    write(&read(&run).unwrap(), &run.path.join("report")).unwrap();
    assert_eq!(text(&run.path.join("report/explore.html")), "sliders");

    // An earlier version wrote no such numbers: the report says so, and shows the rest.
    let mut earlier: serde_json::Value = serde_json::from_slice(&run.bytes("summary.json")).unwrap();
    for key in ["components", "success_with_components", "k_for_95", "content", "mean_self_penetration_m"] {
        earlier.as_object_mut().unwrap().remove(key).unwrap();
    }
    std::fs::write(run.file("summary.json"), earlier.to_string()).unwrap();
    let mut database = run.bytes("postures.sqlite");
    // Where SQLite keeps the version of a file's tables.
    database[60..64].copy_from_slice(&1_u32.to_be_bytes());
    std::fs::write(run.file("postures.sqlite"), database).unwrap();
    let report = write(&read(&run).unwrap(), &run.path.join("report")).unwrap();
    assert!(report.analysis.notes[0].contains("was trained by an earlier version"), "{:?}", report.analysis.notes);
    assert!(report.analysis.runs[0].success_rate.is_some() && report.analysis.lambdas[0].few_numbers.is_none());
    for figure in ["success-numbers", "error-distribution"] {
        assert!(!report.directory.join(format!("figures/{figure}.svg")).exists());
    }
    assert!(!text(&report.page).contains("What the grasps hold"));

    std::fs::remove_file(run.file("summary.json")).unwrap();
    let analysis = analyse(&read(&run).unwrap());
    assert_eq!(analysis.runs[0].state, "unfinished");
    assert!(analysis.notes[0].contains("is not finished (48 of 48"), "{:?}", analysis.notes);
    assert!(analysis.lambdas[0].quantities.is_empty() && analysis.statements.is_empty());

    // A run that has just begun gives no report.
    std::fs::write(run.file("metrics.csv"), "").unwrap();
    assert!(matches!(read(&run), Err(ReportError::NothingYet { .. })));
}

#[test]
fn what_is_wrong_with_the_runs_is_said() {
    let run = trained(1.0, 1);
    let empty = TempDir::new().unwrap();
    for path in [empty.path().to_owned(), empty.path().join("absent"), run.file("config.toml")] {
        assert!(
            matches!(read_runs(std::slice::from_ref(&path)), Err(ReportError::NoRuns { path: named }) if named == path)
        );
    }

    // A file that is not the report's stays untouched.
    std::fs::write(empty.path().join("mine.txt"), "mine").unwrap();
    let refused = write(&read(&run).unwrap(), empty.path()).err().unwrap();
    assert!(refused.is_usage() && matches!(refused, ReportError::OutExists { .. }), "{refused}");
    assert_eq!(files(empty.path()).len(), 1);

    let other = trained(0.0, 1);
    let provenance = text(&other.file("provenance.toml")).replace("hand = \"gripper\"", "hand = \"claw\"");
    std::fs::write(other.file("provenance.toml"), provenance).unwrap();
    let mixed = read_runs(&[run.path.clone(), other.path.clone()]).err().unwrap();
    assert!(mixed.is_usage() && mixed.to_string().contains("gripper") && mixed.to_string().contains("claw"), "{mixed}");

    for (content, part) in [
        ("", "this file holds no evaluation"),
        ("episode,success_rate\n", "this file holds no evaluation"),
        ("episode,success_rate\n8,many\n", "line 2: success_rate is \"many\""),
        ("\u{0}\u{1}\n", "line 1"),
    ] {
        std::fs::write(run.file("metrics.csv"), content).unwrap();
        let error = read(&run).err().unwrap().to_string();
        assert!(error.contains("metrics.csv") && error.contains(part), "{content:?}: {error}");
    }
    std::fs::remove_file(run.file("metrics.csv")).unwrap();
    std::fs::write(run.file("postures.sqlite"), "no database").unwrap();
    assert!(read(&run).is_err());
    std::fs::write(run.file("summary.json"), "{").unwrap();
    assert!(read(&run).err().unwrap().to_string().contains("summary.json"));
}
