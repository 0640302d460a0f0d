//! Every message names the file, the place and what is expected.

use crate::fixture::Fixture;

fn manifest_message(from: &str, to: &str) -> String {
    let hand = Fixture::new();
    hand.edit("hand.toml", from, to);
    hand.message()
}

fn model_message(from: &str, to: &str) -> String {
    let hand = Fixture::new();
    hand.edit("pincer.xml", from, to);
    hand.message()
}

#[test]
fn unknown_key_names_the_nearest() {
    assert_eq!(
        manifest_message("position = [", "positon = ["),
        "DIR/hand.toml: unknown key `mount.positon` (did you mean `position`?); known here: position, quaternion, euler_deg"
    );
}

#[test]
fn unknown_table_lists_the_known_keys() {
    let message = manifest_message("[open_posture]", "[qqq]");
    assert!(
        message.starts_with("DIR/hand.toml: unknown key `qqq`; known here: schema, name, description"),
        "{message}"
    );
}

#[test]
fn missing_key() {
    assert_eq!(
        manifest_message("palm = \"base\"\n", ""),
        "DIR/hand.toml: key `palm` is missing; expected the name of the palm's body, in quotes"
    );
    assert_eq!(
        manifest_message("position = [0.0, 0.0, 0.2]\n", ""),
        "DIR/hand.toml: key `mount.position` is missing; expected three numbers [x, y, z] in metres"
    );
}

#[test]
fn wrong_type_and_wrong_value() {
    assert_eq!(
        manifest_message("[0.0, 0.0, 0.2]", "[0.0, 0.2]"),
        "DIR/hand.toml: key `mount.position`: expected three numbers [x, y, z] in metres, got [0.0, 0.2]"
    );
    assert_eq!(
        manifest_message("schema = 1", "schema = 2"),
        "DIR/hand.toml: key `schema`: expected the integer 1, got 2"
    );
    assert_eq!(
        manifest_message("\"pincer\"", "\"../x\""),
        "DIR/hand.toml: key `name`: expected a name of lower-case letters, digits, `-` and `_`, in quotes, got \"../x\""
    );
    assert_eq!(
        manifest_message("[open_posture]", "[slide]\nstart = 0.5\n[open_posture]"),
        "DIR/hand.toml: key `slide.start`: expected a number of metres inside slide.range, got 0.5"
    );
    assert_eq!(
        manifest_message("[open_posture]", "[slide]\nkp = nan\n[open_posture]"),
        "DIR/hand.toml: key `slide.kp`: expected a positive number (N/m), got nan"
    );
    assert_eq!(
        manifest_message("[open_posture]", "[scripted_grasps]\ntried = 14\nlifted = 15\nreached = 3\n[open_posture]"),
        "DIR/hand.toml: key `scripted_grasps.lifted`: expected a number of grasps, at most those that were tried, got 15"
    );
    assert_eq!(
        manifest_message("left_near_joint = 0.5", "left_near_joint = 90"),
        "DIR/hand.toml: key `open_posture.left_near_joint`: expected a value from -1.5707963267948966 to 1.5707963267948966 (rad), got 90"
    );
    assert_eq!(
        manifest_message("left_near_joint = 0.5", "slide = 0.1"),
        "DIR/hand.toml: key `open_posture.slide`: expected joints of the model only; the slide's start is `slide.start`, got 0.1"
    );
    assert_eq!(
        manifest_message("0.2]\n", "0.2]\nquaternion = [1, 0, 0, 0]\neuler_deg = [0, 0, 0]\n"),
        "DIR/hand.toml: key `mount`: expected either `quaternion` or `euler_deg`, got both"
    );
}

#[test]
fn missing_files() {
    assert_eq!(manifest_message("pincer.xml", "gone.xml"), "DIR/hand.toml: `model`: file DIR/gone.xml does not exist");
    assert_eq!(
        model_message("pad.obj", "gone.obj"),
        "DIR/pincer.xml: `mesh file`: file DIR/meshes/gone.obj does not exist"
    );
    assert_eq!(
        model_message("drives.xml", "gone.xml"),
        "DIR/pincer.xml: `include file`: file DIR/gone.xml does not exist"
    );
    let hand = Fixture::new();
    std::fs::remove_file(hand.path("hand.toml")).unwrap();
    assert_eq!(hand.message(), "DIR: no hand.toml in this directory; name a directory that holds one");
}

#[test]
fn paths_stay_inside() {
    for outside in ["../pincer.xml", "/etc/passwd", "meshes/../../pincer.xml"] {
        assert_eq!(
            manifest_message("pincer.xml", outside),
            format!(
                "DIR/hand.toml: `model`: path `{outside}` leads out of the hand's directory DIR; copy the file into it"
            )
        );
    }
    assert_eq!(
        model_message("pad.obj", "../../pad.obj"),
        "DIR/pincer.xml: `mesh file`: path `meshes/../../pad.obj` leads out of the hand's directory DIR; copy the file into it"
    );
    assert_eq!(
        model_message("drives.xml", "/etc/hostname"),
        "DIR/pincer.xml: `include file`: path `/etc/hostname` leads out of the hand's directory DIR; copy the file into it"
    );
}

#[cfg(unix)]
#[test]
fn a_link_out_of_the_directory_is_refused() {
    let hand = Fixture::new();
    let outside = tempfile::NamedTempFile::new().unwrap();
    std::fs::remove_file(hand.path("drives.xml")).unwrap();
    std::os::unix::fs::symlink(outside.path(), hand.path("drives.xml")).unwrap();
    assert_eq!(
        hand.message(),
        "DIR/pincer.xml: `include file`: path `drives.xml` leads out of the hand's directory DIR; copy the file into it"
    );
}

#[test]
fn names_that_do_not_resolve() {
    assert_eq!(
        manifest_message("\"base\"", "\"bsae\""),
        "DIR/hand.toml: `palm`: expected the name of a body of the model, got `bsae` (did you mean `base`?)"
    );
    assert_eq!(
        manifest_message("\"left_tip\"", "\"left_tap\""),
        "DIR/hand.toml: `fingertips[0]`: expected the name of a site or body of the model, got `left_tap` (did you mean `left_tip`?)"
    );
    assert_eq!(
        manifest_message("left_near_joint = 0.5", "left_naer_joint = 0.5"),
        "DIR/hand.toml: `open_posture.left_naer_joint`: expected the name of a joint of the model, got `left_naer_joint` (did you mean `left_near_joint`?)"
    );
    assert_eq!(
        manifest_message("[mount]", "posture_joints = [\"slide\", \"zzz\"]\n[mount]"),
        "DIR/hand.toml: `posture_joints[1]`: expected the name of a joint of the model or the slide, got `zzz`"
    );
    assert_eq!(
        model_message("joint1=\"left_far_joint\"", "joint1=\"left_far\""),
        "DIR/pincer.xml: `equality `left_far` joint1`: expected the name of a joint of the model, got `left_far` (did you mean `left_far_joint`?)"
    );
    assert_eq!(
        model_message("childclass=\"far\"", "childclass=\"fur\""),
        "DIR/pincer.xml: `joint `left_far_joint` class`: expected the name of a default class, got `fur` (did you mean `far`?)"
    );
    let hand = Fixture::new();
    hand.edit("drives.xml", "tendon=\"both\"", "tendon=\"bath\"");
    assert_eq!(
        hand.message(),
        "DIR/pincer.xml: `actuator `right_drive` tendon`: expected the name of a tendon of the model, got `bath` (did you mean `both`?)"
    );
}

#[test]
fn names_that_clash() {
    assert_eq!(
        model_message("name=\"right_far_joint\"", "name=\"left_far_joint\""),
        "DIR/pincer.xml: joint `left_far_joint`: expected distinct names, got this name twice"
    );
    assert_eq!(
        manifest_message("[mount]", "[slide]\nname = \"left_drive\"\n[mount]"),
        "DIR/hand.toml: key `slide.name`: expected a name that no joint or actuator of the model has, got \"left_drive\""
    );
}

#[test]
fn models_that_cannot_be_a_hand() {
    assert_eq!(
        model_message("range=\"10 20\"", "range=\"20 10\""),
        "DIR/pincer.xml: joint `right_far_joint` range: expected two numbers, the lower first, got [20.0, 10.0]"
    );
    assert_eq!(
        model_message("type=\"slide\"", "type=\"ball\""),
        "DIR/pincer.xml: joint `right_near_joint` type: expected `hinge` or `slide`, got `ball`"
    );
    assert_eq!(
        model_message("<body name=\"base\">", "<body name=\"base\"><freejoint/>"),
        "DIR/pincer.xml: body `base`: expected hinge and slide joints, got a free joint; remove it, the mount carries the hand"
    );
    assert_eq!(
        model_message("<compiler", "<include file=\"drives.xml\"/><compiler"),
        "DIR/pincer.xml: <include>: expected each file included once, got `drives.xml` a second time"
    );
    assert!(model_message("</mujoco>", "").starts_with("DIR/pincer.xml: not valid XML: "));
    assert_eq!(
        model_message("<mujoco>", &format!("<mujoco>{}", "<a>".repeat(100_000))),
        "DIR/pincer.xml: not valid XML: elements nested deeper than 200"
    );
    let hand = Fixture::new();
    hand.edit(
        "drives.xml",
        "<position name=\"right_drive\" tendon=\"both\"/>",
        "<motor name=\"m\" joint=\"right_far_joint\" ctrllimited=\"false\"/>",
    );
    assert_eq!(
        hand.message(),
        "DIR/pincer.xml: motor `m` ctrlrange: expected two numbers with ctrllimited=\"true\", got none"
    );
}

#[test]
fn numbers_that_are_not_finite_are_refused_when_they_are_read() {
    for (bad, shown) in [("nan", "nan"), ("0.01 inf", "0.01 inf"), ("1e400", "1e400"), ("-Infinity", "-Infinity")] {
        let message = model_message(
            "<geom size=\"0.01\"/>\n          <site",
            &format!("<geom size=\"{bad}\"/>\n          <site"),
        );
        assert_eq!(message, format!("DIR/pincer.xml: geom size: expected finite numbers, got {shown}"));
    }
    // A name is no number.
    let hand = Fixture::new();
    hand.edit("pincer.xml", "<body name=\"left_far\" ", "<body name=\"inf\" ");
    hand.load().unwrap();
}

#[test]
fn a_model_of_too_many_parts_is_refused() {
    for (part, most) in [("<joint axis=\"1 0 0\"/>", 200), ("<body/>", 1000), ("<geom size=\"0.01\"/>", 5000)] {
        let message =
            model_message("<site name=\"left_tip\"/>", &format!("<site name=\"left_tip\"/>{}", part.repeat(most + 1)));
        assert!(message.contains(&format!("expected at most {most} of them")), "{message}");
    }
}
