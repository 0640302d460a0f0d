//! Reproductions that run other processes instead of trainings.

use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};

use eigenhand_train::reproduce::{Comparison, Reproduction, Request};
use eigenhand_train::request::{NewRun, resolve};
use eigenhand_train::runs::children::{Ending, train};
use eigenhand_train::runs::{Job, Overview, OverviewDisplay, State};
use eigenhand_train::{Provenance, RunDirectory, TrainError};
use tempfile::TempDir;

use crate::gripper::{GRIPPER_MANIFEST, GRIPPER_MODEL, TINY};
use crate::support::mujoco;

/// A directory with the hand and an empty reproduction.
struct Place {
    root: TempDir,
}

impl Place {
    fn new() -> Place {
        let root = TempDir::new().unwrap();
        std::fs::create_dir(root.path().join("gripper")).unwrap();
        std::fs::write(root.path().join("gripper/hand.toml"), GRIPPER_MANIFEST).unwrap();
        std::fs::write(root.path().join("gripper/gripper.xml"), GRIPPER_MODEL).unwrap();
        Place { root }
    }

    fn settings(&self) -> NewRun {
        let varied = |setting: &&str| ["hand=", "workers=", "lambda="].iter().any(|key| setting.starts_with(key));
        NewRun {
            hand: Some(self.root.path().join("gripper").display().to_string()),
            // The gripper has one actuator.
            assignments: TINY
                .iter()
                .filter(|setting| !varied(setting))
                .chain(&["synergy.components=1"])
                .map(|setting| (*setting).to_owned())
                .collect(),
            ..NewRun::default()
        }
    }

    fn directory(&self) -> PathBuf {
        self.root.path().join("all")
    }

    fn request(&self, seeds: &[u64]) -> Request {
        let out = Some(self.directory());
        let comparison = Comparison::Lambdas(vec![0.0, 1.0, 0.0]);
        Request { settings: self.settings(), comparison, seeds: seeds.to_vec(), out }
    }

    fn prepare(&self, seeds: &[u64]) -> Reproduction {
        Reproduction::prepare(&self.request(seeds)).unwrap_or_else(|error| panic!("{error}"))
    }
}

/// Keeps the notes, and requests a stop when a run trains.
#[derive(Default)]
struct Display<'a> {
    notes: Vec<String>,
    stop: Option<&'a AtomicUsize>,
}

impl OverviewDisplay for Display<'_> {
    fn update(&mut self, overview: &Overview) {
        if let Some(stop) = self.stop.filter(|_| !overview.running.is_empty()) {
            stop.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn note(&mut self, line: &str) {
        self.notes.push(line.to_owned());
    }
}

/// Returns the command of a shell that runs instead of a training. `env` restores the default interrupt first: a test
/// in the background inherits an ignored interrupt, and a shell cannot trap a signal that was ignored at its start.
fn shell(script: &str, jobs: &[Job]) -> impl Fn(usize) -> Result<Command, TrainError> {
    move |i| {
        let mut command = Command::new("env");
        command.args(["--default-signal=INT", "sh", "-c", script, &jobs[i].name]);
        Ok(command)
    }
}

#[test]
fn runs_are_interleaved_and_named_once() {
    let place = Place::new();
    let reproduction = place.prepare(&[4, 2, 4]);
    let names: Vec<&str> = reproduction.members.iter().map(|member| member.job.name.as_str()).collect();
    assert_eq!(names, ["l0-s4", "l1-s4", "l0-s2", "l1-s2"]);
    assert!(reproduction.jobs().iter().all(|job| job.state == State::New && job.episodes == 24));
    assert!(matches!(Reproduction::prepare(&place.request(&[1])), Err(TrainError::Locked { .. })));
}

#[test]
fn a_process_that_fails_is_shown_with_its_last_words_and_the_others_go_on() {
    let place = Place::new();
    let reproduction = place.prepare(&[1]);
    let jobs = reproduction.jobs();
    let mut display = Display::default();
    let script = "echo episode 3 of 24; echo error: $0 is out of luck >&2; echo so much for it >&2; exit 3";
    let endings = train(&jobs, 1, &AtomicUsize::new(0), &shell(script, &jobs), &mut display).unwrap();
    for (ending, name) in endings.iter().zip(["l0-s1", "l1-s1"]) {
        let Ending::Failed { status, lines } = ending else { panic!("{ending:?}") };
        assert!(status.contains('3'), "{status}");
        let error = format!("error: {name} is out of luck");
        assert_eq!(*lines, [error.as_str(), "so much for it"], "what was printed before the error is left out");
    }
    assert!(display.notes.iter().any(|note| note.contains("l1-s1 failed") && note.contains("out of luck")));

    // A process that ends without an error but has trained nothing has failed too.
    let endings = train(&jobs, 2, &AtomicUsize::new(0), &shell("exit 0", &jobs), &mut display).unwrap();
    assert!(endings.iter().all(|ending| matches!(ending, Ending::Failed { .. })));
}

#[test]
fn a_directory_that_is_in_use_or_is_not_a_run_is_left_alone() {
    let place = Place::new();
    let (config, hand) = resolve(&NewRun { lambda: Some(0.0), seed: Some(1), ..place.settings() }).unwrap();
    let provenance = Provenance::collect(&hand, &mujoco());
    let used = RunDirectory::create(Some(&place.directory().join("l0-s1")), &config, &provenance).unwrap();
    let foreign = place.directory().join("l1-s1/mine.txt");
    std::fs::create_dir_all(foreign.parent().unwrap()).unwrap();
    std::fs::write(&foreign, "mine").unwrap();

    let reproduction = place.prepare(&[1]);
    let jobs = reproduction.jobs();
    let endings = train(&jobs, 2, &AtomicUsize::new(0), &shell("exit 0", &jobs), &mut Display::default()).unwrap();
    for (ending, reason) in endings.iter().zip(["in use", "other files"]) {
        let Ending::Failed { lines, .. } = ending else { panic!("{ending:?}") };
        assert!(lines[0].contains(reason), "{lines:?}");
    }
    assert!(used.file("config.toml").exists() && foreign.exists());

    // Once the directory is free, a run that has trained nothing is replaced.
    drop(used);
    let script = "test ! -e \"$0\" && exit 7";
    let there = |i: usize| {
        let mut command = Command::new("sh");
        command.args(["-c", script]).arg(&jobs[i].run);
        Ok(command)
    };
    let endings = train(&jobs, 1, &AtomicUsize::new(0), &there, &mut Display::default()).unwrap();
    assert!(matches!(&endings[0], Ending::Failed { status, .. } if status.contains('7')), "{endings:?}");
}

/// Fails once a file exists.
struct Gone(PathBuf);

impl OverviewDisplay for Gone {
    fn update(&mut self, _overview: &Overview) {
        assert!(!self.0.exists(), "nobody reads, on purpose");
    }

    fn note(&mut self, _line: &str) {}
}

#[test]
fn no_process_is_left_behind_when_the_display_fails() {
    let place = Place::new();
    let reproduction = place.prepare(&[1]);
    let jobs = reproduction.jobs();
    let [ready, told] = ["ready", "told"].map(|name| place.directory().join(name));
    let wait = "while :; do sleep 0.05; done";
    let script = format!("trap 'touch \"{}\"; exit 1' INT; touch \"{}\"; {wait}", told.display(), ready.display());
    let run = || train(&jobs, 1, &AtomicUsize::new(0), &shell(&script, &jobs), &mut Gone(ready.clone()));
    assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err());
    assert!(told.exists(), "the process was asked to stop, and its end was awaited");
}

#[test]
fn a_process_that_ignores_the_first_request_to_stop_is_killed_at_the_second() {
    let place = Place::new();
    let reproduction = place.prepare(&[1]);
    let jobs = reproduction.jobs();
    let stop = AtomicUsize::new(0);
    let mut display = Display { stop: Some(&stop), ..Display::default() };
    let started = std::time::Instant::now();
    let endings = train(&jobs, 1, &stop, &shell("trap '' INT; exec sleep 60", &jobs), &mut display).unwrap();
    assert!(started.elapsed().as_secs() < 50, "the process was waited for");
    assert_eq!(endings, [Ending::Stopped, Ending::Stopped]);
    assert!(!display.notes.iter().any(|note| note.contains("l1-s1 starts")), "no run starts after a request to stop");
}
