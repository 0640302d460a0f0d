//! `eigenhand reproduce` and `eigenhand report`, as a user runs them, with a hand that trains in seconds.
#![forbid(unsafe_code)]
// A helper function of a test fails the test, which is what a panic means here.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

#[path = "../../../tests/workspace/gripper.rs"]
#[allow(dead_code)]
mod gripper;

/// A directory with the hand, in which commands run.
struct Place {
    root: TempDir,
}

impl Place {
    fn new() -> Place {
        let root = TempDir::new().unwrap();
        let hand = root.path().join("gripper");
        std::fs::create_dir(&hand).unwrap();
        std::fs::write(hand.join("hand.toml"), gripper::GRIPPER_MANIFEST).unwrap();
        std::fs::write(hand.join("gripper.xml"), gripper::GRIPPER_MODEL).unwrap();
        Place { root }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().join(name)
    }

    /// The command `reproduce` into the directory `all`, with more arguments.
    fn reproduce(&self, more: &[&str]) -> Command {
        let mut command = self.eigenhand(&["reproduce", "--hand", "gripper", "--out", "all"]);
        let varied = |setting: &&&str| !["hand=", "workers=", "lambda="].iter().any(|key| setting.starts_with(key));
        gripper::TINY.iter().filter(varied).for_each(|setting| _ = command.args(["--set", setting]));
        // The gripper has one actuator.
        command.args(["--set", "synergy.components=1"]);
        // The gripper is made for a cube; longer objects touch its pads at the start.
        command.args(["--set", "learner.gamma=0.9", "--force"]).args(more);
        command
    }

    fn eigenhand(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_eigenhand"));
        command.args(arguments).current_dir(self.root.path()).env("EIGENHAND_NO_INSTALL", "1").stdin(Stdio::null());
        command.env("XDG_CACHE_HOME", self.path("cache"));
        command
    }

    fn summary(&self, run: &str) -> Value {
        json(&std::fs::read(self.path("all").join(run).join("summary.json")).unwrap())
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }
}

fn json(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn status(command: &mut Command, expected: i32) -> Output {
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(expected), "{}", stderr(&output));
    output
}

#[test]
fn a_reproduction_is_continued_and_not_repeated() {
    let place = Place::new();
    let output = status(&mut place.reproduce(&["--seeds", "2", "--jobs", "2", "--json"]), 0);
    let printed = json(&output.stdout);
    let runs = printed["runs"].as_array().unwrap();
    let names: Vec<&str> = runs.iter().map(|run| run["run"].as_str().unwrap()).collect();
    assert_eq!(names, ["l0-s1", "l0-s2", "l1-s1", "l1-s2"]);
    assert!(runs.iter().all(|run| run["state"] == "complete"), "{printed}");
    let table = place.text("all/report/runs.csv");
    assert!(table.starts_with("lambda,seed,success_rate,contribution_sum,n_postures,episodes,wall_s,"), "{table}");
    assert_eq!(table.lines().count(), 5);
    assert!(place.text("all/report/index.html").contains("l1-s2"));
    assert!(place.text("all/l1-s2.log").contains("episode 24/24"));

    // One run loses its end, as if it had been interrupted, and another seed is asked for.
    let before = ["l0-s1", "l1-s1", "l0-s2", "l1-s2"].map(|run| (run, place.summary(run)));
    std::fs::remove_file(place.path("all/l1-s2/summary.json")).unwrap();
    let output = status(&mut place.reproduce(&["--seeds", "3", "--lambda", "0,1"]), 0);
    let told = stderr(&output);
    assert!(told.contains("3 complete, 1 to be resumed"), "{told}");
    assert!(told.find("l1-s2 goes on") < told.find("l0-s3 starts"), "{told}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("l1-s3"), "the report is printed");
    for (run, earlier) in &before {
        let now = place.summary(run);
        if *run == "l1-s2" {
            assert_eq!((&now["success_rate"], &now["n_postures"]), (&earlier["success_rate"], &earlier["n_postures"]));
        } else {
            assert_eq!(now, *earlier, "{run} was trained again");
        }
    }

    let output = status(&mut place.reproduce(&["--seeds", "3", "--set", "learner.gamma=0.5"]), 2);
    assert!(stderr(&output).contains("learner.gamma is 0.9 there and 0.5 here"), "{}", stderr(&output));
    let output = status(&mut place.reproduce(&["--set", "lambda=2"]), 2);
    assert!(stderr(&output).contains("--lambda"), "{}", stderr(&output));

    // A run that cannot go on costs itself and no other.
    std::fs::remove_file(place.path("all/l0-s1/summary.json")).unwrap();
    for checkpoint in checkpoints(&place.path("all/l0-s1")) {
        std::fs::write(checkpoint.join("state.toml"), "schema = \"damaged\"\n").unwrap();
    }
    let output = status(&mut place.reproduce(&["--seeds", "4", "--lambda", "0", "--quiet"]), 1);
    assert!(stderr(&output).contains("failed: l0-s1"), "{}", stderr(&output));
    assert_eq!(place.summary("l0-s4")["stopped_by"], "episodes");
    let page = place.text("all/report/index.html");
    assert!(page.contains("l0-s1 is not finished") && page.contains("l0-s4"), "the report names what is missing");
    let output = status(&mut place.reproduce(&["--seeds", "1", "--lambda", "0"]), 1);
    let told = stderr(&output);
    assert!(told.contains("l0-s1 failed") && told.contains("state.toml"), "the end of its log is shown: {told}");
}

fn checkpoints(run: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(run.join("checkpoints")).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with("episode-")).collect()
}

#[test]
fn an_interrupt_stops_every_run_with_everything_saved() {
    use std::time::{Duration, Instant};

    let place = Place::new();
    let long = ["--seeds", "1", "--jobs", "2", "--set", "episodes=1000000"];
    let mut command = place.reproduce(&long);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let started = Instant::now();
    let rows = |run: &str| std::fs::read_to_string(place.path("all").join(run).join("metrics.csv")).unwrap_or_default();
    let begun = |run: &str| rows(run).lines().count() > 1;
    while !(begun("l0-s1") && begun("l1-s1")) {
        assert!(started.elapsed() < Duration::from_secs(300), "no run came to its first evaluation");
        std::thread::sleep(Duration::from_millis(20));
    }
    let pid = rustix::process::Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap();
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(stderr(&output).contains("continue with: eigenhand reproduce --hand gripper"), "{}", stderr(&output));
    for run in ["l0-s1", "l1-s1"] {
        assert_eq!(place.summary(run)["stopped_by"], "interrupt", "{run}");
    }
    let output = status(&mut place.eigenhand(&["report", "all", "--json"]), 0);
    let printed = json(&output.stdout);
    assert!(printed["runs"].as_array().unwrap().iter().all(|run| run["state"] == "interrupted"), "{printed}");
}

#[test]
fn a_wrong_command_line_is_answered_before_anything_is_made() {
    let place = Place::new();
    for (arguments, part) in [
        (vec!["--seeds", "0"], "at least one seed"),
        (vec!["--seeds", "a"], "no seed"),
        (vec!["--lambda", "-1"], "-1"),
        (vec!["--set", "learner.gama=0.9"], "learner.gamma"),
        (vec!["--jobs", "0"], "--jobs"),
    ] {
        let output = status(&mut place.reproduce(&arguments), 2);
        assert!(stderr(&output).contains(part), "{arguments:?}: {}", stderr(&output));
    }
    assert!(!place.path("all").exists());
    for arguments in [["report", "nothing"], ["report", "gripper"]] {
        let output = status(&mut place.eigenhand(&arguments), 1);
        assert!(stderr(&output).contains("is not a run directory"), "{}", stderr(&output));
    }
}

#[test]
fn a_study_trains_each_space_after_the_run_that_it_needs() {
    let place = Place::new();
    let without_closing = status(&mut place.reproduce(&["--study", "control"]), 2);
    assert!(stderr(&without_closing).contains("no [closing] in hand.toml"), "{}", stderr(&without_closing));
    assert!(!place.path("all/joints-s1").exists());
    let manifest = format!("{}\n[closing]\nclose = 1\n", gripper::GRIPPER_MANIFEST);
    let model = gripper::GRIPPER_MODEL
        .replace("<!-- extra bodies -->", gripper::VANE)
        .replace("<!-- extra actuators -->", gripper::TURN);
    std::fs::write(place.path("gripper/hand.toml"), manifest).unwrap();
    std::fs::write(place.path("gripper/gripper.xml"), model).unwrap();
    let study = |more: &[&str]| {
        let mut command = place.reproduce(&["--study", "control", "--seeds", "1", "--jobs", "2"]);
        // As many components as the hand has actuators with the vane.
        let settings = ["synergy.components=2", "synergy.window=0", "synergy.penalty=none", "evaluation.every=20"];
        let others = ["evaluation.other_objects=[\"sphere\", \"disc\"]", "evaluation.selection_episodes=40"];
        // With these the gripper learns to grasp in 120 episodes.
        let learns = ["learner.gamma=0.995", "exploration.coordinated_probability=0"];
        let settings = settings.iter().chain(&others).chain(&learns).chain(&gripper::LONGER);
        settings.for_each(|setting| _ = command.args(["--set", setting]));
        command.args(more);
        command
    };
    let told = stderr(&status(&mut study(&[]), 0));
    let line = |part: &str| told.lines().position(|line| line.starts_with(part)).unwrap();
    let order = |first: &str, then: &str| line(first) < line(then);
    assert!(order("joints-s1 is complete", "free-synergy-2-s1 starts"), "{told}");
    for variant in ["synergy-2", "synergy-1", "random-2"] {
        assert!(order("confined-s1 is complete", &format!("{variant}-s1 starts")), "{told}");
    }

    let names = ["joints", "confined", "free-synergy-2", "synergy-2", "synergy-1", "random-2", "closing-1"];
    let toml = |name: &str| -> toml::Table { place.text(name).parse().unwrap() };
    for name in names {
        let config = toml(&format!("all/{name}-s1/config.toml"));
        let acts = if ["joints", "confined"].contains(&name) { "joints" } else { "synergy" };
        assert_eq!(config["action_space"].as_str(), Some(acts), "{name}");
    }
    let numbers = |file: &toml::Table, key: &str| -> Vec<f64> {
        file[key].as_array().unwrap().iter().map(|number| number.as_float().unwrap()).collect()
    };
    let (own, random) = (toml("all/confined-s1/synergy/synergy.toml"), toml("all/spaces/random-2-s1.toml"));
    for (own, random) in numbers(&own, "mean").into_iter().zip(numbers(&random, "mean")) {
        assert!((own - random).abs() < 1e-9, "{own} {random}");
    }
    for (own, random) in numbers(&own, "explained_variance").into_iter().zip(numbers(&random, "explained_variance")) {
        assert!((own - random).abs() < 1e-9, "the numbers vary alike: {own} {random}");
    }
    assert_ne!(own["components"], random["components"]);
    // From the open gripper to the closed one; the vane stays.
    let closing = toml("all/spaces/closing-1-s1.toml");
    assert_eq!(closing["components"], toml::Value::try_from([[1.0, 0.0]]).unwrap());
    assert_eq!(numbers(&closing, "mean"), [0.025, 0.0]);

    for name in names {
        let others = &place.summary(&format!("{name}-s1"))["other_objects"];
        assert_eq!((&others["episodes"], others["success_rate_per_object"].as_object().unwrap().len()), (&6.into(), 2));
    }
    assert!(place.summary("confined-s1")["other_objects"]["success_with_components"].is_number());
    let table = place.text("all/report/runs.csv");
    for name in names {
        let episodes = if ["joints", "confined"].contains(&name) { 120 } else { 40 };
        assert!(table.contains(&format!("\n{name},1,{name}-s1,complete,{episodes},")), "{name} is complete: {table}");
    }
    assert!(place.text("all/report/index.html").contains("all closing joints together"));

    // The same command again trains nothing.
    let told = stderr(&status(&mut study(&[]), 0));
    assert!(told.contains("7 complete") && !told.contains("starts"), "{told}");
    // `report` knows a study by its directory.
    let again = status(&mut place.eigenhand(&["report", "all", "--json"]), 0);
    let variants = json(&again.stdout)["variants"].clone();
    let found: Vec<&str> =
        variants.as_array().unwrap().iter().map(|variant| variant["name"].as_str().unwrap()).collect();
    assert_eq!(found, names);
    let output = status(&mut study(&["--lambda", "0"]), 2);
    assert!(stderr(&output).contains("--lambda"), "{}", stderr(&output));
}
