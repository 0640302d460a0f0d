//! Helpers for several modules: the hands, a small hand for tests, and tiny training runs.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use eigenhand_hands::{Hand, Registry, SearchPath};
use eigenhand_mujoco::MuJoCo;
use eigenhand_rl::{Policy, Tensor, TensorMap};
use eigenhand_sim::GraspTask;
use eigenhand_train::config::{Layers, Preset, RunConfig};
use eigenhand_train::{
    Assignment, Behaviour, EpisodeJob, Progress, Provenance, RunDirectory, Silent, Status, Summary, TrainError,
    Trainer, task_of,
};
use tempfile::TempDir;

use crate::gripper::{ANEW, GRIPPER_MANIFEST, GRIPPER_MODEL, LONGER, TINY, TURN, VANE};

/// Returns the root of the workspace.
pub fn workspace() -> PathBuf {
    let tests = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    tests.parent().expect("tests/ lies in the workspace").to_owned()
}

/// Returns the hands of the workspace; ignores the environment.
pub fn registry() -> Registry {
    let mut path = SearchPath::new();
    path.push(workspace().join("plugins"), "the workspace");
    Registry::discover(&path).expect("plugins/")
}

/// Returns the simulator. Without it, the test fails with the error that says what to install.
pub fn mujoco() -> Arc<MuJoCo> {
    MuJoCo::load().unwrap_or_else(|error| panic!("{error}"))
}

/// Returns the Python that runs the examples: the one in `EIGENHAND_PYTHON`, or else the system's.
pub fn python() -> String {
    std::env::var("EIGENHAND_PYTHON").unwrap_or_else(|_| "python3".to_owned())
}

/// Environment variable: if it is set, a test fails when Python or a module is missing, instead of being skipped.
const PYTHON_REQUIRED: &str = "EIGENHAND_PYTHON_REQUIRED";

/// Tells whether Python runs and has all of these modules; if not, prints that the test is skipped.
pub fn python_has(modules: &str) -> bool {
    let probe = std::process::Command::new(python()).args(["-c", &format!("import {modules}")]).output();
    let there = probe.is_ok_and(|output| output.status.success());
    if !there {
        assert!(std::env::var_os(PYTHON_REQUIRED).is_none(), "{} cannot import {modules}", python());
        // The output of passing tests is captured, so this line goes directly to stderr, where a person sees it.
        let _ = writeln!(
            std::io::stderr(),
            "skipped: {} cannot import {modules}; set EIGENHAND_PYTHON to another interpreter",
            python()
        );
    }
    there
}

/// Runs Python and returns what it printed; it must succeed.
pub fn run_python(arguments: &[&str]) -> String {
    let output = std::process::Command::new(python()).args(arguments).output().unwrap();
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{printed}{}", String::from_utf8_lossy(&output.stderr));
    printed
}

/// Runs a script on a path, and returns the JSON that it printed.
pub fn answer<T: serde::de::DeserializeOwned>(script: &str, path: &Path) -> T {
    let printed = run_python(&["-c", script, path.to_str().unwrap()]);
    serde_json::from_str(&printed).unwrap_or_else(|error| panic!("{error}: {printed}"))
}

/// Returns a gripper of two pads.
pub fn gripper() -> Hand {
    gripper_with("", "")
}

/// Returns the gripper with more bodies and actuators.
pub fn gripper_with(bodies: &str, actuators: &str) -> Hand {
    let directory = TempDir::new().unwrap();
    write_gripper(directory.path(), bodies, actuators);
    Hand::load(directory.path()).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns the gripper with many boxes in one place, which can move relative to one another: more contacts than any hand
/// has. With `physics.self_collision` there are none, because bodies that overlap at the start do not collide.
pub fn gripper_with_full_contacts() -> Hand {
    let boxes: String = (0..14)
        .map(|i| {
            format!(
                "<body name=\"box{i}\" pos=\"0.2 0 0.1\"><joint name=\"box{i}_joint\" axis=\"0 0 1\"/>\
                 <geom type=\"box\" size=\"0.03 0.03 0.03\" conaffinity=\"1\" mass=\"0.05\"/></body>"
            )
        })
        .collect();
    gripper_with(&boxes, "")
}

/// Writes the files of the gripper, with more bodies and actuators, into a directory.
pub fn write_gripper(directory: &Path, bodies: &str, actuators: &str) {
    let model = GRIPPER_MODEL.replace("<!-- extra bodies -->", bodies).replace("<!-- extra actuators -->", actuators);
    std::fs::write(directory.join("hand.toml"), GRIPPER_MANIFEST).unwrap();
    std::fs::write(directory.join("gripper.xml"), model).unwrap();
}

/// Returns the settings of a tiny run, with assignments as `--set` takes them.
pub fn tiny(assignments: &[&str]) -> RunConfig {
    let mut layers = Layers::new(Preset::Default).unwrap();
    for assignment in TINY.iter().chain(assignments) {
        layers.add_assignment(assignment).unwrap_or_else(|error| panic!("{error}"));
    }
    layers.resolve().unwrap_or_else(|error| panic!("{error}"))
}

/// Compiles the task of a configuration.
pub fn task(config: &RunConfig, hand: &Hand) -> Arc<GraspTask> {
    task_of(config, hand, &mujoco()).unwrap_or_else(|error| panic!("{error}"))
}

/// Sets the stop flag after some episodes.
pub struct StopAfter<'a> {
    pub episodes: u64,
    pub stop: &'a AtomicBool,
}

impl Progress for StopAfter<'_> {
    fn update(&mut self, status: &Status) {
        if status.episodes >= self.episodes {
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    fn note(&mut self, _line: &str) {}
}

/// Keeps the notes of a run.
#[derive(Default)]
pub struct Notes(pub Vec<String>);

impl Progress for Notes {
    fn update(&mut self, _status: &Status) {}

    fn note(&mut self, line: &str) {
        self.0.push(line.to_owned());
    }
}

/// Ends the run after some episodes like a killed process: it writes nothing more.
pub struct DieAfter {
    pub episodes: u64,
}

impl Progress for DieAfter {
    fn update(&mut self, status: &Status) {
        assert!(status.episodes < self.episodes, "killed on purpose");
    }

    fn note(&mut self, _line: &str) {}
}

/// Returns a run that has learned to grasp with two numbers, and the directory in which its hand lies. It is trained once for
/// all tests, so none may change it.
pub fn learned() -> &'static (Run, PathBuf) {
    static LEARNED: OnceLock<(Run, PathBuf)> = OnceLock::new();
    LEARNED.get_or_init(|| {
        let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join("learned");
        // That of an earlier run of the tests.
        let _ = std::fs::remove_dir_all(&root);
        let plugins = root.join("plugins");
        std::fs::create_dir_all(plugins.join("gripper")).unwrap();
        write_gripper(&plugins.join("gripper"), VANE, TURN);
        let hand = Hand::load(plugins.join("gripper")).unwrap_or_else(|error| panic!("{error}"));
        let run = Run { path: root.join("run"), _root: None, hand };
        run.train(&tiny(&[&LONGER[..], &["synergy.components=2", "synergy.settle=0.3"], &ANEW].concat()));
        (run, plugins)
    })
}

/// A run in a directory, most often a temporary one.
pub struct Run {
    _root: Option<TempDir>,
    pub path: PathBuf,
    hand: Hand,
}

impl Run {
    pub fn new(hand: Hand) -> Run {
        let root = TempDir::new().unwrap();
        Run { path: root.path().join("run"), _root: Some(root), hand }
    }

    /// Trains a new run to its end.
    pub fn train(&self, config: &RunConfig) -> Summary {
        self.start(config, &AtomicBool::new(false), &mut Silent)
    }

    pub fn start(&self, config: &RunConfig, stop: &AtomicBool, progress: &mut dyn Progress) -> Summary {
        self.try_start(config, stop, progress).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Trains a new run to its end, or to the error that ends it.
    pub fn try_start(
        &self,
        config: &RunConfig,
        stop: &AtomicBool,
        progress: &mut dyn Progress,
    ) -> Result<Summary, TrainError> {
        let provenance = Provenance::collect(&self.hand, &mujoco());
        let run = RunDirectory::create(Some(&self.path), config, &provenance).unwrap();
        Trainer::create(self.assignment(config.clone(), provenance, run))?.run(stop, progress)
    }

    /// Prepares to continue the run.
    pub fn resume(&self) -> Result<Trainer, TrainError> {
        self.resume_with(|_| {})
    }

    /// Prepares to continue the run with changed settings.
    pub fn resume_with(&self, change: impl FnOnce(&mut RunConfig)) -> Result<Trainer, TrainError> {
        let run = RunDirectory::open(&self.path)?;
        let mut config = run.config()?;
        change(&mut config);
        Trainer::resume(self.assignment(config, Provenance::collect(&self.hand, &mujoco()), run))
    }

    fn assignment(&self, config: RunConfig, provenance: Provenance, run: RunDirectory) -> Assignment {
        let (hand, task) = (self.hand.clone(), task(&config, &self.hand));
        Assignment { config, provenance, hand, task, other_task: None, space: None, start: None, run }
    }

    pub fn resume_to_the_end(&self) -> Summary {
        let trainer = self.resume().unwrap_or_else(|error| panic!("{error}"));
        trainer.run(&AtomicBool::new(false), &mut Silent).unwrap_or_else(|error| panic!("{error}"))
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    pub fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.file(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Reads every file of the run.
    pub fn snapshot(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut files = BTreeMap::new();
        collect(&self.path, &mut files);
        files
    }

    /// Returns the bytes of the event files. A run has one, unless it is switched off.
    pub fn event_files(&self) -> Vec<Vec<u8>> {
        let is_event = |path: &PathBuf| path.display().to_string().contains("tfevents");
        self.snapshot().into_iter().filter(|(path, _)| is_event(path)).map(|(_, bytes)| bytes).collect()
    }

    /// Returns the rows of metrics.csv, each as a map from column to value.
    pub fn metrics(&self) -> Vec<BTreeMap<String, String>> {
        let text = String::from_utf8(self.bytes("metrics.csv")).unwrap();
        let mut lines = text.lines();
        let header: Vec<&str> = lines.next().unwrap().split(',').collect();
        let row = |line: &str| header.iter().map(|h| (*h).to_owned()).zip(line.split(',').map(str::to_owned)).collect();
        lines.map(row).collect()
    }
}

fn collect(directory: &Path, files: &mut BTreeMap<PathBuf, Vec<u8>>) {
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            files.insert(path.clone(), std::fs::read(&path).unwrap());
        }
    }
}

/// Returns a policy whose action is `action` for every observation.
pub fn constant_policy(task: &GraspTask, action: &[f32]) -> Policy {
    let (obs, goal, act) = (task.observation_len(), GraspTask::GOAL_LEN, task.action_len());
    assert_eq!(action.len(), act);
    let mut tensors = TensorMap::default();
    tensors.insert("actor.0.weight", Tensor::f32(vec![act, obs + goal], vec![0.0; act * (obs + goal)]));
    let bias = action.iter().map(|a| a.clamp(-0.999_999, 0.999_999).atanh()).collect();
    tensors.insert("actor.0.bias", Tensor::f32(vec![act], bias));
    for (name, n) in [("observation", obs), ("goal", goal)] {
        tensors.insert(format!("{name}.mean"), Tensor::f32(vec![n], vec![0.0; n]));
        tensors.insert(format!("{name}.std"), Tensor::f32(vec![n], vec![1.0; n]));
    }
    Policy::import_tensors(&tensors, &tiny(&[]).learner.normalizer).unwrap()
}

/// Returns the job of one episode.
pub fn job(policy: &Policy, behaviour: &Behaviour, index: u64) -> EpisodeJob {
    EpisodeJob {
        seed: 7,
        stream: "test",
        index,
        scene: None,
        policy: policy.clone(),
        behaviour: behaviour.clone(),
        fewer_numbers: false,
        confinement: None,
        disturbance: None,
    }
}
