//! Position servos among a model's actuators.

use crate::error::HandError;
use crate::mjcf::Attributes;
use crate::parts::{HandJoint, Servo, Transmission};

/// Reads the force law of a position servo, written as `position` or as `general`.
pub(crate) fn read(tag: &str, attributes: &Attributes) -> Result<Option<Servo>, HandError> {
    let first_gain = attributes.number("gainprm")?.unwrap_or(1.0);
    let servo = match tag {
        "position" => {
            let kp = attributes.number("kp")?.unwrap_or(first_gain);
            Servo { gain: kp, bias: 0.0, stiffness: kp }
        }
        "general" => {
            let affine = attributes.text("biastype") == Some("affine")
                && attributes.text("gaintype").unwrap_or("fixed") == "fixed";
            let static_gain = matches!(attributes.text("dyntype").unwrap_or("none"), "none" | "filter" | "filterexact");
            if !affine || !static_gain {
                return Ok(None);
            }
            let bias = attributes.numbers("biasprm")?.unwrap_or_default();
            let at = |i: usize| bias.get(i).copied().unwrap_or(0.0);
            Servo { gain: first_gain, bias: at(0), stiffness: -at(1) }
        }
        _ => return Ok(None),
    };
    Ok((servo.gain != 0.0 && servo.stiffness != 0.0).then_some(servo))
}

/// Computes the range of commands that covers the whole range of a limited joint.
pub(crate) fn reach(
    joints: &[HandJoint],
    transmission: &Transmission,
    gear: f64,
    servo: Option<Servo>,
) -> Option<(f64, f64)> {
    let (Transmission::Joint(joint), Some(servo)) = (transmission, servo) else {
        return None;
    };
    let (low, high) = joints.iter().find(|j| j.name == *joint)?.range()?;
    let command = |position: f64| (servo.stiffness * gear * position - servo.bias) / servo.gain;
    let (a, b) = (command(low), command(high));
    (a.is_finite() && b.is_finite() && a != b).then(|| (a.min(b), a.max(b)))
}
