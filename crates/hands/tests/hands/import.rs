//! MJCF as makers publish it: what is mended, what is left out, what is refused.

use std::path::PathBuf;

use eigenhand_hands::xmltree::{Element, XMLNode};
use eigenhand_hands::{HandError, ImportOptions, Imported, import};
use proptest::prelude::*;
use tempfile::TempDir;

use crate::mutation::{PIECES, mutate};

/// A hand among things that are none, with what is newer than MuJoCo 2.2.2.
const CROWDED: &str = r#"<mujoco model="crowded">
  <compiler angle="radian" meshdir="parts"/>
  <option integrator="implicitfast"><flag nativeccd="disable"/></option>
  <statistic center="0 0 0"/>
  <default>
    <mesh scale="0.5 0.5 0.5"/>
    <geom contype="2" conaffinity="2"/>
    <default class="soft"><position kp="4" kv="0.3"/></default>
  </default>
  <asset>
    <mesh file="Tip.obj"/>
    <texture name="wood" builtin="flat" width="1" height="1"/>
    <material name="brown" texture="wood" rgba="0.5 0.3 0.1 1"/>
  </asset>
  <worldbody>
    <light pos="0 0 1"/>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="ball"><freejoint/><geom name="ball_geom" size="0.02"/></body>
    <body name="pointer" mocap="true"><geom name="pointer_geom" size="0.01"/></body>
    <body name="base">
      <geom size="0.03" fancy="1"/>
      <camera pos="0 0 1"/>
      <body>
        <joint range="0 1" damping="0.1"/>
        <geom type="mesh" mesh="Tip"/>
        <geom contype="0" conaffinity="0" size="0.01"/>
      </body>
    </body>
  </worldbody>
  <contact><pair geom1="ball_geom" geom2="floor"/></contact>
  <actuator>
    <position class="soft" joint="joint_1"/>
  </actuator>
  <sensor><clock/></sensor>
  <keyframe><key qpos="0"/></keyframe>
</mujoco>
"#;

struct Files(TempDir);

impl Files {
    fn new(text: &str) -> Self {
        let directory = TempDir::new().unwrap();
        std::fs::create_dir(directory.path().join("parts")).unwrap();
        std::fs::write(directory.path().join("parts/Tip.obj"), "v 0 0 0\n").unwrap();
        std::fs::write(directory.path().join("hand.xml"), text).unwrap();
        Self(directory)
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("hand.xml")
    }

    fn import(&self) -> (Result<Imported, HandError>, String) {
        let mut notes = Vec::new();
        let result = import(&self.path(), &ImportOptions::default(), &mut notes);
        (result, notes.join("\n"))
    }
}

fn read(text: &str) -> (Imported, String) {
    let (result, notes) = Files::new(text).import();
    (result.unwrap(), notes)
}

/// The model with joints, an actuator and `extra`, in which one thing is to be looked at.
fn plain(extra: &str) -> String {
    format!(
        r#"<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom size="0.03"/>
        <body name="finger"><joint name="bend" range="0 1" damping="0.1"/><geom name="pad" size="0.01"/>
        <site name="end" pos="0 0 0.05"/></body></body></worldbody>
        <actuator><motor name="drive" joint="bend" gear="2" forcerange="-3 3" forcelimited="true"/></actuator>{extra}</mujoco>"#
    )
}

/// The actuator of [`plain`].
const DRIVE: &str = "<motor name=\"drive\" joint=\"bend\" gear=\"2\" forcerange=\"-3 3\" forcelimited=\"true\"/>";

fn all<'a>(element: &'a Element, name: &str, found: &mut Vec<&'a Element>) {
    for child in element.children.iter().filter_map(XMLNode::as_element) {
        if child.name == name {
            found.push(child);
        }
        all(child, name, found);
    }
}

fn every<'a>(imported: &'a Imported, name: &str) -> Vec<&'a Element> {
    let mut found = Vec::new();
    all(&imported.model, name, &mut found);
    found
}

fn value<'a>(element: &'a Element, key: &str) -> &'a str {
    element.attributes.get(key).map_or("", String::as_str)
}

#[test]
fn what_is_no_hand_is_left_out() {
    let (imported, notes) = read(CROWDED);
    let bodies: Vec<&str> = every(&imported, "body").iter().map(|body| value(body, "name")).collect();
    assert_eq!(bodies, ["base", "body_1"]);
    for gone in ["light", "camera", "keyframe", "sensor", "texture", "freejoint", "pair"] {
        assert!(every(&imported, gone).is_empty(), "{gone}");
    }
    for said in ["the floor `floor`", "the free object `ball`", "the mocap body `pointer`", "keyframe, sensor"] {
        assert!(notes.contains(said), "{said}: {notes}");
    }
}

#[test]
fn what_is_newer_is_mended_and_said() {
    let (imported, notes) = read(CROWDED);
    for said in ["geom fancy", "kv or dampratio of 1 servos"] {
        assert!(notes.contains(said), "{said}: {notes}");
    }
    // What is left out with its section is not said to be mended.
    assert!(!notes.contains("implicit") && !notes.contains("nativeccd"), "{notes}");
    let joint = every(&imported, "joint").into_iter().find(|joint| value(joint, "name") == "joint_1").unwrap();
    assert!(!joint.attributes.contains_key("kv"));
    assert!(every(&imported, "position").iter().all(|servo| !servo.attributes.contains_key("kv")));
    let servo = every(&imported, "general")[0];
    assert_eq!((value(servo, "gainprm"), value(servo, "biasprm")), ("4", "0 -4 -0.3"));
    assert!(every(&imported, "compiler").iter().any(|compiler| value(compiler, "autolimits") == "true"));
}

#[test]
fn geoms_meet_the_object_and_meshes_keep_their_class() {
    let (imported, notes) = read(CROWDED);
    assert!(notes.contains("2 geoms could not touch the object"), "{notes}");
    let bits: Vec<&str> = every(&imported, "geom").iter().map(|geom| value(geom, "contype")).collect();
    // The class comes first; a geom that touches nothing stays as it is.
    assert_eq!(bits, ["2", "3", "3", "0"]);
    let mesh = every(&imported, "mesh").into_iter().find(|mesh| mesh.attributes.contains_key("file")).unwrap();
    assert_eq!((value(mesh, "name"), value(mesh, "file"), value(mesh, "scale")), ("Tip", "Tip.obj", "0.5 0.5 0.5"));
    assert_eq!(imported.assets, [("Tip.obj".to_owned(), b"v 0 0 0\n".to_vec())]);
}

#[test]
fn a_motor_without_a_control_range_gets_one_from_its_force() {
    let (imported, notes) = read(&plain(""));
    assert_eq!(value(every(&imported, "motor")[0], "ctrlrange"), "-1.5 1.5");
    assert!(notes.contains("without a control range"), "{notes}");
}

/// A servo's range is computed from the joint's, as `Hand::load` does; a motor that is written as `general` is no servo.
#[test]
fn servos_without_a_control_range_get_one_from_their_joint() {
    for (actuator, range, guessed) in [
        (r#"<position name="drive" joint="bend" kp="2"/>"#, "0 1", false),
        (r#"<position name="drive" joint="bend" kp="2" gear="3" inheritrange="1"/>"#, "0 3", false),
        (r#"<position name="drive" jointinparent="bend"/>"#, "0 1", false),
        (
            r#"<general name="drive" joint="bend" gainprm="2" biastype="affine" biasprm="0.5 -4 0"/>"#,
            "-0.25 1.75",
            false,
        ),
        (r#"<general name="drive" joint="bend" gainprm="0.5"/>"#, "-1 1", true),
    ] {
        let text = plain("").replace(DRIVE, actuator);
        assert!(text.contains(actuator));
        let (imported, notes) = read(&text);
        let made = every(&imported, "actuator")[0].children[0].as_element().unwrap();
        assert_eq!((value(made, "ctrllimited"), value(made, "ctrlrange")), ("true", range), "{actuator}");
        assert_eq!(notes.contains("without a control range"), guessed, "{actuator}: {notes}");
    }
}

#[test]
fn a_model_without_actuators_gets_servos_and_damping() {
    let bare = plain("").replace(" damping=\"0.1\"", "");
    let start = bare.find("<actuator>").unwrap();
    let end = bare.find("</actuator>").unwrap() + "</actuator>".len();
    let (imported, notes) = read(&format!("{}{}", &bare[..start], &bare[end..]));
    let servo = every(&imported, "position")[0];
    assert_eq!((value(servo, "joint"), value(servo, "ctrlrange"), value(servo, "forcerange")), ("bend", "0 1", "-1 1"));
    let joint = every(&imported, "joint")[0];
    assert!(
        value(joint, "damping").parse::<f64>().unwrap() > 0.0 && value(joint, "armature").parse::<f64>().unwrap() > 0.0
    );
    assert!(notes.contains("no actuators") && notes.contains("that a stable servo needs"), "{notes}");
}

/// The damping that steadies a joint follows from its servos' stiffness, however they are written.
#[test]
fn joints_without_damping_are_steadied_by_what_their_servos_are() {
    for (actuator, stiffness) in [
        (r#"<general name="drive" joint="bend" gainprm="2" biastype="affine" biasprm="0 -2 0"/>"#, 2.0),
        (r#"<position name="drive" joint="bend"/>"#, 1.0),
        (r#"<position name="drive" joint="bend" kp="3" gear="2"/>"#, 12.0),
    ] {
        let text = plain("").replace(" damping=\"0.1\"", "").replace(DRIVE, actuator);
        let (imported, notes) = read(&text);
        let joint = every(&imported, "joint")[0];
        let number = |key: &str| value(joint, key).parse::<f64>().unwrap();
        // A servo of 12 N m/rad gets a limit of 1 N m, and less damping.
        assert!((number("damping") - (0.06_f64 * stiffness).min(0.5)).abs() < 1e-9, "{actuator}: {notes}");
        assert!((number("armature") - 0.001 * stiffness).abs() < 1e-9, "{actuator}: {notes}");
    }
}

/// A servo's own `kv` is force for each unit of the actuator's velocity, whatever it acts on.
#[test]
fn velocity_feedback_of_servos_stays_in_them() {
    let text = plain("<tendon><fixed name=\"sum\" damping=\"0.5\"><joint joint=\"bend\" coef=\"1\"/></fixed></tendon>")
        .replace(
            "<motor name=\"drive\" joint=\"bend\" gear=\"2\"",
            "<position tendon=\"sum\" kv=\"0.25\"/><position site=\"end\" name=\"push\" kp=\"2\" kv=\"0.5\" ctrlrange=\"0 1\"/>
             <position name=\"drive\" joint=\"bend\" kp=\"10\" dampratio=\"1\" gear=\"2\"",
        );
    let (imported, notes) = read(&text);
    assert_eq!(value(every(&imported, "fixed")[0], "damping"), "0.5");
    let biases: Vec<&str> = every(&imported, "general").iter().map(|servo| value(servo, "biasprm")).collect();
    assert_eq!(biases[..2], ["0 -1 -0.25", "0 -2 -0.5"]);
    // 0.001 kg m2 are 0.00025 behind a gear of 2; 10 N m/rad with it are damped critically by 2 sqrt(10 0.00025).
    assert_eq!(biases[2], "0 -10 -0.1");
    assert!(notes.contains("kv or dampratio of 3 servos"), "{notes}");
    assert!(every(&imported, "option").iter().any(|option| value(option, "integrator") == "implicit"));
    // Newer versions read a positive third number of a position servo's bias as a damping ratio.
    let ratio = r#"<general name="drive" joint="bend" gainprm="10" biastype="affine" biasprm="0 -10 1"/>"#;
    let (imported, _) = read(&plain("").replace(DRIVE, ratio));
    assert_eq!(value(every(&imported, "general")[0], "biasprm"), "0 -10 -0.2");
    assert!(every(&read(&plain("")).0, "option").is_empty());
}

/// No force limit, or one of an arm; the second servo is slow and weak already.
#[test]
fn servos_get_bounds_and_a_makers_bounds_stay() {
    const KEPT: &str =
        r#"<position name="slow" joint="tip" kp="2" forcelimited="true" forcerange="-0.3 0.3" ctrlrange="0 1"/>"#;
    let text = |servo: &str| {
        plain("").replace(DRIVE, &format!("{servo}{KEPT}")).replace(
            "<site name=\"end\"",
            "<body><joint name=\"tip\" range=\"0 1\" damping=\"0.1\" armature=\"0.002\"/><geom size=\"0.01\"/></body>
             <geom size=\"0.01\" solref=\"0.002 1\"/><site name=\"end\"",
        )
    };
    for (servo, limit, damping) in [
        (r#"<position name="drive" joint="bend" kp="8"/>"#, "-1 1", "0.25"),
        (r#"<position name="drive" joint="bend" kp="2"/>"#, "-0.6 0.6", "0.15"),
        (r#"<position name="drive" joint="bend" kp="8" forcerange="-30 30"/>"#, "-1 1", "0.25"),
        (r#"<position name="drive" joint="bend" kp="8" forcerange="-2 2"/>"#, "-2 2", "0.5"),
        (r#"<position name="drive" joint="bend" kp="8" gear="2" forcerange="-2 2"/>"#, "-2 2", "1"),
        // The joint feels twice the limit.
        (r#"<position name="drive" joint="bend" kp="8" gear="2"/>"#, "-0.5 0.5", "0.25"),
        // A joint that is slow because of its servo's velocity feedback needs no damping.
        (r#"<position name="drive" joint="bend" kp="8" kv="2"/>"#, "-1 1", "0.1"),
    ] {
        let (imported, notes) = read(&text(servo));
        let actuators = every(&imported, "actuator")[0];
        let made = |name| actuators.children.iter().filter_map(XMLNode::as_element).find(|e| value(e, "name") == name);
        assert_eq!(value(made("drive").unwrap(), "forcerange"), limit, "{servo}: {notes}");
        assert_eq!(value(made("slow").unwrap(), "forcerange"), "-0.3 0.3");
        let joint =
            |name: &str| every(&imported, "joint").into_iter().find(|joint| value(joint, "name") == name).unwrap();
        assert_eq!((value(joint("bend"), "damping"), value(joint("bend"), "armature")), (damping, "0.001"), "{servo}");
        assert_eq!((value(joint("tip"), "damping"), value(joint("tip"), "armature")), ("0.1", "0.002"));
        assert!(every(&imported, "geom").iter().any(|geom| value(geom, "solref") == "0.008 1"));
        assert_eq!(notes.matches("servos were bounded").count(), 1, "{notes}");
    }
}

/// A tendon over two joints pulls at both; a motor is no servo.
#[test]
fn servos_on_tendons_are_bounded_and_motors_are_not() {
    let tendon = "<tendon><fixed name=\"sum\"><joint joint=\"bend\" coef=\"0.5\"/></fixed></tendon>";
    let pull = r#"<position name="drive" tendon="sum" kp="40" ctrlrange="0 1"/>"#;
    let (imported, notes) = read(&plain(tendon).replace(DRIVE, pull));
    assert_eq!(value(every(&imported, "position")[0], "forcerange"), "-2 2", "{notes}");
    let damping = |imported: &Imported| {
        let joint = every(imported, "joint").into_iter().find(|joint| value(joint, "name") == "bend");
        value(joint.unwrap(), "damping").to_owned()
    };
    assert_eq!(damping(&imported), "0.25");
    let (imported, notes) = read(&plain(""));
    assert_eq!(damping(&imported), "0.1");
    assert!(!notes.contains("bounded"), "{notes}");
}

/// A wrist may be as strong as the fingers that it carries need.
#[test]
fn a_wrist_keeps_its_torque() {
    let finger =
        |name: &str| format!(r#"<body><joint name="{name}" range="0 1" damping="1"/><geom size="0.01"/></body>"#);
    let servo = |joint: &str| format!(r#"<position name="{joint}" joint="{joint}" kp="100" forcerange="-20 20"/>"#);
    let text = plain("")
        .replace("<site name=\"end\"", &format!("{}{}<site name=\"end\"", finger("a"), finger("b")))
        .replace(DRIVE, &["bend", "a", "b"].map(servo).concat());
    let (imported, notes) = read(&text);
    let limits: Vec<&str> = every(&imported, "position").iter().map(|servo| value(servo, "forcerange")).collect();
    assert_eq!(limits, ["-20 20", "-1 1", "-1 1"], "{notes}");
}

#[test]
fn engine_plugins_that_only_sensors_use_are_left_out() {
    let sensor = "<extension><plugin plugin=\"mujoco.sensor.touch_grid\"/></extension>
        <sensor><plugin plugin=\"mujoco.sensor.touch_grid\" objtype=\"site\" objname=\"end\"/></sensor>";
    let (imported, notes) = read(&plain(sensor));
    assert!(every(&imported, "extension").is_empty() && notes.contains("<extension> was removed"), "{notes}");
}

/// A part of a scene whose main file says `angle="radian"`, and one that cannot be meant so.
#[test]
fn small_ranges_without_a_unit_are_radians() {
    let unsaid = plain("").replace(" angle=\"radian\"", "");
    let (imported, notes) = read(&unsaid);
    assert!(every(&imported, "compiler").iter().any(|compiler| value(compiler, "angle") == "radian"));
    assert!(notes.contains("radians were assumed"), "{notes}");
    let (imported, notes) = read(&unsaid.replace("range=\"0 1\"", "range=\"0 90\""));
    assert!(every(&imported, "compiler").iter().all(|compiler| value(compiler, "angle").is_empty()), "{notes}");
    // Ranges in metres say nothing about angles, wherever the joint's type stands.
    let slide = unsaid.replace("<worldbody>", "<default><joint type=\"slide\"/></default><worldbody>");
    let (imported, notes) = read(&slide);
    assert!(every(&imported, "compiler").iter().all(|compiler| value(compiler, "angle").is_empty()), "{notes}");
}

/// An object on joints of its own, as tasks have it.
#[test]
fn what_no_actuator_moves_is_an_object() {
    let door = r#"<worldbody><body name="door"><joint name="hinge"/><geom size="0.1"/></body></worldbody>"#;
    let (imported, notes) = read(&plain(door));
    let bodies: Vec<&str> = every(&imported, "body").iter().map(|body| value(body, "name")).collect();
    assert_eq!(bodies, ["base", "finger"]);
    assert!(notes.contains("the object `door`, which no actuator moves"), "{notes}");
    // A part that a tendon through sites moves is the hand's.
    let finger = r#"<worldbody><body name="digit"><joint name="hinge"/><geom size="0.1"/><site name="knuckle"/></body></worldbody>
        <tendon><spatial name="string"><site site="end"/><site site="knuckle"/></spatial></tendon>"#;
    assert!(every(&read(&plain(finger)).0, "body").iter().any(|body| value(body, "name") == "digit"));
    // So is one that is tied by its site, geom or joint, or that a force acts on from the other's frame.
    let part = r#"<worldbody><body name="digit"><joint name="hinge"/><geom name="nail" size="0.1"/><site name="knuckle"/></body></worldbody>"#;
    for tie in [
        r#"<equality><connect site1="end" site2="knuckle"/></equality>"#,
        r#"<equality><distance geom1="pad" geom2="nail"/></equality>"#,
        r#"<actuator><general name="pull" site="end" refsite="knuckle"/></actuator>"#,
        r#"<actuator><motor name="pull" jointinparent="hinge"/></actuator>"#,
    ] {
        let (imported, notes) = read(&plain(&format!("{part}{tie}")));
        assert!(every(&imported, "body").iter().any(|body| value(body, "name") == "digit"), "{tie}: {notes}");
    }
    // A name of another kind of part ties nothing.
    let namesake = r#"<worldbody><body name="bend"><joint name="hinge"/><geom size="0.1"/></body></worldbody>"#;
    assert!(every(&read(&plain(namesake)).0, "body").iter().all(|body| value(body, "name") != "bend"));
    // So is one that a coupling moves.
    let coupled = format!(r#"{door}<equality><joint joint1="hinge" joint2="bend"/></equality>"#);
    assert!(every(&read(&plain(&coupled)).0, "body").iter().any(|body| value(body, "name") == "door"));
}

/// The type may stand in the class of the part, or of the bodies around it.
#[test]
fn floors_and_free_objects_are_known_by_their_class() {
    let classes = r#"<default><default class="floor"><geom type="plane"/></default>
        <default class="loose"><joint type="free"/></default></default><worldbody><geom name="ground" class="floor" size="1 1 1"/>
        <body name="ball" childclass="loose"><joint name="flies"/><geom size="0.02"/></body></worldbody>"#;
    let (imported, notes) = read(&plain(classes));
    let bodies: Vec<&str> = every(&imported, "body").iter().map(|body| value(body, "name")).collect();
    assert_eq!(bodies, ["base", "finger"]);
    assert!(notes.contains("the floor `ground`") && notes.contains("the free object `ball`"), "{notes}");
}

/// A comment in Latin-1, in the file and in one that it includes, and a byte-order mark.
#[test]
fn files_need_not_be_utf_8() {
    let files = Files::new("");
    let text = plain("<include file=\"more.xml\"/>");
    std::fs::write(files.path(), [b"<!-- M\xfcller -->".as_slice(), text.as_bytes()].concat()).unwrap();
    let more = files.path().with_file_name("more.xml");
    std::fs::write(&more, b"\xef\xbb\xbf<?xml version=\"1.0\"?><mujocoinclude><!-- gr\xfcn --></mujocoinclude>")
        .unwrap();
    let (imported, notes) = files.import();
    assert_eq!(every(&imported.unwrap(), "joint").len(), 1);
    assert!(notes.contains("hand.xml is not UTF-8") && notes.contains("more.xml is not UTF-8"), "{notes}");
    std::fs::write(&more, "\u{feff}<?xml version=\"1.0\"?><mujocoinclude/>").unwrap();
    let (imported, notes) = files.import();
    assert!(imported.is_ok() && !notes.contains("more.xml"), "{notes}");
}

#[test]
fn a_licence_may_stand_before_the_declaration() {
    let (imported, _) = read(&format!("<!-- free -->\n<?xml version=\"1.0\"?>\n{}", plain("")));
    assert_eq!(every(&imported, "joint").len(), 1);
}

/// A pair of antagonists on one joint, one on a tendon, and one whose target's name another actuator has.
#[test]
fn actuators_without_a_name_get_one_of_their_own() {
    let text = plain("<tendon><fixed name=\"sum\"><joint joint=\"bend\" coef=\"1\"/></fixed></tendon>").replace(
        "<motor name=\"drive\" joint=\"bend\"",
        "<motor name=\"bend\" joint=\"bend\"/><motor joint=\"bend\" gear=\"-1\"/><motor tendon=\"sum\"/><motor joint=\"bend\"",
    );
    let (imported, notes) = read(&text);
    let names: Vec<&str> = every(&imported, "motor").iter().map(|motor| value(motor, "name")).collect();
    assert_eq!(names, ["bend", "bend_2", "sum", "bend_3"]);
    assert!(notes.contains("actuator `bend_2`, actuator `sum`, actuator `bend_3`"), "{notes}");
}

#[test]
fn what_refers_to_parts_that_are_gone_is_named() {
    let gone = r#"<equality><connect name="hook" body1="finger" body2="ball"/><weld body1="ball"/></equality>"#;
    let (imported, notes) = read(&plain(gone));
    assert!(every(&imported, "connect").is_empty() && every(&imported, "weld").is_empty());
    assert!(notes.contains("equality <connect> `hook`, equality <weld>"), "{notes}");
}

#[test]
fn the_actuators_of_an_arm_go_with_it() {
    let arm = plain("").replace("<motor name=\"drive\" joint=", "<motor name=\"drive\" jointinparent=");
    let (mut imported, mut notes) = (read(&arm).0, Vec::new());
    imported.leave_out_arm("finger", &["bend".to_owned()], &mut notes);
    assert!(every(&imported, "motor").is_empty() && notes.concat().contains("<motor> `drive`"), "{notes:?}");
}

#[test]
fn connections_between_sites_become_connections_between_bodies() {
    let (imported, _) = read(&plain(r#"<equality><connect site1="end" site2="end"/></equality>"#));
    let connect = every(&imported, "connect")[0];
    assert_eq!(
        (value(connect, "body1"), value(connect, "body2"), value(connect, "anchor")),
        ("finger", "finger", "0 0 0.05")
    );
    assert!(!connect.attributes.contains_key("site1"));
}

#[test]
fn parts_in_the_world_are_put_into_one_body() {
    let text = plain("")
        .replace("<body name=\"base\"><geom size=\"0.03\"/>", "<geom size=\"0.03\"/>")
        .replace("</body></body>", "</body>");
    let (imported, notes) = read(&text);
    let bodies: Vec<&str> = every(&imported, "body").iter().map(|body| value(body, "name")).collect();
    assert_eq!(bodies, ["base", "finger"]);
    assert!(notes.contains("one body `base`"), "{notes}");
}

#[test]
fn what_cannot_be_kept_is_refused_with_the_reason() {
    for (text, said) in [
        (
            plain("<extension><plugin plugin=\"mujoco.pid\"/></extension>")
                .replace(DRIVE, "<plugin plugin=\"mujoco.pid\" joint=\"bend\"/>"),
            "engine plugins",
        ),
        (plain(r#"<equality><weld name="w" site1="end" site2="end"/></equality>"#), "body1, body2 and relpose"),
        (plain("<worldbody><frame pos=\"0 0 1\"/></worldbody>"), "frames"),
        (plain("<worldbody><replicate count=\"3\"/></worldbody>"), "models made of models"),
        (plain("").replace("angle=\"radian\"", "coordinate=\"global\""), "local coordinates"),
        (plain("<asset><mesh file=\"absent.stl\"/></asset>"), "absent.stl does not exist"),
        ("<model/>".to_owned(), "<mujoco> (MJCF) or <robot> (URDF)"),
        ("<mujocoinclude><body/></mujocoinclude>".to_owned(), "name the file that includes it"),
        (plain("").replace("<joint name=\"bend\" range=\"0 1\" damping=\"0.1\"/>", ""), "at least one joint"),
        (String::new(), "no element"),
    ] {
        let files = Files::new(&text);
        let (result, _) = files.import();
        let message = result.unwrap_err().to_string();
        assert!(message.contains(said) && message.contains("hand.xml"), "{said}: {message}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_never_panic(
        edits in prop::collection::vec((any::<usize>(), 0..20_usize, any::<usize>()), 1..6),
    ) {
        let files = Files::new(&mutate(CROWDED, PIECES, &edits));
        let _ = files.import();
    }
}
