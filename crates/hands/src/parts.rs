//! The parts of a hand: joints, actuators, couplings and fingertips, as plain data.

use std::ops::Deref;

use eigenhand_posture::JointInfo;
use serde::Serialize;

/// A joint of the model, with one degree of freedom.
#[derive(Debug, Clone, PartialEq)]
pub struct HandJoint {
    /// Name, unit and limits. A hinge is in rad, a slide in m.
    pub info: JointInfo,
    /// Position in the model's initial configuration (rad or m).
    pub reference: f64,
    /// Body that the joint moves; empty for the slide.
    pub body: String,
}

/// A joint of the model is a joint of postures with more to it.
impl Deref for HandJoint {
    type Target = JointInfo;

    fn deref(&self) -> &JointInfo {
        &self.info
    }
}

/// The part of the model on which an actuator acts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub enum Transmission {
    /// A joint.
    Joint(String),
    /// A fixed tendon: its length is the sum of joint position times coefficient.
    FixedTendon {
        /// The tendon's name.
        name: String,
        /// Joint and coefficient of each term.
        terms: Vec<(String, f64)>,
    },
    /// Another part, as attribute and name: a spatial tendon, a site, a body.
    Other(String),
}

/// Force law of an actuator that holds a position: `force = gain * ctrl + bias - stiffness * length`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Servo {
    /// Force for one unit of control.
    pub gain: f64,
    /// Force at control 0 and length 0 (N or N m).
    pub bias: f64,
    /// Force for one unit of length (N/m or N m/rad).
    pub stiffness: f64,
}

/// An actuator of the model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HandActuator {
    /// Name in the model.
    pub name: String,
    /// Element of the model, such as `position`.
    pub tag: String,
    /// The part on which it acts.
    pub transmission: Transmission,
    /// Factor from the position of the transmission to the actuator's length.
    pub gear: f64,
    /// Lowest and highest command, in the actuator's own unit.
    pub ctrlrange: (f64, f64),
    /// True if the model gives no control range, so that it was computed from the joint's range.
    pub ctrlrange_computed: bool,
    /// Lowest and highest force (N or N m), if limited.
    pub forcerange: Option<(f64, f64)>,
    /// Its force law, if it is a position servo.
    pub servo: Option<Servo>,
}

/// A joint equality of the model: `dependent = polynomial(driver)`, each measured from its reference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HandCoupling {
    /// The joint that follows.
    pub dependent: String,
    /// The joint to follow; none if the dependent joint is held in place.
    pub driver: Option<String>,
    /// Coefficients of powers 0 to 4.
    pub polynomial: [f64; 5],
    /// Reference position of the dependent joint.
    pub dependent_reference: f64,
    /// Reference position of the driver.
    pub driver_reference: f64,
}

impl HandCoupling {
    /// Returns the dependent joint's position for a position of its driver.
    pub fn evaluate(&self, driver: f64) -> f64 {
        let x = driver - self.driver_reference;
        self.dependent_reference + self.polynomial.iter().rev().fold(0.0, |sum, a| sum * x + a)
    }
}

/// Kind of frame that a fingertip names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FrameKind {
    /// A body's frame.
    Body,
    /// A site.
    Site,
}

/// Tip of a finger.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Fingertip {
    /// Name in the model.
    pub name: String,
    /// Kind of frame; a site if a site and a body share the name.
    pub kind: FrameKind,
}
