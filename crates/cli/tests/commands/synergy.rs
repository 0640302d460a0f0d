//! `eigenhand synergy`: synergies are shown, compared, and fitted to other samples.

use std::path::Path;

use eigenhand_synergy::{JointInfo, MotionRecord, PostureDatabase, Unit};
use serde_json::Value;
use tempfile::TempDir;

use super::{FAILURE, USAGE, assert_error, gripper, json, run, stderr};

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
    let list = json(&run(&["synergy", "list", "--json"]));
    let named = list.as_array().unwrap().iter().find(|one| one["hand"] == "shadow").unwrap()["name"].as_str().unwrap();
    assert_eq!(json(&run(&["synergy", "show", named, "--json"])), found, "a ready synergy is found by its name");
    assert_error(&run(&["synergy", "show", named, "--components", "9"]), FAILURE, &["--components 9", "5 components"]);
    let compare = run(&["synergy", "compare", named, named, "--components", "6"]);
    assert_error(&compare, FAILURE, &["--components 6", "5 components"]);
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

#[test]
fn reducers_are_compared_on_grasps_that_they_have_not_seen() {
    let place = TempDir::new().unwrap();
    let path = place.path().join("postures.sqlite").display().to_string();
    database(Path::new(&path));
    let reducers = |more: &[&str]| run(&[&["synergy", "reducers", &path], more].concat());
    let found = json(&reducers(&["--components", "1,2", "--folds", "3", "--json"]));
    let results = found["reconstructions"].as_array().unwrap();
    let names: Vec<&str> = results.iter().map(|result| result["reducer"].as_str().unwrap()).collect();
    assert_eq!(names, ["pca", "ppca", "autoencoder", "pca", "ppca", "autoencoder"]);
    let shares: Vec<f64> = results.iter().map(|result| result["share"].as_f64().unwrap()).collect();
    assert!(shares[0] > 0.9 && shares[0] < 0.9999 && shares[3] > 1.0 - 1e-9, "{shares:?}");
    assert!(results[1]["log_density"].is_f64() && results[0]["log_density"].is_null(), "{found}");
    let table =
        String::from_utf8(reducers(&["--components", "1", "--reducers", "pca", "--folds", "3"]).stdout).unwrap();
    assert!(table.contains("60 samples of 2 coordinates in 3 parts") && !table.contains("ppca"), "{table}");
    assert_error(&reducers(&["--components", "3"]), FAILURE, &["2 coordinates", "1 to 2"]);
    assert_error(&reducers(&["--reducers", "magic"]), USAGE, &["magic", "autoencoder"]);
    // There are six grasps.
    assert_error(&reducers(&["--folds", "7"]), FAILURE, &["7", "6"]);
}

/// Analyses the policy's postures of some databases, and returns how many there are and the angles of their principal space
/// to the rows of a fit; and the angles between the rows of pairs of matrices.
const SCIPY: &str = r#"
import json, sqlite3, sys
import numpy as np
from scipy.linalg import subspace_angles
asked = json.load(open(sys.argv[1]))
postures = []
for path in asked["databases"]:
    with sqlite3.connect(path) as database:
        names = [name for (name,) in database.execute("select column_name from joint order by position")]
        columns = ", ".join('"%s"' % name for name in names)
        postures += database.execute(f"select {columns} from posture where source != 'script'").fetchall()
postures, fit = np.array(postures), np.array(asked["fit"])
main = np.linalg.svd(postures - postures.mean(axis=0))[2][: len(fit)]
pairs = [[main, fit]] + [[np.array(a), np.array(b)] for a, b in asked["pairs"]]
angles = [sorted(map(float, subspace_angles(a.T, b.T))) for a, b in pairs]
print(json.dumps({"samples": len(postures), "angles": angles}))
"#;

/// A synergy that three runs give together, and how far that of another lambda and that of a foreign table are from it.
#[test]
fn spaces_of_runs_are_as_far_apart_as_scipy_says() {
    if !super::python_has("scipy") {
        return;
    }
    let place = TempDir::new().unwrap();
    let path = |name: &str| place.path().join(name).display().to_string();
    let hand = super::write_gripper(place.path());
    let train = |seed: &str, lambda: &str| {
        let out = path(&format!("l{lambda}-s{seed}"));
        let settings = [&gripper::LONGER[..], &["episodes=80"]].concat();
        let mut arguments = super::gripper_run(&hand, Path::new(&out), &settings);
        arguments.extend(["--seed", seed, "--lambda", lambda].map(str::to_owned));
        let output = super::eigenhand().args(&arguments).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        out
    };
    let seeds = ["1", "2", "3"].map(|seed| train(seed, "1"));
    let free = train("1", "0");
    let fit = |sources: &[&str], more: &[&str]| {
        let arguments = [&["synergy", "fit"], sources, &["--space", "postures", "--json"], more].concat();
        json(&run(&arguments))["samples"].as_u64().unwrap()
    };
    let (three, foreign) = (path("three"), path("foreign"));
    let samples = fit(&seeds.each_ref().map(String::as_str), &["--components", "2", "--out", &three]);
    // The slide, two coupled fingers and the vane: three of the four joints move by themselves.
    let arguments = ["synergy", "fit", &seeds[0], "--space", "postures", "--components", "4", "--out", &path("four")];
    assert_error(&run(&arguments), FAILURE, &["--components 4", "at most 3"]);
    // Two of the joints as someone else measured them: with other names, in another order, one in degrees.
    std::fs::write(path("foreign.csv"), "vane,grip\n-20,0.01\n10,0.02\n30,0.05\n5,0.03\n").unwrap();
    let map =
        "columns.vane = { joint = \"vane_joint\", factor = 0.0174533 }\ncolumns.grip = { joint = \"left_joint\" }\n";
    std::fs::write(path("names.toml"), map).unwrap();
    fit(&[&path("foreign.csv")], &["--map", &path("names.toml"), "--components", "1", "--out", &foreign]);

    // (source, joints) => rows of its components, in these joints
    let rows = |source: &str, joints: Option<&Value>| -> Vec<Vec<f64>> {
        let shown = json(&run(&["synergy", "show", source, "--space", "postures", "--json"]));
        let row = |component: &Value| {
            let loadings: Vec<(String, f64)> = serde_json::from_value(component["loadings"].clone()).unwrap();
            let of = |name: &str| loadings.iter().find(|(known, _)| known == name).unwrap().1;
            match joints {
                None => loadings.iter().map(|(_, loading)| *loading).collect(),
                Some(joints) => joints.as_array().unwrap().iter().map(|name| of(name.as_str().unwrap())).collect(),
            }
        };
        shown["components"].as_array().unwrap().iter().map(row).collect()
    };
    let mut pairs = Vec::new();
    let mut found = Vec::new();
    for (a, b) in [(&three, &free), (&seeds[0], &free), (&three, &foreign)] {
        let compared = json(&run(&["synergy", "compare", a, b, "--space", "postures", "--json"]));
        pairs.push([rows(a, Some(&compared["joints"])), rows(b, Some(&compared["joints"]))]);
        found.push(numbers(&compared["angles"]));
    }
    assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [2, 2, 1]);
    let databases: Vec<String> = seeds.iter().map(|run| format!("{run}/postures.sqlite")).collect();
    let asked = serde_json::json!({ "databases": databases, "fit": rows(&three, None), "pairs": pairs });
    std::fs::write(path("asked.json"), asked.to_string()).unwrap();
    let output = super::python().args(["-c", SCIPY, &path("asked.json")]).output().unwrap();
    let expected = json(&output);
    assert_eq!(expected["samples"].as_u64(), Some(samples));
    let angles: Vec<Vec<f64>> = serde_json::from_value(expected["angles"].clone()).unwrap();
    assert!(angles[0].iter().all(|angle| *angle < 1e-6), "the fit is the analysis of all postures: {angles:?}");
    for (found, expected) in found.iter().zip(&angles[1..]) {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-7), "{found:?} {expected:?}");
    }
    assert!(
        found.iter().all(|angles| angles[0] < 1.5) && found[0][1] > 1e-3,
        "they share something, not all: {found:?}"
    );
}
