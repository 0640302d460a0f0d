//! The summary of a hand that `hands list` and `hands show` print.

use std::path::PathBuf;

use eigenhand_posture::{JointInfo, Unit};
use serde::Serialize;
use toml::Value;

use crate::hand::Hand;
use crate::manifest::ScriptedGrasps;
use crate::parts::{FrameKind, HandActuator, HandCoupling};
use crate::schema;

/// A hand in brief.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HandSummary {
    /// Name of the hand.
    pub name: String,
    /// One line about it.
    pub description: String,
    /// Number of joints, the slide included.
    pub n_joints: usize,
    /// Number of actuators, the slide's included.
    pub n_actuators: usize,
    /// Number of fingers.
    pub n_fingers: usize,
    /// Number of joints in a posture.
    pub n_posture: usize,
    /// SHA-256 over the hand's files.
    pub digest: String,
    /// Licence of the hand's files.
    pub licence: String,
    /// The hand's directory.
    pub directory: PathBuf,
    /// What became of scripted grasps when the hand was made, if that is known.
    pub scripted_grasps: Option<ScriptedGrasps>,
    /// Every value of the manifest, and its origin.
    pub values: Vec<SummaryValue>,
    /// Joints of the posture in order.
    pub posture: Vec<SummaryJoint>,
    /// Actuators of the model in order, without the slide's.
    pub actuators: Vec<HandActuator>,
    /// Joints that follow another joint.
    pub couplings: Vec<HandCoupling>,
    /// Changes and assumptions made while reading the model.
    pub notes: Vec<String>,
}

/// A joint of the posture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SummaryJoint {
    /// Name in the model.
    pub name: String,
    /// `hinge` or `slide`.
    pub kind: &'static str,
    /// Lowest and highest position (rad or m); none if the joint is not limited.
    pub range: Option<(f64, f64)>,
    /// Unit of the position, `rad` or `m`.
    pub unit: &'static str,
    /// Position in the model's initial configuration (rad or m).
    pub reference: f64,
    /// Body that the joint moves; empty for the slide.
    pub body: String,
}

impl SummaryJoint {
    fn of(info: &JointInfo, hand: &Hand) -> Self {
        let joint = hand.joint(&info.name);
        Self {
            name: info.name.clone(),
            kind: match info.unit {
                Unit::Radian => "hinge",
                Unit::Metre => "slide",
            },
            range: info.range(),
            unit: info.unit.symbol(),
            reference: joint.map_or(0.0, |joint| joint.reference),
            body: joint.map_or_else(String::new, |joint| joint.body.clone()),
        }
    }
}

/// Origin of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ValueOrigin {
    /// The manifest holds it.
    Written,
    /// The manifest does not hold it; it is the general default.
    Default,
    /// It was computed from the model.
    Computed,
}

/// One value and its origin.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SummaryValue {
    /// Key as in `hand.toml`, or the element of the model.
    pub key: String,
    /// The value.
    pub value: Value,
    /// Its origin.
    pub origin: ValueOrigin,
}

impl HandSummary {
    /// Summarises `hand`.
    pub fn of(hand: &Hand) -> Self {
        let manifest = &hand.manifest;
        Self {
            name: manifest.name.clone(),
            description: manifest.description.clone(),
            n_joints: hand.joints.len() + 1,
            n_actuators: hand.actuators.len() + 1,
            n_fingers: hand.fingertips.len(),
            n_posture: hand.posture.len(),
            digest: hand.digest.clone(),
            licence: manifest.licence.clone(),
            directory: hand.directory.clone(),
            scripted_grasps: manifest.scripted_grasps,
            values: values(hand),
            posture: hand.posture.iter().map(|joint| SummaryJoint::of(joint, hand)).collect(),
            actuators: hand.actuators.clone(),
            couplings: hand.couplings.clone(),
            notes: hand.notes.clone(),
        }
    }
}

fn values(hand: &Hand) -> Vec<SummaryValue> {
    let manifest = &hand.manifest;
    let table = toml::Table::try_from(manifest).unwrap_or_default();
    let mut values = Vec::new();
    for info in schema::keys() {
        let (parent, key) = info.key.split_once('.').unwrap_or(("", info.key));
        let holder = if parent.is_empty() { Some(&table) } else { table.get(parent).and_then(Value::as_table) };
        let written = manifest.written.contains(info.key);
        let (value, origin) = match (info.key, holder.and_then(|t| t.get(key))) {
            ("posture_joints", None) => (
                Value::Array(hand.posture.iter().map(|j| Value::from(j.name.clone())).collect()),
                ValueOrigin::Computed,
            ),
            ("open_posture", _) => {
                let all = hand.open_posture();
                let origin = if all.keys().all(|name| manifest.open_posture.contains_key(name)) {
                    ValueOrigin::Written
                } else {
                    ValueOrigin::Computed
                };
                (Value::Table(all.into_iter().map(|(name, value)| (name, Value::Float(value))).collect()), origin)
            }
            ("closing" | "packages", None) => (Value::Table(toml::Table::new()), ValueOrigin::Default),
            ("closing" | "packages", Some(table)) => (table.clone(), ValueOrigin::Written),
            (_, Some(Value::Table(_)) | None) => continue,
            (_, Some(value)) => (value.clone(), if written { ValueOrigin::Written } else { ValueOrigin::Default }),
        };
        values.push(SummaryValue { key: info.key.to_owned(), value, origin });
    }
    for actuator in hand.actuators.iter().filter(|a| a.ctrlrange_computed) {
        let (low, high) = actuator.ctrlrange;
        let value = Value::Array(vec![Value::Float(low), Value::Float(high)]);
        values.push(SummaryValue {
            key: format!("actuator {} ctrlrange", actuator.name),
            value,
            origin: ValueOrigin::Computed,
        });
    }
    for tip in &hand.fingertips {
        let kind = match tip.kind {
            FrameKind::Body => "body",
            FrameKind::Site => "site",
        };
        values.push(SummaryValue {
            key: format!("fingertip {} is a", tip.name),
            value: Value::from(kind),
            origin: ValueOrigin::Computed,
        });
    }
    values
}
