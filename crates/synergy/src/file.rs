//! `synergy.toml`: a whole synergy in one readable file.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::actuation::check_actuation;
use crate::pca::{SynergyParts, check_numbers};
use crate::{ActuationMap, JointInfo, JointMap, Synergy, SynergyError};

/// The version of `synergy.toml`.
pub const SCHEMA: i64 = 2;

/// Largest relative difference between a derived number in the file and its value recomputed from the other numbers.
const DERIVED_TOLERANCE: f64 = 1e-9;

/// What the numbers of a space are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Space {
    /// Commands of the hand's actuators, along whole grasps: a controller drives the hand with this space.
    Commands,
    /// Joint positions at the end of grasps (Higashi et al., section 2.2).
    Postures,
}

/// The content of `synergy.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct SynergyFile {
    /// The hand's name.
    pub hand: String,
    /// What the numbers of the space are.
    pub space: Space,
    /// The space, with the range of its coefficients. In a space of commands, its joints are the actuators.
    pub synergy: Synergy,
    /// For a space of commands, the joint positions to which they lead.
    pub joint_map: Option<JointMap>,
    /// For a space of postures, the map from a posture to actuator commands, where one is known.
    pub actuation: Option<ActuationMap>,
    /// Number of components that is enough, where it was measured.
    pub recommended: Option<Recommended>,
    /// For a space of commands, the mean grasps of each object.
    pub grasps: Vec<NamedGrasp>,
    /// The origin of the numbers: any keys with texts.
    pub provenance: BTreeMap<String, String>,
}

/// A mean grasp of one object with some numbers, as three moments that a controller can move between.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NamedGrasp {
    /// Name of the object.
    pub object: String,
    /// How many numbers commanded the hand: the first ones. In a file, 0 or nothing means all.
    #[serde(default)]
    pub numbers: usize,
    /// Number of motions of which this is the mean.
    pub motions: usize,
    /// The hand approaches, open.
    pub open: Moment,
    /// The hand has closed, before it lifts.
    pub closed: Moment,
    /// The hand holds the object at the goal.
    pub held: Moment,
}

/// One moment of a grasp.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Moment {
    /// The coefficients: one for each number.
    pub z: Vec<f64>,
    /// The measured joint positions, in the order of the joint map's joints.
    pub q: Vec<f64>,
}

impl NamedGrasp {
    fn check(&self, i: usize, k: usize, n: usize) -> Result<(), SynergyError> {
        if self.numbers == 0 || self.numbers > k {
            return Err(SynergyError::invalid(format!("grasps[{i}].numbers"), format!("1 to {k}"), self.numbers));
        }
        for (name, moment) in [("open", &self.open), ("closed", &self.closed), ("held", &self.held)] {
            check_numbers(&format!("grasps[{i}].{name}.z"), &moment.z, self.numbers)?;
            check_numbers(&format!("grasps[{i}].{name}.q"), &moment.q, n)?;
        }
        Ok(())
    }
}

/// Number of components that is enough.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recommended {
    /// The number.
    pub components: usize,
    /// Why, with the figures.
    pub reason: String,
}

impl SynergyFile {
    /// Returns the text of the file. Numbers read back from it are the same to the last bit.
    ///
    /// # Errors
    /// An actuation map that does not fit the joints.
    pub fn to_toml(&self) -> Result<String, SynergyError> {
        let synergy = &self.synergy;
        let (header, samples, coordinates) = match self.space {
            Space::Commands => (COMMANDS_HEADER, "n_commands", "actuators"),
            Space::Postures => (POSTURES_HEADER, "n_postures", "joints"),
        };
        let mut text = format!("{header}{HEADER}");
        put(&mut text, "schema", &SCHEMA)?;
        put(&mut text, "hand", &self.hand)?;
        put(&mut text, "space", &self.space)?;
        put(&mut text, samples, &synergy.n_postures())?;
        if let Some(Recommended { components, reason }) = &self.recommended {
            put(&mut text, "recommended_components", components)?;
            put(&mut text, "recommended_reason", reason)?;
        }
        put_rows(&mut text, coordinates, synergy.joints())?;
        put(&mut text, "mean", &synergy.mean())?;
        put_rows(&mut text, "components", synergy.components().chunks_exact(synergy.n_joints()))?;
        put(&mut text, "explained_variance", &synergy.explained_variance())?;
        put(&mut text, "contribution", &synergy.contribution())?;
        put(&mut text, "coefficient_min", &synergy.coefficient_min())?;
        put(&mut text, "coefficient_max", &synergy.coefficient_max())?;
        put(&mut text, "total_variance", &synergy.total_variance())?;
        put(&mut text, "eigenvalues", &synergy.eigenvalues())?;
        if let Some(map) = &self.joint_map {
            map.check(synergy.n_components())?;
            text.push_str("\n[joint_map]\n");
            put_rows(&mut text, "joints", &map.joints)?;
            if !map.free.is_empty() {
                put(&mut text, "free", &map.free)?;
            }
            put(&mut text, "mean", &map.mean)?;
            put_rows(&mut text, "matrix", &map.matrix)?;
        }
        self.check_grasps()?;
        for grasp in &self.grasps {
            text.push_str("\n[[grasps]]\n");
            put(&mut text, "object", &grasp.object)?;
            put(&mut text, "numbers", &grasp.numbers)?;
            put(&mut text, "motions", &grasp.motions)?;
            for (name, moment) in [("open", &grasp.open), ("closed", &grasp.closed), ("held", &grasp.held)] {
                put(&mut text, name, moment)?;
            }
        }
        if let Some(actuation) = &self.actuation {
            check_actuation(actuation, synergy.n_joints())?;
            text.push_str("\n[actuation]\n");
            put(&mut text, "actuators", &actuation.actuators)?;
            put(&mut text, "control_min", &actuation.control_min)?;
            put(&mut text, "control_max", &actuation.control_max)?;
            put_rows(&mut text, "matrix", &actuation.matrix)?;
            put(&mut text, "offset", &actuation.offset)?;
        }
        text.push('\n');
        text.push_str(&toml::to_string(&BTreeMap::from([("provenance", &self.provenance)]))?);
        Ok(text)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// A text that is not TOML, another schema, a missing field, a wrong length, a number that is not finite, rows that
    /// are not orthonormal, or derived numbers that contradict the others.
    pub fn from_toml(text: &str) -> Result<Self, SynergyError> {
        let SchemaOnly { schema } = toml::from_str(text)?;
        if schema != SCHEMA {
            return Err(SynergyError::Schema { what: "the synergy file", expected: SCHEMA, got: schema });
        }
        let record: SynergyRecord = toml::from_str(text)?;
        let (coordinates, samples) = match record.space {
            Space::Commands => (("actuators", record.actuators), ("n_commands", record.n_commands)),
            Space::Postures => (("joints", record.joints), ("n_postures", record.n_postures)),
        };
        let missing = |key: &str| SynergyError::invalid(key, "a value, as in every file of this space", "none");
        let synergy = Synergy::from_parts(SynergyParts {
            joints: coordinates.1.ok_or_else(|| missing(coordinates.0))?,
            mean: record.mean,
            components: record.components,
            eigenvalues: record.eigenvalues,
            coefficient_min: record.coefficient_min,
            coefficient_max: record.coefficient_max,
            n_postures: samples.1.ok_or_else(|| missing(samples.0))?,
        })?;
        check_derived("explained_variance", &record.explained_variance, synergy.explained_variance())?;
        check_derived("contribution", &record.contribution, synergy.contribution())?;
        check_derived("total_variance", &[record.total_variance], &[synergy.total_variance()])?;
        if let Some(actuation) = &record.actuation {
            check_actuation(actuation, synergy.n_joints())?;
        }
        if let Some(map) = &record.joint_map {
            map.check(synergy.n_components())?;
        }
        let recommended = match (record.recommended_components, record.recommended_reason) {
            (Some(components), Some(reason)) if (1..=synergy.n_components()).contains(&components) => {
                Some(Recommended { components, reason })
            }
            (None, None) => None,
            (components, _) => {
                let expected = format!("1 to {}, with recommended_reason", synergy.n_components());
                return Err(SynergyError::invalid("recommended_components", expected, format!("{components:?}")));
            }
        };
        let mut grasps = record.grasps;
        let all = synergy.n_components();
        grasps.iter_mut().filter(|grasp| grasp.numbers == 0).for_each(|grasp| grasp.numbers = all);
        let file = SynergyFile {
            hand: record.hand,
            space: record.space,
            synergy,
            joint_map: record.joint_map,
            actuation: record.actuation,
            recommended,
            grasps,
            provenance: record.provenance,
        };
        file.check_grasps()?;
        Ok(file)
    }

    fn check_grasps(&self) -> Result<(), SynergyError> {
        let n = self.joint_map.as_ref().map_or(0, |map| map.joints.len());
        let k = self.synergy.n_components();
        self.grasps.iter().enumerate().try_for_each(|(i, grasp)| grasp.check(i, k, n))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// As [`SynergyFile::from_toml`], with the path; or a file that cannot be read.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, SynergyError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(SynergyError::io("read", path))?;
        Self::from_toml(&text).map_err(|error| error.in_file(path))
    }
}

const COMMANDS_HEADER: &str = "\
# A control synergy: a few numbers z command all actuators u of a hand, from opening to the grasp.
#   decode   u = mean + z components, clamped to the actuators' ranges
#   encode   z = (u - mean) components^T
#   joints   q = mean + z matrix, clamped to the joints' limits: where the hand then is (section [joint_map], in which
#            `free` names joints that no command moves: they stand for the arm)
# To use fewer numbers, use the first rows only. Each of [[grasps]] is the mean grasp of an object with so many numbers: move
# from `open` to `closed`, then lift with `held`; q are the joint positions that were measured there.
";

const POSTURES_HEADER: &str = "\
# A postural synergy: a few coefficients z describe the whole posture q of a hand at the end of a grasp.
#   decode   q = mean + z components, clamped to the joints' limits
#   encode   z = (q - mean) components^T
#   command  ctrl = matrix q + offset, clamped to the control ranges (section [actuation])
";

const HEADER: &str = "\
# `components` has orthonormal rows; in each, the first entry of the largest absolute value is positive.
# `explained_variance` is the sample variance along each row, `contribution` its share of `total_variance`,
# `coefficient_min` and `coefficient_max` the range of z over the samples, which lie beside this file as NPY, and over the
# final grasps.

";

#[derive(Deserialize)]
struct SchemaOnly {
    schema: i64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SynergyRecord {
    // Read before the others.
    #[serde(rename = "schema")]
    _schema: i64,
    hand: String,
    space: Space,
    n_postures: Option<usize>,
    n_commands: Option<usize>,
    recommended_components: Option<usize>,
    recommended_reason: Option<String>,
    joints: Option<Vec<JointInfo>>,
    actuators: Option<Vec<JointInfo>>,
    joint_map: Option<JointMap>,
    #[serde(default)]
    grasps: Vec<NamedGrasp>,
    mean: Vec<f64>,
    components: Vec<Vec<f64>>,
    explained_variance: Vec<f64>,
    contribution: Vec<f64>,
    coefficient_min: Vec<f64>,
    coefficient_max: Vec<f64>,
    total_variance: f64,
    eigenvalues: Vec<f64>,
    actuation: Option<ActuationMap>,
    #[serde(default)]
    provenance: BTreeMap<String, String>,
}

fn put(text: &mut String, key: &str, value: &(impl Serialize + ?Sized)) -> Result<(), SynergyError> {
    let mut line = String::new();
    value.serialize(toml::ser::ValueSerializer::new(&mut line))?;
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{key} = {line}");
    Ok(())
}

/// Writes an array with one element on each line; a matrix row by row.
fn put_rows<T: Serialize>(text: &mut String, key: &str, rows: impl IntoIterator<Item = T>) -> Result<(), SynergyError> {
    let _ = writeln!(text, "{key} = [");
    for row in rows {
        let mut line = String::new();
        row.serialize(toml::ser::ValueSerializer::new(&mut line))?;
        let _ = writeln!(text, "    {line},");
    }
    text.push_str("]\n");
    Ok(())
}

fn check_derived(name: &str, stored: &[f64], computed: &[f64]) -> Result<(), SynergyError> {
    check_numbers(name, stored, computed.len())?;
    for (i, (stored, computed)) in stored.iter().zip(computed).enumerate() {
        if (stored - computed).abs() > DERIVED_TOLERANCE * computed.abs() {
            let expected = format!("{computed}, which follows from the eigenvalues");
            return Err(SynergyError::invalid(format!("{name}[{i}]"), expected, stored));
        }
    }
    Ok(())
}
