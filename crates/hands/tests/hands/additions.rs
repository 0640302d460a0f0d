//! What a manifest adds to its model.

use crate::fixture::{Fixture, MANIFEST};

fn with(text: &str) -> Fixture {
    let files = Fixture::new();
    std::fs::write(files.path("hand.toml"), format!("{MANIFEST}{text}")).unwrap();
    files
}

#[test]
fn a_servo_takes_the_place_of_the_one_on_its_joint() {
    let before = Fixture::new().load().unwrap();
    let files = with(
        "[[actuators]]\njoint = \"left_near_joint\"\nkp = 3\nforce_limit = 2\n\
         [[actuators]]\njoint = \"right_near_joint\"\nname = \"extra\"\nkp = 50\nforce_limit = 9\ncontrol_range = [0.01, 0.02]\n",
    );
    let hand = files.load().unwrap();
    assert_ne!(hand.digest, before.digest);
    let names: Vec<&str> = hand.actuators.iter().map(|actuator| actuator.name.as_str()).collect();
    assert_eq!(names, ["right_drive", "left_near_joint", "extra"]);
    let (left, extra) = (&hand.actuators[1], &hand.actuators[2]);
    assert_eq!((left.servo.unwrap().stiffness, left.forcerange), (3.0, Some((-2.0, 2.0))));
    assert_eq!(Some(left.ctrlrange), hand.joint("left_near_joint").unwrap().range());
    assert_eq!((extra.ctrlrange, extra.forcerange), ((0.01, 0.02), Some((-9.0, 9.0))));
}

#[test]
fn a_coupling_moves_its_joint_without_an_actuator() {
    let files = with(
        "[[couplings]]\njoint = \"right_near_joint\"\nfollows = \"left_near_joint\"\nmultiplier = 0.01\noffset = 0.02\n",
    );
    let hand = files.load().unwrap();
    let coupling = hand.couplings.iter().find(|coupling| coupling.dependent == "right_near_joint").unwrap();
    assert!((coupling.evaluate(1.0) - 0.03).abs() < 1e-12);
    let open = hand.open_posture();
    assert!((open["right_near_joint"] - (0.02 + 0.01 * open["left_near_joint"])).abs() < 1e-12);
}

#[test]
fn closing_directions_name_actuators() {
    let hand = with("[closing]\nleft_drive = 1\nright_drive = -1\n").load().unwrap();
    assert_eq!(hand.manifest.closing["right_drive"], -1.0);
    for (line, key, said) in
        [("left_driv = 1", "closing.left_driv", "left_drive"), ("left_drive = 0.5", "closing.left_drive", "1 or -1")]
    {
        let message = with(&format!("[closing]\n{line}\n")).load().unwrap_err().to_string();
        assert!(message.contains(key) && message.contains(said) && message.contains("hand.toml"), "{message}");
    }
}

#[test]
fn contact_bits_reach_the_geoms_that_collide() {
    let files = with("[contact]\ncontype = 5\nconaffinity = 4\n");
    files.edit(
        "pincer.xml",
        "<geom size=\"0.01\"/>\n          <site",
        "<geom size=\"0.01\" contype=\"0\" conaffinity=\"0\"/>\n          <site",
    );
    let hand = files.load().unwrap();
    fn bits(element: &eigenhand_hands::xmltree::Element, found: &mut Vec<String>) {
        for child in element.children.iter().filter_map(|node| node.as_element()) {
            if child.name == "geom" {
                found.push(format!("{} {}", child.attributes["contype"], child.attributes["conaffinity"]));
            }
            bits(child, found);
        }
    }
    let mut found = Vec::new();
    bits(&hand.model, &mut found);
    assert_eq!(found, ["0 0", "5 4", "5 4", "5 4"]);
}

#[test]
fn what_does_not_fit_is_an_error_that_names_the_key() {
    for (text, said) in [
        ("[[actuators]]\njoint = \"left_nea_joint\"\nkp = 1\nforce_limit = 1\n", "did you mean `left_near_joint`"),
        ("[[actuators]]\njoint = \"left_near_joint\"\nkp = 0\nforce_limit = 1\n", "`actuators[0].kp`"),
        ("[[actuators]]\njoint = \"left_near_joint\"\nkp = 1\nforce_limit = -1\n", "`actuators[0].force_limit`"),
        (
            "[[actuators]]\njoint = \"left_near_joint\"\nkp = 1\nforce_limit = 1\ncontrol_range = [1, 0]\n",
            "control_range",
        ),
        ("[[actuators]]\njoint = \"left_near_joint\"\nforce_limit = 1\n", "kp"),
        (
            "[[actuators]]\njoint = \"left_near_joint\"\nkp = 1\nforce_limit = 1\nstiff = 2\n",
            "unknown key `actuators.stiff`",
        ),
        ("[[couplings]]\njoint = \"left_near_joint\"\nfollows = \"left_near_joint\"\n", "another joint"),
        ("[contact]\ncontype = 1\n", "conaffinity"),
        ("[contact]\ncontype = -1\nconaffinity = 1\n", "contype"),
    ] {
        let message = with(text).message();
        assert!(message.contains(said) && message.contains("DIR"), "{said}: {message}");
    }
}

#[test]
fn a_urdf_is_read_where_it_lies() {
    let files = Fixture::new();
    files.edit("hand.toml", "model = \"pincer.xml\"", "model = \"finger.urdf\"\nformat = \"urdf\"");
    files.edit("hand.toml", "fingertips = [\"left_tip\", \"right_far\"]", "fingertips = [\"tip\"]");
    files.edit("hand.toml", "left_near_joint = 0.5", "bend = 0.5");
    let missing = files.message();
    assert!(missing.contains("finger.urdf does not exist"), "{missing}");
    let urdf = r#"<robot name="f"><link name="base"/><link name="tip"><collision><geometry><sphere radius="0.01"/></geometry></collision>
        </link><joint name="bend" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 1 0"/>
        <limit lower="0" upper="1.5" effort="2" velocity="1"/></joint></robot>"#;
    std::fs::write(files.path("finger.urdf"), urdf).unwrap();
    let hand = files.load().unwrap();
    assert_eq!((hand.actuators[0].name.as_str(), hand.actuators[0].forcerange), ("bend", Some((-2.0, 2.0))));
    assert!(!hand.notes.is_empty());
    std::fs::write(files.path("finger.urdf"), urdf.replace("1.5", "1.4")).unwrap();
    assert_ne!(files.load().unwrap().digest, hand.digest);
    // What makes the hand lies in its directory, so that the directory can be copied.
    std::fs::write(files.path("../stray.stl"), "solid").unwrap();
    let stray = urdf.replace("<sphere radius=\"0.01\"/>", "<mesh filename=\"../stray.stl\"/>");
    std::fs::write(files.path("finger.urdf"), stray).unwrap();
    let message = files.message();
    assert!(message.contains("leads out of the hand's directory") && message.contains("../stray.stl"), "{message}");
    let packaged = urdf.replace("<sphere radius=\"0.01\"/>", "<mesh filename=\"package://finger/tip.stl\"/>");
    std::fs::write(files.path("finger.urdf"), packaged).unwrap();
    let message = files.message();
    assert!(message.contains("`packages = { finger = \"DIR\" }` in hand.toml"), "{message}");
}
