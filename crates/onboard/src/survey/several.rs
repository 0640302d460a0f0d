//! The hands that a file holds: usually one, but some files hold two, or a whole robot.

use std::collections::BTreeMap;

use eigenhand_mujoco::{BodyId, Data, GeomId, JointId, Model};
use nalgebra::Vector3;

use super::arm::carries;
use super::fingers::{ancestors, jointed, rigid_root};
use super::stand::CARRIAGE;

/// Longest finger of a hand in m; what is longer is a limb.
const LONGEST: f64 = 0.6;
/// A part that moves and branches is two fingers if the shorter branch has at least this share of the longer one's
/// length. Otherwise the branch is a link of the finger.
const COMPARABLE: f64 = 0.6;
/// Shortest finger among the comparable ones, as a share of the longest.
const SHORTEST: f64 = 0.35;
/// Least distance in m between the tips of two fingers on one moving part.
const APART: f64 = 0.012;
/// The same for two fingers that make a hand, and their least length in m.
const HAND_APART: f64 = 0.02;
const HAND_LENGTH: f64 = 0.02;

/// A branch of the tree that ends in a finger: bodies that joints connect to what carries it.
#[derive(Clone, Debug)]
pub(super) struct Branch {
    /// The first moving body; several if a closed loop ties them together.
    pub(super) tops: Vec<BodyId>,
    /// The joint's anchor, or the middle of a sliding part, in the model's initial configuration.
    base: Vector3<f64>,
    /// The farthest point from the base along the branch, and the way to it in m.
    tip: Vector3<f64>,
    length: f64,
}

/// Fingers that can touch one another, and the lowest body that carries them all.
#[derive(Clone, Debug)]
pub(super) struct HandInFile {
    pub(super) palm: BodyId,
    pub(super) fingers: Vec<Branch>,
}

/// The tree of a model, in its initial configuration.
pub(super) struct Tree<'a> {
    model: &'a Model,
    data: &'a mut Data,
    moves: Vec<bool>,
    tied: Vec<(BodyId, BodyId)>,
}

impl<'a> Tree<'a> {
    /// `data` is left in the initial configuration.
    pub(super) fn new(model: &'a Model, data: &'a mut Data) -> Self {
        data.reset();
        data.forward();
        let (moves, tied) = (jointed(model), model.tied_bodies());
        Tree { model, data, moves, tied }
    }

    /// Lists the hands of the file.
    pub(super) fn hands(&mut self) -> Vec<HandInFile> {
        let world = self.model.bodies().find(|&body| self.model.body_parent(body) == body);
        let roots: Vec<BodyId> =
            self.model.bodies().filter(|&b| Some(b) != world && Some(self.model.body_parent(b)) == world).collect();
        roots.into_iter().flat_map(|root| self.hands_of(root)).collect()
    }

    /// Lists the fingers that the rigid group of `body` carries. A moving part of the palm that carries several fingers
    /// counts as these.
    pub(super) fn fingers_of(&mut self, body: BodyId) -> Vec<Branch> {
        let group = rigid_root(self.model, &self.moves, body);
        self.branches(group).into_iter().flat_map(|branch| self.parts_of(branch)).collect()
    }

    /// Lists the bodies at and below the tops of a branch.
    pub(super) fn bodies(&self, branch: &Branch) -> Vec<BodyId> {
        let below = |body: BodyId| ancestors(self.model, body).any(|b| branch.tops.contains(&b));
        self.model.bodies().filter(|&b| below(b)).collect()
    }

    /// Lists the hands whose fingers the rigid group of `group` carries, or a part below it.
    fn hands_of(&mut self, group: BodyId) -> Vec<HandInFile> {
        let (mut own, mut found) = (Vec::new(), Vec::new());
        for branch in self.branches(group) {
            let below: Vec<HandInFile> = match branch.tops[..] {
                [top] => self.hands_of(top),
                _ => Vec::new(),
            };
            let is_limb = below.iter().any(|hand| self.far(&branch, hand) || self.carried(group, hand.palm));
            if is_limb {
                found.extend(below);
            } else {
                own.extend(self.parts_of(branch));
            }
        }
        own.retain(|finger| finger.length <= LONGEST);
        for fingers in clusters(own).into_iter().filter(|fingers| is_hand(fingers)) {
            let tops: Vec<BodyId> = fingers.iter().flat_map(|f| f.tops.iter().copied()).collect();
            found.extend(self.carrier(&tops).map(|palm| HandInFile { palm, fingers }));
        }
        found
    }

    /// Tells whether joints between a group and a body below it carry that body as an arm does.
    fn carried(&mut self, group: BodyId, body: BodyId) -> bool {
        let above: Vec<BodyId> = ancestors(self.model, body).take_while(|&b| b != group).collect();
        let joints: Vec<JointId> = self.model.joints().filter(|&j| above.contains(&self.model.joint_body(j))).collect();
        let found = joints.into_iter().any(|joint| carries(self.model, self.data, joint, body));
        self.data.reset();
        self.data.forward();
        found
    }

    /// Tells whether a hand is farther from the joint of its branch than its fingers are long.
    fn far(&self, branch: &Branch, hand: &HandInFile) -> bool {
        let longest = hand.fingers.iter().map(|finger| finger.length).fold(0.0, f64::max);
        hand.fingers.iter().all(|finger| (finger.base - branch.base).norm() > 2.0 * longest)
    }

    /// Returns the lowest body that carries all of these bodies; none without bodies.
    pub(super) fn carrier(&self, tops: &[BodyId]) -> Option<BodyId> {
        let carries_all = |&body: &BodyId| tops.iter().all(|&t| ancestors(self.model, t).skip(1).any(|b| b == body));
        ancestors(self.model, *tops.first()?).skip(1).find(carries_all)
    }

    /// Lists the branches that joints connect to a rigid group, without those that cannot touch an object.
    fn branches(&self, group: BodyId) -> Vec<Branch> {
        let mut leader: BTreeMap<BodyId, BodyId> = BTreeMap::new();
        let top_of = |body: BodyId| {
            let path = ancestors(self.model, body);
            path.take_while(|&b| rigid_root(self.model, &self.moves, b) != group).last()
        };
        let below = |body: BodyId| ancestors(self.model, body).any(|b| b == group);
        for body in self.model.bodies().filter(|&b| below(b)) {
            if let Some(top) = top_of(body) {
                leader.insert(top, top);
            }
        }
        for &(a, b) in &self.tied {
            if !below(a) || !below(b) {
                continue;
            }
            if let (Some(a), Some(b)) = (top_of(a), top_of(b)) {
                let (from, to) = (leader[&a], leader[&b]);
                leader.values_mut().filter(|l| **l == from).for_each(|l| *l = to);
            }
        }
        let mut leaders: Vec<BodyId> = leader.values().copied().collect();
        leaders.sort_unstable();
        leaders.dedup();
        let tops = |l: BodyId| leader.iter().filter(|(_, other)| **other == l).map(|(&top, _)| top).collect();
        leaders.into_iter().filter_map(|l| self.measure(tops(l))).collect()
    }

    /// Measures a branch; none if no part of it collides.
    fn measure(&self, tops: Vec<BodyId>) -> Option<Branch> {
        let mut branch = Branch { tops, base: Vector3::zeros(), tip: Vector3::zeros(), length: 0.0 };
        let bodies = self.bodies(&branch);
        let geoms: Vec<GeomId> = self
            .model
            .geoms()
            .filter(|&g| self.model.geom_collides(g) && bodies.contains(&self.model.geom_body(g)))
            .collect();
        let count = geoms.len().max(1) as f64;
        let middle = geoms.iter().map(|&g| self.data.geom_position(g)).sum::<Vector3<f64>>() / count;
        let joint = self.model.joints().find(|&j| bodies.contains(&self.model.joint_body(j)))?;
        branch.base = if self.model.joint_slides(joint) { middle } else { self.data.joint_anchor(joint) };
        for &geom in &geoms {
            let joints = self.anchors(self.model.geom_body(geom), &bodies);
            let last = joints.last().copied().unwrap_or(branch.base);
            let outward = self.data.geom_position(geom) - last;
            let outward = if outward.norm() > 1e-6 { outward } else { Vector3::z() };
            let tip = self.data.farthest_point(geom, &outward);
            let mut way: Vec<Vector3<f64>> = vec![branch.base];
            way.extend(joints);
            way.push(tip);
            let length = way.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
            if length > branch.length {
                (branch.length, branch.tip) = (length, tip);
            }
        }
        if let Some((low, high)) = self.model.joint_range(joint).filter(|_| self.model.joint_slides(joint)) {
            branch.length += high - low;
        }
        (!geoms.is_empty()).then_some(branch)
    }

    /// Lists the anchors of the hinges that move a body, from the first one among `bodies`.
    fn anchors(&self, body: BodyId, bodies: &[BodyId]) -> Vec<Vector3<f64>> {
        let mut path: Vec<BodyId> = ancestors(self.model, body).filter(|b| bodies.contains(b)).collect();
        path.reverse();
        let hinge =
            |&b: &BodyId| self.model.joints().find(|&j| self.model.joint_body(j) == b && !self.model.joint_slides(j));
        path.iter().filter_map(hinge).map(|joint| self.data.joint_anchor(joint)).collect()
    }

    /// Returns the fingers of a branch: one, or those that a moving part of the palm carries.
    fn parts_of(&self, branch: Branch) -> Vec<Branch> {
        let [top] = branch.tops[..] else { return vec![branch] };
        let mut parts = self.branches(top);
        // Parts in a row are one finger; look behind them for a part that branches.
        if let [only] = &parts[..] {
            let deeper = self.parts_of(only.clone());
            return if deeper.len() > 1 { deeper } else { vec![branch] };
        }
        let longest = parts.iter().map(|part| part.length).fold(0.0, f64::max);
        parts.retain(|part| part.length >= SHORTEST * longest);
        let n_comparable = parts.iter().filter(|part| part.length >= COMPARABLE * longest).count();
        let apart = |part: &Branch| parts.iter().all(|p| p.tops == part.tops || (p.tip - part.tip).norm() > APART);
        if n_comparable > 1 && parts.iter().all(apart) {
            parts.into_iter().flat_map(|part| self.parts_of(part)).collect()
        } else {
            vec![branch]
        }
    }
}

/// What a file holds beside the hand of a palm.
pub(super) struct Surplus {
    /// The highest body that carries the hand alone; none if there is no such body below the root.
    pub(super) keep: Option<BodyId>,
    /// The other hands, or their fingers if the same body carries both hands.
    pub(super) others: Vec<BodyId>,
}

impl Tree<'_> {
    /// Finds what to leave out so that the hand of `palm` alone remains; none if the file holds no other hand.
    pub(super) fn surplus(&mut self, palm: BodyId) -> Option<Surplus> {
        let mut hands = self.hands();
        let (model, moves) = (self.model, &self.moves);
        let below = |body: BodyId, above: BodyId| ancestors(model, body).any(|b| b == above);
        let tops = |hand: &HandInFile| hand.fingers.iter().flat_map(|f| f.tops.clone()).collect::<Vec<BodyId>>();
        let same_group = |hand: &HandInFile| rigid_root(model, moves, hand.palm) == rigid_root(model, moves, palm);
        let carries_fingers = |hand: &HandInFile| tops(hand).iter().any(|&top| below(top, palm));
        // The hand whose fingers the palm carries, or else the hand of whose palm this body is a part.
        let own = hands
            .iter()
            .position(|hand| same_group(hand) && carries_fingers(hand))
            .or_else(|| hands.iter().position(|hand| same_group(hand) && below(palm, hand.palm)))?;
        let own = hands.remove(own);
        let mut needed = tops(&own);
        needed.push(palm);
        let foreign: Vec<BodyId> =
            hands.iter().flat_map(tops).filter(|&top| !needed.iter().any(|&n| below(n, top))).collect();
        if foreign.is_empty() {
            return None;
        }
        let carries_all = |&body: &BodyId| needed.iter().all(|&n| below(n, body));
        let alone = |&body: &BodyId| !foreign.iter().any(|&top| below(top, body));
        let keep = ancestors(model, palm).filter(carries_all).take_while(alone).last();
        let others = hands
            .iter()
            .flat_map(|hand| {
                let apart = !needed.iter().any(|&n| below(n, hand.palm));
                if apart { vec![hand.palm] } else { tops(hand) }
            })
            .filter(|&body| !needed.iter().any(|&n| below(n, body)))
            .collect();
        Some(Surplus { keep, others })
    }
}

/// Tells whether fingers are a hand: at least two are comparable, and apart from each other.
fn is_hand(fingers: &[Branch]) -> bool {
    let longest = fingers.iter().map(|finger| finger.length).fold(0.0, f64::max);
    let long = |finger: &&Branch| finger.length >= (COMPARABLE * longest).max(HAND_LENGTH);
    let long: Vec<&Branch> = fingers.iter().filter(long).collect();
    long.iter().any(|a| long.iter().any(|b| (a.tip - b.tip).norm() > HAND_APART))
}

/// Groups fingers: two are of one hand if their tips can meet.
fn clusters(fingers: Vec<Branch>) -> Vec<Vec<Branch>> {
    let meet = |a: &Branch, b: &Branch| (a.base - b.base).norm() < a.length + b.length;
    let mut clusters: Vec<Vec<Branch>> = Vec::new();
    for finger in fingers {
        let (mut near, far): (Vec<_>, Vec<_>) =
            clusters.into_iter().partition(|cluster: &Vec<Branch>| cluster.iter().any(|other| meet(other, &finger)));
        let mut joined: Vec<Branch> = near.drain(..).flatten().collect();
        joined.push(finger);
        clusters = far;
        clusters.push(joined);
    }
    clusters
}

/// Returns the names by which a user tells the hands of a file apart.
pub(super) fn palms(model: &Model, hands: &[HandInFile]) -> Vec<String> {
    let mut names: Vec<String> = hands.iter().map(|hand| model.body_name(hand.palm)).collect();
    names.retain(|name| name != CARRIAGE && !name.is_empty());
    names.sort();
    names.dedup();
    names
}
