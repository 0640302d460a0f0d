//! The examples for Python, on a run of this workspace.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;

use eigenhand_hands::Hand;
use eigenhand_rl::{Policy, TensorMap};

use crate::confinement::gripper_with_vane;
use crate::gripper::{ANEW, LONGER};
use crate::support::{DieAfter, Run, gripper, python, python_has, registry, tiny, workspace};

/// Runs an example and returns what it printed; it must succeed.
fn example(script: &str, arguments: &[&str], path: &Path) -> String {
    let script = workspace().join("examples/python").join(script);
    let output = Command::new(python()).arg(script).arg(path).args(arguments).output().unwrap();
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{printed}{}", String::from_utf8_lossy(&output.stderr));
    printed
}

/// Tells whether Python reads TOML, by itself or with a package.
fn has_toml() -> bool {
    python_has("importlib.util as u; assert u.find_spec('tomllib') or u.find_spec('tomli')")
}

/// Returns the version of Python's MuJoCo.
fn mujoco_version() -> String {
    let output = Command::new(python()).args(["-c", "import mujoco; print(mujoco.__version__)"]).output().unwrap();
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

#[test]
fn plain_mujoco_repeats_the_reference_step_and_plays_an_episode() {
    if !(python_has("numpy, mujoco") && has_toml()) {
        return;
    }
    const SMALL: [&str; 2] = ["episodes=4", "training.warmup_episodes=2"];
    let usual = vec!["objects=[\"cube\", \"disc\"]", "task.observe_fingertips=true"];
    // The gripper presses the disc, which a newer MuJoCo computes in another way unless it is told not to.
    let pressing = vec![
        "objects=[\"ellipsoid\", \"disc\"]",
        "task.orientation=any",
        "task.settle_time=0.4",
        "task.object_range=0.02",
        "physics.noslip_iterations=3",
        "seed=2",
    ];
    let hands: Vec<Hand> = registry().list().iter().map(|e| e.hand.as_ref().unwrap().clone()).collect();
    // With this seed the gripper's pads do not touch the cube in the first step: a newer MuJoCo finds other contacts where
    // boxes touch.
    let apart = vec!["objects=[\"cube\", \"disc\"]", "seed=5"];
    let hands = hands.into_iter().map(|hand| (hand, &usual));
    for (hand, settings) in hands.chain([(gripper(), &apart), (gripper(), &pressing)]) {
        let run = Run::new(hand);
        run.train(&tiny(&[&SMALL[..], settings].concat()));
        // The script ends with a status of 1 when the step differs by more than it accepts of this MuJoCo.
        let printed = example("run_policy.py", &["--episodes", "2"], &run.path);
        assert_eq!(printed.matches("largest difference").count(), 2, "{printed}");
        let last = printed.lines().last().unwrap();
        assert!(last.ends_with("of 4 episodes succeeded"), "{printed}");
    }
}

/// The hand of the script closes as that of Eigenhand does, and leaves the object's place alone.
#[test]
fn an_episode_in_plain_mujoco_starts_with_a_closed_hand() {
    if !(python_has("numpy, mujoco") && has_toml()) {
        return;
    }
    let run = Run::new(registry().get("shadow").unwrap());
    run.train(&tiny(&["episodes=4", "training.warmup_episodes=4", "task.closed_start=[0.6, 0.9]"]));
    let script = r#"
import json, pathlib, sys
sys.path.insert(0, sys.argv[1])
import numpy as np
import run_policy
run = pathlib.Path(sys.argv[2])
(reference,) = json.loads((run / "scenes" / "reference.json").read_text())
scene = run_policy.Scene(run, run_policy.Policy(run), reference)
start = scene.config["start"]
span = np.subtract(start["closed_ctrl"], start["ctrl"])
share = np.subtract(reference["ctrl"], start["ctrl"])[span != 0] / span[span != 0]
qpos, ctrl = scene.close(share[0])
hand = np.delete(np.arange(len(qpos)), range(scene.object_qpos, scene.object_qpos + 7))
drawn = [scene.place(np.random.default_rng(seed)) for seed in range(5)]
shares = [float(((c - start["ctrl"]) / np.where(span != 0, span, np.inf)).max()) for _, c, _ in drawn]
raised = [float(goal[2] - q[scene.object_qpos + 2]) for q, _, goal in drawn]
off = [float(np.abs(q[scene.object_qpos :][:2]).max()) for q, _, _ in drawn]
difference = float(np.abs(qpos - reference["qpos"])[hand].max()), float(np.abs(ctrl - reference["ctrl"]).max())
print(json.dumps([[float(share.min()), float(share.max())], difference, shares, raised, off]))
"#;
    let examples = workspace().join("examples/python");
    let output = Command::new(python()).args(["-c", script]).arg(examples).arg(&run.path).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    let [share, difference, shares, raised, off]: [Vec<f64>; 5] =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {errors}"));
    assert!((0.6..=0.9).contains(&share[0]) && (share[1] - share[0]).abs() < 1e-9, "{share:?}");
    assert!(difference[0] < 1e-4 && difference[1] < 1e-9, "{difference:?}");
    assert!(shares.iter().all(|share| (0.6..=0.9).contains(share)), "{shares:?}");
    assert!(off.iter().all(|distance| *distance <= 0.005), "{off:?}");
    assert!(raised.iter().all(|height| (0.019..=0.051).contains(height)), "{raised:?}");
}

#[test]
fn the_policy_runs_with_fewer_numbers() {
    if !(python_has("numpy, mujoco") && has_toml()) {
        return;
    }
    let run = Run::new(gripper_with_vane());
    run.train(&tiny(&[&LONGER[..], &["synergy.components=2", "synergy.settle=0.3"], &ANEW].concat()));
    let played = |arguments: &[&str]| {
        let printed = example("run_policy.py", &[&["--episodes", "3"], arguments].concat(), &run.path);
        printed.lines().filter(|line| line.contains("episode")).map(str::to_owned).collect::<Vec<_>>()
    };
    let all = played(&[]);
    assert_eq!(played(&["--numbers", "2"]), all, "the policy has two numbers");
    // The action of one number is that of the policy as told here, projected.
    let script = r#"
import json, pathlib, sys, tomllib
sys.path.insert(0, sys.argv[1])
import run_policy
run = pathlib.Path(sys.argv[2])
policy = run_policy.Policy(run)
policy.use_numbers(tomllib.loads((run / "synergy" / "synergy.toml").read_text()), 1)
(reference,) = json.loads((run / "scenes" / "reference.json").read_text())
action = policy.act(reference["observation"], reference["desired_goal"])
constant = run_policy.Policy(run)
constant.use_numbers(tomllib.loads((run / "synergy" / "synergy.toml").read_text()), 0)
seen = [constant.act(reference[name], reference["desired_goal"]) for name in ("observation", "next_observation")]
moved = [abs(float(b - a)) for a, b in zip(*seen)]
ranges = [[actuator["low"], actuator["high"]] for actuator in policy.config["action"]]
print(json.dumps([list(map(float, action)), reference["observation"], reference["desired_goal"], ranges, moved]))
"#;
    let examples = workspace().join("examples/python");
    let output = Command::new(python()).args(["-c", script]).arg(examples).arg(&run.path).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    type Answer = (Vec<f64>, Vec<f32>, Vec<f32>, Vec<[f64; 2]>, Vec<f64>);
    let (found, observation, goal, ranges, moved): Answer =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {errors}"));
    let tensors = TensorMap::load_bytes(&run.bytes("policy.safetensors")).unwrap();
    let policy = Policy::import_tensors(&tensors, &tiny(&[]).learner.normalizer).unwrap();
    let synergy = eigenhand_synergy::import(run.file("synergy")).unwrap().file.synergy;
    let projected = |policy: &Policy| -> Vec<f64> {
        let mut action = vec![0.0; policy.act_dim()];
        policy.act_through(&observation, &goal, &mut policy.scratch(), &mut action, |_| {});
        // The slide comes first.
        let middle_and_half = |[low, high]: [f64; 2]| ((low + high) / 2.0, (high - low) / 2.0);
        let scales: Vec<(f64, f64)> = ranges[1..].iter().copied().map(middle_and_half).collect();
        let command: Vec<f64> = action[1..].iter().zip(&scales).map(|(a, (m, h))| m + h * f64::from(*a)).collect();
        let z = synergy.encode(&command)[0];
        let on_one = synergy.mean().iter().zip(synergy.component(0)).map(|(mean, c)| mean + z * c);
        let hand = on_one.zip(&scales).map(|(command, (m, h))| (command - m) / h);
        [f64::from(action[0])].into_iter().chain(hand).map(|a| a.clamp(-1.0, 1.0)).collect()
    };
    let distance = |expected: &[f64]| found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(distance(&projected(&policy.with_fewer_numbers(1))) < 1e-4, "{found:?}");
    assert!(distance(&projected(&policy)) > 1e-3, "being told changes the action");
    assert!(all.last().unwrap() != "0 of 3 episodes succeeded", "{all:?}");
    // The slide comes first, and it is free.
    assert!(moved[0] > 0.0 && moved[1..].iter().all(|moved| *moved == 0.0), "a constant command: {moved:?}");
    for numbers in ["0", "1"] {
        assert!(played(&["--numbers", numbers]).last().unwrap().ends_with("of 3 episodes succeeded"));
    }
}

#[test]
fn a_difference_in_the_reference_step_is_noticed() {
    if !(python_has("numpy, mujoco") && has_toml()) {
        return;
    }
    let run = Run::new(gripper());
    run.train(&tiny(&["episodes=4", "training.warmup_episodes=2"]));
    let scene = run.file("scenes/cube.xml");
    let text = std::fs::read_to_string(&scene).unwrap();
    // Of a newer MuJoCo the script accepts a larger difference.
    let mass = if mujoco_version() == "2.2.2" { "mass=\"0.31\"" } else { "mass=\"2\"" };
    let heavier = text.replacen("mass=\"0.3\"", mass, 1);
    assert_ne!(text, heavier);
    std::fs::write(&scene, heavier).unwrap();
    let script = workspace().join("examples/python/run_policy.py");
    let output = Command::new(python()).arg(script).arg(&run.path).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("the reference step differs"));
}

#[test]
fn tensorboard_reads_every_row_of_a_resumed_run_once() {
    if !python_has("tensorboard") {
        return;
    }
    let run = Run::new(gripper());
    let killed = catch_unwind(AssertUnwindSafe(|| {
        run.start(&tiny(&["training.checkpoint_every=12"]), &AtomicBool::new(false), &mut DieAfter { episodes: 22 });
    }));
    assert!(killed.is_err());
    assert_eq!(run.metrics().len(), 2, "one row is after the checkpoint");
    run.resume_to_the_end();
    let script = r#"
import csv, sys
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
curves = EventAccumulator(sys.argv[1]).Reload()
rows = list(csv.DictReader(open(sys.argv[1] + "/metrics.csv")))
found = {tag: [(p.step, p.value) for p in curves.Scalars(tag)] for tag in curves.Tags()["scalars"]}
for speed in ("env_steps_per_s", "updates_per_s"):
    assert [step for step, _ in found.pop("training/" + speed)] == [int(row["episode"]) for row in rows]
columns = {tag.split("/")[1]: points for tag, points in found.items()}
filled = {column for row in rows for column in row if row[column]}
assert filled - set(columns) == {"episode", "wall_s"} and set(columns) < filled, filled ^ set(columns)
for column, points in columns.items():
    expected = [(int(row["episode"]), float(row[column])) for row in rows if row[column]]
    assert [step for step, _ in expected] == [step for step, _ in points], (column, points)
    close = all(abs(a - b) <= 1e-6 * abs(a) for (_, a), (_, b) in zip(expected, points))
    assert close, (column, expected, points)
times = [point.wall_time for point in curves.Scalars("evaluation/success_rate")]
assert times == sorted(times), times
print(len(rows), "rows")
"#;
    let output = Command::new(python()).args(["-c", script]).arg(&run.path).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "3 rows", "{errors}");
}

#[test]
fn the_decoded_posture_is_the_one_of_this_workspace() {
    if !(python_has("numpy") && has_toml()) {
        return;
    }
    let run = Run::new(gripper());
    run.train(&tiny(&[]));
    let import = eigenhand_synergy::import(run.file("synergy")).unwrap();
    let posture = import.file.joint_map.unwrap().decode(&[0.01]);
    let commands = import.file.synergy.decode(&[0.01]);
    let printed = example("decode_synergy.py", &["0.01"], &run.file("synergy"));
    let (_, tables) = printed.split_once("joint angles").unwrap();
    let numbers: Vec<f64> = tables.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    let expected: Vec<f64> = posture.into_iter().chain(commands).collect();
    assert_eq!(numbers.len(), expected.len(), "{printed}");
    for (number, expected) in numbers.iter().zip(expected) {
        assert!((number - expected).abs() < 1e-4, "{number} {expected}");
    }
}

#[test]
fn a_hand_is_driven_through_a_grasp_with_few_numbers_and_no_policy() {
    if !(python_has("numpy, mujoco") && has_toml()) {
        return;
    }
    let run = Run::new(registry().get("shadow").unwrap());
    // This run gives scenes and settings. Its few episodes make no synergy, so that of a whole training takes its place.
    run.train(&tiny(&["episodes=4", "training.warmup_episodes=4", "physics.noslip_iterations=3"]));
    std::fs::create_dir_all(run.file("synergy")).unwrap();
    std::fs::copy(workspace().join("synergies/shadow/synergy.toml"), run.file("synergy/synergy.toml")).unwrap();
    let printed = example("drive_synergy.py", &["--object", "cube"], &run.path);
    assert!(printed.contains("1 of 1 objects lifted"), "{printed}");
}
