//! Small files in `tests/faults`, each with a kind of fault that published hands have, and what `hands new` makes of it.
#![forbid(unsafe_code)]
// A helper function of a test fails the test, which is what a panic means here.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use eigenhand_hands::{Hand, ImportOptions};
use eigenhand_mujoco::MuJoCo;
use eigenhand_onboard::{Hints, NewHand, NewHandReport, OnboardError, Step, Symptom, new_hand};
use eigenhand_sim::Setting;
use tempfile::TempDir;

/// Settings of the task, physics and success as in the default preset.
const PRESET: &str = include_str!("../../train/src/presets/default.toml");

fn fault(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults").join(name)
}

fn setting() -> Setting {
    let preset: toml::Table = PRESET.parse().unwrap();
    let section = |name: &str| preset[name].clone();
    Setting {
        objects: section("objects").try_into().unwrap(),
        task: section("task").try_into().unwrap(),
        physics: section("physics").try_into().unwrap(),
        reward: section("reward").try_into().unwrap(),
    }
}

/// Makes a hand, with scripted grasps of some objects, or of all if there are none.
fn made(source: &Path, hints: Hints, objects: &[&str]) -> Result<(NewHandReport, Hand, Vec<Step>), OnboardError> {
    let place = TempDir::new().unwrap();
    let directory = place.path().join("found");
    let request = NewHand {
        name: "found".to_owned(),
        source: source.to_owned(),
        directory,
        options: ImportOptions::default(),
        hints,
    };
    let mut grasps = setting();
    if !objects.is_empty() {
        grasps.objects = objects.iter().map(|&object| object.to_owned()).collect();
    }
    let library = MuJoCo::load().unwrap_or_else(|error| panic!("{error}"));
    let steps = Mutex::new(Vec::new());
    let report = new_hand(&request, &library, &grasps, &mut Vec::new(), &|step| steps.lock().unwrap().push(step))?;
    let hand = Hand::load(&report.directory).unwrap_or_else(|error| panic!("{error}"));
    Ok((report, hand, steps.into_inner().unwrap()))
}

fn refusal(source: &Path, hints: Hints) -> String {
    match made(source, hints, &["cube"]) {
        Ok((report, ..)) => panic!("{report:?}"),
        Err(error) => error.to_string(),
    }
}

fn with_palm(palm: &str) -> Hints {
    Hints { palm: Some(palm.to_owned()), approach: None }
}

#[test]
fn sliding_jaws_close_along_their_axis_whatever_is_beside_the_palm() {
    let (report, hand, steps) =
        made(&fault("parallel-long-jaws/gripper.urdf"), Hints::default(), &["cube", "box"]).unwrap();
    assert_eq!(report.close_up, ["slide_l", "slide_r"]);
    assert!(report.neither.is_empty(), "{report:?}");
    assert!((0.055..0.08).contains(&report.opening_m), "{report:?}");
    assert!(report.lifted >= 3 && report.is_usable() && report.likeliest_reason().is_none(), "{report:?}");
    // What became of the grasps is in the manifest, and the top of the slide is just above the highest goals.
    let grasps = hand.manifest.scripted_grasps.unwrap();
    assert_eq!([grasps.tried, grasps.lifted, grasps.reached], [report.tried, report.lifted, report.reached]);
    let [low, high] = hand.manifest.slide.range;
    assert!((0.18..0.25).contains(&(high - low)), "{low} to {high}");
    // The steps are told in order, and the grasps are counted.
    assert_eq!((steps.first(), steps.last()), (Some(&Step::Survey), Some(&Step::Contract)));
    let counts = steps.iter().filter_map(|step| match step {
        Step::Grasps(done, all) => Some((*done, *all)),
        _ => None,
    });
    assert!(counts.clone().all(|(done, all)| 0 < done && done <= all) && counts.count() > 10);
}

#[test]
fn two_hands_in_a_file_are_refused_and_the_palm_chooses_one() {
    let file = fault("two-hands/hands.urdf");
    let message = refusal(&file, Hints::default());
    assert!(
        message.contains("more than one hand: name the palm with --palm left_palm or --palm right_palm"),
        "{message}"
    );
    let (report, hand, _) = made(&file, with_palm("left_palm"), &["sphere"]).unwrap();
    assert_eq!((report.palm.as_str(), report.fingertips.len()), ("left_palm", 4));
    assert!(hand.joints.iter().all(|joint| joint.name.starts_with("left_")), "{:?}", hand.joints);
    let said = report.notes.iter().any(|note| note.contains("other hands") && note.contains("right_palm"));
    assert!(said, "{:?}", report.notes);
}

/// A robot with one arm and a head: two limbs, of which one carries a hand.
#[test]
fn a_hand_among_other_limbs_is_refused_and_its_palm_is_named() {
    let text = std::fs::read_to_string(fault("parallel-long-jaws/gripper.urdf")).unwrap();
    let limbs = r#"<link name="trunk"/>
      <link name="neck"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
      <link name="upper"><collision><geometry><box size="0.3 0.05 0.05"/></geometry></collision></link>
      <joint name="nod" type="revolute"><origin xyz="0 0 0.5"/><parent link="trunk"/><child link="neck"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
      <joint name="lift" type="revolute"><origin xyz="0.1 0 0.4"/><parent link="trunk"/><child link="upper"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
      <joint name="end" type="fixed"><origin xyz="0.7 0 0"/><parent link="upper"/><child link="base"/></joint></robot>"#;
    let place = TempDir::new().unwrap();
    let file = place.path().join("robot.urdf");
    std::fs::write(&file, text.replace("</robot>", limbs)).unwrap();
    let message = refusal(&file, Hints::default());
    assert!(message.contains("a hand among other limbs: name the palm with --palm base"), "{message}");
    let (report, ..) = made(&file, with_palm("base"), &["cube"]).unwrap();
    assert_eq!((report.palm.as_str(), report.fingertips.len()), ("base", 2));
    assert_eq!(report.close_up, ["slide_l", "slide_r"]);
}

#[test]
fn one_jaw_closes_against_a_part_of_the_palm() {
    let file = fault("fixed-jaw/gripper.urdf");
    let (report, ..) = made(&file, Hints::default(), &["cube", "sphere"]).unwrap();
    assert_eq!(report.fingertips, ["jaw_tip", "body_tip"]);
    assert!(report.opening_m > 0.04 && report.lifted >= 2, "{report:?}");
    assert_eq!(report.close_down, ["grip"]);
    // Without the fixed jaw, nothing is beside the finger.
    let text = std::fs::read_to_string(&file).unwrap();
    let jaw = r#"<collision><origin xyz="-0.02 0 0.1"/><geometry><box size="0.01 0.03 0.1"/></geometry></collision>"#;
    assert!(text.contains(jaw));
    let place = TempDir::new().unwrap();
    let alone = place.path().join("alone.urdf");
    std::fs::write(&alone, text.replace(jaw, "")).unwrap();
    let message = refusal(&alone, Hints::default());
    assert!(message.contains("only one finger moves") && message.contains("one finger cannot"), "{message}");
}

#[test]
fn a_short_finger_that_follows_another_is_a_finger() {
    let (report, ..) = made(&fault("short-follower/hand.urdf"), Hints::default(), &["sphere"]).unwrap();
    assert_eq!(report.fingertips.len(), 5, "{report:?}");
}

/// Ring and little finger on a part of the palm that folds.
#[test]
fn a_moving_part_of_the_palm_that_carries_two_fingers_is_no_finger() {
    let text = std::fs::read_to_string(fault("short-follower/hand.urdf")).unwrap();
    let fold = r#"<link name="fold"/><joint name="fold" type="revolute"><origin xyz="0.03 -0.02 0"/><parent link="palm"/><child link="fold"/>
      <axis xyz="1 0 0"/><limit lower="0" upper="0.3" effort="2" velocity="3"/></joint></robot>"#;
    let moved = text
        .replace(
            r#"xyz="0.085 -0.012 0" rpy="0 0 0"/><parent link="palm"/>"#,
            r#"xyz="0.055 0.008 0" rpy="0 0 0"/><parent link="fold"/>"#,
        )
        .replace(
            r#"xyz="0.085 -0.034 0" rpy="0 0 0"/><parent link="palm"/>"#,
            r#"xyz="0.055 -0.014 0" rpy="0 0 0"/><parent link="fold"/>"#,
        )
        .replace("</robot>", fold);
    assert_eq!(moved.matches(r#"<parent link="fold"/>"#).count(), 2);
    let place = TempDir::new().unwrap();
    let file = place.path().join("fold.urdf");
    std::fs::write(&file, moved).unwrap();
    let (report, ..) = made(&file, Hints::default(), &["sphere"]).unwrap();
    assert_eq!((report.palm.as_str(), report.fingertips.len()), ("palm", 5), "{report:?}");
}

#[test]
fn a_hand_like_ours_turns_its_palm_to_the_table() {
    let (report, _, steps) =
        made(&fault("humanlike-approach/hand.urdf"), Hints::default(), &["sphere", "cube", "box"]).unwrap();
    assert_eq!(report.approach, [1.0, 0.0, 0.0]);
    assert!(report.lifted >= 5, "{report:?}");
    assert!(steps.iter().any(|step| matches!(step, Step::Approach(2, _))), "{steps:?}");
}

#[test]
fn fingers_that_a_motor_pulls_shut_do_not_start_crossed() {
    let (report, hand, _) =
        made(&fault("motor-tendon-gripper/gripper.xml"), Hints::default(), &["sphere", "box"]).unwrap();
    assert!(report.broken.is_empty(), "{report:?}");
    // Positive angles close; the tips pass each other well before these joints' ends.
    for (near, far) in [("l1", "l2"), ("r1", "r2")] {
        let (near, far) = (hand.manifest.open_posture[near], hand.manifest.open_posture[far]);
        let inward = 0.05 * near.sin() + 0.05 * (near + far).sin();
        assert!(
            inward < 0.02,
            "the tip is {:.1} mm beyond the middle: {:?}",
            1000.0 * (inward - 0.02),
            hand.manifest.open_posture
        );
    }
    assert!((0.09..0.18).contains(&report.opening_m), "{report:?}");
}

/// Jaws that slide by 6 mm with a force of 1.5 N.
#[test]
fn a_hand_that_cannot_grasp_is_told_with_the_likeliest_reason() {
    let text = std::fs::read_to_string(fault("parallel-long-jaws/gripper.urdf")).unwrap();
    let weak = text.replace(r#"effort="20""#, r#"effort="1.5""#).replace(r#"upper="0.03""#, r#"upper="0.006""#);
    let place = TempDir::new().unwrap();
    let file = place.path().join("weak.urdf");
    std::fs::write(&file, weak).unwrap();
    let (report, hand, _) = made(&file, Hints::default(), &["capsule", "disc"]).unwrap();
    assert!(!report.is_usable() && report.lifted == 0, "{report:?}");
    assert!(
        report.verdict().contains("cannot grasp") && report.verdict().contains("lifts 0 of 4"),
        "{}",
        report.verdict()
    );
    assert!(report.likeliest_reason().is_some_and(|reason| reason.contains("--approach")), "{report:?}");
    // Where the hand touches the objects and loses them, a fault of its model is the likeliest reason.
    let symptoms = vec![Symptom { name: "weak servos", detail: "raise their force limit".to_owned() }];
    let loses = NewHandReport { missed: 0, broken: Vec::new(), symptoms, ..report };
    assert_eq!(loses.likeliest_reason().unwrap(), "weak servos: raise their force limit");
    assert!(!hand.manifest.scripted_grasps.unwrap().can_grasp());
}
