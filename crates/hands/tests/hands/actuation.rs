//! The map from a posture to commands.

use crate::fixture::Fixture;

#[test]
fn gears_tendons_and_the_slide() {
    let hand = Fixture::new().load().unwrap();
    let map = hand.actuation();
    assert_eq!(map.actuators, ["slide", "left_drive", "right_drive"]);
    let joints: Vec<&str> = hand.posture.iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(joints, ["slide", "left_near_joint", "left_far_joint", "right_near_joint", "right_far_joint"]);
    assert_eq!(
        map.matrix,
        [vec![1.0, 0.0, 0.0, 0.0, 0.0], vec![0.0, 2.0, 0.0, 0.0, 0.0], vec![0.0, 0.0, 0.0, 3.0, -0.5]]
    );
    assert_eq!(map.offset, [0.0; 3]);
    assert_eq!((map.control_min.clone(), map.control_max.clone()), (vec![-0.12, -1.0, -1.0], vec![0.14, 1.0, 1.0]));
    assert!(map.matrix.iter().all(|row| row.iter().any(|x| *x != 0.0)), "every servo has a row");
    assert_eq!(map.control(&[0.1, 0.25, 9.0, 0.2, 0.4]), [0.1, 0.5, 0.2 * 3.0 - 0.5 * 0.4]);
    assert_eq!(map.control(&[5.0, -9.0, 0.0, 0.0, 0.0]), [0.14, -1.0, 0.0]);
}

#[test]
fn a_driven_joint_outside_the_posture_follows_its_coupling_or_stays_open() {
    let files = Fixture::new();
    files.edit("hand.toml", "[mount]", "posture_joints = [\"left_near_joint\", \"right_near_joint\"]\n[mount]");
    files.edit("drives.xml", "joint=\"left_near_joint\" gear", "joint=\"left_far_joint\" gear");
    files.edit("hand.toml", "left_near_joint = 0.5", "right_far_joint = 0.2");
    let map = files.load().unwrap().actuation();
    assert_eq!(map.matrix, [vec![0.0, 0.0], vec![4.0, 0.0], vec![0.0, 3.0]]);
    assert_eq!(map.offset, [0.0, 0.2, -0.1]);
}

#[test]
fn general_actuators_are_servos_when_their_bias_is_affine() {
    let files = Fixture::new();
    files.edit(
        "drives.xml",
        "<position name=\"left_drive\" joint=\"left_near_joint\" gear=\"2\"/>",
        "<general name=\"left_drive\" joint=\"left_near_joint\" gainprm=\"5\" biastype=\"affine\" biasprm=\"1 -10 0\" ctrllimited=\"false\"/>",
    );
    files.edit(
        "drives.xml",
        "<position name=\"right_drive\" tendon=\"both\"/>",
        "<motor name=\"right_drive\" tendon=\"both\"/>",
    );
    let hand = files.load().unwrap();
    let map = hand.actuation();
    assert_eq!(map.matrix[1], [0.0, 2.0, 0.0, 0.0, 0.0]);
    assert_eq!(map.offset[1], -0.2);
    assert_eq!((&map.matrix[2], map.offset[2]), (&vec![0.0; 5], 0.0), "a motor holds no position");
    let (low, high) = hand.actuators[0].ctrlrange;
    let reach = std::f64::consts::PI;
    assert!((low - (-reach - 0.2)).abs() < 1e-12 && (high - (reach - 0.2)).abs() < 1e-12, "{low} {high}");
}
