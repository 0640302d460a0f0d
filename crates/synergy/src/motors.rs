//! `motors.toml`: from a synergy's commands to what the motors of a real hand take.

use std::collections::BTreeSet;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{JointInfo, SynergyError};

/// The version of `motors.toml`.
const SCHEMA: i64 = 1;

const HEADER: &str = "\
# Motors: from the commands of synergy/synergy.toml to what your motors take. Fill it in for your hand; a new export keeps it.
#   motor = offset + sign * scale * command, clamped to lower and upper
# `id` is the motor's number on its bus, `sign` 1 or -1, `scale` the motor's units for 1 rad (or 1 m) of command, `offset` the
# motor's value where the command is 0, and `lower` and `upper` its limits, in the motor's units. `joints` says what moves with
# the command; it is only a note. As it was written, each motor takes its command.

";

/// A motor of a real hand, and the actuator whose command it takes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Name of the synergy's actuator.
    pub actuator: String,
    /// Joints that move with it.
    #[serde(default)]
    pub joints: Vec<String>,
    /// The motor's number on its bus.
    pub id: i64,
    /// 1, or -1 for a motor that turns the other way.
    pub sign: i64,
    /// The motor's units for one unit of the command (rad, or m).
    pub scale: f64,
    /// The motor's value where the command is 0.
    pub offset: f64,
    /// The motor's least value.
    pub lower: f64,
    /// The motor's greatest value.
    pub upper: f64,
}

impl Motor {
    fn slope(&self) -> f64 {
        self.sign as f64 * self.scale
    }

    /// Returns the motor's value for a command, within the motor's limits.
    pub fn value(&self, command: f64) -> f64 {
        (self.offset + self.slope() * command).clamp(self.lower, self.upper)
    }

    /// Returns the command of a motor's value.
    pub fn command(&self, value: f64) -> f64 {
        (value - self.offset) / self.slope()
    }
}

/// The motors of a hand, one for each of a synergy's actuators and in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct MotorMap {
    motors: Vec<Motor>,
    actuators: Vec<JointInfo>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MotorFile {
    schema: i64,
    hand: String,
    motors: Vec<Motor>,
}

impl MotorMap {
    /// Returns motors that take the commands as they are: ids from 1 on, no change of sign, offset or unit, and the limits of
    /// the actuators. `joints` lists the joints that move with each actuator.
    ///
    /// # Panics
    /// When `joints` does not have one list for each actuator.
    pub fn identity(actuators: &[JointInfo], joints: &[Vec<String>]) -> MotorMap {
        assert_eq!(actuators.len(), joints.len(), "one list of joints for each actuator is needed");
        let motor = |(i, (actuator, joints)): (usize, (&JointInfo, &Vec<String>))| Motor {
            actuator: actuator.name.clone(),
            joints: joints.clone(),
            id: i as i64 + 1,
            sign: 1,
            scale: 1.0,
            offset: 0.0,
            lower: actuator.lower,
            upper: actuator.upper,
        };
        let motors = actuators.iter().zip(joints).enumerate().map(motor).collect();
        MotorMap { motors, actuators: actuators.to_vec() }
    }

    /// Reads `motors.toml` for the actuators of a hand's synergy.
    ///
    /// # Errors
    /// A file that cannot be read, is no TOML, or is of another hand; an actuator without a motor or with two, an id that two
    /// motors have, or a sign, scale or limit that is none. The message names the motor and what is expected.
    pub fn read(path: impl AsRef<Path>, hand: &str, actuators: &[JointInfo]) -> Result<MotorMap, SynergyError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(SynergyError::io("read", path))?;
        Self::from_toml(&text, hand, actuators).map_err(|error| error.in_file(path))
    }

    /// Reads the text of a file, as [`read`](Self::read).
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn from_toml(text: &str, hand: &str, actuators: &[JointInfo]) -> Result<MotorMap, SynergyError> {
        let file: MotorFile = toml::from_str(text).map_err(SynergyError::MotorsToml)?;
        if file.hand != hand {
            return Err(SynergyError::motors("hand", hand, &file.hand));
        }
        if file.schema != SCHEMA {
            return Err(SynergyError::Schema { what: "the file of motors", expected: SCHEMA, got: file.schema });
        }
        let mut ids = BTreeSet::new();
        for motor in &file.motors {
            let wrong = |key: &str, expected: &str, got: String| {
                Err(SynergyError::motors(format!("{key} of the motor of {}", motor.actuator), expected, got))
            };
            if !actuators.iter().any(|actuator| actuator.name == motor.actuator) {
                let names: Vec<&str> = actuators.iter().map(|actuator| actuator.name.as_str()).collect();
                return Err(SynergyError::motors("actuator of a motor", names.join(", "), &motor.actuator));
            }
            if !ids.insert(motor.id) {
                return wrong("id", "a number that no other motor has", motor.id.to_string());
            }
            if !matches!(motor.sign, 1 | -1) {
                return wrong("sign", "1 or -1", motor.sign.to_string());
            }
            if !(motor.scale.is_finite() && motor.scale > 0.0) {
                return wrong("scale", "a positive number; sign says which way", motor.scale.to_string());
            }
            if !motor.offset.is_finite() {
                return wrong("offset", "a finite number", motor.offset.to_string());
            }
            if motor.lower.is_nan() || motor.upper.is_nan() || motor.lower >= motor.upper {
                return wrong(
                    "lower and upper",
                    "two numbers, the lower first",
                    format!("{}, {}", motor.lower, motor.upper),
                );
            }
        }
        let motor_of = |actuator: &JointInfo| {
            let mut found = file.motors.iter().filter(|motor| motor.actuator == actuator.name);
            match (found.next(), found.count()) {
                (Some(motor), 0) => Ok(motor.clone()),
                (first, more) => {
                    let got = usize::from(first.is_some()) + more;
                    Err(SynergyError::motors(format!("motors of {}", actuator.name), "one", got.to_string()))
                }
            }
        };
        let motors = actuators.iter().map(motor_of).collect::<Result<_, _>>()?;
        Ok(MotorMap { motors, actuators: actuators.to_vec() })
    }

    /// Returns the text of the file.
    ///
    /// # Errors
    /// A text that cannot be written as TOML.
    pub fn to_toml(&self, hand: &str) -> Result<String, SynergyError> {
        let file = MotorFile { schema: SCHEMA, hand: hand.to_owned(), motors: self.motors.clone() };
        Ok(format!("{HEADER}{}", toml::to_string(&file)?))
    }

    /// Returns the motors, in the order of the actuators.
    pub fn motors(&self) -> &[Motor] {
        &self.motors
    }

    /// (commands of the actuators) => values of the motors, each within its limits
    ///
    /// # Panics
    /// When there is not one command for each actuator.
    pub fn values(&self, commands: &[f64]) -> Vec<f64> {
        assert_eq!(commands.len(), self.motors.len(), "one command for each actuator is needed");
        self.motors.iter().zip(commands).map(|(motor, command)| motor.value(*command)).collect()
    }

    /// (values of the motors) => commands of the actuators
    ///
    /// # Panics
    /// When there is not one value for each motor.
    pub fn commands(&self, values: &[f64]) -> Vec<f64> {
        assert_eq!(values.len(), self.motors.len(), "one value for each motor is needed");
        self.motors.iter().zip(values).map(|(motor, value)| motor.command(*value)).collect()
    }

    /// Returns the motors whose limits cut off a part of their actuators' range, each with the share that is left.
    pub fn limited(&self) -> Vec<(&Motor, f64)> {
        let left = |(motor, actuator): (&'_ Motor, &JointInfo)| {
            let range = actuator.upper - actuator.lower;
            let [a, b] = [actuator.lower, actuator.upper].map(|command| motor.command(motor.value(command)));
            // Without a range there is nothing to cut off.
            if range.is_finite() && range > 0.0 { ((b - a) / range).clamp(0.0, 1.0) } else { 1.0 }
        };
        let shares = self.motors.iter().zip(&self.actuators).map(|pair| (pair.0, left(pair)));
        shares.filter(|(_, share)| *share < 1.0 - 1e-9).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Unit;

    fn actuators() -> Vec<JointInfo> {
        let actuator = |(name, lower, upper): (&str, f64, f64)| JointInfo {
            name: name.to_owned(),
            unit: Unit::Radian,
            lower,
            upper,
        };
        [("bend", 0.0, 1.5), ("spread", -0.3, 0.3)].map(actuator).to_vec()
    }

    #[test]
    fn motors_take_commands_and_give_them_back() {
        let written = MotorMap::identity(&actuators(), &[vec!["a".to_owned(), "b".to_owned()], Vec::new()]);
        let text = written.to_toml("hand").unwrap();
        assert_eq!(MotorMap::from_toml(&text, "hand", &actuators()).unwrap(), written);
        assert_eq!(written.values(&[0.7, -0.5]), [0.7, -0.3], "the command beyond the range is clamped");
        assert!(written.limited().is_empty());

        // The second motor turns the other way, counts 4096 steps a turn, and stops early.
        let text = "schema = 1\nhand = \"h\"\n[[motors]]\nactuator = \"spread\"\nid = 7\nsign = -1\nscale = 651.9\n\
                    offset = 2048.0\nlower = 2000.0\nupper = 2500.0\n[[motors]]\nactuator = \"bend\"\nid = 3\nsign = 1\n\
                    scale = 1.0\noffset = 0.1\nlower = 0.0\nupper = 2.0\n";
        let map = MotorMap::from_toml(text, "h", &actuators()).unwrap();
        assert_eq!(map.motors().iter().map(|motor| motor.id).collect::<Vec<_>>(), [3, 7], "the synergy's order");
        let values = map.values(&[1.0, -0.2]);
        assert!((values[0] - 1.1).abs() < 1e-12 && (values[1] - (2048.0 + 0.2 * 651.9)).abs() < 1e-9, "{values:?}");
        let back = map.commands(&values);
        assert!((back[0] - 1.0).abs() < 1e-12 && (back[1] + 0.2).abs() < 1e-12, "{back:?}");
        let limited = map.limited();
        assert_eq!(limited.len(), 1);
        // From 2000 to 2048 + 0.3 * 651.9, of twice 0.3 * 651.9.
        let expected = (48.0 + 0.3 * 651.9) / (0.6 * 651.9);
        assert!(limited[0].0.id == 7 && (limited[0].1 - expected).abs() < 1e-9, "{limited:?}");
    }

    #[test]
    fn what_is_wrong_with_a_motor_is_said() {
        let text = MotorMap::identity(&actuators(), &[Vec::new(), Vec::new()]).to_toml("hand").unwrap();
        for (from, to, expected) in [
            ("sign = 1", "sign = 2", "sign of the motor of bend: expected 1 or -1, got 2"),
            ("id = 2", "id = 1", "id of the motor of spread: expected a number that no other motor has, got 1"),
            ("scale = 1.0", "scale = 0.0", "scale of the motor of bend: expected a positive number"),
            ("offset = 0.0", "offset = nan", "offset of the motor of bend"),
            ("upper = 1.5", "upper = -1.0", "lower and upper of the motor of bend"),
            ("\"spread\"", "\"bend\"", "motors of bend: expected one, got 2"),
            ("\"spread\"", "\"twist\"", "actuator of a motor: expected bend, spread, got twist"),
            ("sign = 1", "sing = 1", "unknown field `sing`"),
            ("schema = 1", "schema = 2", "schema 2"),
            ("\"hand\"", "\"other\"", "hand: expected hand, got other"),
        ] {
            assert!(text.contains(from), "{text}");
            let error = MotorMap::from_toml(&text.replacen(from, to, 1), "hand", &actuators()).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
