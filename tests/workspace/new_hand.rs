//! `hands new`: a hand without a description is surveyed and written, and fulfils the contract.

use std::path::{Path, PathBuf};

use eigenhand_hands::{Hand, ImportOptions};
use eigenhand_onboard::survey::Hints;
use eigenhand_onboard::trial::{Search, best_place, lift};
use eigenhand_onboard::{NewHand, NewHandReport, OnboardError, check_hand, new_hand};
use eigenhand_sim::Setting;
use eigenhand_sim::contract::GRASPS;
use eigenhand_train::config::{Layers, Preset};
use tempfile::TempDir;

use crate::contract::setting;
use crate::gripper::GRIPPER_MODEL;
use crate::support::{mujoco, registry, task, workspace};

pub fn request(source: &Path, directory: PathBuf) -> NewHand {
    NewHand {
        name: "found".to_owned(),
        source: source.to_owned(),
        directory,
        options: ImportOptions::default(),
        hints: Hints::default(),
    }
}

/// Makes the hand, which must be usable, and checks it against the contract.
fn made(source: &Path, change: impl Fn(&mut NewHand)) -> (NewHandReport, Hand) {
    let (report, hand) = made_in(&setting(), source, change);
    assert!(report.is_usable(), "{report:?}");
    (report, hand)
}

/// Few grasps, which take most of the time. They place a hand well enough for the contract.
pub fn few_grasps() -> Setting {
    Setting { objects: vec!["cube".to_owned()], ..setting() }
}

/// Makes a hand with scripted grasps in some setting. It keeps the contract in the usual one, but for the grasps.
pub fn made_in(grasps: &Setting, source: &Path, change: impl Fn(&mut NewHand)) -> (NewHandReport, Hand) {
    let place = TempDir::new().unwrap();
    let mut request = request(source, place.path().join("found"));
    change(&mut request);
    let report =
        new_hand(&request, &mujoco(), grasps, &mut Vec::new(), &|_| {}).unwrap_or_else(|error| panic!("{error}"));
    let hand = Hand::load(&report.directory).unwrap_or_else(|error| panic!("{error}"));
    let contract = check_hand(&hand, &mujoco(), &setting(), None).unwrap().report;
    let faults: Vec<_> = contract.faults().collect();
    // The contract repeats what the report says of the grasps.
    let (of_grasps, others): (Vec<_>, Vec<_>) = faults.into_iter().partition(|fault| fault.name == GRASPS);
    assert!(others.is_empty(), "{}: {others:#?}", source.display());
    assert_eq!(of_grasps.is_empty(), report.is_usable(), "{}: {report:?}", source.display());
    (report, hand)
}

fn file(directory: &TempDir, text: &str) -> PathBuf {
    let path = directory.path().join("hand.xml");
    std::fs::write(&path, text).unwrap();
    path
}

/// The gripper approaches along its own -z, and its single actuator closes the pads.
#[test]
fn a_gripper_is_made_out() {
    let place = TempDir::new().unwrap();
    let source = file(&place, GRIPPER_MODEL);
    let (report, hand) = made(&source, |_| {});
    assert_eq!((report.palm.as_str(), report.fingertips.len()), ("bridge", 2));
    assert_eq!(report.close_up, ["close"]);
    assert_eq!(report.approach, [0.0, 0.0, -1.0]);
    // The approach is -z already, so the mount does not tilt the hand.
    assert!(hand.manifest.mount.pose().rotation.angle() % std::f64::consts::PI < 1e-6);
    // The caller's hint is used, even a wrong one.
    let mut turned = request(&source, place.path().join("turned"));
    turned.hints.approach = Some([0.0, 0.0, 1.0]);
    let report = new_hand(&turned, &mujoco(), &setting(), &mut Vec::new(), &|_| {}).unwrap();
    let down = Hand::load(&report.directory).unwrap().manifest.mount.pose().rotation * nalgebra::Vector3::z();
    assert!(down.z < -0.999, "{down}");
}

/// Palm, fingers and fingertips of a model without colours have different ones; stated colours stay.
#[test]
fn a_plain_model_gets_colours() {
    let place = TempDir::new().unwrap();
    let colours = |name: &str, text: &str| {
        let mut request = request(&file(&place, text), place.path().join(name));
        request.hints.approach = Some([0.0, 0.0, -1.0]);
        let report = new_hand(&request, &mujoco(), &few_grasps(), &mut Vec::new(), &|_| {}).unwrap();
        let model = std::fs::read_to_string(report.directory.join("model.xml")).unwrap();
        let values = model.split("rgba=\"").skip(1).filter_map(|rest| rest.split('"').next());
        values.map(str::to_owned).collect::<Vec<_>>()
    };
    let plain = colours("plain", GRIPPER_MODEL);
    assert_eq!(plain.len(), 3, "palm and two tips: {plain:?}");
    assert!(plain[0] != plain[1] && plain[1] == plain[2], "{plain:?}");
    let red = "1 0 0 1";
    let stated = GRIPPER_MODEL.replacen("<geom type", &format!("<geom rgba=\"{red}\" type"), 1);
    assert_eq!(colours("stated", &stated), [red]);
}

/// A hand that hangs beside its objects is brought over them.
#[test]
fn scripted_grasps_find_the_place() {
    const BESIDE: f64 = -0.06;
    let mut hand = registry().get("parallel").unwrap();
    hand.manifest.mount.position[0] += BESIDE;
    let mut layers = Layers::new(Preset::Default).unwrap();
    layers.add_assignment(r#"objects=["sphere", "cube"]"#).unwrap();
    let task = task(&layers.resolve().unwrap(), &hand);
    let place =
        best_place(&task, &hand.manifest.closing, hand.manifest.objects.scale, 2, Search::Whole, &|_, _| {}).unwrap();
    assert!((place.shift[0] + BESIDE).abs() < 0.021, "{place:?}");
    assert!(place.shift[1].abs() < 0.021, "{place:?}");
    assert_eq!(place.grasps.reached, place.grasps.tried, "{place:?}");
    // A hand without closing actuators lifts nothing and stays in its place.
    let idle =
        best_place(&task, &Default::default(), hand.manifest.objects.scale, 2, Search::Whole, &|_, _| {}).unwrap();
    assert_eq!((idle.shift, idle.grasps.lifted), ([0.0; 2], 0), "{idle:?}");
    assert!(lift(&task, &Default::default()).unwrap().is_none());
}

#[test]
fn an_object_is_lifted_for_the_picture() {
    let hand = registry().get("parallel").unwrap();
    let task = task(&Layers::new(Preset::Default).unwrap().resolve().unwrap(), &hand);
    let lifted = lift(&task, &hand.manifest.closing).unwrap().expect("an object");
    assert!(lifted.env.achieved_goal()[2] > 0.1, "{}", lifted.scene);
    assert!(lifted.env.facts().touches_hand && !lifted.env.facts().touches_plane);
}

/// The hand of the workspace that is made out from its model file alone.
const ALONE: &str = "shadow";

/// The model file of a hand of the workspace, without its manifest.
#[test]
fn the_hand_of_the_workspace_is_made_out_from_its_file_alone() {
    let described = Hand::load(workspace().join("plugins").join(ALONE)).unwrap();
    let (report, hand) = made_in(&few_grasps(), &described.directory.join(&described.manifest.model), |_| {});
    assert!(report.is_usable(), "{report:?}");
    assert_eq!(report.palm, described.manifest.palm);
    assert_eq!(report.fingertips.len(), described.fingertips.len());
    assert_eq!(hand.posture.len(), described.posture.len());
    assert!((report.object_scale - 1.0).abs() < 1e-9, "{}", report.object_scale);
    // The palm faces down as in the hand's own manifest: the two mounts differ only by a rotation about the vertical.
    let between = hand.manifest.mount.pose().rotation * described.manifest.mount.pose().rotation.inverse();
    let vertical = between * nalgebra::Vector3::z();
    assert!(vertical.z > 0.999, "{vertical}");
    assert!(compare_closing(&described, &report) > 0);
}

/// From the models alone, the survey finds the directions that the authors of the workspace's hands wrote down. The test
/// above compares those of its hand.
#[test]
fn the_closing_directions_of_described_hands_are_found() {
    let mut n_compared = 0;
    let registry = registry();
    for entry in registry.list() {
        let described = registry.get(&entry.name).unwrap_or_else(|error| panic!("{error}"));
        let source = described.directory.join(&described.manifest.model);
        if described.manifest.closing.is_empty() || !source.is_file() || entry.name == ALONE {
            continue;
        }
        let (report, _) = made_in(&few_grasps(), &source, |_| {});
        assert!(report.is_usable(), "{report:?}");
        n_compared += compare_closing(&described, &report);
    }
    assert!(n_compared > 0);
}

/// Checks that each actuator was found to close the hand as its manifest says, and returns their number.
fn compare_closing(described: &Hand, report: &NewHandReport) -> usize {
    for (actuator, &sign) in &described.manifest.closing {
        let found = if sign > 0.0 { &report.close_up } else { &report.close_down };
        assert!(found.contains(actuator), "{}: {actuator}, {report:?}", described.manifest.name);
    }
    described.manifest.closing.len()
}

/// Fingers hang from a disc, curl outwards as far as inwards, and swing sideways. One bends about the opposite axis.
#[test]
fn a_claw_closes_towards_its_middle() {
    let (mut fingers, mut actuators) = (String::new(), String::new());
    for (i, axis) in ["0 1 0", "0 -1 0", "0 1 0"].into_iter().enumerate() {
        let angle = 120 * i;
        let (x, y) =
            (0.05 * f64::from(angle as u32).to_radians().cos(), 0.05 * f64::from(angle as u32).to_radians().sin());
        fingers.push_str(&format!(
            r#"<body pos="{x} {y} 0" euler="0 0 {angle}"><joint name="swing{i}" axis="1 0 0" range="-30 60"/>
            <joint name="near{i}" axis="{axis}" range="-90 90"/><geom type="capsule" fromto="0 0 0 0 0 -0.07" size="0.01"/>
            <body pos="0 0 -0.08"><joint name="far{i}" axis="{axis}" range="-90 90"/>
            <geom type="capsule" fromto="0 0 0 0 0 -0.06" size="0.009"/></body></body>"#
        ));
        for (joint, range) in [("swing", "-0.5 1"), ("near", "-1.5 1.5"), ("far", "-1.5 1.5")] {
            actuators
                .push_str(&format!(r#"<position name="{joint}{i}" joint="{joint}{i}" kp="3" ctrlrange="{range}"/>"#));
        }
    }
    let text = format!(
        r#"<mujoco><compiler autolimits="true"/><default><joint damping="0.2" armature="0.003"/></default><worldbody>
        <body name="disc"><geom type="cylinder" size="0.06 0.01"/>{fingers}</body></worldbody><actuator>{actuators}</actuator></mujoco>"#
    );
    let place = TempDir::new().unwrap();
    let (report, _) = made(&file(&place, &text), |_| {});
    assert_eq!((report.palm.as_str(), report.approach), ("disc", [0.0, 0.0, -1.0]));
    assert_eq!(report.close_up, ["near0", "far0", "near2", "far2"]);
    assert_eq!(report.close_down, ["near1", "far1"]);
    assert_eq!(report.neither, ["swing0", "swing1", "swing2"]);
}

/// A gripper at the end of an arm (rotating base, shoulder, wrist), beside another limb.
#[test]
fn the_arm_above_a_hand_is_left_out() {
    let hand = GRIPPER_MODEL
        .replace(
            "<body name=\"bridge\">",
            r#"<body name="trunk"><joint name="yaw" type="hinge" axis="0 0 1" range="-180 180"/>
            <geom size="0.05"/><body name="limb" pos="0 0.2 0"><joint name="elsewhere" type="hinge" range="-50 50"/>
            <geom size="0.05"/></body><body name="upper" pos="0.1 0 0"><joint name="shoulder" type="hinge" axis="0 1 0" range="-60 60"/>
            <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0"/>
            <body name="bridge" pos="0.35 0 0"><joint name="wrist" type="hinge" axis="0 1 0" range="-40 40"/>"#,
        )
        .replace("<!-- extra bodies -->\n    </body>", "</body></body></body>")
        .replace("<!-- extra actuators -->", "<motor joint=\"yaw\" ctrlrange=\"-1 1\"/><motor joint=\"shoulder\" ctrlrange=\"-1 1\"/>");
    let place = TempDir::new().unwrap();
    let (report, hand) = made(&file(&place, &hand), |request| request.hints.palm = Some("bridge".to_owned()));
    assert_eq!((report.palm.as_str(), report.fingertips.len(), report.close_up.len()), ("bridge", 2, 1));
    let said = report.notes.iter().any(|note| note.contains("begins with `upper`") && note.contains("shoulder, yaw"));
    assert!(said, "{:?}", report.notes);
    let joints: Vec<&str> = hand.joints.iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(joints, ["wrist", "left_joint", "right_joint"]);
}

/// Models that are not a hand, or are in another unit.
#[test]
fn what_cannot_be_a_hand_is_refused() {
    let place = TempDir::new().unwrap();
    for (from, to, said) in [
        (
            "size=\"0.02 0.008 0.03\"",
            "size=\"0.02 0.008 3\"",
            "fingers longer than 60 cm or shorter than 5 mm are refused",
        ),
        ("range=\"0 0.05\"", "range=\"0 0.00005\"", "no fingertip moves by more than"),
    ] {
        let text = GRIPPER_MODEL.replace(from, to);
        assert_ne!(text, GRIPPER_MODEL);
        let source = file(&place, &text);
        let error =
            new_hand(&request(&source, place.path().join("found")), &mujoco(), &setting(), &mut Vec::new(), &|_| {})
                .unwrap_err();
        assert!(error.to_string().contains(said), "{error}");
    }
}

/// A file with a joint on its only body, and a file whose joints all follow one another.
#[test]
fn what_no_survey_can_find_is_said() {
    let place = TempDir::new().unwrap();
    let stone = "<mujoco><worldbody><body name=\"stone\"><joint range=\"0 60\"/><geom size=\"0.1\"/></body></worldbody></mujoco>";
    let circle = GRIPPER_MODEL
        .replace(
            "<position name=\"close\" joint=\"left_joint\" kp=\"400\" ctrllimited=\"true\" ctrlrange=\"0 0.05\"/>",
            "",
        )
        .replace("</equality>", "<joint joint1=\"left_joint\" joint2=\"right_joint\"/></equality>");
    for (text, said) in [(stone, "name the palm with --palm"), (&circle, "no actuator moves the hand")] {
        let source = file(&place, text);
        let error =
            new_hand(&request(&source, place.path().join("found")), &mujoco(), &setting(), &mut Vec::new(), &|_| {})
                .unwrap_err();
        assert!(error.to_string().contains(said), "{error}");
    }
}

#[test]
fn nothing_is_left_behind_by_a_hand_that_fails() {
    let place = TempDir::new().unwrap();
    let source =
        file(&place, "<mujoco><worldbody><body name=\"stone\"><geom size=\"0.1\"/></body></worldbody></mujoco>");
    let library = mujoco();
    let mut notes = Vec::new();
    new_hand(&request(&source, place.path().join("found")), &library, &setting(), &mut notes, &|_| {}).unwrap_err();
    let left: Vec<_> = std::fs::read_dir(place.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["hand.xml"]);

    let source = file(&place, GRIPPER_MODEL);
    let occupied =
        new_hand(&request(&source, place.path().to_owned()), &library, &setting(), &mut notes, &|_| {}).unwrap_err();
    assert!(matches!(occupied, OnboardError::HandExists { .. }), "{occupied}");
    let mut named = request(&source, place.path().join("found"));
    named.name = "Not A Name".to_owned();
    assert!(matches!(
        new_hand(&named, &library, &setting(), &mut notes, &|_| {}).unwrap_err(),
        OnboardError::HandName { .. }
    ));
    let mut lost = request(&source, place.path().join("found"));
    lost.hints.palm = Some("bridg".to_owned());
    let message = new_hand(&lost, &library, &setting(), &mut notes, &|_| {}).unwrap_err().to_string();
    assert!(message.contains("\"bridg\"; choose from the bodies that carry moving parts: bridge"), "{message}");
}
