//! The hand contract on every hand of the workspace, and on hands that break it.

use eigenhand_hands::Hand;
use eigenhand_onboard::check_hand;
use eigenhand_sim::Setting;
use eigenhand_sim::contract::ContractReport;
use eigenhand_train::config::RunConfig;

use crate::support::{mujoco, registry};

const MANIFEST: &str = r#"schema = 1
name = "gripper"
model = "gripper.xml"
palm = "bridge"
fingertips = ["left", "right"]

[mount]
position = [0.0, 0.0, 0.12]

[slide]
range = [-0.07, 0.12]
"#;

const MODEL: &str = r#"<mujoco>
  <default>
    <joint type="slide" limited="true" range="0 0.05" damping="10" armature="0.01"/>
    <geom contype="1" conaffinity="0"/>
  </default>
  <worldbody>
    <body name="bridge">
      <geom type="box" size="0.02 0.07 0.01" mass="0.3"/>
      <body name="left" pos="0 0.06 -0.03">
        <joint name="left_joint" axis="0 -1 0"/>
        <geom name="left_pad" type="box" size="0.02 0.008 0.02" mass="0.05"/>
      </body>
      <body name="right" pos="0 -0.06 -0.03">
        <joint name="right_joint" axis="0 1 0"/>
        <geom name="right_pad" type="box" size="0.02 0.008 0.02" mass="0.05"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="left_motor" joint="left_joint" kp="400" ctrllimited="true" ctrlrange="0 0.05"/>
    <position name="right_motor" joint="right_joint" kp="400" ctrllimited="true" ctrlrange="0 0.05"/>
  </actuator>
</mujoco>
"#;

/// Returns the objects and the simulation of the default configuration.
pub fn setting() -> Setting {
    RunConfig::default_preset().unwrap().setting()
}

fn check(hand: &Hand) -> ContractReport {
    check_hand(hand, &mujoco(), &setting(), None).unwrap().report
}

/// Checks the gripper with one piece of its manifest or model replaced.
fn check_with(old: &str, new: &str) -> ContractReport {
    check(&gripper_with(old, new))
}

/// Reads the gripper with one piece of its manifest or model replaced.
pub fn gripper_with(old: &str, new: &str) -> Hand {
    assert_eq!(MANIFEST.matches(old).count() + MODEL.matches(old).count(), 1, "{old:?} must occur exactly once");
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("hand.toml"), MANIFEST.replace(old, new)).unwrap();
    std::fs::write(directory.path().join("gripper.xml"), MODEL.replace(old, new)).unwrap();
    Hand::load(directory.path()).unwrap_or_else(|error| panic!("{error}"))
}

/// Asserts that the condition `name` fails, and that its message contains each part of `says`.
fn assert_fails(report: &ContractReport, name: &str, says: &[&str]) {
    assert!(!report.passed());
    let found = report.checks.iter().find(|c| c.name == name).unwrap_or_else(|| panic!("no {name:?} in {report:#?}"));
    assert!(!found.passed, "{report:#?}");
    for part in says {
        assert!(found.detail.contains(part), "{:?} does not say {part:?}", found.detail);
    }
}

#[test]
fn every_hand_of_the_workspace_keeps_it() {
    let registry = registry();
    assert!(!registry.list().is_empty());
    for entry in registry.list() {
        let hand = entry.hand.as_ref().unwrap_or_else(|error| panic!("{}: {error}", entry.name));
        let report = check(hand);
        assert!(report.passed(), "{report:#?}");
    }
}

#[test]
fn a_sound_gripper_keeps_it() {
    let report = check_with("schema = 1", "schema = 1");
    assert!(report.passed(), "{report:#?}");
}

#[test]
fn a_model_that_does_not_compile_ends_it() {
    let report = check_with(r#"size="0.02 0.07 0.01""#, r#"size="-1""#);
    assert_fails(&report, "compiles", &["MuJoCo refuses"]);
    assert_eq!(report.checks.len(), 1);
}

#[test]
fn a_hand_that_starts_in_the_plane_is_told() {
    let report = check_with("position = [0.0, 0.0, 0.12]", "position = [0.0, 0.0, 0.045]");
    assert_fails(&report, "open posture is free", &["the plane", "mm", "mount"]);
}

#[test]
fn an_actuator_that_moves_nothing_is_told() {
    let report = check_with(
        r#"<position name="right_motor" joint="right_joint" kp="400""#,
        r#"<position name="right_motor" joint="right_joint" kp="0.001""#,
    );
    assert_fails(&report, "actuators move their joints", &["right_motor", "right_joint", "% of the joint's range"]);
}

#[test]
fn a_hand_out_of_reach_is_told() {
    let high = check_with("range = [-0.07, 0.12]", "range = [0.0, 0.12]");
    assert_fails(&high, "object is within reach", &["comes down to", "tall"]);
    let aside = check_with("position = [0.0, 0.0, 0.12]", "position = [0.6, 0.0, 0.12]");
    assert_fails(&aside, "object is within reach", &["no object was touched"]);
}

#[test]
fn a_joint_that_cannot_move_is_told() {
    // A body as heavy as a ship does not move, to the last bit of the observation.
    let report = check_with(
        r#"<body name="bridge">"#,
        r#"<body name="ship" pos="0 0 1">
             <joint name="stuck" type="slide" axis="1 0 0" armature="1e7" damping="0"/>
             <geom type="sphere" size="0.01" mass="0.01"/>
           </body>
           <body name="bridge">"#,
    );
    assert_fails(&report, "observations vary", &["qpos:stuck", "posture_joints"]);
}

#[test]
fn an_unstable_hand_is_told() {
    let report = check_with(
        r#"<position name="right_motor" joint="right_joint" kp="400""#,
        r#"<position name="right_motor" joint="right_joint" kp="1e12""#,
    );
    assert!(!report.passed(), "{report:#?}");
    assert!(
        report.checks.iter().any(|c| !c.passed && (c.detail.contains("diverged") || c.detail.contains("warns"))),
        "{report:#?}"
    );
}

#[test]
fn a_hand_is_drawn_if_it_compiles() {
    let library = mujoco();
    let directory = tempfile::tempdir().unwrap();
    let draw = |old: &str, new: &str, name: &str| {
        let file = directory.path().join("pictures").join(name);
        let found = check_hand(&gripper_with(old, new), &library, &setting(), Some(&file)).unwrap();
        assert_eq!(found.picture.is_some(), file.is_file());
        (found.report.passed(), std::fs::read(file).ok())
    };
    let (passed, sound) = draw("schema = 1", "schema = 1", "sound.png");
    let sound = sound.unwrap();
    assert!(passed && sound.starts_with(b"\x89PNG"));
    // Lower in the picture, and failing the contract.
    let (passed, low) = draw("position = [0.0, 0.0, 0.12]", "position = [0.0, 0.0, 0.045]", "low.png");
    assert!(!passed && low.is_some_and(|low| low.starts_with(b"\x89PNG") && low != sound));
    assert_eq!(draw(r#"size="0.02 0.07 0.01""#, r#"size="-1""#, "broken.png"), (false, None));

    let file = directory.path().join("pictures/sound.png/no-directory.png");
    let error = check_hand(&gripper_with("schema = 1", "schema = 1"), &library, &setting(), Some(&file)).unwrap_err();
    assert!(error.to_string().contains("sound.png"), "{error}");
}
