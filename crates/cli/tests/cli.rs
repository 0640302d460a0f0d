//! The command line as scripts see it: standard output, standard error, exit status, and what is left on disk.
#![forbid(unsafe_code)]
// A helper function of a test fails the test, which is what a panic means here.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use disk::Disk;
use eigenhand_synergy::PostureDatabase;
use serde_json::Value;
use tempfile::TempDir;

#[path = "../../../tests/workspace/gripper.rs"]
#[allow(dead_code)]
mod gripper;

#[path = "../../../xtask/src/disk.rs"]
mod disk;
#[path = "commands/synergy.rs"]
mod synergy;
#[path = "commands/unruly.rs"]
mod unruly;

/// Settings with which a run passes through every stage in a second or two.
const TINY: [&str; 11] = [
    "training.warmup_episodes=6",
    "training.checkpoint_every=4",
    "evaluation.every=8",
    "evaluation.episodes=2",
    "evaluation.final_episodes=4",
    "evaluation.selection_episodes=4",
    "task.steps=20",
    "task.settle_time=0.1",
    "learner.hidden=[16, 16]",
    "learner.batch_size=32",
    "workers=1",
];
/// Time after which something that should happen in a second is taken not to happen, also on a busy machine.
const PATIENCE: Duration = Duration::from_secs(300);
/// Status of a failure, of a wrong command line, and after Ctrl-C.
const FAILURE: i32 = 1;
const USAGE: i32 = 2;
const INTERRUPTED: i32 = 130;

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn eigenhand() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_eigenhand"));
    command.current_dir(workspace()).env_remove("EIGENHAND_PLUGINS").env("EIGENHAND_NO_INSTALL", "1");
    command.env("XDG_CACHE_HOME", Path::new(env!("CARGO_TARGET_TMPDIR")).join("cache"));
    command
}

/// Returns the Python of the tests: the one in `EIGENHAND_PYTHON`, or else the system's.
fn python() -> Command {
    Command::new(std::env::var("EIGENHAND_PYTHON").unwrap_or_else(|_| "python3".to_owned()))
}

/// Tells whether that Python has a module. Where `EIGENHAND_PYTHON_REQUIRED` is set, it must.
fn python_has(module: &str) -> bool {
    let there = python().args(["-c", &format!("import {module}")]).output().is_ok_and(|probe| probe.status.success());
    assert!(there || std::env::var_os("EIGENHAND_PYTHON_REQUIRED").is_none(), "Python cannot import {module}");
    there
}

fn run(arguments: &[&str]) -> Output {
    eigenhand().args(arguments).output().unwrap()
}

/// Name of a hand that the workspace has, as files that a test can copy and change: the one with the fewest actuators, whose
/// runs are the shortest.
fn hand() -> String {
    let hands = json(&run(&["hands", "list", "--json"]));
    let written = |hand: &&Value| Path::new(hand["directory"].as_str().unwrap()).join("hand.toml").is_file();
    let actuators = |hand: &&Value| hand["n_actuators"].as_u64();
    hands.as_array().unwrap().iter().filter(written).min_by_key(actuators).unwrap()["name"].as_str().unwrap().to_owned()
}

/// Starts the arguments of a tiny run.
fn tiny(hand: &str, out: &Path) -> Vec<String> {
    let mut arguments: Vec<String> =
        ["train", "--hand", hand, "--preset", "quick", "--out"].map(str::to_owned).to_vec();
    arguments.push(out.display().to_string());
    for setting in TINY {
        arguments.extend(["--set".to_owned(), setting.to_owned()]);
    }
    arguments
}

/// Writes the gripper with a vane into a directory of its own in a place, and returns its path.
fn write_gripper(place: &Path) -> String {
    let hand = place.join("gripper");
    std::fs::create_dir(&hand).unwrap();
    let model = gripper::GRIPPER_MODEL.replace("<!-- extra bodies -->", gripper::VANE);
    std::fs::write(hand.join("gripper.xml"), model.replace("<!-- extra actuators -->", gripper::TURN)).unwrap();
    std::fs::write(hand.join("hand.toml"), gripper::GRIPPER_MANIFEST).unwrap();
    hand.display().to_string()
}

/// Starts the arguments of a run of the gripper, which succeeds now and then; `more` are further settings.
fn gripper_run(hand: &str, out: &Path, more: &[&str]) -> Vec<String> {
    let mut arguments = ["train", "--hand", hand, "--force", "--out"].map(str::to_owned).to_vec();
    arguments.push(out.display().to_string());
    for setting in gripper::TINY.iter().chain(more).filter(|setting| !setting.starts_with("hand=")) {
        arguments.extend(["--set".to_owned(), (*setting).to_owned()]);
    }
    arguments
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Reads standard output, which must be one JSON document and nothing else.
fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {output:?}"))
}

/// Asserts that a command failed with this status and one error that says all of these.
fn assert_error(output: &Output, status: i32, says: &[&str]) {
    let text = stderr(output);
    assert_eq!(output.status.code(), Some(status), "{text}");
    assert!(output.stdout.is_empty(), "{output:?}");
    assert_eq!(text.matches("error:").count(), 1, "{text}");
    assert!(!text.contains("panicked") && !text.contains("stack backtrace"), "{text}");
    for part in says {
        assert!(text.contains(part), "{text:?} does not say {part:?}");
    }
}

/// A run that trains in the background.
struct Background {
    child: Child,
    stderr: BufReader<std::process::ChildStderr>,
}

impl Background {
    fn start(arguments: &[String]) -> Background {
        let mut child = eigenhand().args(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        Background { child, stderr }
    }

    /// Reads standard error up to a line with this in it.
    fn wait_for(&mut self, part: &str) {
        let mut line = String::new();
        while !line.contains(part) {
            line.clear();
            assert!(self.stderr.read_line(&mut line).unwrap() > 0, "it ended before {part:?}");
        }
    }

    fn signal(&self, name: &str) {
        let status = Command::new("kill").args([name, &self.child.id().to_string()]).status().unwrap();
        assert!(status.success());
    }

    /// Waits for the end; returns its status and the rest of standard error.
    fn finish(mut self) -> (Option<i32>, String) {
        let mut rest = String::new();
        self.stderr.read_to_string(&mut rest).unwrap();
        (self.child.wait().unwrap().code(), rest)
    }
}

fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < PATIENCE, "{what} did not happen in {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn copy_directory(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy_directory(&path, &target);
        } else {
            std::fs::copy(&path, &target).unwrap();
        }
    }
}

#[test]
fn a_run_is_trained_extended_evaluated_and_exported() {
    let root = TempDir::new().unwrap();
    let (out, export) = (root.path().join("run"), root.path().join("export"));
    let (out_text, export_text) = (out.to_str().unwrap(), export.to_str().unwrap());
    let mut arguments = tiny(&hand(), &out);
    arguments.extend(["--episodes", "8", "--lambda", "0.5", "--json"].map(str::to_owned));
    let output = eigenhand().args(&arguments).output().unwrap();
    let summary = json(&output);
    let heading = stderr(&output);
    assert!(heading.starts_with(&format!("run       {out_text}\nhand ")), "{heading}");
    for key in [
        "hand",
        "lambda",
        "seed",
        "episodes",
        "env_steps",
        "updates",
        "wall_s",
        "success_rate",
        "success_rate_per_object",
        "eval_episodes",
        "n_postures",
        "contribution",
        "contribution_sum",
        "mean_error_rad",
        "mujoco_version",
        "stopped_by",
    ] {
        assert!(summary.get(key).is_some(), "the summary lacks {key}");
    }
    assert_eq!((&summary["episodes"], &summary["lambda"]), (&8.into(), &0.5.into()));
    assert_eq!((&summary["run"], &summary["stopped_by"]), (&out_text.into(), &"episodes".into()));
    let written: Value = serde_json::from_slice(&std::fs::read(out.join("summary.json")).unwrap()).unwrap();
    assert_eq!(written["success_rate"], summary["success_rate"]);
    for file in ["config.toml", "provenance.toml", "metrics.csv", "postures.sqlite", "log.txt", "policy.toml"] {
        assert!(out.join(file).is_file(), "no {file}");
    }
    let log = std::fs::read_to_string(out.join("log.txt")).unwrap();
    assert!(log.contains("evaluated success") && log.contains("stopped by episodes"), "{log}");

    let extended = json(&run(&["train", "--resume", out_text, "--episodes", "12", "--workers", "2", "--json"]));
    assert_eq!(extended["episodes"], 12);
    let config = std::fs::read_to_string(out.join("config.toml")).unwrap();
    assert!(config.contains("\nepisodes = 12\n") && config.contains("\nworkers = 1\n"), "{config}");
    // A complete run that is resumed stays as it is.
    let files = || -> Vec<(PathBuf, std::time::SystemTime)> {
        let entries = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap());
        let mut files: Vec<_> = entries.map(|e| (e.path(), e.metadata().unwrap().modified().unwrap())).collect();
        files.sort();
        files
    };
    let before = files();
    let resumed = run(&["train", "--resume", out_text, "--json"]);
    assert!(stderr(&resumed).contains("complete, and stays as it is"), "{}", stderr(&resumed));
    assert_eq!((json(&resumed), files()), (extended, before));
    let fewer = run(&["train", "--resume", out_text, "--episodes", "5", "--quiet"]);
    assert_error(&fewer, USAGE, &["--episodes 5", "12 episodes already"]);

    let again = |seed: &str| json(&run(&["eval", out_text, "--episodes", "6", "--seed", seed, "--json"]));
    let first = again("3");
    assert_eq!((&first["episodes"], &first["seed"]), (&6.into(), &3.into()));
    assert_eq!(first["interval"].as_array().unwrap().len(), 2);
    assert_eq!(first, again("3"));
    assert_ne!(first["mean_final_distance_m"], again("4")["mean_final_distance_m"]);

    let changed =
        |setting: &str| run(&["eval", out_text, "--episodes", "6", "--seed", "3", "--json", "--set", setting]);
    // A hand that has learned nothing need not touch any object. So the change is one that no touch is needed for.
    let slippery = json(&changed("physics.friction=[0.01, 0.02]"));
    assert_eq!(slippery["changed"][0], "physics.friction=[0.01, 0.02]");
    let high = json(&changed("task.goal_height=[0.4, 0.41]"));
    let distance = |summary: &Value| summary["mean_final_distance_m"].as_f64().unwrap();
    assert!(distance(&high) > distance(&first) + 0.1, "{high} {first}");
    let unseen = json(&run(&["eval", out_text, "--episodes", "9", "--objects", "unseen", "--json"]));
    assert_eq!(unseen["changed"][0], "objects=[\"unseen\"]");
    let objects: Vec<&str> =
        unseen["objects"].as_array().unwrap().iter().filter_map(|o| o["object"].as_str()).collect();
    assert_eq!(objects.len(), 9);
    assert!(objects.contains(&"pyramid") && !objects.contains(&"cube"), "{objects:?}");
    let driven = |arguments: &[&str]| run(&[&["eval", out_text, "--components"], arguments].concat());
    assert_error(&driven(&["3..1"]), USAGE, &["3 is greater than 1"]);
    assert_error(&driven(&["0..x"]), USAGE, &["\"x\" is not a whole number"]);
    assert_error(&driven(&["0..1", "--free", "tail"]), USAGE, &["--free tail", "no actuator \"tail\""]);
    assert_error(&driven(&["0..1"]), FAILURE, &["so there is no synergy", "train longer"]);
    let unknown = run(&["eval", out_text, "--objects", "unsen"]);
    assert_error(&unknown, USAGE, &["\"unsen\"", "unseen (", "paper ("]);
    for setting in ["learner.gamma=0.9", "task.observe_shape=false", "learner.gamma=0.5"] {
        assert_error(&changed(setting), USAGE, &[setting, "physics.*"]);
    }

    let exported = json(&run(&["export", out_text, "--out", export_text, "--json"]));
    let files: Vec<&str> = exported["files"].as_array().unwrap().iter().map(|f| f.as_str().unwrap()).collect();
    assert!(files.iter().any(|file| file.ends_with("policy.toml")), "{files:?}");
    assert!(files.iter().all(|file| Path::new(file).is_file()), "{files:?}");
    let twice = json(&run(&["export", out_text, "--out", export_text, "--json"]));
    assert_eq!(twice, exported, "an earlier export is written again");
    let over_run = run(&["export", out_text, "--out", out_text]);
    assert_error(&over_run, USAGE, &["--out"]);
    let over_new = eigenhand().args(&arguments).output().unwrap();
    assert_error(&over_new, USAGE, &["exists already", "--resume"]);
}

#[test]
fn a_policy_acts_in_a_given_synergy() {
    let place = TempDir::new().unwrap();
    let (out, synergy) = (place.path().join("run"), place.path().join("synergy"));
    std::fs::create_dir(&synergy).unwrap();
    let file = synergy.join("synergy.toml");
    std::fs::copy(workspace().join("synergies/shadow/synergy.toml"), &file).unwrap();
    let acts = |hand: &str, out: &Path, components: &str| {
        let mut arguments = tiny(hand, out);
        let synergy = synergy.display().to_string();
        let more = ["--episodes", "8", "--action-space", "synergy", "--components", components, "--synergy", &synergy];
        arguments.extend(more.map(str::to_owned));
        eigenhand().args(arguments).output().unwrap()
    };
    let other = place.path().join("other");
    assert_error(&acts("parallel", &other, "1"), FAILURE, &["commands the actuators", "the hand parallel has"]);
    assert_error(&acts("parallel", &other, "2"), USAGE, &["components = 2", "at most 1"]);
    assert_error(&acts("shadow", &other, "9"), FAILURE, &["it has 5 components, fewer than the 9"]);
    assert!(!other.exists());
    let trained = acts("shadow", &out, "2");
    assert!(trained.status.success(), "{}", stderr(&trained));
    // Two numbers and the slide, for the 20 actuators of the hand and the slide.
    let policy = std::fs::read(out.join("policy.safetensors")).unwrap();
    let length = u64::from_le_bytes(policy[..8].try_into().unwrap()) as usize;
    let header: Value = serde_json::from_slice(&policy[8..8 + length]).unwrap();
    assert_eq!(header["action.matrix"]["shape"], serde_json::json!([21, 3]));
    // The run keeps the synergy.
    std::fs::remove_file(&file).unwrap();
    let resumed = run(&["train", "--resume", out.to_str().unwrap(), "--episodes", "12", "--quiet"]);
    assert!(resumed.status.success(), "{}", stderr(&resumed));
    assert_error(&acts("shadow", &other, "2"), FAILURE, &["cannot act in the synergy"]);
}

#[test]
fn a_value_out_of_range_is_named_with_its_file_and_line() {
    let root = TempDir::new().unwrap();
    let (out, hand) = (root.path().join("run"), hand());
    let file = root.path().join("config.toml");
    let file_text = file.to_str().unwrap();
    let cases = [
        ("seed = 3\nlambda = -2.0\n", 2, "lambda = -2 is not allowed: expected "),
        ("# A comment.\n\n[learner]\nhidden = [16]\ngamma = 1.5\n", 5, "learner.gamma = 1.5 is not allowed: expected "),
        ("\ntraining.slide_hold = 0.5\n", 2, "training.slide_hold = 0.5 is not allowed: expected "),
        ("[training]\n\nfinal_noise = \"low\"\n", 3, "training.final_noise = \"low\" is not allowed: "),
    ];
    for (text, line, says) in cases {
        std::fs::write(&file, text).unwrap();
        let output = run(&["train", "--hand", &hand, "--config", file_text, "--out", out.to_str().unwrap()]);
        assert_error(&output, USAGE, &[&format!("{file_text}, line {line}: {says}")]);
        assert!(!out.exists());
    }
}

#[test]
fn a_learner_that_diverges_ends_the_run_and_its_checkpoint_gives_a_policy() {
    let root = TempDir::new().unwrap();
    let out = root.path().join("run");
    let out_text = out.to_str().unwrap();
    let mut arguments = tiny(&hand(), &out);
    arguments.extend(["--episodes", "40", "--quiet"].map(str::to_owned));
    arguments.extend(["--set", "learner.critic_lr=1e30"].map(str::to_owned));
    let diverged = eigenhand().args(&arguments).output().unwrap();
    assert_error(&diverged, FAILURE, &["diverged at update ", "critic loss ", "learner.critic_lr=1e29"]);
    // The same again would end the same.
    assert!(!stderr(&diverged).contains("--resume"), "{}", stderr(&diverged));
    assert!(!out.join("policy.safetensors").exists());
    let checkpoints = std::fs::read_dir(out.join("checkpoints")).unwrap();
    let numbers = checkpoints.filter_map(|entry| {
        entry.unwrap().file_name().to_str().and_then(|name| name.strip_prefix("episode-"))?.parse::<u64>().ok()
    });
    let last = numbers.max().unwrap();
    assert_eq!(last, 4, "updates begin after 6 episodes, and the next checkpoint is due after 8");
    let resumed = json(&run(&["train", "--resume", out_text, "--episodes", &last.to_string(), "--json", "--quiet"]));
    assert_eq!((&resumed["episodes"], &resumed["stopped_by"]), (&last.into(), &"episodes".into()));
    assert_eq!(resumed["eval_episodes"], 4);
    assert!(out.join("policy.safetensors").is_file());
    let exported = run(&["export", out_text, "--out", root.path().join("export").to_str().unwrap()]);
    assert!(exported.status.success(), "{}", stderr(&exported));
}

/// Names of the hands in this repository that are directories of data, in order.
fn written_hands() -> Vec<String> {
    let directories = std::fs::read_dir(workspace().join("plugins")).unwrap();
    let name = |manifest: PathBuf| {
        let text = std::fs::read_to_string(manifest).ok()?;
        let line = text.lines().find_map(|line| line.strip_prefix("name = "))?;
        Some(line.trim_matches('"').to_owned())
    };
    let mut names: Vec<String> =
        directories.filter_map(|entry| name(entry.unwrap().path().join("hand.toml"))).collect();
    names.sort();
    names
}

#[test]
fn the_program_alone_has_the_hands_and_trains_one() {
    let root = TempDir::new().unwrap();
    let [home, cache, work, plugins] = ["home", "cache", "work", "plugins"].map(|name| root.path().join(name));
    [&home, &cache, &work].into_iter().for_each(|place| std::fs::create_dir(place).unwrap());
    let alone = || {
        let mut command = eigenhand();
        command.current_dir(&work).env("HOME", &home).env("XDG_CACHE_HOME", &cache);
        command
    };
    let list = |command: &mut Command| -> Vec<(String, PathBuf)> {
        let listed = json(&command.args(["hands", "list", "--json"]).output().unwrap());
        let text = |value: &Value| value.as_str().unwrap().to_owned();
        let pair = |hand: &Value| (text(&hand["name"]), PathBuf::from(text(&hand["directory"])));
        listed.as_array().unwrap().iter().map(pair).collect()
    };
    let listed = list(&mut alone());
    let mut names: Vec<String> = listed.iter().map(|(name, _)| name.clone()).collect();
    names.sort();
    assert!(names.len() >= 4, "{names:?}");
    assert_eq!(names, written_hands());
    assert!(listed.iter().all(|(_, directory)| directory.starts_with(&cache)), "{listed:?}");
    let hand = &names[0];
    let out = work.join("run");
    let trained = alone().args(tiny(hand, Path::new("run"))).args(["--episodes", "8", "--json"]).output().unwrap();
    assert_eq!(json(&trained)["hand"], hand.as_str());
    assert!(out.join("policy.safetensors").is_file());

    copy_directory(&workspace().join("plugins").join(hand), &plugins.join("mine"));
    let listed = list(alone().env("EIGENHAND_PLUGINS", &plugins));
    let found: Vec<&(String, PathBuf)> = listed.iter().filter(|(name, _)| name == hand).collect();
    assert!(found.len() == 1 && found[0].1.starts_with(&plugins), "{listed:?}");
    assert_eq!(listed.len(), names.len(), "the others are there as before");
}

#[test]
fn a_wrong_command_line_ends_with_2_and_makes_no_directory() {
    let root = TempDir::new().unwrap();
    let out = root.path().join("run");
    let hand = hand();
    let typo = &hand[..hand.len() - 1];
    let with = |more: &[&str]| -> Vec<String> {
        let start = ["train", "--out", out.to_str().unwrap()];
        start.iter().chain(more).map(|part| (*part).to_owned()).collect()
    };
    let config = root.path().join("config.toml");
    std::fs::write(&config, "lamda = 1.0\n").unwrap();
    let absent = root.path().join("absent").display().to_string();
    let cases = [
        (with(&[]), vec!["--hand", hand.as_str()]),
        (with(&["--hand", typo]), vec!["did you mean", hand.as_str()]),
        (with(&["--hand", &hand, "--objects", "cube,cup"]), vec!["\"cup\"", "cube"]),
        (with(&["--hand", &hand, "--set", "learner.gama=0.9"]), vec!["learner.gamma"]),
        (with(&["--hand", &hand, "--set", "gamma"]), vec!["key=value"]),
        (with(&["--hand", &hand, "--lambda=-2"]), vec!["lambda = -2"]),
        (with(&["--hand", &hand, "--config", config.to_str().unwrap()]), vec!["lamda", "lambda"]),
        (with(&["--hand", &hand, "--plugins", &absent]), vec![&absent, "--plugins"]),
        (with(&["--hand", &hand, "--preset", "slow"]), vec!["slow", "quick"]),
        (with(&["--hand", "parallel", "--set", "synergy.components=99"]), vec!["99", "at most 1", "--set"]),
        (with(&["--resume", "runs/x"]), vec!["--resume", "--out"]),
    ];
    for (arguments, says) in cases {
        assert_error(&eigenhand().args(&arguments).output().unwrap(), USAGE, &says);
        assert!(!out.exists(), "{arguments:?} made a directory");
    }
    assert_error(&run(&["train", "--resume", "runs/x", "--lambda", "1"]), USAGE, &["--resume", "--lambda"]);
    assert_error(&run(&["hands", "show", typo]), USAGE, &["did you mean"]);
}

#[test]
fn a_missing_library_or_place_ends_with_1_and_leaves_nothing() {
    let root = TempDir::new().unwrap();
    let out = root.path().join("run");
    let hand = hand();
    let absent = root.path().join("absent").display().to_string();
    let missing = eigenhand().args(tiny(&hand, &out)).env("EIGENHAND_MUJOCO_LIB", &absent).output().unwrap();
    assert_error(&missing, FAILURE, &["EIGENHAND_MUJOCO_LIB", &absent, "libmujoco2.2.2"]);
    assert!(!out.exists());
    let file = root.path().join("file");
    std::fs::write(&file, "precious").unwrap();
    let below = eigenhand().args(tiny(&hand, &file.join("run"))).output().unwrap();
    assert_error(&below, FAILURE, &["cannot create the directory"]);
    assert_eq!(std::fs::read(&file).unwrap(), b"precious");
    for command in ["eval", "export", "train"] {
        let arguments: &[&str] = match command {
            "eval" => &["eval", &absent],
            "export" => &["export", &absent, "--out", out.to_str().unwrap()],
            _ => &["train", "--resume", &absent],
        };
        assert_error(&run(arguments), FAILURE, &[&format!("{absent} is not a run directory")]);
    }
}

#[test]
fn an_interrupted_run_saves_and_a_killed_one_goes_on_from_its_checkpoint() {
    let root = TempDir::new().unwrap();
    let out = root.path().join("run");
    let mut arguments = tiny(&hand(), &out);
    // It does not end by itself before it is interrupted.
    arguments.extend(["--episodes".to_owned(), "1000000".to_owned()]);
    let mut running = Background::start(&arguments);
    running.wait_for("episode 0/");
    wait_until("a checkpoint", || out.join("checkpoints/episode-00000004").exists());
    let resume = ["train", "--resume", out.to_str().unwrap()].map(str::to_owned);
    let second = eigenhand().args(&resume).output().unwrap();
    assert_error(&second, FAILURE, &["in use by another process"]);
    running.signal("-INT");
    let (status, text) = running.finish();
    assert_eq!(status, Some(INTERRUPTED), "{text}");
    assert!(text.contains("eigenhand train --resume"), "{text}");
    let summary: Value = serde_json::from_slice(&std::fs::read(out.join("summary.json")).unwrap()).unwrap();
    assert_eq!(summary["stopped_by"], "interrupt");
    let done = summary["episodes"].as_u64().unwrap();
    assert!(done >= 4);

    let mut running = Background::start(&resume);
    running.wait_for(&format!("from episode {done}"));
    let next = (done / 4 + 2) * 4;
    wait_until("another checkpoint", || out.join(format!("checkpoints/episode-{next:08}")).exists());
    running.signal("-KILL");
    running.finish();

    let total = (next + 40).to_string();
    let output = run(&["train", "--resume", out.to_str().unwrap(), "--episodes", &total, "--json"]);
    assert_eq!(json(&output)["episodes"], next + 40);
    let text = stderr(&output);
    let from: u64 = text.split("from episode ").nth(1).unwrap().split(',').next().unwrap().parse().unwrap();
    assert!(from >= next, "{text}");
}

#[test]
fn damage_is_named_and_nothing_is_lost() {
    let root = TempDir::new().unwrap();
    let plugins = root.path().join("plugins");
    let hand = hand();
    copy_directory(&workspace().join("plugins").join(&hand), &plugins.join("copy"));
    let manifest = plugins.join("copy/hand.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, text.replace(&format!("name = \"{hand}\""), "name = \"copy\"")).unwrap();
    let out = root.path().join("run");
    let (out_text, plugins_text) = (out.to_str().unwrap(), plugins.to_str().unwrap());
    let mut arguments = tiny("copy", &out);
    arguments.extend(["--episodes", "8", "--quiet", "--plugins", plugins_text].map(str::to_owned));
    assert!(eigenhand().args(&arguments).output().unwrap().status.success());
    let resume = || run(&["train", "--resume", out_text, "--plugins", plugins_text, "--quiet"]);
    let resume_longer =
        || run(&["train", "--resume", out_text, "--plugins", plugins_text, "--quiet", "--episodes", "12"]);

    let learner = out.join("checkpoints/episode-00000008/learner.safetensors");
    let mut damaged = std::fs::read(&learner).unwrap();
    *damaged.last_mut().unwrap() ^= 1;
    std::fs::write(&learner, &damaged).unwrap();
    let output = resume_longer();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stderr(&output).contains("is set aside as"), "also with --quiet: {}", stderr(&output));
    let aside = out.join("checkpoints/damaged-episode-00000008/learner.safetensors");
    assert_eq!(std::fs::read(aside).unwrap(), damaged, "nothing is thrown away");

    let policy = out.join("policy.safetensors");
    std::fs::write(&policy, b"not tensors").unwrap();
    let eval = run(&["eval", out_text, "--plugins", plugins_text]);
    assert_error(&eval, FAILURE, &["policy.safetensors is damaged", "--resume"]);

    let original = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, original.replace("scale = 1.0", "scale = 1.1")).unwrap();
    assert_error(&resume(), FAILURE, &["has changed since", "digest"]);
    std::fs::write(&manifest, original).unwrap();
    assert!(resume().status.success(), "what was mended goes on");
    assert!(run(&["eval", out_text, "--plugins", plugins_text, "--episodes", "2", "--json"]).status.success());
}

#[test]
fn hands_are_listed_shown_and_checked() {
    let name = hand();
    let shown = json(&run(&["hands", "show", &name, "--json"]));
    assert_eq!(shown["name"], name.as_str());
    assert_eq!(shown["posture"].as_array().unwrap().len() as u64, shown["n_posture"].as_u64().unwrap());
    let text = run(&["hands", "show", &name]);
    let text = String::from_utf8(text.stdout).unwrap();
    for joint in shown["posture"].as_array().unwrap() {
        assert!(text.contains(joint["name"].as_str().unwrap()));
    }
    let checked = json(&run(&["hands", "check", &name, "--json"]));
    assert!(checked["checks"].as_array().unwrap().iter().all(|check| check["passed"] == true), "{checked}");

    let root = TempDir::new().unwrap();
    let plugins = root.path().join("plugins");
    copy_directory(&workspace().join("plugins").join(&name), &plugins.join("low"));
    let manifest = plugins.join("low/hand.toml");
    let lowered = std::fs::read_to_string(&manifest)
        .unwrap()
        .replace(&format!("name = \"{name}\""), "name = \"low\"")
        .lines()
        .map(|line| if line.starts_with("position = ") { "position = [-0.385, 0.0, 0.0]" } else { line })
        .collect::<Vec<_>>()
        .join("\n");
    std::fs::write(&manifest, lowered).unwrap();
    let output = run(&["hands", "check", plugins.join("low").to_str().unwrap(), "--json"]);
    assert_eq!(output.status.code(), Some(FAILURE));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(report["checks"].as_array().unwrap().iter().any(|check| check["passed"] == false), "{report}");

    let heavy = plugins.join("heavy");
    std::fs::create_dir(&heavy).unwrap();
    std::fs::write(heavy.join("hand.toml"), gripper::GRIPPER_MANIFEST).unwrap();
    let model = gripper::GRIPPER_MODEL.replace("mass=\"0.3\"", "mass=\"30\"");
    std::fs::write(heavy.join("gripper.xml"), model).unwrap();
    let check = |how| run(&["hands", "check", heavy.to_str().unwrap(), "--no-picture", how]);
    let text = String::from_utf8(check("--no-install").stdout).unwrap();
    assert!(text.starts_with("look at mass: the hand weighs 30.1"), "{text}");
    let report: Value = serde_json::from_slice(&check("--json").stdout).unwrap();
    assert_eq!(report["symptoms"][0]["name"], "mass", "{report}");
}

/// Pads that stay farther apart than any object is wide.
#[test]
fn a_new_hand_that_cannot_grasp_is_told_and_warned_of() {
    let place = TempDir::new().unwrap();
    let (file, out) = (place.path().join("maker.xml"), place.path().join("wide"));
    std::fs::write(&file, gripper::GRIPPER_MODEL.replace("range=\"0 0.05\"", "range=\"0 0.005\"")).unwrap();
    let (file, out_text) = (file.to_str().unwrap(), out.to_str().unwrap());
    let made = run(&["hands", "new", "wide", "--from", file, "--out", out_text]);
    assert_eq!(made.status.code(), Some(FAILURE), "{made:?}");
    let said = String::from_utf8(made.stdout).unwrap();
    assert!(said.contains("cannot grasp") && said.contains("likeliest reason: "), "{said}");
    assert!(!said.contains("train --hand"), "{said}");
    let shown = run(&["hands", "show", out_text]);
    assert!(String::from_utf8(shown.stdout).unwrap().contains("cannot grasp"));
    let run_directory = place.path().join("run");
    let mut train = tiny(out_text, &run_directory);
    let refused = run(&train.iter().map(String::as_str).collect::<Vec<_>>());
    assert_error(&refused, FAILURE, &["hand contract", "cannot grasp", "--force"]);
    assert!(!run_directory.exists());
    train.extend(["--force", "--episodes", "10"].map(str::to_owned));
    let forced = run(&train.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(forced.status.success() && stderr(&forced).contains("cannot grasp"), "{}", stderr(&forced));
}

#[test]
fn a_new_hand_is_made_listed_checked_and_trained() {
    let place = TempDir::new().unwrap();
    let file = place.path().join("maker.xml");
    std::fs::write(&file, gripper::GRIPPER_MODEL).unwrap();
    let (file, plugins) = (file.to_str().unwrap(), place.path().join("plugins"));
    let out = plugins.join("mine");
    let (out_text, plugins_text) = (out.to_str().unwrap(), plugins.to_str().unwrap());
    let made = json(&run(&["hands", "new", "mine", "--from", file, "--out", out_text, "--json"]));
    assert_eq!((made["palm"].as_str(), made["close_up"][0].as_str()), (Some("bridge"), Some("close")));
    let listed = json(&run(&["hands", "list", "--plugins", plugins_text, "--json"]));
    assert!(listed.as_array().unwrap().iter().any(|hand| hand["name"] == "mine"), "{listed}");
    let picture = place.path().join("mine.png");
    let checked = run(&["hands", "check", "mine", "--plugins", plugins_text, "--picture", picture.to_str().unwrap()]);
    assert!(checked.status.success() && std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"), "{checked:?}");
    let trained = run(&[
        tiny("mine", &place.path().join("run")).iter().map(String::as_str).collect(),
        vec!["--episodes", "10", "--plugins", plugins_text],
    ]
    .concat());
    assert!(trained.status.success(), "{}", stderr(&trained));

    let again = run(&["hands", "new", "mine", "--from", file, "--out", out_text]);
    assert_error(&again, USAGE, &[out_text]);
    let nameless = run(&["hands", "new", "Mine!", "--from", file, "--out", plugins.join("other").to_str().unwrap()]);
    assert_error(&nameless, USAGE, &["Mine!"]);
    assert_error(&run(&["hands", "new", "other", "--from", file, "--approach", "up"]), USAGE, &["--approach", "up"]);
    let names: Vec<_> = std::fs::read_dir(&plugins).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["mine"], "nothing is left of what failed");
}

#[test]
fn the_doctor_names_what_is_missing_and_what_mends_it() {
    let root = TempDir::new().unwrap();
    let output = eigenhand()
        .args(["doctor", "--json"])
        .env("EIGENHAND_MUJOCO_LIB", root.path().join("absent"))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(FAILURE));
    let diagnosis: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(diagnosis["ok"], false);
    let mujoco = diagnosis["findings"].as_array().unwrap().iter().find(|f| f["name"] == "MuJoCo").unwrap();
    assert_eq!((&mujoco["ok"], &mujoco["required"]), (&false.into(), &true.into()));
    assert!(mujoco["detail"].as_str().unwrap().contains("EIGENHAND_MUJOCO_LIB"), "{mujoco}");
    let healthy = json(&run(&["doctor", "--json"]));
    assert_eq!(healthy["ok"], true);
}

/// Starts the program, `$0` with `$@`, in a script of Bash whose output nobody reads.
fn silent(script: &str, arguments: &[String]) -> Command {
    let mut command = Command::new("bash");
    command.args(["-c", script, env!("CARGO_BIN_EXE_eigenhand")]).args(arguments).current_dir(workspace());
    command.env_remove("EIGENHAND_PLUGINS").env("EIGENHAND_NO_INSTALL", "1");
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// What is printed is no part of the work: a reader that is gone, or a full disk, ends no run.
#[test]
fn a_run_outlives_the_reader_of_its_output() {
    for (name, streams) in [("closed", "2>&1 | head -n 1"), ("full", ">/dev/full 2>/dev/full")] {
        let root = TempDir::new().unwrap();
        let out = root.path().join("run");
        let mut arguments = tiny(&hand(), &out);
        arguments.extend(["--episodes", "8"].map(str::to_owned));
        let script = format!("set -o pipefail; \"$0\" \"$@\" {streams}");
        let status = silent(&script, &arguments).status().unwrap();
        let written = std::fs::read(out.join("summary.json")).unwrap_or_else(|error| panic!("{name}: {error}"));
        let summary: Value = serde_json::from_slice(&written).unwrap();
        assert_eq!((&summary["episodes"], &summary["stopped_by"]), (&8.into(), &"episodes".into()), "{name}");
        // What cannot be printed on a full disk is a failure that the status tells; a reader that had enough is none.
        assert_eq!(status.code(), Some(if name == "closed" { 0 } else { FAILURE }), "{name}");
    }
}

/// A terminal that closes saves the run, unless the run was started to outlive it.
#[test]
fn a_closed_terminal_saves_a_run_and_nohup_lets_it_go_on() {
    for ignored in [false, true] {
        let root = TempDir::new().unwrap();
        let out = root.path().join("run");
        let mut arguments = tiny(&hand(), &out);
        arguments.extend(["--episodes", "24"].map(str::to_owned));
        let script = if ignored { "trap '' HUP; exec \"$0\" \"$@\"" } else { "exec \"$0\" \"$@\"" };
        let mut child = silent(script, &arguments).spawn().unwrap();
        wait_until("a checkpoint", || out.join("checkpoints/episode-00000004").is_dir());
        assert!(Command::new("kill").args(["-HUP", &child.id().to_string()]).status().unwrap().success());
        let status = child.wait().unwrap().code();
        let written = std::fs::read(out.join("summary.json")).unwrap();
        let stopped_by = serde_json::from_slice::<Value>(&written).unwrap()["stopped_by"].clone();
        let expected = if ignored { (Some(0), "episodes") } else { (Some(INTERRUPTED), "interrupt") };
        assert_eq!((status, stopped_by), (expected.0, expected.1.into()), "ignored: {ignored}");
    }
}

/// Returns a disk whose power can be cut; none where that is not allowed, which is said.
fn disk() -> Option<Disk> {
    use std::io::Write as _;
    let refused = |reason: anyhow::Error| {
        let _ = writeln!(std::io::stderr(), "skipped: a disk needs root, mkfs.ext4 and loop devices: {reason}");
    };
    Disk::new().map_err(refused).ok()
}

/// A finished run can be used where nothing may be written, also one whose database has stayed in WAL mode.
#[test]
fn a_finished_run_is_used_on_read_only_media() {
    let Some(disk) = disk() else { return };
    let beside = TempDir::new().unwrap();
    let hand = write_gripper(beside.path());
    for wal in [false, true] {
        let run_directory = disk.path().join(if wal { "wal" } else { "run" });
        let train = silent("exec \"$0\" \"$@\"", &gripper_run(&hand, &run_directory, &gripper::LONGER)).status();
        assert!(train.unwrap().success());
        if wal {
            let script = "import sqlite3, sys; sqlite3.connect(sys.argv[1]).execute('PRAGMA journal_mode=WAL')";
            let database = run_directory.join("postures.sqlite");
            assert!(Command::new("python3").args(["-c", script]).arg(database).status().unwrap().success());
        }
    }
    let protected = Command::new("mount").args(["-o", "remount,ro"]).arg(disk.path()).status().unwrap();
    assert!(protected.success());
    for name in ["run", "wal"] {
        let finished = disk.path().join(name).display().to_string();
        let out = |what: &str| beside.path().join(format!("{name}-{what}")).display().to_string();
        for arguments in [
            vec!["report", &finished, "--out", &out("report")],
            vec!["export", &finished, "--out", &out("export")],
            vec!["synergy", "fit", &finished, "--joints", "all", "--components", "1", "--out", &out("fit")],
            vec!["eval", &finished, "--episodes", "2"],
            vec!["explore", &finished, "--no-open", "--out", &out("page.html")],
        ] {
            let output = run(&arguments);
            assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
        }
    }
}

/// After a power cut, a run goes on from its last checkpoint to the same end, with all rows of its metrics and database.
#[test]
fn a_run_survives_power_cuts() {
    let Some(disk) = disk() else { return };
    let beside = TempDir::new().unwrap();
    let hand = write_gripper(beside.path());
    let train = |out: &Path| silent("exec \"$0\" \"$@\"", &gripper_run(&hand, out, &["episodes=40"]));
    let whole = beside.path().join("whole");
    assert!(train(&whole).status().unwrap().success());
    let postures = |run: &Path| PostureDatabase::open_existing(run.join("postures.sqlite")).unwrap().load().unwrap();
    assert!(!postures(&whole).is_empty(), "a checkpoint counts postures");
    let out = disk.path().join("run");
    let mut child = train(&out).spawn().unwrap();
    for episodes in [8, 16, 32] {
        wait_until("a checkpoint", || {
            let there = out.join(format!("checkpoints/episode-{episodes:08}")).is_dir();
            assert!(there || child.try_wait().unwrap().is_none(), "the run ended before episode {episodes}");
            there
        });
        disk.cut_power().unwrap();
        let _ = child.kill();
        child.wait().unwrap();
        disk.restart().unwrap();
        let resume = ["train", "--resume", out.to_str().unwrap()].map(str::to_owned);
        child = silent("exec \"$0\" \"$@\"", &resume).spawn().unwrap();
    }
    assert!(child.wait().unwrap().success(), "it goes on to its end");
    let rows = |run: &Path| -> Vec<String> {
        let text = std::fs::read_to_string(run.join("metrics.csv")).unwrap();
        let wall = text.lines().next().unwrap().split(',').position(|column| column == "wall_s").unwrap();
        let without = |line: &str| -> Vec<String> {
            line.split(',').enumerate().filter(|(i, _)| *i != wall).map(|(_, cell)| cell.to_owned()).collect()
        };
        text.lines().map(|line| without(line).join(",")).collect()
    };
    assert_eq!(rows(&out), rows(&whole));
    assert_eq!(postures(&out), postures(&whole));
    let policy = |run: &Path| std::fs::read(run.join("policy.safetensors")).unwrap();
    assert!(policy(&out) == policy(&whole), "the same policy");
}
