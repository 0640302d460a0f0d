//! Signs of a fault in a hand's model: each is seen in a hand that has it, and sound hands show none.

use eigenhand_hands::Hand;
use eigenhand_onboard::symptoms;
use eigenhand_sim::{GraspTask, Setting};

use crate::contract::{gripper_with, setting};
use crate::support::{mujoco, registry};

fn names_of(hand: &Hand) -> Vec<(&'static str, String)> {
    let cube = Setting { objects: vec!["cube".to_owned()], ..setting() };
    let task = GraspTask::new(&mujoco(), hand, &cube).unwrap();
    symptoms(hand, &task).unwrap().into_iter().map(|symptom| (symptom.name, symptom.detail)).collect()
}

/// A trough 60 mm wide, 80 mm long and 40 mm deep, with a floor like a V.
const TROUGH: &str = "-0.03 -0.04 0.04  -0.03 0.04 0.04  0.03 -0.04 0.04  0.03 0.04 0.04  0 -0.04 0  0 0.04 0  \
                      -0.03 -0.04 -0.005  -0.03 0.04 -0.005  0.03 -0.04 -0.005  0.03 0.04 -0.005";
const TROUGH_FACES: &str = "0 4 5  0 5 1  4 2 3  4 3 5  2 8 9  2 9 3  8 6 7  8 7 9  6 0 1  6 1 7  \
                            0 6 4  4 6 8  4 8 2  1 5 7  5 9 7  5 3 9";

#[test]
fn sound_hands_show_none() {
    for entry in registry().list() {
        let hand = entry.hand.as_ref().unwrap();
        assert_eq!(names_of(hand), [], "{}", entry.name);
    }
}

#[test]
fn each_fault_shows() {
    let left = "<joint name=\"left_joint\" axis=\"0 -1 0\"/>";
    for (old, new, name, says) in [
        ("pos=\"0 0.06 -0.03\"", "pos=\"0 0.06 -3\"", "size", "3.00"),
        ("mass=\"0.3\"", "mass=\"300\"", "mass", "300"),
        (
            left,
            "<joint name=\"left_joint\" axis=\"0 -1 0\"/><inertial pos=\"0 0 0\" mass=\"0.05\" diaginertia=\"5 5 5\"/>",
            "inertia",
            "left",
        ),
        (
            "<geom name=\"left_pad\" type=\"box\"",
            "<geom name=\"left_pad\" contype=\"0\" type=\"box\"",
            "links without collision geometry",
            "left_joint",
        ),
        (
            "<worldbody>\n    <body name=\"bridge\">",
            &format!(
                "<asset><mesh name=\"trough\" vertex=\"{TROUGH}\" face=\"{TROUGH_FACES}\"/></asset>\
                 <worldbody>\n    <body name=\"bridge\"><geom type=\"mesh\" mesh=\"trough\" pos=\"0 0 0.05\" mass=\"0.01\"/>"
            ),
            "meshes filled by their hulls",
            "bridge",
        ),
        (
            "<geom name=\"left_pad\" type=\"box\"",
            "<body name=\"inside\"><joint name=\"nail\" axis=\"0 0 1\" range=\"0 0.001\"/>\
             <geom type=\"sphere\" size=\"0.008\"/></body>\
             <body name=\"outside\"><joint name=\"skin\" axis=\"0 0 1\" range=\"0 0.001\"/>\
             <geom type=\"sphere\" size=\"0.008\"/></body><geom name=\"left_pad\" type=\"box\"",
            "links inside each other",
            "inside and outside (16 mm)",
        ),
        (
            "joint=\"left_joint\" kp=\"400\"",
            "joint=\"left_joint\" kp=\"400\" forcelimited=\"true\" forcerange=\"-0.05 0.05\"",
            "weak servos",
            "left_motor",
        ),
        ("axis=\"0 1 0\"", "axis=\"0 -1 0\"", "fingers close the same way", "[closing]"),
        (
            left,
            "<joint name=\"left_joint\" axis=\"0 -1 0\"/>\
             <joint name=\"turn\" type=\"hinge\" axis=\"0 0 1\" range=\"-90 90\" armature=\"0.001\"/>",
            "limits of ±90 degrees",
            "turn",
        ),
    ] {
        let mut hand = gripper_with(old, new);
        hand.manifest.closing = ["left_motor", "right_motor"].map(|motor| (motor.to_owned(), 1.0)).into();
        let found = names_of(&hand);
        let detail = found.iter().find(|(found, _)| *found == name).map(|(_, detail)| detail);
        assert!(detail.is_some_and(|detail| detail.contains(says)), "{name}: {found:?}");
    }
}
