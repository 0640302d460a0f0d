//! Small files in `tests/faults`, each with a kind of fault that published hands have.

use std::path::{Path, PathBuf};

use eigenhand_hands::xmltree::{Element, XMLNode};
use eigenhand_hands::{HandError, ImportOptions, Imported, import};

fn fault(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults").join(name)
}

/// Reads a file of a fault, and its notes.
fn read(name: &str) -> (Imported, String) {
    let mut notes = Vec::new();
    let imported = import(&fault(name), &ImportOptions::default(), &mut notes);
    (imported.unwrap_or_else(|error| panic!("{name}: {error}")), notes.join("\n"))
}

fn every<'a>(element: &'a Element, name: &str) -> Vec<&'a Element> {
    let mut found = Vec::new();
    for child in element.children.iter().filter_map(XMLNode::as_element) {
        found.extend((child.name == name).then_some(child));
        found.extend(every(child, name));
    }
    found
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

/// `general` and `position` say the same servo, whose velocity feedback stays within its force limit.
#[test]
fn the_same_servo_is_the_same_however_it_is_written() {
    let (general, _) = read("general-kv/hand.xml");
    let (position, _) = read("general-kv/same-as-position.xml");
    for joint in ["damping", "armature"] {
        let values = |imported: &Imported| -> Vec<String> {
            let joints = every(imported.model.get_child("worldbody").unwrap(), "joint");
            joints.iter().map(|e| e.attributes.get(joint).cloned().unwrap_or_default()).collect()
        };
        assert_eq!(values(&general), values(&position), "{joint}");
    }
    let default = general.model.get_child("default").unwrap().get_child("general").unwrap();
    for servo in every(position.model.get_child("actuator").unwrap(), "general") {
        for key in ["gainprm", "biasprm", "biastype"] {
            assert_eq!(servo.attributes[key], default.attributes[key]);
        }
    }
    assert_eq!(every(position.model.get_child("actuator").unwrap(), "general").len(), 6);
    for imported in [general, position, read("general-kv/stiff.xml").0] {
        let option = imported.model.get_child("option").unwrap();
        assert_eq!(option.attributes["integrator"], "implicit");
    }
}

#[test]
fn friction_and_damping_beyond_the_effort_are_lowered() {
    let (imported, notes) = read("dynamics-beyond-effort/gripper.urdf");
    for joint in every(imported.model.get_child("worldbody").unwrap(), "joint") {
        assert_eq!(joint.attributes["frictionloss"], "4");
        // The servo's 20 N move the jaw at 0.17 m/s.
        assert_eq!(joint.attributes["damping"], "120");
    }
    for servo in every(&imported.model, "position") {
        assert_eq!((&*servo.attributes["forcerange"], &*servo.attributes["kp"]), ("-20 20", "2000"));
    }
    assert!(notes.contains("friction was lowered") && notes.contains("jl, jr"), "{notes}");
}

/// One servo with a follower that is damped as if it had a servo of its own; and a wrist that carries two fingers.
#[test]
fn a_servo_overcomes_its_followers_and_a_wrist_carries_its_fingers() {
    const LINK: &str = r#"<inertial><mass value="2"/><origin xyz="0 0 0.2"/>
        <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>"#;
    let joint = |name: &str, parent: &str, more: &str| {
        format!(
            r#"<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/><axis xyz="0 1 0"/>
            <limit lower="0" upper="1.5" effort="1.5" velocity="2"/>{more}</joint><link name="{name}"/>"#
        )
    };
    let parts = [
        joint("wrist", "arm", "").replace("<link name=\"wrist\"/>", &format!("<link name=\"wrist\">{LINK}</link>")),
        joint("a", "wrist", ""),
        joint("b", "wrist", ""),
        joint("c", "b", r#"<mimic joint="b" multiplier="2"/><dynamics damping="5" friction="0.01"/>"#),
    ];
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("hand.urdf");
    std::fs::write(&file, format!("<robot name=\"h\"><link name=\"arm\"/>{}</robot>", parts.concat())).unwrap();
    let mut notes = Vec::new();
    let imported = import(&file, &ImportOptions::default(), &mut notes).unwrap();
    let limit = |name: &str| {
        let servos = every(&imported.model, "position");
        servos.into_iter().find(|servo| servo.attributes["joint"] == name).unwrap().attributes["forcerange"].clone()
    };
    // 2 kg at 20 cm weigh 3.9 N m.
    let wrist: f64 = limit("wrist").split_whitespace().last().unwrap().parse().unwrap();
    assert!((5.0..7.0).contains(&wrist), "{wrist}");
    assert_eq!(limit("a"), "-1.5 1.5");
    let joints = every(imported.model.get_child("worldbody").unwrap(), "joint");
    let follower = joints.into_iter().find(|joint| joint.attributes["name"] == "c").unwrap();
    // 1.5 N m at 2 rad/s, seen through a multiplier of 2.
    assert_eq!(follower.attributes["damping"], "0.1875");
    assert_eq!(follower.attributes["frictionloss"], "0.01");
    let notes = notes.join("\n");
    assert!(notes.contains("damping was lowered") && notes.contains("carries its fingers"), "{notes}");
}

/// What MuJoCo 2.2.2 refuses becomes a binary STL, as in a URDF.
#[test]
fn meshes_of_mjcf_are_mended_as_those_of_urdf() {
    for (name, said) in
        [("ascii", "became binary STL"), ("flat", "became thin boxes"), ("flipped-obj", "became binary STL")]
    {
        let (imported, notes) = read(&format!("mjcf-meshes/{name}.xml"));
        assert!(notes.contains(said), "{name}: {notes}");
        let [(file, bytes)] = &imported.assets[..] else { panic!("{name}: one asset") };
        assert_eq!(every(&imported.model, "mesh")[0].attributes["file"], *file);
        let n_faces = u32::from_le_bytes(bytes[80..84].try_into().unwrap()) as usize;
        assert!(file.ends_with(".stl") && n_faces > 0 && bytes.len() == 84 + 50 * n_faces, "{name}");
        if name == "flat" {
            let heights: Vec<f32> = bytes[84..]
                .chunks_exact(50)
                .flat_map(|face| [20, 32, 44].map(|at| f32::from_le_bytes(face[at..at + 4].try_into().unwrap())))
                .collect();
            let span = heights.iter().fold(0.0_f32, |most, z| most.max(z.abs()));
            assert_eq!((n_faces, span), (12, 0.0005));
        } else {
            let (urdf, _) = read(&format!("mjcf-meshes/{name}.urdf"));
            assert_eq!(urdf.assets[0].1, *bytes, "{name}");
        }
    }
}

/// Forty meshes that say so are one note; so are those of MJCF, where MuJoCo reads no COLLADA.
#[test]
fn meshes_with_another_axis_up_are_one_note() {
    const DAE: &str = r##"<COLLADA><asset><up_axis>Y_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
        <source id="p"><float_array>0 0 0 1 0 0 0 1 0 0 0 1</float_array></source>
        <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
        <triangles><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 1 2 3 0 3 2</p></triangles></mesh></geometry>
        </library_geometries><library_visual_scenes><visual_scene><node><instance_geometry url="#g"/></node></visual_scene>
        </library_visual_scenes></COLLADA>"##;
    let directory = tempfile::tempdir().unwrap();
    for name in ["a.dae", "b.dae"] {
        std::fs::write(directory.path().join(name), DAE).unwrap();
    }
    let text = std::fs::read_to_string(fault("mjcf-meshes/ascii.xml")).unwrap();
    let text = text
        .replace("file=\"ascii.stl\"/>", "file=\"a.dae\"/><mesh name=\"other\" file=\"b.dae\"/>")
        .replace("mesh=\"palm\"/>", "mesh=\"palm\"/><geom type=\"mesh\" mesh=\"other\"/>");
    let file = directory.path().join("hand.xml");
    std::fs::write(&file, text).unwrap();
    let mut notes = Vec::new();
    let imported = import(&file, &ImportOptions::default(), &mut notes).unwrap();
    let names: Vec<&str> = imported.assets.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["a.stl", "b.stl"]);
    let said: Vec<&String> = notes.iter().filter(|note| note.contains("Y_UP")).collect();
    assert!(matches!(said[..], [one] if one.contains("a.dae, b.dae")), "{notes:?}");
}

#[test]
fn a_ball_joint_becomes_three_hinges_outside_the_posture() {
    let (imported, notes) = read("ball-joints/hand.xml");
    let joints = every(imported.model.get_child("worldbody").unwrap(), "joint");
    let hinges: Vec<&&Element> = joints.iter().filter(|e| e.attributes["name"].starts_with("rod_ball")).collect();
    let axes: Vec<&str> = hinges.iter().map(|hinge| hinge.attributes["axis"].as_str()).collect();
    assert_eq!(axes, ["1 0 0", "0 1 0", "0 0 1"]);
    assert!(hinges.iter().all(|e| e.attributes["type"] == "hinge" && e.attributes["limited"] == "false"));
    assert_eq!(imported.passive, ["rod_ball_x", "rod_ball_y", "rod_ball_z"]);
    assert!(notes.contains("ball joints became three hinges"), "{notes}");
}

#[test]
fn an_actuator_on_a_ball_joint_is_refused() {
    let text = std::fs::read_to_string(fault("ball-joints/hand.xml")).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("hand.xml");
    std::fs::write(&file, text.replace("joint=\"thumb\" kp", "joint=\"rod_ball\" kp")).unwrap();
    let error = import(&file, &ImportOptions::default(), &mut Vec::new()).unwrap_err().to_string();
    assert!(error.contains("rod_ball") && error.contains("three hinges"), "{error}");
}

/// The package is known from its own directory, or from its manifest above the file.
#[test]
fn a_mesh_missing_in_a_package_that_was_found_is_said_to_be_missing_there() {
    let text = r#"<robot name="h"><link name="palm"><collision><geometry>
        <mesh filename="package://my_hand/meshes/palm.stl"/></geometry></collision></link>
        <joint name="f" type="revolute"><parent link="palm"/><child link="f"/><axis xyz="0 1 0"/>
        <limit lower="0" upper="1" effort="1" velocity="1"/></joint><link name="f"/></robot>"#;
    let directory = tempfile::tempdir().unwrap();
    let urdf = directory.path().join("some_name/urdf");
    std::fs::create_dir_all(&urdf).unwrap();
    let file = urdf.join("hand.urdf");
    std::fs::write(&file, text).unwrap();
    let refusal = || import(&file, &ImportOptions::default(), &mut Vec::new()).unwrap_err().to_string();
    assert!(refusal().contains("name the package's directory"), "{}", refusal());
    std::fs::write(directory.path().join("some_name/package.xml"), "<package>\n <name> my_hand </name></package>")
        .unwrap();
    assert!(refusal().contains("lies at") && refusal().contains("not in it"), "{}", refusal());
    std::fs::remove_file(directory.path().join("some_name/package.xml")).unwrap();
    std::fs::create_dir(directory.path().join("my_hand")).unwrap();
    assert!(refusal().contains("lies at") && refusal().contains("not in it"), "{}", refusal());
}
