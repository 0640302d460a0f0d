//! The documents must agree with the code and files that they describe.

use std::collections::{BTreeMap, BTreeSet};

use eigenhand_hands::HandManifest;
use eigenhand_train::config::{Layers, Preset};
use toml::{Table, Value};

use crate::support::{Run, gripper, tiny, workspace};

fn read(name: &str) -> String {
    std::fs::read_to_string(workspace().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Returns the rows of a document's tables, split into cells.
fn rows(text: &str) -> Vec<Vec<String>> {
    let cells = |line: &str| line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect();
    text.lines().filter(|line| line.starts_with('|')).map(cells).collect()
}

/// Returns the words in backquotes.
fn quoted(text: &str) -> BTreeSet<String> {
    text.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

fn parse(cell: &str) -> Option<Value> {
    format!("value = {cell}").parse::<Table>().ok()?.remove("value")
}

fn settings(preset: Preset) -> BTreeMap<String, Value> {
    let config = Layers::new(preset).unwrap().resolve().unwrap();
    let table: Table = config.to_toml().unwrap().parse().unwrap();
    let mut flat = BTreeMap::new();
    flatten(&table, "", &mut flat);
    flat
}

fn flatten(table: &Table, prefix: &str, flat: &mut BTreeMap<String, Value>) {
    for (key, value) in table {
        let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match value {
            Value::Table(inner) => flatten(inner, &path, flat),
            _ => _ = flat.insert(path, value.clone()),
        }
    }
}

/// Compares two values; numbers are compared in single precision, because some settings are stored in it.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Float(a), Value::Float(b)) => *a as f32 == *b as f32,
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
        _ => a == b,
    }
}

#[test]
fn every_setting_is_documented_with_its_default() {
    let text = read("docs/configuration.md");
    let written: BTreeMap<String, String> = rows(&text)
        .into_iter()
        .filter(|row| row.len() == 4 && row[0].starts_with('`'))
        .map(|row| (row[0].trim_matches('`').to_owned(), row[1].clone()))
        .collect();
    let settings = settings(Preset::Default);
    for (key, value) in &settings {
        let cell = written.get(key).unwrap_or_else(|| panic!("docs/configuration.md lacks `{key}`, default {value}"));
        let found = parse(cell).unwrap_or_else(|| panic!("docs/configuration.md: `{key}` has the default {cell}"));
        assert!(same(&found, value), "docs/configuration.md: `{key}` is {cell}, but presets/default.toml has {value}");
    }
    for key in written.keys() {
        assert!(settings.contains_key(key), "docs/configuration.md has `{key}`, but there is no such setting");
    }
}

#[test]
fn every_deviation_of_the_default_from_the_paper_is_numbered() {
    let text = read("docs/algorithms.md");
    let (_, deviations) = text.split_once("## Deviations").expect("the section");
    let (by_setting, others) = deviations.split_once("### In both presets").expect("the section");
    let table: Vec<Vec<String>> = rows(by_setting).into_iter().filter(|row| row[0].parse::<u32>().is_ok()).collect();
    let whole = "synergy.penalty";
    let value = |preset: Preset, key: &str| {
        let config = Layers::new(preset).unwrap().resolve().unwrap();
        let mut table: Value = config.to_toml().unwrap().parse::<Table>().unwrap().into();
        for part in key.split('.') {
            table = table.get(part).unwrap_or_else(|| panic!("no setting {key}")).clone();
        }
        table
    };
    let mut documented = BTreeSet::new();
    for (i, row) in table.iter().enumerate() {
        assert_eq!(row[0], (i + 1).to_string(), "the deviations are numbered consecutively");
        let key = row[1].trim_matches('`');
        for (cell, preset) in [(&row[2], Preset::Default), (&row[3], Preset::Paper)] {
            let (found, expected) = (parse(cell), value(preset, key));
            let right = found.as_ref().is_some_and(|found| same(found, &expected));
            assert!(right, "docs/algorithms.md, deviation {}: {key} is {cell}, but {expected} in {preset:?}", row[0]);
        }
        let differs = !same(&value(Preset::Default, key), &value(Preset::Paper, key));
        assert!(differs, "docs/algorithms.md, deviation {}: {key} is the paper's", row[0]);
        documented.insert(key.to_owned());
    }
    let (default, paper) = (settings(Preset::Default), settings(Preset::Paper));
    for key in default.keys().chain(paper.keys()).filter(|key| *key != "preset") {
        let differs = match (default.get(key), paper.get(key)) {
            (Some(a), Some(b)) => !same(a, b),
            _ => true,
        };
        let name = if key.starts_with(whole) { whole } else { key };
        assert!(!differs || documented.contains(name), "docs/algorithms.md lacks the deviation of {key}");
    }
    let numbers = others.lines().filter_map(|line| line.split_once(". ")?.0.parse::<usize>().ok());
    let expected: Vec<usize> = (table.len() + 1..).take(numbers.clone().count()).collect();
    assert_eq!(numbers.collect::<Vec<_>>(), expected, "the deviations are numbered consecutively");
}

#[test]
fn every_column_and_every_file_of_a_run_is_documented() {
    let run = Run::new(gripper());
    run.train(&tiny(&[]));
    let algorithms = quoted(&read("docs/algorithms.md"));
    for column in run.metrics()[0].keys() {
        let general = match (column.strip_prefix("success_rate_"), column.strip_prefix("contribution_")) {
            (Some(_), _) => "success_rate_<object>",
            (_, Some(i)) if i.parse::<usize>().is_ok() => "contribution_<i>",
            _ => column,
        };
        assert!(algorithms.contains(general), "docs/algorithms.md lacks the column `{column}`");
    }
    let summary: serde_json::Value = serde_json::from_slice(&run.bytes("summary.json")).unwrap();
    for key in summary.as_object().unwrap().keys() {
        assert!(algorithms.contains(key), "docs/algorithms.md lacks the key `{key}` of summary.json");
    }
    let text = read("docs/run-directory.md");
    let directory = quoted(&text);
    let policy: Table = String::from_utf8(run.bytes("policy.toml")).unwrap().parse().unwrap();
    let table = |file: &str| -> Table { String::from_utf8(run.bytes(file)).unwrap().parse().unwrap() };
    let (commands, postures) = (table("synergy/synergy.toml"), table("synergy-postures/synergy.toml"));
    for key in policy.keys().chain(commands.keys()).chain(postures.keys()) {
        assert!(directory.contains(key), "docs/run-directory.md lacks the key `{key}`");
    }
    for (section, table) in [("joint_map", &commands["joint_map"]), ("actuation", &postures["actuation"])] {
        for key in table.as_table().unwrap().keys() {
            assert!(directory.contains(&format!("{section}.{key}")), "docs/run-directory.md lacks {section}.{key}");
        }
    }
    for path in run.snapshot().keys() {
        let name = path.file_name().unwrap().to_str().unwrap();
        let general = match name {
            _ if name.ends_with(".xml") => "<object>.xml",
            _ if name.starts_with("events.out.tfevents.") => "events.out.tfevents.<n>",
            _ if name.starts_with("policy-") => "policy-<m>.safetensors",
            _ => name,
        };
        assert!(text.contains(general), "docs/run-directory.md lacks the file {}", path.display());
    }
}

#[test]
fn the_hand_in_the_readme_is_one() {
    let text = read("README.md");
    let manifest = text.split("```toml").nth(1).and_then(|rest| rest.split("```").next()).expect("a manifest");
    let manifest = HandManifest::parse(manifest, "README.md".as_ref()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((manifest.name.as_str(), manifest.fingertips.len()), ("myhand", 2));
}

#[test]
fn links_between_documents_lead_somewhere() {
    for document in [
        "README.md",
        "ARCHITECTURE.md",
        "CHANGELOG.md",
        "bench/peers/README.md",
        "crates/synergy/README.md",
        "docs/README.md",
        "docs/algorithms.md",
        "docs/configuration.md",
        "docs/experiments.md",
        "docs/gallery.md",
        "docs/hands.md",
        "docs/objects.md",
        "docs/performance.md",
        "docs/reliability.md",
        "docs/report.md",
        "docs/results/README.md",
        "docs/run-directory.md",
        "docs/scaling.md",
        "docs/study/README.md",
        "examples/python/README.md",
    ] {
        let text = read(document);
        let directory = workspace().join(document).parent().unwrap().to_owned();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let path = link.split('#').next().unwrap();
            if path.is_empty() || path.contains("://") {
                continue;
            }
            assert!(directory.join(path).exists(), "{document} links to {link}, which is not there");
        }
    }
}

/// The table in the document must equal the report's CSV file.
#[test]
fn the_table_of_results_is_that_of_the_runs() {
    let file = read("docs/results/runs.csv");
    let mut lines = file.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().unwrap();
    let runs: Vec<Vec<String>> = lines
        .map(|line| {
            let value = |name: &str| line[head.iter().position(|column| *column == name).unwrap()];
            let number = |name: &str| value(name).parse::<f64>().unwrap();
            let percent = |name: &str| format!("{:.1} %", 100.0 * number(name));
            vec![
                value("lambda").to_owned(),
                value("seed").to_owned(),
                percent("success_rate"),
                percent("success_with_5"),
                percent("success_with_2"),
                percent("success_with_1"),
                percent("success_with_0"),
                format!("{:.3}", number("contribution_sum")),
                format!("{:.3}", number("mean_error_rad")),
                format!("{:.1}", 1000.0 * number("mean_penetration_m")),
                value("n_postures").to_owned(),
            ]
        })
        .collect();
    assert!(!runs.is_empty());
    let written: Vec<Vec<String>> =
        rows(&read("docs/results/README.md")).into_iter().filter(|row| row[0].parse::<f64>().is_ok()).collect();
    assert_eq!(written, runs);
}

/// The tests that the page on reliability names.
#[test]
fn the_tests_that_a_page_names_exist() {
    let page = std::fs::read_to_string(workspace().join("docs/reliability.md")).unwrap();
    let names: Vec<&str> = page.split('`').skip(1).step_by(2).filter(|word| word.matches('_').count() > 2).collect();
    assert!(names.len() > 15, "{names:?}");
    let code: String = ["crates", "tests", "xtask"]
        .iter()
        .flat_map(|place| crate::source::rust_files(&workspace().join(place)))
        .map(|file| std::fs::read_to_string(file).unwrap())
        .collect();
    for name in names {
        assert!(code.contains(&format!("fn {name}(")), "there is no test {name}");
    }
}
