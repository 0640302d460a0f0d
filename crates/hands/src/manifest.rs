//! `hand.toml`, the description of a hand. `docs/hands.md` explains it key by key.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::error::HandError;
use crate::schema;

/// File name of the manifest in a hand's directory.
pub const MANIFEST_FILE: &str = "hand.toml";

/// The schema of `hand.toml` that this crate reads.
pub const SCHEMA: i64 = 1;

/// The contents of `hand.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandManifest {
    /// Version of this file's format.
    pub schema: i64,
    /// Name of the hand on the command line; also part of the names of run directories.
    pub name: String,
    /// One line about the hand.
    #[serde(default)]
    pub description: String,
    /// Model file, relative to the hand's directory and inside it.
    pub model: String,
    /// Format of the model file.
    #[serde(default)]
    pub format: ModelFormat,
    /// Directories of ROS packages inside the hand's directory, for a URDF's `package://name/...`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub packages: BTreeMap<String, String>,
    /// Joints of the posture in order, the slide included; absent: the slide, then every joint in model order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posture_joints: Option<Vec<String>>,
    /// Body of the palm.
    pub palm: String,
    /// Site or body at the tip of each finger.
    pub fingertips: Vec<String>,
    /// Licence of the hand's files, as an SPDX expression.
    #[serde(default = "unknown_licence")]
    pub licence: String,
    /// Origin of the model and of its numbers.
    #[serde(default)]
    pub provenance: Vec<String>,
    /// Pose of the hand's root body in the frame of the slide.
    pub mount: Mount,
    /// The vertical slide that carries the hand.
    #[serde(default)]
    pub slide: Slide,
    /// Joint values of the open hand (rad, m); a joint that is missing starts at 0, or at the limit nearest
    /// to 0.
    #[serde(default)]
    pub open_posture: BTreeMap<String, f64>,
    /// End of its range at which each actuator closes the hand: 1 the upper, -1 the lower. An actuator without an entry
    /// does not close the hand.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub closing: BTreeMap<String, f64>,
    /// The objects to grasp.
    #[serde(default)]
    pub objects: Objects,
    /// Position servos to add to the model.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub actuators: Vec<AddedActuator>,
    /// Couplings to add to the model.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub couplings: Vec<AddedCoupling>,
    /// Contact bits of the hand's geoms; absent: as the model has them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<ContactBits>,
    /// What became of scripted grasps when the file was made; absent: unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scripted_grasps: Option<ScriptedGrasps>,
    /// Keys written in the file; all others have their defaults.
    #[serde(skip)]
    pub written: BTreeSet<String>,
}

/// Format of a hand's model file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ModelFormat {
    /// MuJoCo's XML; MuJoCo 2.2.2 loads the file unchanged.
    #[default]
    Mjcf,
    /// URDF, converted to MJCF at every load.
    Urdf,
}

/// Pose of the hand's root body in the frame of the slide, which at slide 0 is the world's: z up, the plane at z = 0,
/// the object near x = y = 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mount {
    /// Position (m).
    pub position: [f64; 3],
    /// Orientation as a quaternion (w, x, y, z), made unit length on reading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<[f64; 4]>,
    /// Orientation as turns about the slide frame's fixed x, then y, then z axis (degrees).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub euler_deg: Option<[f64; 3]>,
}

impl Mount {
    /// Returns the pose of the hand's root body in the frame of the slide, `slide_from_root`.
    pub fn pose(&self) -> Isometry3<f64> {
        let rotation = match (self.quaternion, self.euler_deg) {
            (Some([w, x, y, z]), _) => UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
            (None, Some(angles)) => {
                let [x, y, z] = angles.map(f64::to_radians);
                UnitQuaternion::from_euler_angles(x, y, z)
            }
            (None, None) => UnitQuaternion::identity(),
        };
        Isometry3::from_parts(Translation3::from(Vector3::from(self.position)), rotation)
    }

    /// Returns the orientation as MuJoCo writes it, (w, x, y, z).
    pub fn quaternion_wxyz(&self) -> [f64; 4] {
        let q = self.pose().rotation;
        [q.w, q.i, q.j, q.k]
    }
}

/// The vertical slide that carries the hand, and its position servo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Slide {
    /// Name of its joint and of its actuator.
    pub name: String,
    /// Lowest and highest position (m, upward).
    pub range: [f64; 2],
    /// Position at the start of an episode (m).
    pub start: f64,
    /// Servo stiffness (N/m).
    pub kp: f64,
    /// Joint damping (N s/m).
    pub damping: f64,
    /// Largest force of the servo (N).
    pub force_limit: f64,
    /// Mass added to the joint, as a drive's rotor would (kg).
    pub armature: f64,
    /// Largest speed at which the servo raises the hand (m/s); absent: not limited.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rise_speed: Option<f64>,
}

impl Default for Slide {
    fn default() -> Self {
        Self {
            name: "slide".to_owned(),
            range: [-0.12, 0.14],
            start: 0.0,
            kp: 3000.0,
            damping: 300.0,
            force_limit: 200.0,
            armature: 0.0,
            rise_speed: None,
        }
    }
}

/// The objects to grasp.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Objects {
    /// Factor on every length of the objects.
    pub scale: f64,
}

impl Default for Objects {
    fn default() -> Self {
        Self { scale: 1.0 }
    }
}

/// Scripted grasps of every object, with the hand as the manifest describes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScriptedGrasps {
    /// Number of grasps.
    pub tried: u32,
    /// Grasps that lifted the object.
    pub lifted: u32,
    /// Grasps that brought the object to its goal.
    pub reached: u32,
}

impl ScriptedGrasps {
    /// A hand can grasp if it lifts at least this many of [`OF`](Self::OF) objects.
    pub const LEAST: u32 = 4;
    /// See [`LEAST`](Self::LEAST).
    pub const OF: u32 = 14;

    /// Tells whether the hand can grasp.
    pub fn can_grasp(&self) -> bool {
        u64::from(self.lifted) * u64::from(Self::OF) >= u64::from(self.tried) * u64::from(Self::LEAST)
            && self.lifted > 0
    }

    /// Tells in one line whether the hand can grasp.
    pub fn verdict(&self) -> String {
        let ScriptedGrasps { tried, lifted, reached } = self;
        let can = if self.can_grasp() { "this hand can grasp" } else { "this hand cannot grasp as it is described" };
        format!("{can}: by a script, it lifts {lifted} of {tried} and reaches the goal in {reached}")
    }
}

/// A position servo to add on a joint; it replaces the actuators that act on this joint alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddedActuator {
    /// Joint to move.
    pub joint: String,
    /// Name of the actuator; absent: the joint's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Stiffness (N m/rad or N/m).
    pub kp: f64,
    /// Largest torque (N m) or force (N).
    pub force_limit: f64,
    /// Lowest and highest command (rad or m); absent: the joint's range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub control_range: Option<[f64; 2]>,
}

/// A joint that follows another joint: `joint = multiplier * follows + offset`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddedCoupling {
    /// The dependent joint; its own actuators are removed.
    pub joint: String,
    /// The joint to follow.
    pub follows: String,
    /// Factor; absent: 1.
    #[serde(default = "one")]
    pub multiplier: f64,
    /// Position of the dependent joint when the followed joint is at 0 (rad or m); absent: 0.
    #[serde(default)]
    pub offset: f64,
}

/// Contact bits of every geom of the hand that collides with anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactBits {
    /// Bits compared with the other geom's `conaffinity`.
    pub contype: u32,
    /// Bits compared with the other geom's `contype`.
    pub conaffinity: u32,
}

fn one() -> f64 {
    1.0
}

fn unknown_licence() -> String {
    "unknown".to_owned()
}

impl HandManifest {
    /// Reads and checks the manifest in `text`; `file` is named in errors.
    ///
    /// # Errors
    /// Says which key is unknown, missing or has a wrong value, and what is expected.
    pub fn parse(text: &str, file: &Path) -> Result<Self, HandError> {
        let toml_error = |e: &toml::de::Error| HandError::Toml {
            file: file.to_path_buf(),
            message: e.to_string().trim_end().to_owned(),
        };
        let table: toml::Table = toml::from_str(text).map_err(|e| toml_error(&e))?;
        let written = schema::check(&table, file)?;
        if table.get("schema").and_then(toml::Value::as_integer) != Some(SCHEMA) {
            return Err(HandError::invalid(
                file,
                "schema",
                schema::expected("schema"),
                table.get("schema").map_or(String::new(), ToString::to_string),
            ));
        }
        let formats = ["mjcf", "urdf"];
        if let Some(format) = table.get("format").and_then(toml::Value::as_str).filter(|f| !formats.contains(f)) {
            return Err(HandError::invalid(file, "format", schema::expected("format"), format!("\"{format}\"")));
        }
        let mut manifest: Self = toml::from_str(text).map_err(|e| toml_error(&e))?;
        manifest.written = written;
        manifest.check(file)?;
        Ok(manifest)
    }

    fn check(&self, file: &Path) -> Result<(), HandError> {
        let require = |ok: bool, key: &str, got: String| {
            if ok { Ok(()) } else { Err(HandError::invalid(file, key, schema::expected(key), got)) }
        };
        require(is_hand_name(&self.name), "name", format!("\"{}\"", self.name))?;
        require(!self.palm.is_empty(), "palm", "\"\"".to_owned())?;
        require(!self.fingertips.is_empty(), "fingertips", "[]".to_owned())?;
        check_relative("model", &self.model, file)?;
        for (key, names) in [("fingertips", Some(&self.fingertips)), ("posture_joints", self.posture_joints.as_ref())] {
            if let Some(twice) = names.and_then(|names| first_duplicate(names)) {
                return Err(HandError::invalid(file, key, "distinct names", format!("`{twice}` twice")));
            }
        }
        require(self.posture_joints.as_ref().is_none_or(|names| !names.is_empty()), "posture_joints", "[]".to_owned())?;
        self.check_mount(file)?;
        self.check_additions(file)?;
        let slide = &self.slide;
        let [low, high] = slide.range;
        require(!slide.name.is_empty(), "slide.name", "\"\"".to_owned())?;
        require(low < high, "slide.range", format!("[{low}, {high}]"))?;
        require((low..=high).contains(&slide.start), "slide.start", slide.start.to_string())?;
        require(slide.kp > 0.0, "slide.kp", slide.kp.to_string())?;
        require(slide.damping >= 0.0, "slide.damping", slide.damping.to_string())?;
        require(slide.force_limit > 0.0, "slide.force_limit", slide.force_limit.to_string())?;
        require(slide.armature >= 0.0, "slide.armature", slide.armature.to_string())?;
        if let Some(speed) = slide.rise_speed {
            require(speed > 0.0, "slide.rise_speed", speed.to_string())?;
        }
        if let Some(ScriptedGrasps { tried, lifted, reached }) = self.scripted_grasps {
            require(lifted <= tried, "scripted_grasps.lifted", lifted.to_string())?;
            require(reached <= tried, "scripted_grasps.reached", reached.to_string())?;
        }
        require(self.objects.scale > 0.0, "objects.scale", self.objects.scale.to_string())
    }

    fn check_additions(&self, file: &Path) -> Result<(), HandError> {
        for (i, actuator) in self.actuators.iter().enumerate() {
            let positive = |key: &str, value: f64| {
                let key = format!("actuators[{i}].{key}");
                if value > 0.0 { Ok(()) } else { Err(HandError::invalid(file, &key, "a positive number", value)) }
            };
            positive("kp", actuator.kp)?;
            positive("force_limit", actuator.force_limit)?;
            if let Some([low, high]) = actuator.control_range.filter(|[low, high]| low >= high) {
                let key = format!("actuators[{i}].control_range");
                return Err(HandError::invalid(file, &key, "two numbers, the lower first", format!("[{low}, {high}]")));
            }
        }
        for (actuator, &sign) in &self.closing {
            if sign != 1.0 && sign != -1.0 {
                return Err(HandError::invalid(file, &format!("closing.{actuator}"), "1 or -1", sign));
            }
        }
        for directory in self.packages.values() {
            check_relative("packages", directory, file)?;
        }
        Ok(())
    }

    fn check_mount(&self, file: &Path) -> Result<(), HandError> {
        if self.mount.quaternion.is_some() && self.mount.euler_deg.is_some() {
            return Err(HandError::invalid(file, "mount", "either `quaternion` or `euler_deg`", "both"));
        }
        if let Some(q) = self.mount.quaternion {
            let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
            if !(norm > 1e-6 && norm.is_finite()) {
                return Err(HandError::invalid(
                    file,
                    "mount.quaternion",
                    schema::expected("mount.quaternion"),
                    format!("{q:?}"),
                ));
            }
        }
        Ok(())
    }
}

fn check_relative(key: &str, path: &str, file: &Path) -> Result<(), HandError> {
    if path.is_empty() {
        return Err(HandError::invalid(file, key, schema::expected(key), "\"\""));
    }
    let inside = Path::new(path).components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if inside {
        return Ok(());
    }
    Err(HandError::Escape {
        file: file.to_path_buf(),
        key: key.to_owned(),
        got: path.to_owned(),
        directory: file.parent().unwrap_or(Path::new(".")).to_path_buf(),
    })
}

/// Returns true if a hand can have this name.
pub fn is_hand_name(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_lowercase() || c.is_ascii_digit())
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_')
}

fn first_duplicate(names: &[String]) -> Option<&String> {
    let mut seen = BTreeSet::new();
    names.iter().find(|name| !seen.insert(*name))
}
