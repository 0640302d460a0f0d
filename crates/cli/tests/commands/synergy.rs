//! `eigenhand synergy`: synergies are shown, compared, and fitted to other samples.

use std::path::Path;

use eigenhand_synergy::{JointInfo, MotionRecord, PostureDatabase, Unit};
use serde_json::Value;
use tempfile::TempDir;

use super::{FAILURE, USAGE, assert_error, json, run, stderr};

/// A synergy of the repository, of a hand that it has.
fn ready() -> String {
    super::workspace().join("synergies/shadow").display().to_string()
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

/// A database with motions of two objects: the hand closes from one posture to another, a little differently each time.
fn database(path: &Path) {
    let coordinate = |name: &str| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -2.0, upper: 2.0 };
    let (joints, actuators) = (["slide", "J1", "J2"].map(coordinate), ["A1", "A2"].map(coordinate));
    let mut database = PostureDatabase::open(path, &joints, &actuators).unwrap();
    let motion = |i: u32| {
        let (bend, curl) = (f64::from(i % 10) / 10.0, f64::from(i % 3) / 30.0);
        MotionRecord {
            episode: u64::from(i / 10),
            object: if i < 20 { "cube" } else { "disc" }.to_owned(),
            step: i % 10,
            held: i % 10 > 5,
            posture: vec![0.1, bend, 0.5 * bend + curl],
            command: vec![bend, bend + curl],
        }
    };
    database.insert_motions(&(0..60).map(motion).collect::<Vec<_>>()).unwrap();
}

#[test]
fn a_synergy_is_fitted_to_some_samples_of_a_database() {
    let place = TempDir::new().unwrap();
    let path = |name: &str| place.path().join(name).display().to_string();
    database(&place.path().join("postures.sqlite"));
    let fit = |more: &[&str]| {
        run(&[&["synergy", "fit", &path("postures.sqlite"), "--out", &path("out"), "--json"], more].concat())
    };
    let count = |more: &[&str]| json(&fit(more))["samples"].as_u64().unwrap();
    assert_eq!(count(&["--components", "1"]), 60);
    assert_eq!(count(&["--object", "cube"]), 20);
    assert_eq!(count(&["--object", "disc", "--episodes", "3..5"]), 20);
    assert_eq!(count(&["--weights", "per-object"]), 40);
    let text = std::fs::read_to_string(place.path().join("out/synergy.toml")).unwrap();
    assert!(text.contains("[joint_map]") && text.contains("weights = \"per-object\""), "{text}");
    std::fs::remove_dir_all(place.path().join("out")).unwrap();
    assert_error(&fit(&["--object", "cube", "--object", "sphere"]), FAILURE, &["sphere", "they have cube, disc"]);
    assert_error(&fit(&["--joints", "fingers"]), FAILURE, &["needs the hand", "--hand"]);
    assert_error(&fit(&["--episodes", "5..5"]), USAGE, &["A..B"]);
    let not_a_run = run(&["synergy", "fit", &ready(), "--out", &path("out")]);
    assert_error(&not_a_run, FAILURE, &["no run directory"]);
    assert!(!place.path().join("out").exists());
}

#[test]
fn what_would_be_wrong_in_silence_is_refused() {
    let place = TempDir::new().unwrap();
    let path = |name: &str| place.path().join(name).display().to_string();
    let shown = json(&run(&["hands", "show", "shadow", "--json"]));
    let key = shown["values"].as_array().unwrap().iter().find(|value| value["key"] == "posture_joints").unwrap();
    let joint = key["value"][1].as_str().unwrap();
    std::fs::write(path("degrees.csv"), format!("time,{joint}\nnoon,0\none,90\n")).unwrap();
    std::fs::write(path("map.toml"), "columns.time = { drop = true }\n").unwrap();
    std::fs::write(path("slip.toml"), "columns.Time = { drop = true }\n").unwrap();
    std::fs::write(path("numbers.csv"), "time,bend\n0,0\n1,0.5\n").unwrap();
    let fit_table =
        |table: &str, more: &[&str]| run(&[&["synergy", "fit", &path(table), "--out", &path("out")], more].concat());
    let fit = |more: &[&str]| fit_table("degrees.csv", more);
    let told = ["--space", "postures", "--hand", "shadow"];
    assert_error(&fit(&["--hand", "shadow"]), FAILURE, &["--space"]);
    let error = fit(&[&told[..], &["--map", &path("map.toml")]].concat());
    assert_error(&error, FAILURE, &[joint, "its limits are", "0.0174533"]);
    let error = fit_table("numbers.csv", &["--space", "postures", "--map", &path("slip.toml")]);
    assert_error(&error, FAILURE, &["no table has the column Time", "time"]);
    assert!(!place.path().join("out").exists());
    // A posture is no command, although joints and actuators may have the same names.
    std::fs::write(path("a.csv"), "a,b\n0,1\n1,3\n").unwrap();
    for space in ["postures", "commands"] {
        json(&run(&["synergy", "fit", &path("a.csv"), "--space", space, "--out", &path(space), "--json"]));
    }
    assert_error(&run(&["synergy", "compare", &path("postures"), &path("commands")]), FAILURE, &["of one kind"]);
    assert_error(&run(&["synergy", "show", &ready(), "--space", "postures"]), FAILURE, &["control synergy"]);
}

#[test]
fn a_page_is_written_for_a_synergy_and_its_hand() {
    let place = TempDir::new().unwrap();
    let path = |name: &str| place.path().join(name).display().to_string();
    let explore = |synergy: &str, more: &[&str]| run(&[&["explore", "--synergy", synergy, "--json"], more].concat());
    let made = json(&explore(&ready(), &["--out", &path("page.html")]));
    let page = std::fs::read_to_string(path("page.html")).unwrap();
    assert_eq!(made["bytes"].as_u64().unwrap() as usize, page.len());
    assert!(page.contains("control synergy of shadow: 5 numbers") && !page.contains("{{"), "the page is filled in");
    let place_of_page = place.path().display().to_string();
    assert_error(&explore(&ready(), &["--out", &place_of_page]), FAILURE, &["is a directory", "explore.html"]);
    assert_error(
        &explore(&ready(), &["--hand", "parallel", "--out", &path("x")]),
        FAILURE,
        &["the hand parallel has no"],
    );
    // Commands without postures do not tell where the joints are; a table without a hand does not tell whose joints they are.
    std::fs::write(path("a.csv"), "a,b\n0,1\n1,3\n").unwrap();
    json(&run(&["synergy", "fit", &path("a.csv"), "--space", "commands", "--out", &path("commands"), "--json"]));
    let error = explore(&path("commands"), &["--hand", "shadow", "--out", &path("x")]);
    assert_error(&error, FAILURE, &["no joint map"]);
    assert_error(&explore(&path("commands"), &["--out", &path("x")]), USAGE, &["--hand"]);
    assert!(!Path::new(&path("x")).exists());
}
