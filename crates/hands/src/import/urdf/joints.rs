//! Joints of a URDF: the motion of each, and the groups of links that move together.

use std::path::Path;

use nalgebra::{Isometry3, Translation3, UnitVector3, Vector3};
use urdf_rs::JointType;

use super::finite::{HUGE, finite, pose};
use super::source::Source;
use super::tree::Tree;
use crate::error::HandError;
use crate::notes::note;

/// Motion of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Motion {
    Fixed,
    Hinge,
    Slide,
}

/// A joint in the terms of MJCF.
#[derive(Debug)]
pub(super) struct Joint {
    pub(super) motion: Motion,
    /// From the parent link's frame to the child's.
    pub(super) pose: Isometry3<f64>,
    /// Unit axis in the child's frame.
    pub(super) axis: UnitVector3<f64>,
    /// Limits of the position, if any.
    pub(super) range: Option<[f64; 2]>,
    /// Position of a joint with equal limits, which is fixed there.
    pub(super) held_at: f64,
    /// Damping, friction, effort and velocity in the file; none if absent or zero.
    pub(super) damping: Option<f64>,
    pub(super) friction: Option<f64>,
    pub(super) effort: Option<f64>,
    pub(super) velocity: Option<f64>,
}

/// Names of joints for the notes.
#[derive(Default)]
struct Mended<'a> {
    unlimited: Vec<&'a str>,
    swapped: Vec<&'a str>,
    held: Vec<&'a str>,
}

/// Reads all joints, in the order of the file.
pub(super) fn read(source: &Source, file: &Path, notes: &mut Vec<String>) -> Result<Vec<Joint>, HandError> {
    let mut mended = Mended::default();
    let joints = source
        .robot
        .joints
        .iter()
        .zip(&source.stated)
        .map(|(joint, stated)| read_joint(joint, stated.range, &mut mended, file))
        .collect::<Result<_, _>>()?;
    note(notes, "joints without limits in the file stay unlimited", &mended.unlimited);
    note(notes, "limits were swapped, because the lower was above the upper, at the joints", &mended.swapped);
    note(notes, "joints with equal limits were fixed there", &mended.held);
    Ok(joints)
}

fn read_joint<'a>(
    joint: &'a urdf_rs::Joint,
    range_stated: bool,
    mended: &mut Mended<'a>,
    file: &Path,
) -> Result<Joint, HandError> {
    let name = joint.name.as_str();
    let place = format!("joint `{name}`");
    let motion = match joint.joint_type {
        JointType::Revolute | JointType::Continuous => Motion::Hinge,
        JointType::Prismatic => Motion::Slide,
        // The source holds no joint of another type.
        _ => Motion::Fixed,
    };
    let mut read = Joint {
        motion,
        pose: pose(&joint.origin, &place, file)?,
        axis: Vector3::z_axis(),
        range: None,
        held_at: 0.0,
        damping: None,
        friction: None,
        effort: None,
        velocity: None,
    };
    if motion == Motion::Fixed {
        return Ok(read);
    }
    let axis = finite(&joint.axis.xyz.0, &format!("{place} <axis>"), file)?;
    read.axis = UnitVector3::try_new(Vector3::from(axis), 1e-9)
        .ok_or_else(|| HandError::model(file, format!("{place} <axis>"), "a direction", "0 0 0"))?;
    let limit = &joint.limit;
    let dynamics = joint.dynamics.as_ref();
    for (key, value, target) in [
        ("damping", dynamics.map_or(0.0, |d| d.damping), &mut read.damping),
        ("friction", dynamics.map_or(0.0, |d| d.friction), &mut read.friction),
        ("effort", limit.effort, &mut read.effort),
        ("velocity", limit.velocity, &mut read.velocity),
    ] {
        if value.is_nan() {
            return Err(HandError::model(file, format!("{place} {key}"), "a number", value));
        }
        // An infinite limit is no limit.
        *target = (value > 0.0 && value.is_finite()).then_some(value);
    }
    if joint.joint_type == JointType::Continuous {
        return Ok(read);
    }
    match bounds(limit.lower, limit.upper, range_stated)
        .map_err(|got| HandError::model(file, format!("{place} <limit>"), "numbers", got))?
    {
        None => mended.unlimited.push(name),
        Some([lower, upper]) if lower == upper => {
            mended.held.push(name);
            read.hold(lower);
        }
        Some([lower, upper]) if lower > upper => {
            mended.swapped.push(name);
            read.range = Some([upper, lower]);
        }
        range => read.range = range,
    }
    Ok(read)
}

fn bounds(lower: f64, upper: f64, stated: bool) -> Result<Option<[f64; 2]>, f64> {
    match [lower, upper].iter().find(|x| x.is_nan()) {
        Some(nan) => Err(*nan),
        None => Ok((stated && lower.abs() < HUGE && upper.abs() < HUGE).then_some([lower, upper])),
    }
}

impl Joint {
    fn hold(&mut self, position: f64) {
        self.pose *= match self.motion {
            Motion::Hinge => Isometry3::rotation(self.axis.scale(position)),
            _ => Isometry3::from(Translation3::from(self.axis.scale(position))),
        };
        self.held_at = position;
        self.motion = Motion::Fixed;
    }
}

/// Returns, for every link, the first link of its rigid group: the root, or a link whose joint moves.
pub(super) fn groups(tree: &Tree, joints: &[Joint]) -> Vec<usize> {
    let mut groups: Vec<usize> = (0..tree.joint.len()).collect();
    for &link in &tree.order {
        if let (Some(parent), Some(joint)) = (tree.parent[link], tree.joint[link])
            && joints[joint].motion == Motion::Fixed
        {
            groups[link] = groups[parent];
        }
    }
    groups
}
