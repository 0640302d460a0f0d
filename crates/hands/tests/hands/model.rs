//! What is read from a model: order, units, default classes, couplings, digest.

use eigenhand_hands::{FrameKind, Hand, HandSummary, Unit, ValueOrigin};

use crate::fixture::Fixture;

const RAD_PER_DEG: f64 = std::f64::consts::PI / 180.0;

fn range_of(hand: &Hand, joint: &str) -> (f64, f64) {
    hand.joint(joint).unwrap().range().unwrap()
}

#[test]
fn joints_come_in_mujoco_order_with_ranges_of_their_classes() {
    let hand = Fixture::new().load().unwrap();
    let names: Vec<&str> = hand.joints.iter().map(|j| j.name.as_str()).collect();
    assert_eq!(names, ["left_near_joint", "left_far_joint", "right_near_joint", "right_far_joint"]);
    assert_eq!(range_of(&hand, "left_near_joint"), (-90.0 * RAD_PER_DEG, 90.0 * RAD_PER_DEG));
    assert_eq!(range_of(&hand, "left_far_joint"), (0.0, 60.0 * RAD_PER_DEG));
    assert_eq!(range_of(&hand, "right_far_joint"), (10.0 * RAD_PER_DEG, 20.0 * RAD_PER_DEG));
    let slide = hand.joint("right_near_joint").unwrap();
    assert_eq!((slide.unit, slide.range()), (Unit::Metre, Some((0.0, 0.05))));
}

#[test]
fn radians_are_taken_as_written() {
    let files = Fixture::new();
    files.edit("pincer.xml", "<compiler ", "<compiler angle=\"radian\" ");
    files.edit("hand.toml", "left_near_joint = 0.5", "left_near_joint = 50");
    assert_eq!(range_of(&files.load().unwrap(), "left_far_joint"), (0.0, 60.0));
}

#[test]
fn an_unlimited_joint_has_no_range() {
    let files = Fixture::new();
    files.edit("pincer.xml", "class=\"far\" axis", "class=\"far\" limited=\"false\" axis");
    assert_eq!(files.load().unwrap().joint("right_far_joint").unwrap().range(), None);
}

#[test]
fn couplings_in_force_are_read() {
    let hand = Fixture::new().load().unwrap();
    assert_eq!(hand.couplings.len(), 1);
    let coupling = &hand.couplings[0];
    assert_eq!((coupling.dependent.as_str(), coupling.driver.as_deref()), ("left_far_joint", Some("left_near_joint")));
    assert!((coupling.evaluate(0.25) - 0.6).abs() < 1e-15);
}

#[test]
fn the_open_posture_is_clamped_and_follows_couplings() {
    let hand = Fixture::new().load().unwrap();
    let open = hand.open_posture();
    assert_eq!(open["left_near_joint"], 0.5);
    // The coupling asks for 1.1, the joint allows 60 degrees.
    assert_eq!(open["left_far_joint"], 60.0 * RAD_PER_DEG);
    assert_eq!(open["right_near_joint"], 0.0);
    assert_eq!(open["right_far_joint"], 10.0 * RAD_PER_DEG);
    assert_eq!(hand.open_posture_vector(), [0.0, 0.5, 60.0 * RAD_PER_DEG, 0.0, 10.0 * RAD_PER_DEG]);
}

#[test]
fn fingertips_are_sites_or_bodies() {
    let hand = Fixture::new().load().unwrap();
    let kinds: Vec<FrameKind> = hand.fingertips.iter().map(|tip| tip.kind).collect();
    assert_eq!(kinds, [FrameKind::Site, FrameKind::Body]);
}

#[test]
fn the_mount_turns_as_written() {
    let files = Fixture::new();
    files.edit("hand.toml", "0.2]\n", "0.2]\neuler_deg = [90, 0, 90]\n");
    let hand = files.load().unwrap();
    // About x first: z goes to -y; then about z: -y goes to x.
    let z = hand.manifest.mount.pose().rotation * nalgebra::Vector3::z();
    assert!((z - nalgebra::Vector3::x()).norm() < 1e-12, "{z}");
    let [w, x, y, zq] = hand.manifest.mount.quaternion_wxyz();
    assert!((w * w + x * x + y * y + zq * zq - 1.0).abs() < 1e-12);
}

#[test]
fn the_digest_covers_every_file_and_nothing_else() {
    let files = Fixture::new();
    let hand = files.load().unwrap();
    let names: Vec<String> = hand.files.iter().map(|f| f.display().to_string()).collect();
    assert_eq!(names, ["drives.xml", "hand.toml", "meshes/pad.obj", "pincer.xml"]);
    assert_eq!(hand.digest.len(), 64);
    std::fs::write(files.path("README.md"), "about").unwrap();
    assert_eq!(files.load().unwrap().digest, hand.digest);
    for name in names {
        let text = std::fs::read_to_string(files.path(&name)).unwrap();
        std::fs::write(files.path(&name), format!("{text}\n")).unwrap();
        assert_ne!(files.load().unwrap().digest, hand.digest, "{name}");
        std::fs::write(files.path(&name), text).unwrap();
    }
    assert_eq!(files.load().unwrap().digest, hand.digest);
}

#[test]
fn includes_are_expanded_in_place() {
    let hand = Fixture::new().load().unwrap();
    assert!(hand.model.get_child("include").is_none());
    assert!(hand.model.get_child("actuator").is_some());
}

#[test]
fn the_last_folder_that_is_said_counts_and_strippath_drops_the_files_own() {
    let files = Fixture::new();
    files.edit(
        "pincer.xml",
        "<compiler meshdir=\"meshes\"/>",
        "<compiler meshdir=\"absent\"/><compiler meshdir=\"meshes\" strippath=\"true\"/>",
    );
    files.edit("pincer.xml", "file=\"pad.obj\"", "file=\"elsewhere/pad.obj\"");
    let hand = files.load().unwrap();
    assert!(hand.files.iter().any(|file| file.ends_with("meshes/pad.obj")), "{:?}", hand.files);
    let path = |kind: &str| hand.compiler.asset_path(kind, "elsewhere/pad.obj", &hand.model_directory);
    assert_eq!(path("mesh"), files.path("meshes/pad.obj"));
    assert_eq!(path("texture"), files.path("pad.obj"));
}

#[test]
fn the_summary_tells_who_set_a_value() {
    let files = Fixture::new();
    files.edit("drives.xml", "gear=\"2\"", "gear=\"2\" ctrllimited=\"false\"");
    let summary = HandSummary::of(&files.load().unwrap());
    assert_eq!((summary.n_joints, summary.n_actuators, summary.n_fingers, summary.n_posture), (5, 3, 2, 5));
    let origin = |key: &str| summary.values.iter().find(|v| v.key == key).map(|v| v.origin);
    assert_eq!(origin("palm"), Some(ValueOrigin::Written));
    assert_eq!(origin("slide.kp"), Some(ValueOrigin::Default));
    assert_eq!(origin("posture_joints"), Some(ValueOrigin::Computed));
    assert_eq!(origin("open_posture"), Some(ValueOrigin::Computed));
    assert_eq!(origin("closing"), Some(ValueOrigin::Default));
    assert_eq!(origin("actuator left_drive ctrlrange"), Some(ValueOrigin::Computed));
    files.edit("hand.toml", "[mount]", "[closing]\nleft_drive = 1\n\n[mount]");
    let closing = HandSummary::of(&files.load().unwrap()).values.into_iter().find(|v| v.key == "closing").unwrap();
    assert_eq!((closing.value.to_string().as_str(), closing.origin), ("{ left_drive = 1.0 }", ValueOrigin::Written));
    assert_eq!(origin("packages"), Some(ValueOrigin::Default));
    files.edit("hand.toml", "[mount]", "[packages]\nhand_description = \"meshes\"\n\n[mount]");
    let summary = HandSummary::of(&files.load().unwrap());
    let packages = summary.values.iter().find(|v| v.key == "packages").unwrap();
    assert_eq!(packages.value.to_string(), "{ hand_description = \"meshes\" }");
    assert_eq!(packages.origin, ValueOrigin::Written);
    let json = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["n_joints"], 5);
    assert_eq!(json["licence"], "unknown");
    let position = json["values"].as_array().unwrap().iter().find(|v| v["key"] == "mount.position").unwrap();
    assert_eq!(position["value"], serde_json::json!([0.0, 0.0, 0.2]));
}
