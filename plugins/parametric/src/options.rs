//! The options of the hand.

use std::fmt::Display;
use std::ops::RangeInclusive;

use serde::Deserialize;

const FINGERS: RangeInclusive<usize> = 2..=6;
const PHALANGES: RangeInclusive<usize> = 1..=4;
/// Default length of a phalanx (m).
const PHALANX_LENGTH: f64 = 0.045;
/// Bounds within which the generated hand can still grasp the objects of this task.
const LENGTH: RangeInclusive<f64> = 0.01..=0.2;
const RADIUS: RangeInclusive<f64> = 0.003..=0.03;
const PALM_RADIUS: RangeInclusive<f64> = 0.01..=0.2;
const OPEN_ANGLE: RangeInclusive<f64> = 0.0..=0.7;
const POSITIVE: RangeInclusive<f64> = 1e-3..=1e3;

/// The table `[options]` of the sidecar. All options are optional.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Name of the hand.
    pub name: String,
    /// Number of fingers, evenly spaced around the palm.
    pub fingers: usize,
    /// Number of phalanges of each finger, and of its joints.
    pub phalanges: usize,
    /// Lengths of the phalanges from the palm outwards (m); empty: the default for each.
    pub phalanx_lengths: Vec<f64>,
    /// Radius of the fingers (m).
    pub finger_radius: f64,
    /// Radius of the palm's disc, on whose rim the fingers stand (m).
    pub palm_radius: f64,
    /// Outward lean of the fingers of the open hand (rad).
    pub open_angle: f64,
    /// Stiffness of each joint's servo (N m/rad).
    pub kp: f64,
    /// Largest torque of each joint's servo (N m).
    pub force_limit: f64,
    /// Damping of each joint (N m s/rad).
    pub damping: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            name: "parametric".to_owned(),
            fingers: 3,
            phalanges: 3,
            phalanx_lengths: Vec::new(),
            finger_radius: 0.009,
            palm_radius: 0.05,
            open_angle: 0.3,
            kp: 1.5,
            force_limit: 1.0,
            damping: 0.3,
        }
    }
}

impl Options {
    /// Reads and checks options.
    ///
    /// # Errors
    /// Names the option that is unknown or out of its bounds.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut options: Self = toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
        within("fingers", options.fingers, &FINGERS)?;
        within("phalanges", options.phalanges, &PHALANGES)?;
        if options.phalanx_lengths.is_empty() {
            options.phalanx_lengths = vec![PHALANX_LENGTH; options.phalanges];
        }
        if options.phalanx_lengths.len() != options.phalanges {
            let (expected, got) = (options.phalanges, options.phalanx_lengths.len());
            return Err(format!("`phalanx_lengths`: expected {expected} numbers, one for each phalanx, got {got}"));
        }
        for length in &options.phalanx_lengths {
            within("phalanx_lengths", *length, &LENGTH)?;
        }
        within("finger_radius", options.finger_radius, &RADIUS)?;
        within("palm_radius", options.palm_radius, &PALM_RADIUS)?;
        within("open_angle", options.open_angle, &OPEN_ANGLE)?;
        for (name, value) in [("kp", options.kp), ("force_limit", options.force_limit), ("damping", options.damping)] {
            within(name, value, &POSITIVE)?;
        }
        Ok(options)
    }

    /// Length of a straight finger from the palm to its end (m).
    pub(crate) fn reach(&self) -> f64 {
        self.phalanx_lengths.iter().sum::<f64>() + self.finger_radius
    }
}

fn within<T: PartialOrd + Display>(name: &str, value: T, bounds: &RangeInclusive<T>) -> Result<(), String> {
    if bounds.contains(&value) {
        return Ok(());
    }
    Err(format!("`{name}`: expected a number from {} to {}, got {value}", bounds.start(), bounds.end()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_may_be_left_out() {
        let options = Options::parse("").unwrap();
        assert_eq!(options.phalanx_lengths, [PHALANX_LENGTH; 3]);
        assert_eq!(Options { phalanx_lengths: Vec::new(), ..options }, Options::default());
        assert_eq!(Options::parse("phalanges = 1").unwrap().phalanx_lengths, [PHALANX_LENGTH]);
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, says) in [
            ("fingers = 7", "`fingers`: expected a number from 2 to 6, got 7"),
            ("phalanges = 0", "`phalanges`: expected a number from 1 to 4, got 0"),
            ("phalanx_lengths = [0.1]", "`phalanx_lengths`: expected 3 numbers, one for each phalanx, got 1"),
            ("palm_radius = nan", "`palm_radius`: expected a number from 0.01 to 0.2, got NaN"),
            ("finger = 3", "unknown field `finger`"),
            ("fingers = ", "TOML parse error"),
        ] {
            let error = Options::parse(text).unwrap_err();
            assert!(error.contains(says), "{error}");
        }
    }

    #[test]
    fn the_sidecar_writes_the_defaults_down() {
        let sidecar: toml::Table = toml::from_str(include_str!("../hand-plugin.toml")).unwrap();
        let written = sidecar["options"].as_table().unwrap().to_string();
        assert_eq!(Options::parse(&written), Options::parse(""));
        for key in sidecar["options"].as_table().unwrap().keys() {
            assert!(include_str!("../README.md").contains(&format!("| `{key}` |")), "README.md lacks {key}");
        }
    }
}
