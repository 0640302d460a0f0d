//! Damaged runs: a checkpoint that cannot be used is set aside, and the run loses no more than what is damaged.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use eigenhand_hands::SearchPath;
use eigenhand_train::config::RunConfig;
use eigenhand_train::request::{Launch, NewRun, ResumedRun};
use eigenhand_train::{FinishedRun, RunDirectory, Silent, Summary, TrainError};
use tempfile::TempDir;

use crate::support::{Notes, Run, StopAfter, gripper, tiny, write_gripper};
use crate::training::assert_same;

/// A change to the bytes of a file.
type Damage<'a> = &'a dyn Fn(&mut Vec<u8>);

/// Files of a run, by their paths.
type Files = BTreeMap<PathBuf, Vec<u8>>;

/// Damages a run, and what a note then says.
type Case<'a> = (&'a str, Box<dyn Fn(&Run) + 'a>);

const LEARNER: &str = "learner.safetensors";
const REPLAY: &str = "checkpoints/replay.bin";

/// Each checkpoint has an evaluation of its own.
fn settings() -> RunConfig {
    tiny(&["evaluation.every=4"])
}

/// A run that was never stopped, with its results.
fn whole() -> &'static (Run, Summary) {
    static WHOLE: OnceLock<(Run, Summary)> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let run = Run::new(gripper());
        let summary = run.train(&settings());
        (run, summary)
    })
}

/// A run that was stopped with two checkpoints, and its files.
fn stopped() -> (Run, Files, [String; 2]) {
    let run = Run::new(gripper());
    let stop = AtomicBool::new(false);
    run.start(&settings(), &stop, &mut StopAfter { episodes: 20, stop: &stop });
    let names = std::fs::read_dir(run.file("checkpoints")).unwrap().map(|e| e.unwrap().file_name());
    let mut names: Vec<String> =
        names.map(|n| n.into_string().unwrap()).filter(|n| n.starts_with("episode-")).collect();
    names.sort();
    let [older, newest] = names.try_into().unwrap();
    let files = run.snapshot();
    (run, files, [older, newest])
}

fn restore(run: &Run, files: &Files) {
    std::fs::remove_dir_all(&run.path).unwrap();
    for (path, bytes) in files {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
}

/// Resumes a run to its end, and returns its results and what it said.
fn go_on(run: &Run) -> (Summary, Vec<String>) {
    let mut notes = Notes::default();
    let trainer = run.resume().unwrap_or_else(|error| panic!("{error}"));
    (trainer.run(&AtomicBool::new(false), &mut notes).unwrap(), notes.0)
}

fn flip(bytes: &mut [u8]) {
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
}

fn cut(bytes: &mut Vec<u8>) {
    bytes.truncate(bytes.len() - 7);
}

fn edit(from: &'static str, to: &'static str) -> impl Fn(&mut Vec<u8>) {
    move |bytes: &mut Vec<u8>| {
        let text = String::from_utf8(bytes.clone()).unwrap();
        assert!(text.contains(from), "{text}");
        *bytes = text.replacen(from, to, 1).into_bytes();
    }
}

fn damage_file(run: &Run, name: &str, damage: Damage<'_>) {
    let mut bytes = run.bytes(name);
    damage(&mut bytes);
    std::fs::write(run.file(name), bytes).unwrap();
}

fn sql(run: &Run, statement: &str) {
    let changed = rusqlite::Connection::open(run.file("postures.sqlite")).unwrap().execute(statement, []).unwrap();
    assert!(changed > 0, "{statement}");
}

#[test]
fn a_run_goes_on_from_the_checkpoint_before_a_damaged_one() {
    let (run, files, [_, newest]) = stopped();
    let in_newest = |name: &str| format!("checkpoints/{newest}/{name}");
    let last_rows = "DELETE FROM posture WHERE episode = (SELECT max(episode) FROM posture)";
    let last_value = "UPDATE posture SET goal_x = goal_x + 1e-9 WHERE episode = (SELECT max(episode) FROM posture)";
    fn with_file<'a>(name: String, damage: fn(&mut Vec<u8>)) -> Box<dyn Fn(&Run) + 'a> {
        Box::new(move |run| damage_file(run, &name, &damage))
    }
    let state = in_newest("state.toml");
    let cases: Vec<Case<'_>> = vec![
        ("SHA-256", with_file(in_newest(LEARNER), |bytes| flip(bytes))),
        ("SHA-256", with_file(in_newest(LEARNER), cut)),
        ("SHA-256", Box::new(|run| damage_file(run, &state, &edit("updates = ", "updates = 1")))),
        ("SHA-256", Box::new(|run| damage_file(run, &state, &edit("digest = ", "")))),
        ("state.toml is damaged", Box::new(|run| std::fs::remove_file(run.file(&state)).unwrap())),
        ("bytes", with_file(REPLAY.to_owned(), cut)),
        (
            "rows up to episode",
            Box::new(|run| {
                let text = String::from_utf8(run.bytes("metrics.csv")).unwrap();
                let kept: Vec<&str> = text.lines().collect();
                std::fs::write(run.file("metrics.csv"), kept[..kept.len() - 1].join("\n") + "\n").unwrap();
            }),
        ),
        ("postures up to episode", Box::new(|run| sql(run, last_rows))),
        ("are not those that the run wrote", Box::new(|run| sql(run, last_value))),
    ];
    for (reason, damage) in cases {
        restore(&run, &files);
        damage(&run);
        let (summary, notes) = go_on(&run);
        let note =
            notes.iter().find(|note| note.contains("is set aside as")).unwrap_or_else(|| panic!("{reason}: {notes:?}"));
        assert!(note.contains(reason) && note.contains(&newest), "{reason}: {note}");
        assert!(run.file(&format!("checkpoints/damaged-{newest}")).is_dir(), "nothing is thrown away");
        let (whole, expected) = whole();
        assert_same((whole, expected.clone()), (&run, summary));
    }
}

#[test]
fn a_run_goes_on_without_what_no_checkpoint_can_do_without() {
    let (run, files, _) = stopped();
    let whole_replay = run.bytes(REPLAY).len();
    for gone in [false, true] {
        restore(&run, &files);
        if gone {
            std::fs::remove_file(run.file(REPLAY)).unwrap();
        } else {
            damage_file(&run, REPLAY, &|bytes| bytes[40] ^= 1);
        }
        let (summary, notes) = go_on(&run);
        assert!(notes.iter().any(|note| note.contains("goes on without what is lost")), "{notes:?}");
        assert_eq!(summary.episodes, crate::training::EPISODES);
        assert!(run.bytes(REPLAY).len() < whole_replay, "the replay began anew");
        run.resume_to_the_end();
    }

    restore(&run, &files);
    std::fs::remove_file(run.file("metrics.csv")).unwrap();
    let (_, notes) = go_on(&run);
    assert!(notes.iter().any(|note| note.contains("metrics.csv") && note.contains("goes on without")), "{notes:?}");
    run.resume_to_the_end();
}

#[test]
fn a_run_without_a_sound_checkpoint_is_an_error_that_changes_nothing() {
    let (run, files, [older, newest]) = stopped();
    let all = |name: &str| [&older, &newest].map(|checkpoint| format!("checkpoints/{checkpoint}/{name}"));
    for name in all(LEARNER) {
        damage_file(&run, &name, &|bytes| flip(bytes));
    }
    let refused = |run: &Run, expected: &str| {
        let before = run.snapshot();
        let error = run.resume().err().unwrap_or_else(|| panic!("{expected}")).to_string();
        assert!(error.contains(expected) && error.lines().count() >= 2, "{error}");
        assert!(before == run.snapshot(), "{expected}: files were changed");
    };
    refused(&run, "SHA-256");
    restore(&run, &files);
    sql(&run, "DELETE FROM posture");
    refused(&run, "postures up to episode");
}

#[test]
fn a_run_that_is_moved_or_removed_ends_with_an_error_and_is_not_made_again() {
    for moved in [true, false] {
        let run = Run::new(gripper());
        let elsewhere = run.path.with_file_name("elsewhere");
        struct Move<'a>(&'a Path, &'a Path, bool);
        impl eigenhand_train::Progress for Move<'_> {
            fn update(&mut self, status: &eigenhand_train::Status) {
                if status.episodes >= 12 && self.0.exists() {
                    if self.2 {
                        std::fs::rename(self.0, self.1).unwrap();
                    } else {
                        std::fs::remove_dir_all(self.0).unwrap();
                    }
                }
            }
            fn note(&mut self, _line: &str) {}
        }
        let error =
            run.try_start(&settings(), &AtomicBool::new(false), &mut Move(&run.path, &elsewhere, moved)).err().unwrap();
        assert!(matches!(error, TrainError::Moved { .. }), "{error}");
        assert!(!run.path.exists(), "nothing is made anew");
        if moved {
            std::fs::rename(&elsewhere, &run.path).unwrap();
            let (whole, expected) = whole();
            assert_same((whole, expected.clone()), (&run, run.resume_to_the_end()));
        }
    }
}

#[test]
fn files_of_others_in_a_run_do_not_end_it() {
    let run = Run::new(gripper());
    let stop = AtomicBool::new(false);
    run.start(&tiny(&[]), &stop, &mut StopAfter { episodes: 12, stop: &stop });
    for directory in ["synergy", "synergy-postures", "scenes", "checkpoints"] {
        std::fs::create_dir_all(run.file(directory).join("mine")).unwrap();
        std::fs::write(run.file(directory).join("notes.txt"), "mine").unwrap();
        std::fs::write(run.file(directory).join("mine/notes.txt"), "mine").unwrap();
    }
    run.resume_to_the_end();
    for directory in ["synergy", "synergy-postures", "scenes", "checkpoints"] {
        assert!(run.file(directory).join("mine/notes.txt").is_file(), "{directory}");
    }
}

/// Requests for runs of a hand in a directory.
fn requests(root: &Path) -> (NewRun, ResumedRun) {
    write_gripper(root, "", "");
    let out = root.join("run");
    let file = root.join("run.toml");
    let mut hands = SearchPath::new();
    hands.push(root.to_owned(), "the test");
    std::fs::write(
        &file,
        tiny(&[&format!("hand={:?}", root.display().to_string()), "synergy.components=1"]).to_toml().unwrap(),
    )
    .unwrap();
    let new =
        NewRun { file: Some(file), out: Some(out.clone()), force: true, hands: hands.clone(), ..NewRun::default() };
    (new, ResumedRun { run: out, hands, ..ResumedRun::default() })
}

fn finish(launch: Result<Launch, TrainError>) -> Summary {
    launch.and_then(|launch| launch.run(&AtomicBool::new(false), &mut Silent)).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_run_killed_before_its_first_checkpoint_begins_anew_with_the_same_command() {
    let root = TempDir::new().unwrap();
    let (new, resumed) = requests(root.path());
    let out = resumed.run.clone();
    let expected = finish(Launch::start(&new)).success_rate;
    std::fs::remove_dir_all(&out).unwrap();
    // A kill leaves everything up to some file.
    drop(Launch::start(&new).unwrap());
    assert!(out.join("postures.sqlite").is_file());
    let mut names: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).collect();
    names.sort();
    std::fs::write(out.join("checkpoints/replay.bin"), b"half an epis").unwrap();
    std::fs::create_dir(out.join("checkpoints/.episode-00000000.partial")).unwrap();
    assert_eq!(finish(Launch::resume(&resumed)).success_rate, expected);
    for gone in ["config.toml", "provenance.toml", "postures.sqlite", "checkpoints"] {
        std::fs::remove_dir_all(&out).unwrap();
        drop(Launch::start(&new).unwrap());
        let path = out.join(gone);
        if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }.unwrap();
        assert_eq!(finish(Launch::start(&new)).success_rate, expected, "without {gone}");
    }
    // What is more than a beginning is left as it is.
    assert!(matches!(Launch::start(&new).err(), Some(TrainError::RunExists { .. })));
    std::fs::remove_dir_all(out.join("checkpoints")).unwrap();
    assert!(matches!(Launch::start(&new).err(), Some(TrainError::RunExists { .. })), "it has postures");
    std::fs::remove_dir_all(&out).unwrap();
    drop(Launch::start(&new).unwrap());
    std::fs::write(out.join("thesis.tex"), "mine").unwrap();
    assert!(matches!(Launch::start(&new).err(), Some(TrainError::RunExists { .. })));
    assert!(matches!(Launch::resume(&resumed).err(), Some(TrainError::NotARun { .. })));
    assert!(out.join("thesis.tex").is_file() && out.join("postures.sqlite").is_file());
}

#[test]
fn an_edited_configuration_is_refused_by_its_key() {
    let root = TempDir::new().unwrap();
    let (new, resumed) = requests(root.path());
    let launch = Launch::start(&new).unwrap();
    let stop = AtomicBool::new(false);
    launch.run(&stop, &mut StopAfter { episodes: 12, stop: &stop }).unwrap();
    let path = resumed.run.join("config.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("gamma = ", "gamma = 0.5 # ")).unwrap();
    let error = Launch::resume(&resumed).err().unwrap().to_string();
    assert!(error.contains("learner.gamma was") && error.contains("is now 0.5"), "{error}");
    // What may change is no edit.
    std::fs::write(&path, text.replace("workers = 1", "workers = 2")).unwrap();
    assert_eq!(finish(Launch::resume(&ResumedRun { episodes: Some(28), ..resumed.clone() })).episodes, 28);
    assert_eq!(finish(Launch::resume(&resumed)).episodes, 28);
    drop(RunDirectory::open(&resumed.run).unwrap());
}

#[test]
fn results_that_changed_are_refused_and_the_run_writes_them_again() {
    let root = TempDir::new().unwrap();
    let (new, resumed) = requests(root.path());
    let summary = finish(Launch::start(&new));
    let open = || FinishedRun::open(&resumed.run, &SearchPath::default(), &[]);
    open().unwrap_or_else(|error| panic!("{error}"));
    let path = resumed.run.join("policy.safetensors");
    let policy = std::fs::read(&path).unwrap();
    // A bit of a weight: the file can still be read.
    let mut damaged = policy.clone();
    *damaged.last_mut().unwrap() ^= 1;
    std::fs::write(&path, damaged).unwrap();
    let error = open().err().expect("an error").to_string();
    assert!(
        error.contains("policy.safetensors") && error.contains("has changed") && error.contains("--resume"),
        "{error}"
    );
    let again = finish(Launch::resume(&resumed));
    assert_eq!(std::fs::read(&path).unwrap(), policy);
    assert_eq!(Summary { wall_s: 0.0, ..again }, Summary { wall_s: 0.0, ..summary });
    open().unwrap_or_else(|error| panic!("{error}"));
}
