//! URDF files, sound, odd and broken, become MJCF or an error that says what is wrong.

use std::path::{Path, PathBuf};

use eigenhand_hands::xmltree::{Element, XMLNode};
use eigenhand_hands::{HandError, ImportOptions, Imported, import};
use proptest::prelude::*;

use crate::mutation::mutate;

mod corpus;

/// A palm with one finger of two joints, the second following the first, and a tip on a fixed joint.
const FINGER: &str = r#"<?xml version="1.0"?>
<robot name="pendulum" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <!-- ${not} a value -->
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="palm">
    <inertial><origin xyz="0 0 0.01"/><mass value="0.4"/><inertia ixx="4e-4" ixy="0" ixz="0" iyy="4e-4" iyz="0" izz="4e-4"/></inertial>
    <collision><geometry><box size="0.08 0.02 0.1"/></geometry></collision>
  </link>
  <joint name="base" type="revolute">
    <origin xyz="0.03 0 0.05" rpy="0 0 1.5707963267948966"/>
    <parent link="palm"/><child link="proximal"/><axis xyz="0 2 0"/>
    <limit lower="0" upper="1.5" effort="2.5" velocity="3"/><dynamics damping="0.02" friction="0.01"/>
  </joint>
  <link name="proximal">
    <inertial><mass value="0.05"/><inertia ixx="2e-5" ixy="0" ixz="0" iyy="2e-5" iyz="0" izz="4e-6"/></inertial>
    <collision><origin xyz="0 0 0.02"/><geometry><cylinder radius="0.01" length="0.04"/></geometry></collision>
  </link>
  <joint name="coupled" type="revolute">
    <origin xyz="0 0 0.04"/><parent link="proximal"/><child link="distal"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="1.7" effort="0"/><mimic joint="base" multiplier="1.1" offset="0.05"/>
  </joint>
  <link name="distal">
    <inertial><mass value="0.03"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="2e-6"/></inertial>
    <collision><geometry><sphere radius="0.01"/></geometry></collision>
  </link>
  <joint name="tip_joint" type="fixed"><origin xyz="0 0 0.03"/><parent link="distal"/><child link="tip"/></joint>
  <link name="tip"/>
  <transmission name="t"><joint name="base"/><actuator name="a"/></transmission>
  <gazebo reference="palm"><mu1>0.2</mu1></gazebo>
</robot>
"#;

struct Robot {
    directory: tempfile::TempDir,
}

impl Robot {
    fn new(urdf: &str) -> Self {
        let robot = Self { directory: tempfile::tempdir().unwrap() };
        robot.write("urdf/robot.urdf", urdf.as_bytes());
        robot
    }

    fn write(&self, path: &str, bytes: &[u8]) {
        let path = self.directory.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }

    fn file(&self) -> PathBuf {
        self.directory.path().join("urdf/robot.urdf")
    }

    fn import(&self) -> Result<Converted, HandError> {
        let (imported, notes) = read(&self.file());
        imported.map(|imported| Converted { imported, notes })
    }
}

/// A model and what was said while it was read.
#[derive(Debug)]
struct Converted {
    imported: Imported,
    notes: Vec<String>,
}

impl std::ops::Deref for Converted {
    type Target = Imported;

    fn deref(&self) -> &Imported {
        &self.imported
    }
}

fn convert(urdf: &str) -> Converted {
    Robot::new(urdf).import().unwrap()
}

fn refusal(urdf: &str) -> String {
    let robot = Robot::new(urdf);
    let message = robot.import().unwrap_err().to_string();
    assert!(message.contains("robot.urdf"), "names the file: {message}");
    assert!(!message.contains('\n'), "is one line: {message}");
    message
}

/// All elements named `name`, in the order of the file.
fn all<'a>(root: &'a Element, name: &str) -> Vec<&'a Element> {
    let mut found = Vec::new();
    for child in root.children.iter().filter_map(XMLNode::as_element) {
        if child.name == name {
            found.push(child);
        }
        found.extend(all(child, name));
    }
    found
}

fn body<'a>(imported: &'a Imported, name: &str) -> &'a Element {
    all(&imported.model, "body").into_iter().find(|b| b.attributes["name"] == name).unwrap()
}

fn numbers(element: &Element, key: &str) -> Vec<f64> {
    element.attributes[key].split_whitespace().map(|w| w.parse().unwrap()).collect()
}

fn has_note(converted: &Converted, words: &[&str]) -> bool {
    converted.notes.iter().any(|note| words.iter().all(|word| note.contains(word)))
}

#[track_caller]
fn assert_close(got: &[f64], expected: &[f64]) {
    assert_eq!(got.len(), expected.len());
    assert!(got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{got:?} is not {expected:?}");
}

#[test]
fn a_finger_keeps_its_links_joints_and_numbers() {
    let imported = convert(FINGER);
    let model = &imported.model;
    assert_eq!(model.get_child("compiler").unwrap().attributes["angle"], "radian");
    let names: Vec<&str> = all(model, "body").iter().map(|b| b.attributes["name"].as_str()).collect();
    assert_eq!(names, ["palm", "proximal", "distal", "tip"]);
    let base = body(&imported, "proximal").get_child("joint").unwrap();
    assert_eq!(base.attributes["name"], "base");
    assert_eq!(base.attributes["type"], "hinge");
    assert_close(&numbers(base, "axis"), &[0.0, 1.0, 0.0]);
    assert_close(&numbers(base, "range"), &[0.0, 1.5]);
    // The file's 0.02 is too little for a servo of 2.5 N m.
    assert_close(&numbers(base, "damping"), &[0.5]);
    assert_close(&numbers(base, "frictionloss"), &[0.01]);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    assert_close(&numbers(body(&imported, "proximal"), "quat"), &[half, 0.0, 0.0, half]);
    assert_close(&numbers(body(&imported, "palm").get_child("geom").unwrap(), "size"), &[0.04, 0.01, 0.05]);
    assert_close(&numbers(body(&imported, "proximal").get_child("geom").unwrap(), "size"), &[0.01, 0.02]);
    assert_close(&numbers(body(&imported, "distal").get_child("joint").unwrap(), "damping"), &[0.02]);
    assert_eq!(imported.imported.efforts.into_iter().collect::<Vec<_>>(), [("base".to_owned(), 2.5)]);
}

#[test]
fn a_fixed_tip_stays_a_body_without_joint_and_mass() {
    let imported = convert(FINGER);
    let tip = body(&imported, "tip");
    assert!(tip.children.is_empty());
    assert_close(&numbers(tip, "pos"), &[0.0, 0.0, 0.03]);
}

#[test]
fn an_inertial_outside_of_its_link_is_said() {
    let imported = convert(&FINGER.replace("</robot>", "<inertial><mass value=\"1.3\"/></inertial></robot>"));
    assert!(has_note(&imported, &["outside of links and joints", "<inertial>"]));
    assert!(!has_note(&convert(FINGER), &["outside"]));
}

#[test]
fn mimic_becomes_an_equality_with_the_driver() {
    let imported = convert(FINGER);
    let equality = all(imported.model.get_child("equality").unwrap(), "joint");
    assert_eq!(equality.len(), 1);
    assert_eq!((&*equality[0].attributes["joint1"], &*equality[0].attributes["joint2"]), ("coupled", "base"));
    assert_close(&numbers(equality[0], "polycoef"), &[0.05, 1.1, 0.0, 0.0, 0.0]);
}

#[test]
fn a_chain_of_mimics_ends_at_the_joint_that_moves_by_itself() {
    let third = r#"<joint name="third" type="continuous"><parent link="tip"/><child link="end"/><axis xyz="1 0 0"/>
        <mimic joint="coupled" multiplier="2" offset="1"/></joint><link name="end"/></robot>"#;
    let imported = convert(&FINGER.replace("</robot>", third));
    let equality = all(imported.model.get_child("equality").unwrap(), "joint");
    assert_eq!(equality[1].attributes["joint2"], "base");
    assert_close(&numbers(equality[1], "polycoef"), &[1.0 + 2.0 * 0.05, 2.0 * 1.1, 0.0, 0.0, 0.0]);

    let cycle = FINGER.replace("<dynamics damping", "<mimic joint=\"coupled\"/><dynamics damping");
    assert!(refusal(&cycle).contains("a cycle"));
    let unknown = refusal(&FINGER.replace("mimic joint=\"base\"", "mimic joint=\"bass\""));
    assert!(unknown.contains("`bass`") && unknown.contains("did you mean `base`"), "{unknown}");
    assert!(unknown.contains("coupled"), "{unknown}");
}

#[test]
fn neighbours_do_not_touch() {
    let sphere = "<link name=\"tip\"><collision><geometry><sphere radius=\"0.01\"/></geometry></collision></link>";
    let imported = convert(&FINGER.replace("<link name=\"tip\"/>", sphere));
    let pairs: Vec<(&str, &str)> = all(&imported.model, "exclude")
        .iter()
        .map(|e| (e.attributes["body1"].as_str(), e.attributes["body2"].as_str()))
        .collect();
    assert_eq!(
        pairs,
        [("palm", "proximal"), ("distal", "tip"), ("proximal", "distal"), ("proximal", "tip")],
        "within a rigid group and across one joint, and no further"
    );
}

#[test]
fn a_link_without_geometry_between_two_joints_joins_its_neighbours() {
    let bare = FINGER.replace(
        "<collision><origin xyz=\"0 0 0.02\"/><geometry><cylinder radius=\"0.01\" length=\"0.04\"/></geometry></collision>",
        "",
    );
    let excludes = convert(&bare);
    let pair = all(&excludes.model, "exclude")[0];
    assert_eq!((&*pair.attributes["body1"], &*pair.attributes["body2"]), ("palm", "distal"));
}

#[test]
fn limits_are_read_with_sense() {
    let limits = |limit: &str| {
        let imported =
            convert(&FINGER.replace("<limit lower=\"0\" upper=\"1.5\" effort=\"2.5\" velocity=\"3\"/>", limit));
        let joint = body(&imported, "proximal").get_child("joint").map(|j| j.attributes.get("range").cloned());
        (joint, imported.notes.join("\n"))
    };
    assert_eq!(limits("").0, Some(None));
    assert_eq!(limits("<limit effort=\"1\" velocity=\"1\"/>").0, Some(None));
    let (range, notes) = limits("<limit lower=\"1.5\" upper=\"-0.5\" velocity=\"1\"/>");
    assert_eq!(range, Some(Some("-0.5 1.5".to_owned())));
    assert!(
        notes.contains("limits were swapped, because the lower was above the upper, at the joints: base"),
        "{notes}"
    );
    let (fixed, notes) = limits("<limit lower=\"0.5\" upper=\"0.5\" velocity=\"1\"/>");
    assert_eq!(fixed, None);
    assert!(notes.contains("fixed there: base"), "{notes}");
}

#[test]
fn inertias_that_no_body_can_have_are_mended() {
    let broken = FINGER
        .replace("ixx=\"2e-5\" ixy=\"0\" ixz=\"0\" iyy=\"2e-5\"", "ixx=\"1e-6\" ixy=\"0\" ixz=\"0\" iyy=\"-1\"")
        .replace("<mass value=\"0.03\"/>", "<mass value=\"NaN\"/>");
    let imported = convert(&broken);
    assert!(has_note(&imported, &["raised", "proximal"]), "{:?}", imported.notes);
    assert!(has_note(&imported, &["computed from their size", "distal"]), "{:?}", imported.notes);
    for name in ["palm", "proximal", "distal"] {
        let inertial = body(&imported, name).get_child("inertial").unwrap();
        let mut moments = numbers(inertial, "diaginertia");
        moments.sort_by(f64::total_cmp);
        assert!(moments[0] > 0.0 && moments[0] + moments[1] >= moments[2], "{name}: {moments:?}");
        assert!(numbers(inertial, "mass")[0] > 0.0);
    }
}

#[test]
fn a_tensor_is_turned_to_its_principal_axes() {
    let turned = FINGER.replace(
        "<mass value=\"0.05\"/><inertia ixx=\"2e-5\" ixy=\"0\" ixz=\"0\" iyy=\"2e-5\" iyz=\"0\" izz=\"4e-6\"/>",
        "<origin xyz=\"0 0 0.02\" rpy=\"0.3 0.2 0.1\"/><mass value=\"0.05\"/>\
         <inertia ixx=\"3e-5\" ixy=\"1e-6\" ixz=\"-2e-6\" iyy=\"2e-5\" iyz=\"3e-6\" izz=\"2.5e-5\"/>",
    );
    let imported = convert(&turned);
    let inertial = body(&imported, "proximal").get_child("inertial").unwrap();
    let (q, m) = (numbers(inertial, "quat"), numbers(inertial, "diaginertia"));
    let got = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]));
    let rotation = nalgebra::UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1).inverse() * got;
    let axes = rotation.to_rotation_matrix();
    let tensor = axes * nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(m[0], m[1], m[2])) * axes.inverse();
    let expected = nalgebra::Matrix3::new(3e-5, 1e-6, -2e-6, 1e-6, 2e-5, 3e-6, -2e-6, 3e-6, 2.5e-5);
    assert!((tensor - expected).abs().max() < 1e-15, "{tensor}");
}

#[test]
fn xacro_is_refused_with_the_way_out() {
    for xacro in [
        FINGER.replace("<link name=\"tip\"/>", "<xacro:tip/><link name=\"tip\"/>"),
        FINGER.replace("radius=\"0.01\"", "radius=\"${r}\""),
        FINGER.replace("name=\"tip\"", "name=\"$(arg tip)\""),
        "<robot name=\"a\"><xacro:undeclared/></robot>".to_owned(),
    ] {
        let message = refusal(&xacro);
        assert!(message.contains("xacro in.xacro > out.urdf"), "{message}");
    }
}

#[test]
fn a_comment_before_the_declaration_is_skipped_and_said() {
    let imported = convert(&format!("<!-- licence -->\n\n{FINGER}"));
    assert!(has_note(&imported, &["a comment before the XML declaration, which XML forbids, was skipped"]));
    assert_eq!(all(&imported.model, "body").len(), 4);
    assert!(!has_note(&convert(FINGER), &["comment"]));
}

#[test]
fn prefixes_need_no_declaration() {
    let drake = FINGER.replace("<material ", "<drake:group name=\"a\" drake:kind=\"b:c\"/><material ");
    assert_ne!(drake, FINGER);
    assert_eq!(convert(&drake).model, convert(FINGER).model);
    // The root is not what a comment says, and the prefix is not the beginning of another.
    let commented = drake.replace("<robot ", "<!-- a <robot of two --><robot xmlns:drakeling=\"d\" ");
    assert_ne!(commented, drake);
    assert_eq!(convert(&commented).model, convert(FINGER).model);
}

/// Parsers that compare each attribute or prefix with all others would take long for these.
#[test]
fn attributes_and_prefixes_without_end_change_nothing() {
    let many: String = (0..10_000).map(|i| format!(" a{i}=\"\" p{i}:a=\"\"")).collect();
    let robot = FINGER.replace("<link name=\"tip\"", &format!("<link name=\"tip\"{many}"));
    assert_ne!(robot, FINGER);
    assert_eq!(convert(&robot).model, convert(FINGER).model);
}

/// MuJoCo looks for a centre of mass where a body has several geoms without mass.
#[test]
fn a_fixed_link_without_inertia_says_that_it_has_none() {
    let shape = "<collision><geometry><sphere radius=\"0.01\"/></geometry></collision>";
    let imported =
        convert(&FINGER.replace("<link name=\"tip\"/>", &format!("<link name=\"tip\">{shape}{shape}</link>")));
    let tip = body(&imported, "tip");
    assert_eq!((all(tip, "geom").len(), numbers(all(tip, "inertial")[0], "mass")), (2, vec![0.0]));
}

#[test]
fn broken_trees_are_refused() {
    let link = |name: &str| format!("<link name=\"{name}\"/>");
    let joint = |name: &str, parent: &str, child: &str| {
        format!("<joint name=\"{name}\" type=\"fixed\"><parent link=\"{parent}\"/><child link=\"{child}\"/></joint>")
    };
    let robot = |parts: &[String]| format!("<robot name=\"r\">{}</robot>", parts.concat());
    let cases = [
        (robot(&[link("a"), link("b")]), "`a`, `b`"),
        (robot(&[link("a"), link("b"), joint("j", "a", "b"), joint("k", "b", "a")]), "cycle"),
        (robot(&[link("a"), link("b"), link("c"), joint("j", "b", "c"), joint("k", "c", "b")]), "a cycle of `b`, `c`"),
        (robot(&[link("a"), joint("j", "a", "a")]), "cycle"),
        (robot(&[link("a"), link("b"), joint("j", "palm", "b")]), "`palm`"),
        (robot(&[link("a"), link("b"), link("c"), joint("j", "a", "c"), joint("k", "b", "c")]), "`j` and `k`"),
        (robot(&[link("a"), link("a")]), "link `a`"),
        (robot(&[]), "<link>"),
        ("<mujoco/>".to_owned(), "at least one joint"),
        ("".to_owned(), "no element"),
    ];
    for (urdf, expected) in cases {
        let message = refusal(&urdf);
        assert!(message.contains(expected), "{message}");
    }
    let links: String = (0..300).map(|i| link(&i.to_string())).collect();
    let joints: String = (1..300).map(|i| joint(&format!("j{i}"), &(i - 1).to_string(), &i.to_string())).collect();
    assert!(refusal(&robot(&[links, joints])).contains("200"));
}

#[test]
fn broken_joints_and_numbers_name_their_owner() {
    let cases = [
        ("type=\"revolute\"", "type=\"floating\"", "type `floating`"),
        ("type=\"revolute\"", "type=\"planar\"", "type `planar`"),
        ("axis xyz=\"0 2 0\"", "axis xyz=\"0 0 0\"", "joint `base` <axis>"),
        ("xyz=\"0.03 0 0.05\"", "xyz=\"nan 0 0.05\"", "joint `base` <origin xyz>"),
        ("xyz=\"0.03 0 0.05\"", "xyz=\"inf 0 0.05\"", "joint `base` <origin xyz>"),
        ("upper=\"1.5\"", "upper=\"NaN\"", "joint `base` <limit>"),
        ("damping=\"0.02\"", "damping=\"NaN\"", "joint `base` damping"),
        ("box size=\"0.08", "box size=\"NaN", "link `palm` <collision> <box>"),
        ("multiplier=\"1.1\"", "multiplier=\"NaN\"", "joint `coupled` <mimic>"),
        ("<sphere radius=\"0.01\"/>", "", "link `distal` <collision>"),
    ];
    for (from, to, expected) in cases {
        assert!(FINGER.contains(from));
        let message = refusal(&FINGER.replacen(from, to, 1));
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn a_link_named_world_is_renamed() {
    let imported = convert(&FINGER.replace("\"palm\"", "\"world\""));
    assert_eq!(all(&imported.model, "body")[0].attributes["name"], "world_link");
    assert!(all(&imported.model, "exclude").iter().all(|e| e.attributes["body1"] != "world"));
}

#[test]
fn geometry_is_taken_from_what_is_seen_only_where_nothing_touches() {
    let imported = convert(&FINGER.replace("collision>", "visual>"));
    assert_eq!(all(&imported.model, "geom").len(), 3);
    assert!(has_note(&imported, &["no link has collision geometry"]));
    let visual = "<link name=\"tip\"><visual><geometry><sphere radius=\"1\"/></geometry></visual></link>";
    let imported = convert(&FINGER.replace("<link name=\"tip\"/>", visual));
    let solid = all(&imported.model, "geom").into_iter().filter(|geom| geom.attributes["contype"] != "0");
    assert_eq!(solid.count(), 3);
    assert!(has_note(&imported, &["touch nothing: tip"]));
}

#[test]
fn what_only_shows_does_not_change_which_hand_it_is() {
    let visual = "<visual><geometry><mesh filename=\"looks.obj\"/></geometry></visual>";
    let solid = "<collision><geometry><mesh filename=\"solid.obj\"/></geometry></collision>";
    let place = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(place.path().join(name), text).unwrap();
    write("robot.urdf", &FINGER.replace("<link name=\"palm\">", &format!("<link name=\"palm\">{visual}{solid}")));
    let manifest = "schema = 1\nname = \"pendulum\"\nmodel = \"robot.urdf\"\nformat = \"urdf\"\npalm = \"palm\"\n\
                    fingertips = [\"tip\"]\n[mount]\nposition = [0, 0, 0.2]\n";
    write("hand.toml", manifest);
    let digest = |looks: &str, solid: &str| {
        write("looks.obj", looks);
        write("solid.obj", solid);
        let hand = eigenhand_hands::Hand::load(place.path()).unwrap();
        (hand.assets.len(), hand.digest)
    };
    let larger = TETRAHEDRON.replace("v 1 0 0", "v 2 0 0");
    let before = digest(TETRAHEDRON, TETRAHEDRON);
    assert_eq!(before.0, 2);
    assert_eq!(digest(&larger, TETRAHEDRON), before, "another look");
    assert_ne!(digest(TETRAHEDRON, &larger), before, "another shape");
}

#[test]
fn what_only_shows_keeps_its_colour_and_touches_and_weighs_nothing() {
    let visual = |inside: &str, material: &str| format!("<visual><geometry>{inside}</geometry>{material}</visual>");
    let palm = visual("<mesh filename=\"looks.obj\"/>", "<material name=\"grey\"/>");
    let distal = visual("<mesh filename=\"gone.stl\"/>", "")
        + &visual("<box size=\"0.02 0.02 0.02\"/>", "<material name=\"red\"><color rgba=\"1 0 0 1\"/></material>");
    let urdf = FINGER
        .replace("<link name=\"palm\">", &format!("<link name=\"palm\">{palm}"))
        .replace("<link name=\"distal\">", &format!("<link name=\"distal\">{distal}"));
    let robot = Robot::new(&urdf);
    robot.write("urdf/looks.obj", TETRAHEDRON.as_bytes());
    let imported = robot.import().unwrap();
    let geom = |link: &str, kind: &str| {
        let mut own =
            body(&imported, link).children.iter().filter_map(XMLNode::as_element).filter(|e| e.name == "geom");
        own.find(|e| e.attributes["type"] == kind).unwrap().attributes.clone()
    };
    let looks = geom("palm", "mesh");
    assert_eq!(
        ["contype", "conaffinity", "group", "mass", "mesh", "rgba"].map(|key| looks[key].as_str()),
        ["0", "0", "2", "0", "palm_visual_0", "0.5 0.5 0.5 1"]
    );
    assert_eq!(imported.assets.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["palm_visual_0.stl"]);
    // MuJoCo's viewer hides what the looks cover, and only that.
    assert_eq!(geom("palm", "box")["group"], "3");
    assert!(!geom("proximal", "cylinder").contains_key("group"));
    assert_eq!(geom("distal", "box")["rgba"], "1 0 0 1");
    assert!(has_note(&imported, &["visual geometry", "left out", "distal"]));
}

/// A tetrahedron whose faces look outwards.
const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1/1/1 4//4 3\nf -3 -2 -1\n";

fn with_mesh(mesh: &str) -> String {
    FINGER.replace("<sphere radius=\"0.01\"/>", mesh)
}

fn triangles(stl: &[u8]) -> Vec<[nalgebra::Vector3<f32>; 3]> {
    let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
    assert_eq!(u32::from_le_bytes(stl[80..84].try_into().unwrap()) as usize * 50 + 84, stl.len());
    stl[84..]
        .chunks_exact(50)
        .map(|face| [0, 1, 2].map(|i| nalgebra::Vector3::from_fn(|k, _| number(&face[12 * (i + 1) + 4 * k..][..4]))))
        .collect()
}

fn volume(stl: &[u8]) -> f32 {
    triangles(stl).iter().map(|[a, b, c]| a.dot(&b.cross(c)) / 6.0).sum()
}

#[test]
fn meshes_are_found_scaled_and_shared() {
    let mesh = |scale: &str| format!("<mesh filename=\"package://hand/meshes/tip.obj\"{scale}/>");
    let twice = with_mesh(&mesh("")).replace("<cylinder radius=\"0.01\" length=\"0.04\"/>", &mesh(""));
    let robot = Robot::new(&twice);
    let message = robot.import().unwrap_err().to_string();
    assert!(message.contains("--package hand=DIR") && message.contains("`proximal`"), "{message}");

    // Beside the file's directory, under the package's name.
    robot.write("hand/meshes/tip.obj", TETRAHEDRON.as_bytes());
    let imported = robot.import().unwrap();
    assert_eq!(imported.assets.len(), 1, "one asset for one file");
    assert_eq!(all(&imported.model, "mesh")[0].attributes["file"], imported.assets[0].0);

    // Where the option says.
    let elsewhere = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(elsewhere.path().join("meshes")).unwrap();
    std::fs::write(elsewhere.path().join("meshes/tip.obj"), TETRAHEDRON).unwrap();
    let options = ImportOptions { packages: [("hand".to_owned(), elsewhere.path().to_owned())].into() };
    let robot = Robot::new(&with_mesh(&mesh(" scale=\"-0.01 0.02 0.01\"")));
    let imported = import(&robot.file(), &options, &mut Vec::new()).unwrap();
    let stl = &imported.assets[0].1;
    assert!(triangles(stl).iter().flatten().all(|p| p.x <= 0.0 && p.y <= 0.021));
    assert!((volume(stl) - 2e-6 / 6.0).abs() < 1e-12, "mirrored, and its faces still look outwards");
}

#[test]
fn meshes_of_one_name_are_two_assets() {
    let files = with_mesh("<mesh filename=\"../a/part.OBJ\"/>")
        .replace("<cylinder radius=\"0.01\" length=\"0.04\"/>", "<mesh filename=\"../b/part.OBJ\"/>");
    let robot = Robot::new(&files);
    robot.write("a/part.OBJ", TETRAHEDRON.as_bytes());
    robot.write("b/part.OBJ", TETRAHEDRON.replace("v 0 0 1", "v 0 0 2").as_bytes());
    let assets = robot.import().unwrap().imported.assets;
    assert_eq!(assets.len(), 2);
    assert_ne!(assets[0].0, assets[1].0);
    assert!((volume(&assets[0].1) - volume(&assets[1].1)).abs() > 0.1);
}

#[test]
fn stl_is_read_in_both_forms() {
    let text = "solid a\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 1 0 0\nendloop\nendfacet\n\
        facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet\nendsolid\n";
    let robot = Robot::new(&with_mesh("<mesh filename=\"tip.stl\"/>"));
    robot.write("urdf/tip.stl", text.as_bytes());
    let first = robot.import().unwrap().imported.assets;
    robot.write("urdf/tip.stl", text.to_uppercase().as_bytes());
    assert_eq!(robot.import().unwrap().assets, first, "capitals are the same");
    robot.write("urdf/tip.stl", &first[0].1);
    assert_eq!(robot.import().unwrap().assets, first, "what was written reads as the same");
    robot.write("urdf/tip.stl", &first[0].1[..150]);
    let message = robot.import().unwrap_err().to_string();
    assert!(message.contains("tip.stl") && message.contains("number of faces"), "{message}");
}

#[test]
fn a_mesh_without_volume_becomes_a_thin_box() {
    let robot = Robot::new(&with_mesh("<mesh filename=\"plate.obj\" scale=\"0.1 0.1 0.1\"/>"));
    robot.write("urdf/plate.obj", b"v 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nf 1 2 3 4\n");
    let imported = robot.import().unwrap();
    assert!(imported.assets.is_empty());
    let geom = body(&imported, "distal").get_child("geom").unwrap();
    assert_close(&numbers(geom, "size"), &[0.05, 0.05, 0.0005]);
    assert_close(&numbers(geom, "pos"), &[0.05, 0.05, 0.1]);
    assert!(has_note(&imported, &["thin box", "plate.obj"]));
}

#[test]
fn collada_is_read_in_metres_with_its_nodes() {
    let dae = r##"<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
      <asset><unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis></asset>
      <library_geometries><geometry id="g"><mesh>
        <source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
          <technique_common><accessor source="#pa" count="4" stride="3"/></technique_common></source>
        <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
        <polylist count="2"><input semantic="VERTEX" source="#v" offset="0"/>
          <input semantic="NORMAL" source="#n" offset="1"/>
          <vcount>3 3</vcount><p>0 9 2 9 1 9 0 9 1 9 3 9</p></polylist>
        <triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>0 3 2 1 2 3</p></triangles>
      </mesh></geometry></library_geometries>
      <library_visual_scenes><visual_scene id="s"><node id="n1"><translate>0 0 10</translate>
        <node><rotate>0 0 1 90</rotate><instance_geometry url="#g"/></node></node></visual_scene></library_visual_scenes>
      <scene><instance_visual_scene url="#s"/></scene></COLLADA>"##;
    let robot = Robot::new(&with_mesh("<mesh filename=\"tip.dae\"/>"));
    robot.write("urdf/tip.dae", dae.as_bytes());
    let assets = robot.import().unwrap().imported.assets;
    assert!((volume(&assets[0].1) - 1e-6 / 6.0).abs() < 1e-11);
    let points: Vec<_> = triangles(&assets[0].1).into_iter().flatten().collect();
    assert!(points.iter().all(|p| p.z > 0.099 && p.x < 1e-6 && p.x > -0.0101), "lifted, turned and in metres");
    robot.write("urdf/tip.dae", dae.replace("1 2 3</p>", "1 2 4</p>").as_bytes());
    assert!(robot.import().unwrap_err().to_string().contains("convert other kinds to STL"));
}

/// Pieces that are likely to lead a reader astray.
const PIECES: &[&str] = &[
    "",
    "\"",
    "<",
    ">",
    "/>",
    "</",
    "&",
    "-",
    "nan",
    "inf",
    "1e999",
    "-0",
    "0 0",
    "0 0 0 0",
    "palm",
    "tip",
    "base",
    "name=\"\"",
    "<link name=\"a\"/>",
    "<!--",
    "-->",
    "<?xml?>",
    "${",
    "<origin xyz=\"0 0\"/>",
    "<inertial/>",
    "<collision/>",
    "<limit/>",
    "é",
    "\u{0}",
    "fixed",
    "prismatic",
    "<mesh filename=\"package://\"/>",
    "<mesh filename=\"tip.obj\" scale=\"0 1 1\"/>",
    "<mimic joint=\"coupled\"/>",
];

fn check_finite(imported: &Imported) -> Result<(), TestCaseError> {
    let mut text = Vec::new();
    imported.model.write(&mut text).unwrap();
    let text = String::from_utf8(text).unwrap().to_lowercase();
    prop_assert!(!text.contains("nan ") && !text.contains("\"inf"), "{text}");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_robots_never_panic(
        edits in prop::collection::vec((any::<usize>(), 0..12_usize, any::<usize>()), 1..5),
        flips in prop::collection::vec((any::<usize>(), 0..8_u8), 0..3),
        words in prop::collection::vec((any::<usize>(), any::<usize>()), 0..3),
    ) {
        let text = with_mesh("<mesh filename=\"tip.obj\" scale=\"1 -1 1\"/>");
        let mut parts: Vec<&str> = text.split_inclusive(['"', ' ']).collect();
        for (a, b) in words {
            let n_parts = parts.len();
            parts.swap(a % n_parts, b % n_parts);
        }
        let mut bytes = mutate(&parts.concat(), PIECES, &edits).into_bytes();
        for (at, bit) in flips {
            let n_bytes = bytes.len();
            bytes[at % n_bytes] ^= 1 << bit;
        }
        let robot = Robot::new("");
        robot.write("urdf/robot.urdf", &bytes);
        robot.write("urdf/tip.obj", TETRAHEDRON.as_bytes());
        match robot.import() {
            Ok(imported) => check_finite(&imported)?,
            Err(error) => prop_assert!(error.to_string().contains(robot.directory.path().to_str().unwrap())),
        }
    }

    #[test]
    fn damaged_meshes_never_panic(
        kind in 0..3_usize,
        edits in prop::collection::vec((any::<usize>(), 0..12_usize, any::<usize>()), 1..5),
    ) {
        let robot = Robot::new(&with_mesh(&format!("<mesh filename=\"tip.{}\"/>", ["obj", "stl", "dae"][kind])));
        let stl = "solid a\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendsolid";
        let dae = r##"<COLLADA><library_geometries><geometry id="g"><mesh><source id="p"><float_array>0 0 0 1 0 0 0 1 0
            0 0 1</float_array></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
            <polylist><input semantic="VERTEX" source="#v" offset="0"/><vcount>3 3</vcount><p>0 2 1 0 1 3</p></polylist>
            </mesh></geometry></library_geometries><library_visual_scenes><visual_scene><node id="n">
            <matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#g"/></node></visual_scene>
            </library_visual_scenes></COLLADA>"##;
        let (name, text) = [("tip.obj", TETRAHEDRON), ("tip.stl", stl), ("tip.dae", dae)][kind];
        robot.write(&format!("urdf/{name}"), mutate(text, PIECES, &edits).as_bytes());
        if let Err(error) = robot.import() {
            prop_assert!(error.to_string().contains(name));
        }
    }
}

fn read(path: &Path) -> (Result<Imported, HandError>, Vec<String>) {
    let mut notes = Vec::new();
    (import(path, &ImportOptions::default(), &mut notes), notes)
}
