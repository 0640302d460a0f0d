//! What an export holds for other programs (arrays, the policy as ONNX, motors, files for ROS 2, digests), and pictures of a run.

use std::path::Path;

use eigenhand_bundle::{Bundle, BundleError, MOTORS, export};
use eigenhand_hands::SearchPath;
use eigenhand_render::{Film, grasp};
use eigenhand_synergy::{Compared, Comparison, JointInfo, Synergy, SynergyFile, Unit};
use eigenhand_train::FinishedRun;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use tempfile::TempDir;

use crate::support::{answer, learned, python_has};

/// A finished run in few numbers, and its export.
struct Exported {
    run: FinishedRun,
    out: TempDir,
}

impl Exported {
    fn new() -> Exported {
        let (trained, plugins) = learned();
        let mut hands = SearchPath::new();
        hands.push(plugins, "the test");
        let run = FinishedRun::open(&trained.path, &hands, &[]).unwrap();
        let out = TempDir::new().unwrap();
        Exported { run, out }
    }

    fn synergy(&self) -> SynergyFile {
        self.run.control_synergy().unwrap().unwrap()
    }

    /// Exports anew, as the command does.
    fn write(&self) -> Result<eigenhand_bundle::Exported, BundleError> {
        let bundle = Bundle {
            hand: &self.run.hand,
            synergy: Some(&self.synergy()),
            policy: &self.run.policy,
            normalizer: self.run.config.learner.normalizer,
            version: "1.2.3",
        };
        export(&bundle, self.out.path(), |staging| {
            self.run.export(staging).unwrap();
            Ok(())
        })
    }
}

#[test]
fn other_programs_read_an_export_as_this_one_does() {
    if !python_has("eigenhand, onnxruntime, yaml") {
        return;
    }
    let exported = Exported::new();
    let files = exported.write().unwrap().files;
    for name in ["policy.onnx", "synergy.npz", MOTORS, "ros2/grasp_profiles.yaml", "README.md", "manifest.json"] {
        assert!(files.contains(&exported.out.path().join(name)), "{name}: {files:?}");
    }
    let script = r#"
import hashlib, json, pathlib, sys
import numpy as np, onnxruntime, yaml
import eigenhand
out = pathlib.Path(sys.argv[1])
policy, synergy = eigenhand.Policy.load(out), eigenhand.Synergy.load(out)

# The policy, in a batch.
random = np.random.default_rng(0)
observations = random.normal(0, 3, (20, len(policy.config["observation"]))).astype(np.float32)
goals = random.normal(0, 1, (20, 3)).astype(np.float32)
session = onnxruntime.InferenceSession(out / "policy.onnx")
(actions,) = session.run(None, {"observation": observations, "goal": goals})
expected = np.array([policy.act(o, g) for o, g in zip(observations, goals)])
assert np.abs(actions - expected).max() < 1e-5 and actions.std(axis=0).max() > 0.01, actions

# The arrays.
arrays = np.load(out / "synergy.npz")
for name, known in (("mean", synergy.mean), ("components", synergy.components), ("z_low", synergy.z_low),
        ("z_high", synergy.z_high), ("joint_mean", synergy.joint_mean), ("joint_matrix", synergy.joint_matrix),
        ("actuator_low", synergy.actuator_low), ("joint_high", synergy.joint_high)):
    assert np.array_equal(arrays[name], known), name
assert list(arrays["actuators"]) == synergy.actuators and list(arrays["joints"]) == synergy.joints
assert list(arrays["free"]) == synergy.free == ["slide"], synergy.free

# Motors that take commands as they are.
z = synergy.z_low + 0.3 * (synergy.z_high - synergy.z_low)
motors = eigenhand.Motors.load(out / "motors.toml", synergy)
assert np.allclose(motors.values(synergy.command(z)), synergy.command(z), atol=1e-12)
assert np.allclose(motors.commands(motors.values(synergy.command(z))), synergy.command(z), atol=1e-12)

# ROS 2. Each actuator of this hand drives one joint, which is sent where the command leads; another joint follows the first.
(node, parameters), = yaml.safe_load((out / "ros2/grasp_profiles.yaml").read_text()).items()
parameters = parameters["ros__parameters"]
assert node == "/**/grasp_synergy_adapter"
assert isinstance(parameters["state_timeout_sec"], float) and parameters["synergy_joint"] not in parameters["joints"]
moved = [motor["joints"] for motor in motors.motors]
assert [joints[0] for joints in moved] == parameters["joints"] and moved[0][1:] == ["right_joint"], (parameters["joints"], moved)
assert set(parameters["grasp_names"]) == set(parameters["grasps"]) == {"cube", "number_1", "number_2"}
paths = {}
for name, profile in parameters["grasps"].items():
    knots = [profile["knots"][knot] for knot in profile["knot_names"]]
    coordinates = [knot["coordinate"] for knot in knots]
    assert coordinates[0] == 0.0 and coordinates[-1] == 1.0 and all(np.diff(coordinates) > 0), coordinates
    assert all(isinstance(number, float) for knot in knots for number in [knot["coordinate"], *knot["positions"]])
    paths[name] = np.array([knot["positions"] for knot in knots])
moments = [synergy.command(z) for z, q in synergy.grasp("cube").values()]
assert np.allclose(paths["cube"][[0, -1]], [moments[0], moments[-1]], atol=1e-6), (paths["cube"], moments)
ends = [synergy.command([0.0, bound]) for bound in (synergy.z_low[1], synergy.z_high[1])]
assert np.allclose(paths["number_2"][[0, -1]], ends, atol=1e-6)
trajectory = json.loads((out / "ros2/trajectories/cube.json").read_text())
assert trajectory["joint_names"] == parameters["joints"]
assert np.allclose([point["positions"] for point in trajectory["points"]], moments, atol=1e-9)
times = [point["time_from_start"] for point in trajectory["points"]]
assert all(a["sec"] + a["nanosec"] / 1e9 < b["sec"] + b["nanosec"] / 1e9 for a, b in zip(times, times[1:]))

# Digests of every file but that of motors.
manifest = json.loads((out / "manifest.json").read_text())
for entry in manifest["files"]:
    data = (out / entry["path"]).read_bytes()
    assert len(data) == entry["bytes"] and hashlib.sha256(data).hexdigest() == entry["sha256"], entry
there = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
assert there - {entry["path"] for entry in manifest["files"]} == {"manifest.json", "motors.toml"}
print(json.dumps("good"))
"#;
    let good: String = answer(script, exported.out.path());
    assert_eq!(good, "good");
    let readme = std::fs::read_to_string(exported.out.path().join("README.md")).unwrap();
    assert!(readme.starts_with("# gripper\n\n2 numbers for the 2 actuators"), "{readme}");
}

#[test]
fn an_export_keeps_the_motors_that_their_owner_filled_in() {
    let exported = Exported::new();
    exported.write().unwrap();
    let motors = exported.out.path().join(MOTORS);
    let text = std::fs::read_to_string(&motors).unwrap();
    let changed = text.replacen("sign = 1", "sign = -1", 1);
    assert_ne!(text, changed);
    std::fs::write(&motors, &changed).unwrap();
    assert!(
        exported.write().unwrap().notes.iter().all(|note| note.contains("reaches")),
        "the way is turned, so limits cut it off"
    );
    assert_eq!(std::fs::read_to_string(&motors).unwrap(), changed);

    std::fs::write(&motors, text.replacen("sign = 1", "sign = 0", 1)).unwrap();
    let error = exported.write().unwrap_err().to_string();
    assert!(
        error.contains("motors.toml: sign of the motor of") && error.contains("expected 1 or -1, got 0"),
        "{error}"
    );
}

/// What an earlier export wrote and the new one does not is gone; the owner's own files stay, and the manifest does not name them.
#[test]
fn an_export_leaves_no_file_of_an_earlier_one() {
    let exported = Exported::new();
    exported.write().unwrap();
    let out = exported.out.path();
    let manifest = |out: &Path| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(out.join("manifest.json")).unwrap()).unwrap()
    };
    // A file of an earlier export with another object.
    let mut earlier = manifest(out);
    std::fs::write(out.join("scenes/moon.xml"), "<mujoco/>").unwrap();
    std::fs::write(out.join("notes.txt"), "mine").unwrap();
    std::fs::write(out.join("ros2/grasp_profiles.yaml"), "with my joints").unwrap();
    let outside = out.with_extension("outside");
    std::fs::write(&outside, "not of an export").unwrap();
    let beyond = format!("../{}", outside.file_name().unwrap().to_str().unwrap());
    for path in ["scenes/moon.xml", &beyond] {
        let digest = eigenhand_files::sha256(b"<mujoco/>");
        let entry = serde_json::json!({ "path": path, "bytes": 1, "sha256": digest });
        earlier["files"].as_array_mut().unwrap().push(entry);
    }
    std::fs::write(out.join("manifest.json"), earlier.to_string()).unwrap();
    let eigenhand_bundle::Exported { files, notes } = exported.write().unwrap();
    assert!(!out.join("scenes/moon.xml").exists());
    assert_eq!(std::fs::read_to_string(out.join("notes.txt")).unwrap(), "mine");
    assert!(outside.exists(), "a manifest reaches no file outside its directory");
    std::fs::remove_file(&outside).unwrap();
    assert_eq!(notes, ["ros2/grasp_profiles.yaml had been changed: it is kept as ros2/grasp_profiles.yaml.edited"]);
    let edited = std::fs::read_to_string(out.join("ros2/grasp_profiles.yaml.edited")).unwrap();
    assert_eq!(edited, "with my joints");
    let named = manifest(out).to_string();
    assert!(!named.contains("notes.txt") && named.contains("scenes/cube.xml"), "{named}");
    assert!(files.iter().all(|file| file.is_file() && !file.ends_with("notes.txt")));

    // A run that cannot be exported leaves the earlier export as it was.
    let before = manifest(out);
    let bundle = Bundle {
        hand: &exported.run.hand,
        synergy: None,
        policy: &exported.run.policy,
        normalizer: exported.run.config.learner.normalizer,
        version: "2",
    };
    let failed = export(&bundle, out, |_| Err(std::io::Error::other("no database").into()));
    assert!(failed.is_err_and(|error: BundleError| error.to_string().contains("no database")));
    assert_eq!(manifest(out), before);
    assert!(
        before["files"].as_array().unwrap().iter().all(|entry| out.join(entry["path"].as_str().unwrap()).is_file())
    );
}

/// The principal angles of a comparison are those of SciPy, also where the spaces share only some joints.
#[test]
fn principal_angles_are_those_of_scipy() {
    if !python_has("scipy") {
        return;
    }
    let joints = |names: &[&str]| -> Vec<JointInfo> {
        let joint = |name: &&str| JointInfo { name: (*name).to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 };
        names.iter().map(joint).collect()
    };
    let mut random = StdRng::seed_from_u64(4);
    let mut synergy = |names: &[&str], k: usize| {
        let postures: Vec<Vec<f64>> = (0..60)
            .map(|_| (0..names.len()).map(|j| random.random_range(-1.0..1.0) / (1.0 + j as f64)).collect())
            .collect();
        Synergy::fit(&joints(names), &postures, k).unwrap()
    };
    let a = synergy(&["a", "b", "c", "d", "e", "f"], 3);
    let b = synergy(&["f", "e", "d", "c", "b", "x"], 2);
    let compared = |synergy| Compared { synergy, samples: None };
    let comparison = Comparison::of(compared(&a), compared(&b)).unwrap();
    assert_eq!(comparison.joints, ["b", "c", "d", "e", "f"]);
    let rows = |synergy: &Synergy| -> Vec<Vec<f64>> {
        let column = |name: &String| synergy.joints().iter().position(|joint| joint.name == *name).unwrap();
        let cut = |i| comparison.joints.iter().map(|name| synergy.component(i)[column(name)]).collect();
        (0..synergy.n_components()).map(cut).collect()
    };
    let directory = TempDir::new().unwrap();
    std::fs::write(directory.path().join("rows.json"), serde_json::to_vec(&[rows(&a), rows(&b)]).unwrap()).unwrap();
    let script = r#"
import json, sys
import numpy as np
from scipy.linalg import subspace_angles
a, b = (np.array(rows).T for rows in json.load(open(sys.argv[1] + "/rows.json")))
print(json.dumps(sorted(map(float, subspace_angles(a, b)))))
"#;
    let expected: Vec<f64> = answer(script, directory.path());
    assert_eq!(comparison.angles.len(), expected.len());
    for (angle, expected) in comparison.angles.iter().zip(&expected) {
        assert!((angle - expected).abs() < 1e-7, "{:?} {expected:?}", comparison.angles);
    }
    assert!(expected[0] > 0.05 && expected[1] < 1.5, "the spaces share something, and not all: {expected:?}");
}

/// An episode that is drawn is that of the policy: it is watched from its start to its end, twice the same.
#[test]
fn an_episode_is_watched_step_by_step() {
    let run = Exported::new().run;
    let (scene, mut film, mut heights) = (&run.task.scenes[0], Film::default(), Vec::new());
    let success = run
        .watch(0, 5, 0, |env| {
            film.include(&run.hand, scene, env.simulation()).unwrap();
            heights.push(env.achieved_goal()[2]);
        })
        .unwrap();
    assert_eq!(heights.len(), run.task.config.steps + 1, "the start, and every step");
    assert!(success && heights[heights.len() - 1] > heights[0] + 0.01, "the gripper has learned to lift: {heights:?}");
    let mut again = Vec::new();
    run.watch(0, 5, 0, |env| again.push(env.achieved_goal()[2])).unwrap();
    assert_eq!(again, heights);
    let mut pictures = Vec::new();
    run.watch(0, 5, 0, |env| pictures.push(film.frame(env.simulation()))).unwrap();
    assert_ne!(pictures[0], pictures[pictures.len() - 1]);
    let grasped = run.successful_grasp(0, 20).unwrap().unwrap();
    let [side, other] = grasp(&run.hand, scene, grasped.simulation()).unwrap();
    assert_ne!(side, other, "two views");
}
