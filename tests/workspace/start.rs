//! Runs that start with the networks of another run.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use eigenhand_train::request::{Launch, NewRun, ResumedRun};
use eigenhand_train::{Progress, RunDirectory, Silent, Summary, TrainError, read_metrics};
use tempfile::TempDir;

use crate::gripper::{ANEW, LONGER, TINY, TURN, VANE};
use crate::support::{StopAfter, write_gripper};

/// A hand, and a run that trained it.
struct Place {
    root: TempDir,
}

impl Place {
    /// Trains a run with settings after those of the tiny one.
    fn new(settings: &[&str]) -> Place {
        let place = Place { root: TempDir::new().unwrap() };
        std::fs::create_dir(place.path("gripper")).unwrap();
        write_gripper(&place.path("gripper"), VANE, TURN);
        let assignments = TINY.iter().chain(settings).filter(|setting| !setting.starts_with("hand="));
        let request = NewRun {
            hand: Some(place.path("gripper").display().to_string()),
            assignments: assignments.map(|setting| (*setting).to_owned()).collect(),
            force: true,
            out: Some(place.path("before")),
            ..NewRun::default()
        };
        run(Launch::start(&request), &AtomicBool::new(false), &mut Silent);
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().join(name)
    }

    /// Requests a run that starts with the networks of the first.
    fn request(&self, out: &str, settings: &[&str]) -> NewRun {
        NewRun {
            from: Some(self.path("before")),
            assignments: settings.iter().map(|setting| (*setting).to_owned()).collect(),
            force: true,
            out: Some(self.path(out)),
            ..NewRun::default()
        }
    }

    fn train(&self, out: &str, settings: &[&str]) -> Summary {
        run(Launch::start(&self.request(out, settings)), &AtomicBool::new(false), &mut Silent)
    }

    fn refused(&self, settings: &[&str]) -> String {
        let error = Launch::start(&self.request("refused", settings)).err().expect("an error");
        assert!(error.is_usage(), "{error}");
        error.to_string()
    }

    fn success(&self, run: &str) -> Vec<(u64, f64)> {
        read_metrics(&self.path(run)).unwrap().iter().map(|row| (row.episode, row.success_rate.unwrap())).collect()
    }

    fn components(&self, run: &str) -> Vec<u8> {
        std::fs::read(self.path(run).join("synergy/components.npy")).unwrap()
    }
}

fn run(launch: Result<Launch, TrainError>, stop: &AtomicBool, progress: &mut dyn Progress) -> Summary {
    launch.and_then(|launch| launch.run(stop, progress)).unwrap_or_else(|error| panic!("{error}"))
}

/// The networks act from the first episode on as they did at the end, in the space that they know.
#[test]
fn a_run_starts_where_another_ended() {
    let place = Place::new(&[&LONGER[..], &ANEW, &["synergy.settle=0.3"]].concat());
    let ended = *place.success("before").last().unwrap();
    place.train("after", &["episodes=16"]);
    let started = place.success("after")[0];
    assert_eq!((started.0, started.1), (0, ended.1), "the same episodes, the same policy");
    assert!(ended.1 > 0.0, "it has learned something");
    assert_eq!(place.components("after"), place.components("before"), "the space that was settled stays");
    let config = RunDirectory::open(&place.path("after")).unwrap().config().unwrap();
    assert_eq!((config.learner.hidden, config.episodes), (vec![32, 32], 16), "settings of the run before, but for one");
    assert_eq!(Path::new(&config.from), place.path("before").canonicalize().unwrap());
    // It goes on to other objects, and the run before can be gone when it is resumed.
    let stop = AtomicBool::new(false);
    let request = place.request("stopped", &["episodes=16", "objects=[\"cylinder\"]"]);
    let whole = place.train("whole", &["episodes=16", "objects=[\"cylinder\"]"]);
    run(Launch::start(&request), &stop, &mut StopAfter { episodes: 8, stop: &stop });
    std::fs::remove_dir_all(place.path("before")).unwrap();
    let resumed = ResumedRun { run: place.path("stopped"), ..ResumedRun::default() };
    let resumed = run(Launch::resume(&resumed), &AtomicBool::new(false), &mut Silent);
    assert_eq!(Summary { wall_s: 0.0, ..resumed }, Summary { wall_s: 0.0, ..whole });
    assert_eq!(place.components("stopped"), place.components("whole"));
    assert_eq!(place.success("stopped"), place.success("whole"));
}

#[test]
fn networks_that_command_every_joint_start_a_run_too() {
    let place = Place::new(&["lambda=0"]);
    let ended = *place.success("before").last().unwrap();
    place.train("after", &["episodes=8"]);
    assert_eq!(place.success("after")[0], (0, ended.1));
    assert!(!place.path("after/start.sqlite").exists());
}

#[test]
fn what_the_networks_do_not_fit_is_refused() {
    let place = Place::new(&[]);
    let says = |settings: &[&str], part: &str| {
        let error = place.refused(settings);
        assert!(error.contains(part) && error.contains("--from"), "{error}");
    };
    says(&["learner.hidden=[8]"], "learner.hidden");
    says(&["task.observe_fingertips=true"], "task.observe_*");
    says(&["from=elsewhere"], "choose it with --from");
    // Another hand, and one whose files have changed.
    std::fs::create_dir(place.path("other")).unwrap();
    write_gripper(&place.path("other"), "", "");
    let manifest = std::fs::read_to_string(place.path("other/hand.toml")).unwrap();
    std::fs::write(place.path("other/hand.toml"), manifest.replace("name = \"gripper\"", "name = \"other\"")).unwrap();
    let other = format!("hand={:?}", place.path("other").display().to_string());
    says(&[&other, "synergy.components=1"], "trained the hand gripper, not other");
    write_gripper(&place.path("gripper"), "", "");
    says(&["synergy.components=1"], "have changed");
    let nowhere = NewRun { from: Some(place.path("nowhere")), ..NewRun::default() };
    let error = Launch::start(&nowhere).err().expect("an error").to_string();
    assert!(error.contains("nowhere"), "{error}");
}
