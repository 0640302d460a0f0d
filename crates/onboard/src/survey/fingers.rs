//! The tree of a hand: its palm, its fingers and their tips.

use std::sync::Arc;

use eigenhand_mujoco::{BodyId, Data, GeomId, JointId, Model};
use nalgebra::Vector3;

use super::findings::Hints;
use super::several::{Tree, palms};
use super::stand::CARRIAGE;
use crate::error::{OnboardError, refuse};

/// Largest number of bodies that an error lists.
const SHOWN: usize = 15;

/// A finger while it is measured.
pub(super) struct Chain {
    /// Joint nearest to the palm.
    pub(super) first_joint: JointId,
    /// Body that holds the tip.
    pub(super) tip_body: BodyId,
    /// The tip in the body's frame.
    pub(super) tip: Vector3<f64>,
    /// Whether every joint of the finger follows another one.
    pub(super) follows: bool,
    /// The joint whose axis the finger slides along, if no joint of it turns.
    pub(super) slide: Option<JointId>,
    /// The hinges of the finger, whose anchors lie along it.
    pub(super) hinges: Vec<JointId>,
    /// Whether this is a part of the palm that does not move, against which the only finger closes.
    pub(super) fixed: bool,
}

/// Lists the bodies from `body` up to the world, `body` first.
pub(super) fn ancestors(model: &Model, body: BodyId) -> impl Iterator<Item = BodyId> + '_ {
    let mut next = Some(body);
    std::iter::from_fn(move || {
        let current = next?;
        let parent = model.body_parent(current);
        next = (parent != current).then_some(parent);
        Some(current)
    })
}

/// Tells for every body whether a joint of the hand moves it relative to its parent.
pub(super) fn jointed(model: &Model) -> Vec<bool> {
    let mut found = vec![false; model.nbody()];
    for joint in model.joints().filter(|&joint| model.joint_name(joint) != CARRIAGE) {
        found[model.joint_body(joint).index()] = true;
    }
    found
}

/// Returns the palm: the body that the hint names, or else the body that carries every finger.
///
/// # Errors
/// [`OnboardError::Survey`] if the file holds several hands, or a hand beside other limbs, and no hint names the palm.
pub(super) fn palm(model: &Arc<Model>, hints: &Hints) -> Result<BodyId, OnboardError> {
    let Some(name) = &hints.palm else {
        let palm = common_ancestor(model);
        let mut data = Data::new(model)?;
        let hands = Tree::new(model, &mut data).hands();
        let moves = jointed(model);
        let group = |body| rigid_root(model, &moves, body);
        let whole = match &hands[..] {
            [] => false,
            [only] => palm.as_ref().map_or(true, |&palm| group(palm) != group(only.palm)),
            _ => true,
        };
        return if whole { Err(more_than_a_hand(&palms(model, &hands))) } else { palm };
    };
    let moves = jointed(model);
    let carries =
        |body: &BodyId| body.index() > 0 && model.bodies().any(|b| moves[b.index()] && model.body_parent(b) == *body);
    model.body(name).map_err(|_| {
        let names = model.bodies().filter(carries).map(|b| model.body_name(b)).filter(|name| name != CARRIAGE);
        let names: Vec<String> = names.take(SHOWN).collect();
        refuse(format!(
            "the file has no body {name:?}; choose from the bodies that carry moving parts: {}",
            names.join(", ")
        ))
    })
}

fn more_than_a_hand(palms: &[String]) -> OnboardError {
    let options: Vec<String> = palms.iter().take(SHOWN).map(|name| format!("--palm {name}")).collect();
    let what = if palms.len() == 1 { "a hand among other limbs" } else { "more than one hand" };
    refuse(format!("the file holds {what}: name the palm with {}", options.join(" or ")))
}

/// Returns the body that carries every finger: the lowest one above all moving parts.
fn common_ancestor(model: &Model) -> Result<BodyId, OnboardError> {
    let moves = jointed(model);
    let has_child_that_moves = |body: BodyId| {
        model.bodies().any(|b| moves[b.index()] && b != body && ancestors(model, b).skip(1).any(|a| a == body))
    };
    let ends: Vec<BodyId> = model.bodies().filter(|&b| moves[b.index()] && !has_child_that_moves(b)).collect();
    let first = *ends.first().ok_or_else(|| refuse("the file has no joint, so it has no finger that moves"))?;
    let shared = ancestors(model, first)
        .skip(usize::from(ends.len() == 1))
        .find(|&a| ends.iter().all(|&end| end != a && ancestors(model, end).any(|b| b == a)));
    shared
        .filter(|&b| b.index() > 0 && model.body_name(b) != CARRIAGE)
        .ok_or_else(|| refuse("no body carries all fingers; name the palm with --palm"))
}

/// Returns the top body of the rigid group of `body`; no joint moves the bodies of a group relative to one another.
pub(super) fn rigid_root(model: &Model, moves: &[bool], body: BodyId) -> BodyId {
    ancestors(model, body).find(|b| moves[b.index()] || model.body_parent(*b).index() == 0).unwrap_or(body)
}

/// Finds the fingers of a palm: the branches that joints connect to it, and that can meet. Branches that a closed loop
/// ties together are one finger.
pub(super) fn chains(model: &Arc<Model>, palm: BodyId) -> Result<Vec<Chain>, OnboardError> {
    let mut data = Data::new(model)?;
    let mut tree = Tree::new(model, &mut data);
    let fingers: Vec<Vec<BodyId>> = tree.fingers_of(palm).iter().map(|finger| tree.bodies(finger)).collect();
    let moves = jointed(model);
    let mut found: Vec<Chain> =
        fingers.into_iter().filter_map(|bodies| chain(model, &data, &moves, palm, bodies)).collect();
    found.sort_by_key(|chain| chain.first_joint);
    if found.is_empty() {
        let palm = model.body_name(palm);
        return Err(refuse(format!(
            "{palm:?} carries no jointed part that can touch an object; name the palm with --palm"
        )));
    }
    Ok(found)
}

/// Measures the finger that consists of `bodies`. Its tip is the point of its last moving part that is farthest from
/// the joints before that part.
pub(super) fn chain(model: &Model, data: &Data, moves: &[bool], palm: BodyId, bodies: Vec<BodyId>) -> Option<Chain> {
    let depth = |body: BodyId| ancestors(model, body).filter(|b| moves[b.index()]).count();
    let joint_of = |body: BodyId| model.joints().find(|&j| model.joint_body(j) == body);
    let first_joint = bodies.iter().find_map(|&b| joint_of(b))?;
    let base = base_of(model, data, palm, first_joint);
    let geoms: Vec<GeomId> =
        model.geoms().filter(|&g| model.geom_collides(g) && bodies.contains(&model.geom_body(g))).collect();
    let deepest = geoms.iter().map(|&g| depth(model.geom_body(g))).max()?;
    let (body, point) = geoms
        .iter()
        .filter(|&&g| depth(model.geom_body(g)) == deepest)
        .map(|&g| {
            let part = rigid_root(model, moves, model.geom_body(g));
            let from = joint_of(part).map_or(base, |joint| base_of(model, data, palm, joint));
            let away = data.geom_position(g) - from;
            // The tip of a sliding jaw is where the jaw extends farthest perpendicular to its slide.
            let slides = joint_of(part).filter(|&joint| model.joint_slides(joint)).map(|joint| data.joint_axis(joint));
            let away = slides.map_or(away, |axis| away - axis * away.dot(&axis));
            let outward = if away.norm() > 1e-6 { away } else { from - base };
            // The tip lies on the line through the geom's middle, because the farthest point of a box would be a
            // corner.
            let (middle, outward) = (data.geom_position(g), outward.try_normalize(1e-9).unwrap_or_else(Vector3::z));
            let length = (data.farthest_point(g, &outward) - middle).dot(&outward);
            (model.geom_body(g), middle + outward * length)
        })
        .max_by(|a, b| (a.1 - base).norm().total_cmp(&(b.1 - base).norm()))?;
    let tip = data.body_orientation(body).inverse_transform_vector(&(point - data.body_position(body)));
    let following = model.following_joints();
    let joints: Vec<JointId> = model.joints().filter(|&j| bodies.contains(&model.joint_body(j))).collect();
    let follows = joints.iter().all(|j| following.contains(j));
    let hinges: Vec<JointId> = joints.iter().copied().filter(|&j| !model.joint_slides(j)).collect();
    let slide = hinges.is_empty().then_some(first_joint);
    Some(Chain { first_joint, tip_body: body, tip, follows, slide, hinges, fixed: false })
}

/// Returns the base of a finger: the anchor of its first joint, or the middle of the palm if that joint slides.
pub(super) fn base_of(model: &Model, data: &Data, palm: BodyId, joint: JointId) -> Vector3<f64> {
    if !model.joint_slides(joint) {
        return data.joint_anchor(joint);
    }
    let own: Vec<Vector3<f64>> = model
        .geoms()
        .filter(|&g| model.geom_collides(g) && model.geom_body(g) == palm)
        .map(|g| data.geom_position(g))
        .collect();
    if own.is_empty() { data.body_position(palm) } else { own.iter().sum::<Vector3<f64>>() / own.len() as f64 }
}
