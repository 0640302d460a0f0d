//! The Python package and the Python examples, on runs of this workspace.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;

use eigenhand_hands::Hand;
use eigenhand_rl::{Policy, TensorMap};
use eigenhand_sim::GraspEnv;
use rand::SeedableRng;
use rand::rngs::StdRng;

use crate::gripper::LONGER;
use crate::support::{
    DieAfter, Run, answer, gripper, learned, python, python_has, registry, run_python, task, tiny, workspace,
};

/// Plays episodes with the package, and returns what it printed.
fn play(path: &Path, arguments: &[&str]) -> String {
    run_python(&[&["-m", "eigenhand", "play", path.to_str().unwrap()], arguments].concat())
}

/// Returns the version of Python's MuJoCo.
fn mujoco_version() -> String {
    let output = Command::new(python()).args(["-c", "import mujoco; print(mujoco.__version__)"]).output().unwrap();
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

#[test]
fn plain_mujoco_repeats_the_reference_step_and_plays_an_episode() {
    if !python_has("eigenhand, mujoco") {
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
        let printed = play(&run.path, &["--episodes", "2", "--verbose"]);
        assert_eq!(printed.matches("largest difference").count(), 2, "{printed}");
        let last = printed.lines().last().unwrap();
        assert!(last.ends_with("of 4 episodes succeeded"), "{printed}");
    }
}

/// The hand of the script closes as that of Eigenhand does, and leaves the object's place alone.
#[test]
fn an_episode_in_plain_mujoco_starts_with_a_closed_hand() {
    if !python_has("eigenhand, mujoco") {
        return;
    }
    let run = Run::new(registry().get("shadow").unwrap());
    run.train(&tiny(&["episodes=4", "training.warmup_episodes=4", "task.closed_start=[0.6, 0.9]"]));
    let script = r#"
import json, sys
import numpy as np
from eigenhand import Policy
from eigenhand.scene import Scene, read_references
(reference,) = read_references(sys.argv[1])
scene = Scene(sys.argv[1], Policy.load(sys.argv[1]), reference)
start = scene.config["start"]
span = np.subtract(start["closed_ctrl"], start["ctrl"])
share = np.subtract(reference["ctrl"], start["ctrl"])[span != 0] / span[span != 0]
qpos, ctrl = scene.close(share[0])
hand = np.delete(np.arange(len(qpos)), range(scene.object_qpos, scene.object_qpos + 7))
drawn = [scene.draw(np.random.default_rng(seed)) for seed in range(5)]
shares = [float(((c - start["ctrl"]) / np.where(span != 0, span, np.inf)).max()) for _, c, _ in drawn]
raised = [float(goal[2] - q[scene.object_qpos + 2]) for q, _, goal in drawn]
off = [float(np.abs(q[scene.object_qpos :][:2]).max()) for q, _, _ in drawn]
difference = float(np.abs(qpos - reference["qpos"])[hand].max()), float(np.abs(ctrl - reference["ctrl"]).max())
print(json.dumps([[float(share.min()), float(share.max())], difference, shares, raised, off]))
"#;
    let [share, difference, shares, raised, off]: [Vec<f64>; 5] = answer(script, &run.path);
    assert!((0.6..=0.9).contains(&share[0]) && (share[1] - share[0]).abs() < 1e-9, "{share:?}");
    assert!(difference[0] < 1e-4 && difference[1] < 1e-9, "{difference:?}");
    assert!(shares.iter().all(|share| (0.6..=0.9).contains(share)), "{shares:?}");
    assert!(off.iter().all(|distance| *distance <= 0.005), "{off:?}");
    assert!(raised.iter().all(|height| (0.019..=0.051).contains(height)), "{raised:?}");
}

#[test]
fn the_policy_runs_with_fewer_numbers() {
    if !python_has("eigenhand, mujoco") {
        return;
    }
    let (run, _) = learned();
    let played = |arguments: &[&str]| {
        let printed = play(&run.path, &[&["--episodes", "3"], arguments].concat());
        printed.lines().filter(|line| line.contains("episode")).map(str::to_owned).collect::<Vec<_>>()
    };
    let all = played(&[]);
    assert_eq!(played(&["--numbers", "2"]), all, "the policy has two numbers");
    // The action of one number is that of the policy as told here, projected.
    let script = r#"
import json, sys
from eigenhand import Policy, Synergy
from eigenhand.scene import read_references
all_numbers, synergy = Policy.load(sys.argv[1]), Synergy.load(sys.argv[1])
policy = all_numbers.with_numbers(synergy.first(1))
(reference,) = read_references(sys.argv[1])
action = policy.act(reference["observation"], reference["desired_goal"])
constant = all_numbers.with_numbers(synergy.first(0))
seen = [constant.act(reference[name], reference["desired_goal"]) for name in ("observation", "next_observation")]
moved = [abs(float(b - a)) for a, b in zip(*seen)]
ranges = [[actuator["low"], actuator["high"]] for actuator in policy.config["action"]]
print(json.dumps([list(map(float, action)), reference["observation"], reference["desired_goal"], ranges, moved]))
"#;
    type Answer = (Vec<f64>, Vec<f32>, Vec<f32>, Vec<[f64; 2]>, Vec<f64>);
    let (found, observation, goal, ranges, moved): Answer = answer(script, &run.path);
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
    if !python_has("eigenhand, mujoco") {
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
    let output = Command::new(python()).args(["-m", "eigenhand", "play"]).arg(&run.path).output().unwrap();
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

/// The package turns numbers into commands and joint positions, and back, as the library does.
#[test]
fn the_package_decodes_and_encodes_as_the_library() {
    if !python_has("eigenhand") {
        return;
    }
    let run = Run::new(gripper());
    run.train(&tiny(&[]));
    let import = eigenhand_synergy::import(run.file("synergy")).unwrap();
    let joint_map = import.file.joint_map.unwrap();
    assert_eq!(joint_map.free.len(), 1, "the slide");
    let script = r#"
import json, sys
from eigenhand import Synergy
synergy = Synergy.load(sys.argv[1])
ends = Synergy.load(sys.argv[1] + "/synergy-postures")
posture, command = synergy.decode([0.01]), synergy.command([0.01])
by_name = dict(zip(synergy.joints, posture + 0.003))
found = [posture, command, synergy.encode(posture + 0.003), synergy.encode(by_name), synergy.encode_command(command)]
print(json.dumps([list(map(float, array)) for array in [*found, ends.decode([0.02]), ends.command([0.02])]]))
"#;
    let found: Vec<Vec<f64>> = answer(script, &run.path);
    let z = [0.01];
    let (posture, command) = (joint_map.decode(&z), import.file.synergy.decode(&z));
    let measured: Vec<f64> = posture.iter().map(|q| q + 0.003).collect();
    let encoded = joint_map.encode(&measured).unwrap();
    let ends = eigenhand_synergy::import(run.file("synergy-postures")).unwrap().file;
    let end = ends.synergy.decode(&[0.02, 0.0]);
    let end_command = ends.actuation.unwrap().control(&end);
    let by_command = import.file.synergy.encode(&command);
    let expected = [posture, command, encoded.clone(), encoded, by_command, end, end_command];
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        assert_eq!(found.len(), expected.len());
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} {expected:?}");
    }
    let printed = run_python(&["-m", "eigenhand", "decode", run.file("synergy").to_str().unwrap(), "0.01"]);
    let (_, tables) = printed.split_once("joint positions").unwrap();
    let numbers: Vec<f64> = tables.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert!(numbers.iter().zip(found[0].iter().chain(&found[1])).all(|(a, b)| (a - b).abs() < 1e-6), "{printed}");
    assert_eq!(numbers.len(), found[0].len() + found[1].len());
}

/// Objects come to rest in Python as they do in training: a box, and the hull of a mesh, lie on one of their faces.
#[test]
fn an_object_comes_to_rest_in_plain_mujoco_as_in_training() {
    if !python_has("eigenhand, mujoco") {
        return;
    }
    let run = Run::new(gripper());
    let settings = [
        "objects=[\"box\", \"varied/wedge\"]",
        "task.orientation=any",
        "task.settle_time=0.8",
        "episodes=4",
        "training.warmup_episodes=2",
    ];
    let config = tiny(&settings);
    run.train(&config);
    let script = r#"
import json, sys
import numpy as np
from eigenhand import Policy
from eigenhand.scene import Scene, read_references
policy, random, heights = Policy.load(sys.argv[1]), np.random.default_rng(0), {}
for reference in read_references(sys.argv[1]):
    scene = Scene(sys.argv[1], policy, reference)
    heights[scene.object] = [float(scene.rest(random)[0]) for _ in range(12)]
print(json.dumps(heights))
"#;
    let found: BTreeMap<String, Vec<f64>> = answer(script, &run.path);
    let task = task(&config, &gripper());
    let mut env = GraspEnv::new(&task).unwrap();
    for (index, scene) in task.scenes.iter().enumerate() {
        let mut random = StdRng::seed_from_u64(0);
        let mut rest = || -> f64 {
            env.reset(index, &mut random).unwrap();
            f64::from(env.achieved_goal()[2])
        };
        let heights: Vec<f64> = (0..60).map(|_| rest()).collect();
        let strange = |height: &&f64| heights.iter().all(|known| (known - **height).abs() > 1e-4);
        let found = &found[&scene.object.name];
        assert_eq!(found.iter().filter(strange).count(), 0, "{found:?} {heights:?}");
        let spread = found.iter().fold(0.0, |most: f64, height| most.max((height - found[0]).abs()));
        assert!(spread > 1e-3, "it lies on several faces: {found:?}");
    }
}

/// The environment passes Gymnasium's checks, and an episode in it is that of the scene.
#[test]
fn the_task_is_a_gymnasium_environment() {
    if !python_has("eigenhand, mujoco, gymnasium") {
        return;
    }
    let (run, _) = learned();
    let script = r#"
import json, sys
import eigenhand, gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env
export = sys.argv[1]
def make(**kind):
    return gymnasium.make("eigenhand/Grasp-v0", export=export, **kind)
for kind in ({}, {"action": "synergy"}, {"action": "synergy", "numbers": 1, "objects": ["cube"]}):
    check_env(make(**kind).unwrapped, skip_render_check=True)
policy, synergy = eigenhand.Policy.load(export), eigenhand.Synergy.load(export)
low, high = policy.low[1:], policy.high[1:]
def episode(action, act):
    env, rewards = make(action=action), []
    observation, info = env.reset(seed=3, options={"object": "cube"})
    while True:
        chosen = np.float32(act(observation, policy.act(observation["observation"], observation["desired_goal"])))
        observation, reward, terminated, truncated, info = env.step(chosen)
        rewards.append(reward)
        assert not terminated
        if truncated:
            again = env.unwrapped.compute_reward(
                np.array([observation["achieved_goal"]] * 2), np.array([observation["desired_goal"]] * 2), [info] * 2)
            assert list(again) == [reward] * 2
            return rewards, bool(info["is_success"]), info["object"]
def numbers(_, action):
    # The slide comes first. A number of the synergy stands in its range.
    z = synergy.encode_command(low + (action[1:] + 1) / 2 * (high - low))
    return [action[0], *(2 * (z - synergy.z_low) / (synergy.z_high - synergy.z_low) - 1)]
plain = episode("joints", lambda _, action: action)
# A copy of an environment is an environment of its own.
import copy
env = make()
env.reset(seed=1)
twin = copy.deepcopy(env.unwrapped)
first, second = env.unwrapped.reset(seed=5), twin.reset(seed=5)
for _ in range(4):
    assert np.array_equal(first[0]["observation"], second[0]["observation"])
    moved = np.float32([0.5] * len(policy.actuators))
    first, second = env.unwrapped.step(moved), twin.step(moved)
# Batches, and numbers one after another.
seen = [first[0]["observation"], second[0]["observation"] + 0.1]
batch = policy.act(np.array(seen), np.zeros((2, 3)))
assert np.allclose(batch, [policy.act(one, np.zeros(3)) for one in seen], atol=1e-6)
told = policy.with_numbers(synergy.first(1)).with_numbers(synergy)
assert np.array_equal(told.act(seen[0], np.zeros(3)), policy.with_numbers(synergy).act(seen[0], np.zeros(3)))
for bad in (lambda: env.unwrapped.step(0.5), lambda: synergy.command([float("nan")]), lambda: policy.act(seen[0][:3], np.zeros(3)),
        lambda: synergy.encode({"slide": 0.1}), lambda: synergy.first(9)):
    try:
        bad()
    except ValueError:
        continue
    raise AssertionError("no error")
wrong = []
for refused in ({"action": "feet"}, {"numbers": 1}, {"objects": ["moon"]}, {"action": "synergy", "numbers": 9}):
    try:
        make(**refused)
    except ValueError as error:
        wrong.append(str(error))
print(json.dumps([plain, episode("synergy", numbers), wrong]))
"#;
    type Episode = (Vec<f64>, bool, String);
    let (plain, by_numbers, wrong): (Episode, Episode, Vec<String>) = answer(script, &run.path);
    let steps = tiny(&LONGER).task.steps;
    assert_eq!(plain.0.len(), steps);
    assert_eq!(plain, by_numbers, "the policy commands two numbers, so the numbers say all");
    assert_eq!(plain.1, plain.0.iter().rev().take(tiny(&LONGER).task.final_steps).all(|reward| *reward == 0.0));
    assert!(plain.1, "the gripper has learned: {:?}", plain.0);
    assert_eq!(wrong.len(), 4, "{wrong:?}");
    assert!(wrong[2].contains("moon") && wrong[2].contains("cube") && wrong[3].contains("0 to 2"), "{wrong:?}");
}

/// Runs where Stable-Baselines3 is installed, which brings PyTorch; the packages of the other tests do not have it.
#[test]
fn stable_baselines3_trains_in_the_task() {
    let probe = Command::new(python()).args(["-c", "import eigenhand, gymnasium, stable_baselines3"]).output();
    if !probe.is_ok_and(|output| output.status.success()) {
        let _ = writeln!(std::io::stderr(), "skipped: {} has no stable_baselines3", python());
        return;
    }
    let (run, _) = learned();
    let example = workspace().join("examples/python/train_sb3.py");
    let run = run.path.to_str().unwrap();
    for space in [&[][..], &["--numbers", "1"]] {
        let short = ["--steps", "1200", "--episodes", "2"];
        let printed = run_python(&[&[example.to_str().unwrap(), run], &short[..], space].concat());
        assert!(printed.lines().any(|line| line.starts_with("success: ")), "{printed}");
    }
}

#[test]
fn a_hand_is_driven_through_a_grasp_with_few_numbers_and_no_policy() {
    if !python_has("eigenhand, mujoco") {
        return;
    }
    let run = Run::new(registry().get("shadow").unwrap());
    // This run gives scenes and settings. Its few episodes make no synergy, so that of a whole training takes its place.
    run.train(&tiny(&["episodes=4", "training.warmup_episodes=4", "physics.noslip_iterations=3"]));
    std::fs::create_dir_all(run.file("synergy")).unwrap();
    std::fs::copy(workspace().join("synergies/shadow/synergy.toml"), run.file("synergy/synergy.toml")).unwrap();
    let script = workspace().join("examples/python/drive_synergy.py");
    let printed = run_python(&[script.to_str().unwrap(), run.path.to_str().unwrap(), "--object", "cube"]);
    assert!(printed.contains("1 of 1 objects lifted"), "{printed}");
}
