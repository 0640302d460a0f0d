//! The arm that some files carry above the hand.

use std::sync::Arc;

use eigenhand_hands::xmltree::Element;

use eigenhand_mujoco::{BodyId, Data, JointId, Model, MuJoCo};

use super::findings::Hints;
use super::fingers::{ancestors, palm};
use super::several::Tree;
use super::stand::{CARRIAGE, stand};
use crate::error::OnboardError;

/// A joint belongs to an arm if it moves the palm's origin by more than this (m), or turns by more than this (rad). The
/// joints of a wrist stay below both.
const CARRIED: f64 = 0.08;
const TURNED: f64 = 3.6;
/// Range that is assumed for a joint without limits (rad, m).
const UNLIMITED: (f64, f64) = (-std::f64::consts::PI, std::f64::consts::PI);

/// An arm: the body at its end, and its joints.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arm {
    /// The last body that the arm moves: the hand begins with it.
    pub hand: String,
    /// The joints between that body and the world.
    pub joints: Vec<String>,
}

/// Finds the arm above the palm of the model whose root is `root`; none where the file holds a hand alone.
///
/// # Errors
/// As [`survey`](super::survey).
pub fn arm(
    library: &Arc<MuJoCo>,
    root: &Element,
    assets: &[(String, Vec<u8>)],
    hints: &Hints,
) -> Result<Option<Arm>, OnboardError> {
    let model = Arc::new(Model::from_xml(library, &stand(root, "disable"), assets)?);
    let palm = palm(&model, hints)?;
    let mut data = Data::new(&model)?;
    let own = |body: BodyId| {
        model.joints().filter(|&j| model.joint_body(j) == body && model.joint_name(j) != CARRIAGE).collect::<Vec<_>>()
    };
    let mut found: Option<Arm> = None;
    for body in ancestors(&model, palm) {
        for joint in own(body) {
            let is_arm = carries(&model, &mut data, joint, palm);
            match &mut found {
                None if is_arm => {
                    found = Some(Arm { hand: model.body_name(body), joints: vec![model.joint_name(joint)] })
                }
                // A joint between two parts of the arm belongs to the arm, however little it moves the palm.
                Some(arm) if is_arm || arm.hand != model.body_name(body) => arm.joints.push(model.joint_name(joint)),
                _ => {}
            }
        }
    }
    Ok(found)
}

/// The parts of a file that belong to other hands than that of the palm.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OtherHands {
    /// The body below which the hand is alone.
    pub keep: Option<String>,
    /// The bodies at which the other hands begin.
    pub bodies: Vec<String>,
}

/// Finds other hands beside that of the palm that the hint names.
///
/// # Errors
/// As [`survey`](super::survey).
pub fn other_hands(
    library: &Arc<MuJoCo>,
    root: &Element,
    assets: &[(String, Vec<u8>)],
    hints: &Hints,
) -> Result<Option<OtherHands>, OnboardError> {
    if hints.palm.is_none() {
        return Ok(None);
    }
    let model = Arc::new(Model::from_xml(library, &stand(root, "disable"), assets)?);
    let palm = palm(&model, hints)?;
    let mut data = Data::new(&model)?;
    let surplus = Tree::new(&model, &mut data).surplus(palm);
    let name = |body: BodyId| Some(model.body_name(body)).filter(|name| name != CARRIAGE && !name.is_empty());
    Ok(surplus.map(|found| OtherHands {
        keep: found.keep.and_then(name),
        bodies: found.others.into_iter().filter_map(name).collect(),
    }))
}

/// Tells whether a joint moves the palm as an arm does; a wrist only tilts it.
pub(super) fn carries(model: &Model, data: &mut Data, joint: JointId, palm: BodyId) -> bool {
    let (low, high) = model.joint_range(joint).unwrap_or(UNLIMITED);
    let mut at = |q: f64| {
        data.reset();
        data.qpos_mut()[model.qpos_address(joint)] = q;
        data.forward();
        data.body_position(palm)
    };
    let (first, last) = (at(low), at(high));
    (last - first).norm() > CARRIED || (!model.joint_slides(joint) && high - low > TURNED)
}
