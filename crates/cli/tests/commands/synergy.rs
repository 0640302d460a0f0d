//! `eigenhand synergy`: synergies are shown, compared, and fitted to other samples.

use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use super::{FAILURE, assert_error, json, run, stderr};

/// A synergy of the repository, of a hand that it has.
fn ready() -> String {
    let mut entries = std::fs::read_dir(super::workspace().join("synergies")).unwrap();
    entries.next().unwrap().unwrap().path().display().to_string()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

#[test]
fn a_synergy_is_shown_with_bars_and_words() {
    let output = run(&["synergy", "show", &ready(), "--components", "2"]);
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(text.contains("z1 rises: closes") && text.contains('\u{2588}') && !text.contains("z3"), "{text}");
    let found = json(&run(&["synergy", "show", &ready(), "--json"]));
    let component = &found["components"][0];
    let loadings = component["loadings"].as_array().unwrap();
    let length: f64 = loadings.iter().map(|loading| loading[1].as_f64().unwrap().powi(2)).sum();
    assert!((length - 1.0).abs() < 1e-9 && component["words"].as_str().unwrap().contains("closes"), "{component}");
    let place = TempDir::new().unwrap();
    let missing = place.path().join("nothing").display().to_string();
    assert_error(&run(&["synergy", "show", &missing]), FAILURE, &["does not exist", "run directory"]);
    assert_error(&run(&["synergy", "show", &place.path().display().to_string()]), FAILURE, &["holds no synergy"]);
}

#[test]
fn a_synergy_is_fitted_to_a_table_and_compared() {
    let place = TempDir::new().unwrap();
    let path = |name: &str| place.path().join(name).display().to_string();
    // Two joints move together by one and two parts; the third varies less. In the other table, one joint is turned round.
    let rows: Vec<[f64; 3]> =
        (0..40).map(|i| (f64::from(i) / 10.0, f64::from(i % 3) / 50.0)).map(|(t, u)| [t, 2.0 * t, u]).collect();
    let table = |names: &str, factor: f64| {
        let lines = rows.iter().map(|[a, b, c]| format!("{},{},{}\n", factor * a + 0.5, b, c));
        format!("{names}\n{}", lines.collect::<String>())
    };
    std::fs::write(path("a.csv"), table("a,b,c", 1.0)).unwrap();
    std::fs::write(path("b.csv"), table("A,b,d", -1.0)).unwrap();
    std::fs::write(path("map.toml"), "columns.A = { joint = \"a\", factor = -1.0, offset = 0.5 }\n").unwrap();
    let fit = |table: &str, more: &[&str]| {
        let out = path(&format!("{table}-fit"));
        let arguments = ["synergy", "fit", &path(table), "--space", "postures", "--out", &out, "--json"];
        json(&run(&[&arguments[..], more].concat()))
    };
    let a = fit("a.csv", &["--variance", "0.9"]);
    assert_eq!((&a["components"], &a["samples"], &a["hand"]), (&1.into(), &40.into(), &"unknown".into()));
    fit("b.csv", &["--map", &path("map.toml"), "--components", "2"]);
    let compared = json(&run(&["synergy", "compare", &path("a.csv-fit"), &path("b.csv-fit"), "--json"]));
    assert_eq!(compared["joints"], serde_json::json!(["a", "b"]));
    assert_eq!(compared["alone"], serde_json::json!([["c"], ["d"]]));
    assert!(numbers(&compared["angles"])[0] < 1e-6, "{compared}");
    let own = numbers(&compared["explained"][0]["own"])[0];
    let other = numbers(&compared["explained"][0]["other"])[0];
    assert!((own - 1.0).abs() < 1e-6 && (other - 1.0).abs() < 1e-6, "{compared}");
    let loadings = json(&run(&["synergy", "show", &path("a.csv-fit"), "--json"]))["components"][0]["loadings"].clone();
    let expected = 1.0 / 5.0_f64.sqrt();
    assert!((loadings[0][1].as_f64().unwrap() - expected).abs() < 1e-3, "{loadings}");
    // What is asked for and cannot be is refused, and nothing is written.
    let refused = |more: &[&str], says: &str| {
        let arguments = ["synergy", "fit", &path("a.csv"), "--space", "postures", "--out", &path("refused")];
        assert_error(&run(&[&arguments[..], more].concat()), FAILURE, &[says]);
        assert!(!Path::new(&path("refused")).exists());
    };
    refused(&["--components", "3"], "2 independent directions");
    refused(&["--joints", "a,z"], "no z; they have a, b, c");
    refused(&["--object", "cube"], "which object");
    refused(&["--weights", "per-object"], "objects");
}
