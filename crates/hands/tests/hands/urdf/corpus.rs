//! Hands as their makers publish them, where a collection of them is at hand.

use std::path::PathBuf;

use super::{all, read};

/// Variable that names the collection.
const VARIABLE: &str = "EIGENHAND_HANDS_CORPUS";

fn corpus() -> Option<PathBuf> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/hands-corpus"));
    let path = std::env::var_os(VARIABLE).map_or(beside, PathBuf::from);
    if path.join("INDEX.tsv").is_file() {
        return Some(path);
    }
    eprintln!("skipped: no INDEX.tsv in {}; set {VARIABLE}", path.display());
    None
}

#[test]
fn published_hands_convert_with_their_joints_and_couplings() {
    let Some(corpus) = corpus() else { return };
    let index = std::fs::read_to_string(corpus.join("INDEX.tsv")).unwrap();
    let mut rows = index.lines().map(|line| line.split('\t').collect::<Vec<_>>());
    let head = rows.next().unwrap();
    let column = |name: &str| head.iter().position(|h| *h == name).unwrap();
    let mut read_any = false;
    for row in rows.filter(|row| row[column("format")] == "URDF") {
        let file = corpus.join(row[column("hand")]).join(row[column("entry")]);
        let (imported, notes) = read(&file);
        let model = imported.unwrap().model;
        let bodies = model.get_child("worldbody").unwrap();
        assert_eq!(all(bodies, "joint").len(), row[column("nv")].parse::<usize>().unwrap(), "{}", file.display());
        let mimics = model.get_child("equality").map_or(0, |e| all(e, "joint").len());
        assert_eq!(mimics, row[column("mimic")].parse::<usize>().unwrap(), "{}", file.display());
        assert!(!all(bodies, "geom").is_empty());
        assert!(notes.iter().all(|note| !note.contains('\n')));
        read_any = true;
    }
    assert!(read_any);
}

#[test]
fn published_files_that_are_refused_say_why() {
    let Some(corpus) = corpus() else { return };
    let refused = |path: &str| {
        let (imported, notes) = read(&corpus.join("refused").join(path));
        (imported.unwrap_err().to_string(), notes.join("\n"))
    };
    let (reason, _) = refused("pchands_klampt_xacro_silent/assets/allegro_hand_right/model_klampt.urdf");
    assert!(reason.contains("this is xacro"), "{reason}");
    // These come without their meshes.
    let (reason, notes) = refused("shadow_sr_common_urdf/sr_description/mujoco_models/urdfs/shadowhand_motor.urdf");
    assert!(notes.contains("a comment before the XML declaration"), "{notes}");
    assert!(reason.contains(".dae") && reason.contains("--package sr_description=DIR"), "{reason}");
    let (reason, _) = refused("robotiq_c2_urdf/robotiq_2f_c2_gripper_visualization/urdf/robotiq_c2_model.urdf");
    assert!(reason.contains(".dae") && reason.contains("was not found"), "{reason}");
    let (reason, _) = refused("shadow_dexee/shadow_dexee.xml");
    assert!(reason.contains("engine plugins"), "{reason}");
    for path in ["franka_hand_2026/hand.xml", "jaco_2025/jaco_hand.xml"] {
        let (reason, _) = refused(path);
        assert!(reason.contains("does not exist"), "{reason}");
    }
}
