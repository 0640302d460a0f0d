//! The hand in `plugins/shadow`.

use std::path::PathBuf;

use eigenhand_hands::{AngleUnit, FrameKind, Hand, Registry, SearchPath, Unit};

fn directory() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../plugins/shadow")
}

fn shadow() -> Hand {
    Hand::load(directory()).unwrap()
}

#[test]
fn the_registry_of_the_workspace_has_it() {
    let registry = Registry::discover(&SearchPath::from_environment(&[])).unwrap();
    assert_eq!(registry.get("shadow").unwrap().digest, shadow().digest);
}

#[test]
fn joints_and_actuators_are_those_of_the_facts() {
    let hand = shadow();
    let joints: Vec<&str> = hand.joints.iter().map(|j| j.name.as_str()).collect();
    assert_eq!(
        joints.join(" "),
        "WRJ1 WRJ0 FFJ3 FFJ2 FFJ1 FFJ0 MFJ3 MFJ2 MFJ1 MFJ0 RFJ3 RFJ2 RFJ1 RFJ0 LFJ4 LFJ3 LFJ2 LFJ1 LFJ0 THJ4 THJ3 THJ2 THJ1 THJ0"
    );
    assert_eq!(hand.compiler.angle, AngleUnit::Radian);
    assert!(hand.joints.iter().all(|j| j.unit == Unit::Radian && j.range().is_some()));
    assert_eq!(hand.joint("WRJ1").unwrap().range(), Some((-0.489, 0.140)));
    assert_eq!(hand.joint("RFJ3").unwrap().range(), Some((-0.349, 0.349)));
    assert_eq!(hand.joint("LFJ0").unwrap().range(), Some((0.0, 1.571)));
    assert_eq!(hand.joint("THJ0").unwrap().range(), Some((-1.571, 0.0)));
    let actuators: Vec<&str> = hand.actuators.iter().map(|a| a.name.trim_start_matches("A_")).collect();
    assert_eq!(
        actuators.join(" "),
        "WRJ1 WRJ0 FFJ3 FFJ2 FFJ1 MFJ3 MFJ2 MFJ1 RFJ3 RFJ2 RFJ1 LFJ4 LFJ3 LFJ2 LFJ1 THJ4 THJ3 THJ2 THJ1 THJ0"
    );
    for actuator in &hand.actuators {
        let joint = hand.joint(actuator.name.trim_start_matches("A_")).unwrap();
        assert_eq!(Some(actuator.ctrlrange), joint.range(), "{}", actuator.name);
        assert!(actuator.forcerange.is_some_and(|(low, high)| low == -high), "{}", actuator.name);
    }
    assert_eq!(hand.actuators[0].servo.unwrap().gain, 5.0);
    assert_eq!(hand.actuators[2].servo.unwrap().gain, 1.0);
}

#[test]
fn distal_joints_follow_the_middle_ones() {
    let pairs: Vec<(String, String)> =
        shadow().couplings.into_iter().map(|c| (c.dependent, c.driver.unwrap())).collect();
    let expected = ["FF", "MF", "RF", "LF"].map(|f| (format!("{f}J0"), format!("{f}J1")));
    assert_eq!(pairs, expected);
}

#[test]
fn a_posture_of_25_joints_maps_to_21_commands() {
    let hand = shadow();
    let map = hand.actuation();
    assert_eq!((hand.posture.len(), map.actuators.len()), (25, 21));
    assert_eq!((hand.posture[0].name.as_str(), map.actuators[0].as_str()), ("slide", "slide"));
    assert!(map.matrix.iter().all(|row| row.iter().any(|x| *x != 0.0)), "every servo has a row");
    let open = hand.open_posture_vector();
    let commands = map.control(&open);
    for (actuator, command) in map.actuators.iter().zip(commands) {
        let column = hand.posture.iter().position(|j| j.name == actuator.trim_start_matches("A_")).unwrap();
        assert_eq!(command, open[column], "{actuator}");
    }
}

#[test]
fn it_hangs_palm_down_a_drag_beside_the_origin() {
    let hand = shadow();
    let mount = hand.manifest.mount.pose();
    let to_world = |v: [f64; 3]| mount * nalgebra::Point3::from(v);
    // The finger bases' middle, from the root along the arm; closing drags an object by 6 and 10 mm (README.md, 11).
    let bases = to_world([0.0, 0.0, 0.256 + 0.034 + 0.095]);
    assert!((bases - nalgebra::Point3::new(-0.006, -0.01, 0.12)).norm() < 1e-12, "{bases}");
    let palm_faces = mount.rotation * -nalgebra::Vector3::y();
    assert!((palm_faces + nalgebra::Vector3::z()).norm() < 1e-12, "{palm_faces}");
    assert!(hand.fingertips.iter().all(|tip| tip.kind == FrameKind::Site));
}

#[test]
fn the_docs_describe_every_key() {
    let docs = std::fs::read_to_string(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/hands.md")).unwrap();
    for info in eigenhand_hands::keys() {
        assert!(docs.contains(&format!("`{}`", info.key)), "docs/hands.md does not describe `{}`", info.key);
    }
}
