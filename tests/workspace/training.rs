//! Tiny but complete training runs: repeatability, interruption, divergence, and the files of a run.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use eigenhand_hands::{Hand, SearchPath};
use eigenhand_rl::EpisodeData;
use eigenhand_synergy::{PostureDatabase, PostureRecord, Source, newest};
use eigenhand_train::{Counting, FinishedRun, Progress, Silent, Status, StoppedBy, Summary, TrainError, Workers};

use crate::confinement::gripper_with_vane;
use crate::gripper::LONGER;
use crate::support::{
    DieAfter, Notes, Run, StopAfter, gripper, gripper_with, gripper_with_full_contacts, python, python_has, tiny,
};

pub const EPISODES: u64 = 24;
const LAST: &str = "checkpoints/episode-00000024";

fn postures(run: &Run) -> Vec<PostureRecord> {
    PostureDatabase::open_existing(run.file("postures.sqlite")).unwrap().load().unwrap()
}

fn stored_episodes(run: &Run) -> usize {
    let bytes = run.bytes("checkpoints/replay.bin");
    let (mut rest, mut count) = (bytes.as_slice(), 0);
    while !rest.is_empty() {
        (_, rest) = EpisodeData::read_prefix(rest).unwrap();
        count += 1;
    }
    count
}

fn metrics_without(run: &Run, columns: &[&str]) -> Vec<BTreeMap<String, String>> {
    let mut rows = run.metrics();
    assert!(!rows.is_empty());
    for row in &mut rows {
        for column in columns {
            assert!(row.remove(*column).is_some(), "metrics.csv has no column {column}");
        }
    }
    rows
}

/// Asserts that two runs have the same results and the same files, except for wall time.
pub fn assert_same(a: (&Run, Summary), b: (&Run, Summary)) {
    let ((a, mut summary_a), (b, mut summary_b)) = (a, b);
    let learner = format!("checkpoints/episode-{:08}/learner.safetensors", summary_a.episodes);
    for name in [&learner, "checkpoints/replay.bin", "policy.safetensors"] {
        assert!(a.bytes(name) == b.bytes(name), "{name} differs");
    }
    for name in ["policy.toml", "scenes/reference.json", "synergy/components.npy", "synergy/commands.npy"] {
        assert!(a.bytes(name) == b.bytes(name), "{name} differs");
    }
    assert_eq!(postures(a), postures(b));
    assert_eq!(metrics_without(a, &["wall_s"]), metrics_without(b, &["wall_s"]));
    let lengths = |run: &Run| run.event_files().iter().map(Vec::len).collect::<Vec<_>>();
    assert_eq!((lengths(a).len(), lengths(a)), (1, lengths(b)), "event files");
    (summary_a.wall_s, summary_b.wall_s) = (0.0, 0.0);
    assert_eq!(summary_a, summary_b);
}

#[test]
fn a_run_repeats_itself_with_any_number_of_workers() {
    let first = Run::new(gripper());
    let summary = first.train(&tiny(&[]));
    assert_eq!((summary.episodes, summary.env_steps, summary.updates), (EPISODES, EPISODES * 30, 60));
    assert_eq!(summary.stopped_by, StoppedBy::Episodes);
    assert!(summary.n_postures > 2, "the test needs successes, and an active synergy");
    assert_eq!(summary.eval_episodes, 6);
    assert!(summary.success_rate.is_some());
    for workers in ["workers=1", "workers=3"] {
        let again = Run::new(gripper());
        let same = again.train(&tiny(&[workers]));
        assert_same((&first, summary.clone()), (&again, same));
    }
    let other = Run::new(gripper());
    other.train(&tiny(&["seed=2"]));
    assert!(first.bytes("policy.safetensors") != other.bytes("policy.safetensors"));
}

/// Returns the networks at the end of a run; the chosen policy may be an earlier one.
fn learned(run: &Run) -> Vec<u8> {
    run.bytes(&format!("checkpoints/episode-{EPISODES:08}/learner.safetensors"))
}

#[test]
fn hands_that_say_what_closes_them_attempt_grasps_while_little_is_held() {
    let closing = || {
        let mut hand = gripper();
        hand.manifest.closing.insert("close".to_owned(), 1.0);
        Run::new(hand)
    };
    let (few, enough, plain) = (closing(), closing(), closing());
    let summary = plain.train(&tiny(&[]));
    let same = enough.train(&tiny(&["training.least_held_steps=0.01"]));
    assert_same((&plain, summary), (&enough, same));
    let random = few.train(&tiny(&["training.least_held_steps=1000000"]));
    assert_eq!(random.updates, 60, "it learns from them");
    assert!(learned(&few) != learned(&plain));
    // A hand without closing directions makes no scripted grasps.
    let (silent, idle) = (Run::new(gripper()), Run::new(gripper()));
    let summary = silent.train(&tiny(&[]));
    let same = idle.train(&tiny(&["training.least_held_steps=1000000"]));
    assert_same((&silent, summary), (&idle, same));
    // Neither the number of workers nor a stop changes the result.
    let again = closing();
    let stop = AtomicBool::new(false);
    let config = tiny(&["training.least_held_steps=1000000", "workers=3"]);
    again.start(&config, &stop, &mut StopAfter { episodes: 19, stop: &stop });
    let resumed = again.resume_to_the_end();
    assert_same((&few, random), (&again, resumed));
}

#[test]
fn a_stopped_run_that_is_resumed_ends_as_if_it_had_not_stopped() {
    let whole = Run::new(gripper());
    let summary = whole.train(&tiny(&[]));
    // In the warm-up, while it learns, and near the end.
    for stop_after in [6, 18, 20] {
        let run = Run::new(gripper());
        let stop = AtomicBool::new(false);
        let stopped = run.start(&tiny(&[]), &stop, &mut StopAfter { episodes: stop_after, stop: &stop });
        assert_eq!(stopped.stopped_by, StoppedBy::Interrupt);
        assert!((stop_after..EPISODES).contains(&stopped.episodes), "{}", stopped.episodes);
        assert_eq!(stopped.success_rate, None);
        let resumed = run.resume_to_the_end();
        assert_same((&whole, summary.clone()), (&run, resumed));
    }
}

#[test]
fn a_killed_run_goes_on_from_its_last_checkpoint() {
    let whole = Run::new(gripper());
    let summary = whole.train(&tiny(&[]));
    let run = Run::new(gripper());
    let killed = catch_unwind(AssertUnwindSafe(|| {
        run.start(&tiny(&[]), &AtomicBool::new(false), &mut DieAfter { episodes: 22 });
    }));
    assert!(killed.is_err());
    // Episodes after the checkpoint are already stored; they are played again.
    assert!(stored_episodes(&run) > 16);
    let resumed = run.resume_to_the_end();
    assert_same((&whole, summary), (&run, resumed));
    let episodes: Vec<u64> = postures(&run).iter().map(|p| p.episode).collect();
    let distinct: BTreeSet<u64> = episodes.iter().copied().collect();
    assert_eq!(distinct.len(), episodes.len(), "an episode is in the database twice");
}

#[test]
fn an_unfinished_or_foreign_directory_is_not_resumed() {
    let run = Run::new(gripper());
    assert!(matches!(run.resume().err(), Some(TrainError::NotARun { .. })));
    std::fs::create_dir_all(&run.path).unwrap();
    assert!(matches!(run.resume().err(), Some(TrainError::NotARun { .. })));
    assert_eq!(std::fs::read_dir(&run.path).unwrap().count(), 0, "a directory that is no run is left as it is");
}

#[test]
fn evaluation_leaves_no_trace_in_training() {
    let seldom = Run::new(gripper());
    let a = seldom.train(&tiny(&["evaluation.every=1000", "evaluation.finalists=0"]));
    let often = Run::new(gripper());
    let b = often.train(&tiny(&["evaluation.every=2", "evaluation.episodes=6", "evaluation.finalists=0"]));
    assert_eq!(postures(&seldom), postures(&often));
    assert!(a.n_postures > 0 && a.n_postures == b.n_postures);
    assert!(seldom.bytes("checkpoints/replay.bin") == often.bytes("checkpoints/replay.bin"));
    assert!(seldom.bytes("policy.safetensors") == often.bytes("policy.safetensors"));
    assert!(often.metrics().len() > seldom.metrics().len());
    // One row for each successful training episode, and no other row.
    let episodes: Vec<u64> = postures(&often).iter().map(|p| p.episode).collect();
    assert!(episodes.is_sorted() && episodes.iter().all(|e| *e < EPISODES));
}

/// Returns the gripper with a wheel whose motor pushes harder the faster the wheel turns.
fn runaway(growth: f64) -> Hand {
    let wheel = "<body name=\"wheel\" pos=\"0 0 0.1\"><inertial pos=\"0 0 0\" mass=\"0.01\" \
                 diaginertia=\"1e-3 1e-3 1e-3\"/><joint name=\"spin\" type=\"hinge\" axis=\"0 0 1\" limited=\"false\" \
                 damping=\"0\" armature=\"0\"/></body>";
    let motor = format!(
        "<general name=\"motor\" joint=\"spin\" ctrllimited=\"true\" ctrlrange=\"-1 1\" gaintype=\"fixed\" \
         biastype=\"affine\" gainprm=\"1e-3\" biasprm=\"0 0 {growth}\"/>"
    );
    gripper_with(wheel, &motor)
}

#[test]
fn event_files_can_be_left_out() {
    let run = Run::new(gripper());
    run.train(&tiny(&["episodes=2", "tensorboard=false"]));
    assert_eq!(run.event_files().len(), 0);
}

#[test]
fn diverged_episodes_are_counted_and_stored_nowhere() {
    // The growth is low enough that some episodes end before the wheel's speed is infinite.
    let run = Run::new(runaway(0.021));
    let summary = run.train(&tiny(&[]));
    let diverged = summary.diverged_episodes;
    assert!(diverged > 2 && diverged < EPISODES - 2, "{diverged} of {EPISODES} diverged");
    assert_eq!(summary.episodes, EPISODES);
    assert_eq!(summary.env_steps, (EPISODES - diverged) * 30);
    assert_eq!(stored_episodes(&run) as u64, EPISODES - diverged);
    assert_eq!(postures(&run).len() as u64, summary.n_postures);
    for record in postures(&run) {
        assert!(record.posture.iter().all(|q| q.abs() < 1e9), "{record:?}");
    }
    assert_eq!(run.metrics().last().unwrap()["diverged"], diverged.to_string());
    assert!(summary.eval_warnings.bad_state > 0 || summary.success_rate > Some(0.0));
}

#[test]
fn a_hand_that_always_diverges_ends_its_run_and_is_named() {
    let run = Run::new(runaway(10.0));
    let few = EPISODES - 6;
    let summary = run.train(&tiny(&[&format!("episodes={few}")]));
    assert_eq!((summary.diverged_episodes, summary.env_steps, summary.updates), (few, 0, 0));
    assert_eq!((summary.success_rate, summary.n_postures), (Some(0.0), 0));
    assert_eq!((stored_episodes(&run), postures(&run).len()), (0, 0));
    assert_eq!(run.bytes("scenes/reference.json"), b"[]");

    let run = Run::new(runaway(10.0));
    let error = run.try_start(&tiny(&[]), &AtomicBool::new(false), &mut Silent).expect_err("it learns nothing");
    let message = error.to_string();
    for part in
        ["in 20 of the last 20 episodes", "the joint spin", "the actuator motor", "cube", "physics.timestep=0.002"]
    {
        assert!(message.contains(part), "{message}");
    }
    assert!(run.file("checkpoints/episode-00000020").is_dir(), "the run is saved");
}

#[test]
fn the_final_evaluation_shows_its_results_one_by_one() {
    let run = Run::new(gripper_with_vane());
    let mut notes = Notes::default();
    let summary = run.start(&tiny(&LONGER), &AtomicBool::new(false), &mut notes);
    let percent = |rate: f64| format!("{:.1} %", 100.0 * rate);
    let success = &summary.success_with_components;
    assert!(success.len() > 1);
    let expected = [
        format!("with all joints: {}", percent(summary.success_rate.unwrap())),
        format!("with 0 numbers: {}", percent(success[0])),
        format!("with 1 number: {}", percent(success[1])),
    ];
    let last: Vec<&String> = notes.0.iter().filter(|line| line.starts_with("with ")).collect();
    assert_eq!(last[..3], expected.each_ref(), "{:?}", notes.0);
    let finalists = notes.0.iter().filter(|line| line.starts_with("policy after episode ")).count();
    assert!(finalists > 1, "{:?}", notes.0);
}

#[test]
fn full_buffers_in_training_are_counted() {
    let run = Run::new(gripper_with_full_contacts());
    let summary =
        run.train(&tiny(&["episodes=2", "task.steps=3", "evaluation.episodes=1", "evaluation.final_episodes=1"]));
    assert!(summary.buffer_warnings > 0);
    assert!(summary.eval_warnings.contacts_full > 0);
    assert_eq!(run.metrics().last().unwrap()["buffer_warnings"], summary.buffer_warnings.to_string());
}

#[test]
fn the_synergy_of_a_run_is_numpys_analysis_of_its_postures() {
    if !python_has("numpy") {
        return;
    }
    let run = Run::new(gripper_with_vane());
    let config = tiny(&[&LONGER[..], &["episodes=120"]].concat());
    let summary = run.train(&config);
    let script = r#"
import json, sys
import numpy as np
d = sys.argv[1] + "/synergy-postures/"
load = lambda name: np.load(d + name + ".npy")
q, c, mean, l, r = (load(n) for n in ("postures", "components", "mean", "explained_variance", "contribution"))
values, vectors = np.linalg.eigh(np.cov(q.T))
values, vectors = values[::-1], vectors[:, ::-1].T[: len(c)]
vectors = vectors * np.sign(np.sum(vectors * c, axis=1))[:, None]
close = lambda a, b: bool(np.max(np.abs(a - b)) < 1e-8)
print(json.dumps([
    c.shape == (2, q.shape[1]), close(c @ c.T, np.eye(len(c))), close(c, vectors), close(mean, q.mean(axis=0)),
    close(l, values[: len(c)]), close(r, values[: len(c)] / values.sum()),
]))
"#;
    let output = Command::new(python()).args(["-c", script]).arg(&run.path).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(text.trim(), "[true, true, true, true, true, true]", "{errors}");
    assert_eq!(postures(&run).len() as u64, summary.n_postures);
    let npy = eigenhand_synergy::import(run.file("synergy-postures")).unwrap();
    let of_the_policy = postures(&run).into_iter().filter(|p| p.source != Source::Script);
    let rows: Vec<Vec<f64>> = of_the_policy.map(|p| p.posture).collect();
    let covered = newest(&rows, config.synergy.window);
    assert!(covered.len() < rows.len(), "the test needs more postures than the analysis covers");
    assert_eq!(npy.samples, covered, "postures.npy holds the database's newest rows");
}

#[test]
fn noise_that_has_fallen_to_nothing_is_no_noise() {
    let policy = |changes: &[&str]| {
        let run = Run::new(gripper());
        run.train(&tiny(&[&["exploration.noise_free_share=0", "lambda=0"], changes].concat()));
        run.bytes(&format!("{LAST}/learner.safetensors"))
    };
    let without = policy(&["exploration.noise_sigma=0", "exploration.random_probability=0"]);
    assert!(policy(&["training.noise_decay=[0, 0]", "training.final_noise=0"]) == without);
    assert!(policy(&["training.noise_decay=[1, 1]", "training.final_noise=0"]) != without);
}

#[test]
fn a_run_directory_holds_what_it_should_and_no_half_written_file() {
    let run = Run::new(gripper());
    run.train(&tiny(&[]));
    let expected = [
        "config.toml",
        "provenance.toml",
        "metrics.csv",
        "postures.sqlite",
        "policy.safetensors",
        "policy.toml",
        "scenes/cube.xml",
        "scenes/reference.json",
        "summary.json",
        "synergy/synergy.toml",
        "synergy/components.npy",
        "synergy/mean.npy",
        "synergy/explained_variance.npy",
        "synergy/contribution.npy",
        "synergy/commands.npy",
        "synergy-postures/synergy.toml",
        "synergy-postures/postures.npy",
    ];
    for name in expected {
        assert!(run.file(name).is_file(), "{name}");
    }
    for path in run.snapshot().keys() {
        assert!(!path.display().to_string().contains("partial"), "{}", path.display());
    }
    let config = run.bytes("config.toml");
    let read = eigenhand_train::read_config(&run.path).unwrap();
    assert_eq!(read, tiny(&[]));
    // A second run never writes into the first.
    let again = catch_unwind(AssertUnwindSafe(|| run.start(&tiny(&[]), &AtomicBool::new(false), &mut Silent)));
    assert!(again.is_err());
    assert!(config == run.bytes("config.toml"));
}

/// Stops the run when its final evaluation begins.
struct StopInEvaluation<'a> {
    stop: &'a AtomicBool,
}

impl Progress for StopInEvaluation<'_> {
    fn update(&mut self, _status: &Status) {}

    fn note(&mut self, line: &str) {
        if line.starts_with("final evaluation") {
            self.stop.store(true, Ordering::Relaxed);
            // Until the flag has been seen.
            std::thread::sleep(Duration::from_millis(200));
        }
    }
}

#[test]
fn a_run_stopped_in_its_final_evaluation_goes_on_to_the_same_end() {
    let config = tiny(&[]);
    let whole = Run::new(gripper());
    let summary = whole.train(&config);
    let (run, stop) = (Run::new(gripper()), AtomicBool::new(false));
    let stopped = run.start(&config, &stop, &mut StopInEvaluation { stop: &stop });
    assert_eq!(stopped.stopped_by, StoppedBy::Interrupt);
    assert_eq!((stopped.success_rate, stopped.episodes), (None, config.episodes));
    assert_same((&whole, summary), (&run, run.resume_to_the_end()));
}

/// Sends a message shortly before the last episodes of a run.
struct NearTheEnd(std::sync::mpsc::Sender<()>, u64);

impl Progress for NearTheEnd {
    fn update(&mut self, status: &Status) {
        if status.episodes >= self.1 {
            // Nobody listens after the first message.
            let _ = self.0.send(());
        }
    }

    fn note(&mut self, _line: &str) {}
}

#[test]
fn a_run_stopped_in_an_evaluation_leaves_it_at_once_and_makes_it_later() {
    // One evaluation, which takes seconds.
    let config = tiny(&["evaluation.every=24", "evaluation.episodes=300"]);
    let whole = Run::new(gripper());
    let summary = whole.train(&config);
    let (run, stop) = (Run::new(gripper()), AtomicBool::new(false));
    let (near, heard) = std::sync::mpsc::channel();
    let stopped = std::thread::scope(|scope| {
        let stop = &stop;
        scope.spawn(move || {
            heard.recv().unwrap();
            std::thread::sleep(Duration::from_millis(300));
            stop.store(true, Ordering::Relaxed);
        });
        run.start(&config, stop, &mut NearTheEnd(near, EPISODES - 2))
    });
    assert_eq!((stopped.stopped_by, stopped.episodes), (StoppedBy::Interrupt, EPISODES));
    let written = run.bytes("metrics.csv");
    assert_eq!((stopped.last_evaluation, written.len()), (None, 0), "it is left, and nothing is written");
    assert_same((&whole, summary), (&run, run.resume_to_the_end()));
}

#[test]
fn an_evaluation_counts_its_episodes() {
    let (trained, plugins) = crate::support::learned();
    let mut hands = SearchPath::new();
    hands.push(plugins, "the test");
    let run = FinishedRun::open(&trained.path, &hands, &[]).unwrap();
    let seen = Arc::new(Mutex::new(Vec::new()));
    let counted = Arc::clone(&seen);
    let counting: Counting = Arc::new(move |done, all| counted.lock().unwrap().push((done, all)));
    let found = run.evaluate(5, 1, Workers { count: 2, counting: Some(counting) }).unwrap();
    assert_eq!(*seen.lock().unwrap(), (0..=5).map(|done| (done, 5)).collect::<Vec<_>>());
    assert_eq!(found.success_rate, run.evaluate(5, 1, 2).unwrap().success_rate);
}
