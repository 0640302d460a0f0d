//! The joints of a posture, with units and limits.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The unit of a joint's coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Unit {
    /// A rotation, in radians.
    #[serde(rename = "rad")]
    Radian,
    /// A translation, in metres.
    #[serde(rename = "m")]
    Metre,
}

impl Unit {
    /// Returns the symbol that the files use: `rad` or `m`.
    pub fn symbol(self) -> &'static str {
        match self {
            Unit::Radian => "rad",
            Unit::Metre => "m",
        }
    }

    /// Returns the unit whose symbol is `symbol`, if there is one.
    pub fn from_symbol(symbol: &str) -> Option<Self> {
        [Unit::Radian, Unit::Metre].into_iter().find(|unit| unit.symbol() == symbol)
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol())
    }
}

/// One joint of a posture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointInfo {
    /// The joint's name; any text that is not empty.
    pub name: String,
    /// The unit of `lower`, `upper` and of the joint's column in every posture.
    pub unit: Unit,
    /// The lower limit; `-inf` for a joint without one.
    pub lower: f64,
    /// The upper limit; `inf` for a joint without one.
    pub upper: f64,
}

impl JointInfo {
    /// Returns the lower and the upper limit; none where the joint has neither.
    pub fn range(&self) -> Option<(f64, f64)> {
        (self.lower > f64::NEG_INFINITY || self.upper < f64::INFINITY).then_some((self.lower, self.upper))
    }

    /// Returns `value` moved to the nearest position that the joint can take.
    pub fn clamp(&self, value: f64) -> f64 {
        value.clamp(self.lower, self.upper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_symbols_are_those_of_serde() {
        assert_eq!(Unit::from_symbol("deg"), None);
        for unit in [Unit::Radian, Unit::Metre] {
            assert_eq!(Unit::from_symbol(unit.symbol()), Some(unit));
            assert_eq!(toml::Value::try_from(unit).expect("a word").as_str(), Some(unit.symbol()));
        }
    }

    #[test]
    fn a_joint_without_limits_takes_every_position() {
        let joint = |lower, upper| JointInfo { name: "a".to_owned(), unit: Unit::Radian, lower, upper };
        let free = joint(f64::NEG_INFINITY, f64::INFINITY);
        assert_eq!((free.range(), free.clamp(7.0)), (None, 7.0));
        let limited = joint(-1.0, 2.0);
        assert_eq!((limited.range(), limited.clamp(7.0), limited.clamp(-7.0)), (Some((-1.0, 2.0)), 2.0, -1.0));
    }
}
