//! Small files in `tests/faults`, each with a kind of fault that published hands have.

use std::path::{Path, PathBuf};

use eigenhand_hands::{HandError, ImportOptions, import};

fn fault(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults").join(name)
}

#[test]
fn a_mesh_that_git_lfs_did_not_fetch_is_named_with_the_command_that_fetches_it() {
    for (model, mesh) in [
        ("hand.xml", "palm.stl"),
        ("hand.urdf", "palm.stl"),
        ("hand-obj.urdf", "palm.obj"),
        ("hand-dae.urdf", "palm.dae"),
    ] {
        let file = fault("lfs-pointer").join(model);
        let error = import(&file, &ImportOptions::default(), &mut Vec::new()).unwrap_err();
        assert!(matches!(&error, HandError::LfsPointer { path } if path.ends_with(mesh)), "{model}: {error}");
        assert!(error.to_string().contains("git lfs pull"), "{error}");
    }
}

#[test]
fn the_torque_limit_of_a_joint_becomes_that_of_its_servo() {
    let mut notes = Vec::new();
    let imported = import(&fault("torque-limit-on-joint").join("hand.xml"), &ImportOptions::default(), &mut notes);
    let model = imported.unwrap().model;
    let actuators = model.get_child("actuator").unwrap();
    let servos: Vec<_> = actuators.children.iter().filter_map(|node| node.as_element()).collect();
    assert_eq!(servos.len(), 6);
    for servo in servos {
        let expected = if servo.attributes["name"] == "t1" { "-2.4 2.4" } else { "-1.4 1.4" };
        assert_eq!(
            (servo.attributes["forcelimited"].as_str(), servo.attributes["forcerange"].as_str()),
            ("true", expected)
        );
    }
    assert!(notes.iter().any(|note| note.contains("actuatorfrcrange") && note.contains("force range")), "{notes:?}");
}

#[test]
fn a_torque_limit_that_no_servo_takes_is_noted() {
    let text = std::fs::read_to_string(fault("torque-limit-on-joint").join("hand.xml")).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("hand.xml");
    std::fs::write(&file, text.replace(r#"<position name="b2" joint="b2"/>"#, "")).unwrap();
    let mut notes = Vec::new();
    import(&file, &ImportOptions::default(), &mut notes).unwrap();
    assert!(
        notes.contains(&"actuatorfrcrange removed from joints that no actuator drives directly: b2".to_owned()),
        "{notes:?}"
    );
}
