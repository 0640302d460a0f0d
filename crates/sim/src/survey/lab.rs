//! Measuring a hand by moving it.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::fingers::{Chain, ancestors, base_of};
use super::{CARRIAGE, Closing, Finger, Survey, TIMESTEP, refuse};
use crate::SimError;
use crate::ffi::{BodyId, Data, GeomId, JointId, Model};

/// Random postures that are looked at.
const POSTURES: usize = 40;
/// Time in s in which a posture is taken.
const SETTLE_TIME: f64 = 1.0;
/// An actuator whose effect on a fingertip's distance from the grasp is below this share of the finger's largest does
/// not close it.
const NEUTRAL: f64 = 0.16;
/// A direction within this angle (rad) of an axis of the palm is taken to be that axis.
const SNAP_ANGLE: f64 = 0.7;
/// Reach in m of a finger, and opening in m between fingertips, for which the objects have the right size.
const USUAL_REACH: f64 = 0.1;
const USUAL_OPENING: f64 = 0.11;
/// Opening in m that the open posture aims at, for objects of scale 1.
const OPENING: f64 = 0.13;
/// Scales this near to 1 are 1.
const NEAR_ONE: f64 = 0.25;
const SCALES: [f64; 2] = [0.3, 1.0];
/// Height in m of the tallest object of scale 1, and the room above it.
const TALLEST: f64 = 0.095;
const ROOM: f64 = 0.012;
/// How far in m the hand can press on the plane, and its travel above that.
const PRESS: f64 = 0.005;
const TRAVEL: f64 = 0.28;
/// A joint that moves less than this (rad, m) over all postures is stuck.
const STUCK: f64 = 1e-4;
const SEED: u64 = 7;

/// One posture, in the palm's frame.
pub(super) struct Pose {
    controls: Vec<f64>,
    tips: Vec<Vector3<f64>>,
}

/// The hand under examination.
pub(super) struct Lab<'a> {
    model: &'a Arc<Model>,
    palm: BodyId,
    data: Data,
    chains: Vec<Chain>,
    ranges: Vec<(f64, f64)>,
    /// Direction of approach and centre of the grasp in the palm's frame.
    approach: Vector3<f64>,
    grasp: Vector3<f64>,
    /// Length of each finger when it is straight, and the number of the posture in which it is.
    straight: Vec<(f64, usize)>,
    lowest: Vec<f64>,
    highest: Vec<f64>,
}

impl<'a> Lab<'a> {
    pub(super) fn new(model: &'a Arc<Model>, palm: BodyId) -> Result<Self, SimError> {
        let ranges = model
            .actuators()
            .map(|id| {
                let name = model.actuator_name(id);
                model.control_range(id).ok_or_else(|| refuse(format!("actuator {name:?} has no control range")))
            })
            .collect::<Result<_, _>>()?;
        let data = Data::new(model)?;
        Ok(Lab {
            model,
            palm,
            data,
            chains: Vec::new(),
            ranges,
            approach: Vector3::z(),
            grasp: Vector3::zeros(),
            straight: Vec::new(),
            lowest: vec![f64::INFINITY; model.nq()],
            highest: vec![f64::NEG_INFINITY; model.nq()],
        })
    }

    /// Holds controls until the hand has settled.
    fn take(&mut self, controls: &[f64]) -> Result<Vec<Vector3<f64>>, SimError> {
        self.data.reset();
        self.data.ctrl_mut().copy_from_slice(controls);
        for _ in 0..(SETTLE_TIME / TIMESTEP) as usize {
            self.data.step();
        }
        if self.data.warnings().bad_state > 0 || self.data.qpos().iter().any(|q| !q.is_finite()) {
            return Err(refuse(
                "the hand diverges under its own actuators, without contacts or gravity: give its joints damping and \
                 armature, or its actuators less gain",
            ));
        }
        for (i, &q) in self.data.qpos().iter().enumerate() {
            self.lowest[i] = self.lowest[i].min(q);
            self.highest[i] = self.highest[i].max(q);
        }
        let palm_from_world = self.palm_pose().inverse();
        let tip = |chain: &Chain| {
            let turned = self.data.body_orientation(chain.tip_body) * chain.tip;
            palm_from_world.transform_point(&(self.data.body_position(chain.tip_body) + turned).into()).coords
        };
        Ok(self.chains.iter().map(tip).collect())
    }

    fn palm_pose(&self) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::from(self.data.body_position(self.palm)),
            self.data.body_orientation(self.palm),
        )
    }

    /// Where a finger's first joint is, in the palm's frame.
    fn base(&self, chain: &Chain) -> Vector3<f64> {
        let base = base_of(self.model, &self.data, self.palm, chain.first_joint);
        self.palm_pose().inverse_transform_point(&base.into()).coords
    }

    pub(super) fn random_postures(&mut self, chains: Vec<Chain>) -> Result<Vec<Pose>, SimError> {
        self.chains = chains;
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut poses = Vec::with_capacity(POSTURES);
        for _ in 0..POSTURES {
            let controls: Vec<f64> =
                self.ranges.iter().map(|&(low, high)| low + (high - low) * random.random_range(0.0..=1.0)).collect();
            let tips = self.take(&controls)?;
            poses.push(Pose { controls, tips });
        }
        Ok(poses)
    }

    /// The mean place of a fingertip.
    fn mean_tip(poses: &[Pose], finger: usize) -> Vector3<f64> {
        poses.iter().map(|pose| pose.tips[finger]).sum::<Vector3<f64>>() / poses.len().max(1) as f64
    }

    /// Length of a finger in a posture.
    fn length(&self, finger: usize, pose: &Pose) -> f64 {
        (pose.tips[finger] - self.base(&self.chains[finger])).norm()
    }

    /// The hand approaches where its fingers reach on average, over all that they can do.
    pub(super) fn approach(&mut self, poses: &[Pose], hint: Option<[f64; 3]>) -> Result<(), SimError> {
        let outward: Vector3<f64> = (0..self.chains.len())
            .map(|f| {
                let reach = poses.iter().map(|pose| self.length(f, pose)).fold(1e-6, f64::max);
                (Self::mean_tip(poses, f) - self.base(&self.chains[f])) / reach
            })
            .sum();
        let direction = match hint {
            Some(given) => Vector3::from(given),
            None => snap(&outward),
        };
        self.approach = direction.try_normalize(1e-6).ok_or_else(|| {
            refuse("the direction of approach cannot be made out; name it with --approach, such as --approach +z")
        })?;
        Ok(())
    }

    /// Leaves out links that only guide a finger beside them: they follow other joints, and end far behind the tips.
    pub(super) fn leave_out_guides(&mut self, poses: &mut [Pose]) {
        const SHORT: f64 = 0.75;
        let forward: Vec<f64> = (0..self.chains.len())
            .map(|f| poses.iter().map(|pose| pose.tips[f].dot(&self.approach)).fold(f64::NEG_INFINITY, f64::max))
            .collect();
        let bases = self.chains.iter().map(|chain| self.base(chain).dot(&self.approach));
        let palm = bases.fold(f64::INFINITY, f64::min);
        let longest = forward.iter().copied().fold(f64::NEG_INFINITY, f64::max) - palm;
        let stays: Vec<bool> =
            self.chains.iter().zip(&forward).map(|(c, &f)| !c.follows || f - palm >= SHORT * longest).collect();
        let mut at = stays.iter();
        self.chains.retain(|_| at.next().copied().unwrap_or(true));
        for pose in poses {
            let mut at = stays.iter();
            pose.tips.retain(|_| at.next().copied().unwrap_or(true));
        }
    }

    /// Finds where the fingers meet, and a posture in which each is nearly straight and as far from there as it can be.
    pub(super) fn straighten(&mut self, poses: &[Pose]) {
        const NEARLY: f64 = 0.85;
        let n_fingers = self.chains.len();
        self.grasp = (0..n_fingers).map(|f| Self::mean_tip(poses, f)).sum::<Vector3<f64>>() / n_fingers.max(1) as f64;
        self.straight = (0..n_fingers)
            .map(|f| {
                let longest = poses.iter().map(|pose| self.length(f, pose)).fold(0.0, f64::max);
                let away = |&i: &usize| (poses[i].tips[f] - self.grasp).norm();
                let farthest = (0..poses.len())
                    .filter(|&i| self.length(f, &poses[i]) >= NEARLY * longest)
                    .max_by(|a, b| away(a).total_cmp(&away(b)));
                (longest, farthest.unwrap_or(0))
            })
            .collect();
    }

    /// Tells which way each actuator brings the tips of straight fingers nearer to the grasp.
    pub(super) fn closing(&mut self, poses: &[Pose]) -> Result<Vec<Closing>, SimError> {
        const NUDGE: f64 = 0.25;
        // The strongest effect of each actuator on a finger, as a share of the strongest that any has on that finger.
        let mut strongest = vec![0.0_f64; self.ranges.len()];
        let starts: Vec<usize> = self.straight.iter().map(|&(_, at)| at).collect();
        for (finger, start) in starts.into_iter().enumerate() {
            let from = poses[start].controls.clone();
            let side = self.plane(finger, &poses[start].tips[finger]);
            let mut effects = Vec::with_capacity(self.ranges.len());
            for actuator in 0..self.ranges.len() {
                let (low, high) = self.ranges[actuator];
                let mut distance = [0.0; 2];
                for (end, sign) in [-1.0, 1.0].into_iter().enumerate() {
                    let mut controls = from.clone();
                    controls[actuator] = (from[actuator] + sign * NUDGE * (high - low)).clamp(low, high);
                    let tip = self.take(&controls)?[finger];
                    let away = tip - self.grasp;
                    distance[end] = away.dot(&self.approach).hypot(away.dot(&side));
                }
                effects.push(distance[0] - distance[1]);
            }
            let largest = effects.iter().fold(1e-9_f64, |most, e| most.max(e.abs()));
            for (share, effect) in strongest.iter_mut().zip(effects) {
                if (effect / largest).abs() > share.abs() {
                    *share = effect / largest;
                }
            }
        }
        Ok(strongest
            .iter()
            .map(|&share| match share {
                s if s > NEUTRAL => Closing::Up,
                s if s < -NEUTRAL => Closing::Down,
                _ => Closing::Neither,
            })
            .collect())
    }

    /// The direction that, with that of approach, spans the plane in which a finger bends: along the straight finger, or
    /// for one that points the way the hand approaches, towards the grasp. What leaves the plane spreads fingers.
    fn plane(&self, finger: usize, tip: &Vector3<f64>) -> Vector3<f64> {
        const LEAST: f64 = 0.35;
        let base = self.base(&self.chains[finger]);
        let across = |v: Vector3<f64>| v - self.approach * v.dot(&self.approach);
        let along = across((tip - base).try_normalize(1e-9).unwrap_or_else(Vector3::zeros));
        let towards = across(self.grasp - base);
        along.try_normalize(LEAST).or_else(|| towards.try_normalize(1e-9)).unwrap_or_else(Vector3::zeros)
    }

    /// Controls of the hand closed by a share of each closing actuator's range.
    fn closed_by(&self, closing: &[Closing], share: f64) -> Vec<f64> {
        self.ranges
            .iter()
            .zip(closing)
            .map(|(&(low, high), closing)| match closing {
                Closing::Up => low + share * (high - low),
                Closing::Down => high - share * (high - low),
                Closing::Neither if low <= 0.0 && 0.0 <= high => 0.0,
                Closing::Neither => (low + high) / 2.0,
            })
            .collect()
    }

    /// Twice the mean distance of the tips from the line of approach.
    fn opening(&self, tips: &[Vector3<f64>]) -> f64 {
        let centre = tips.iter().sum::<Vector3<f64>>() / tips.len().max(1) as f64;
        let across = |tip: &Vector3<f64>| {
            let from = tip - centre;
            (from - self.approach * from.dot(&self.approach)).norm()
        };
        2.0 * tips.iter().map(across).sum::<f64>() / tips.len().max(1) as f64
    }

    /// Finds how far closed the hand should start: controls, opening and scale of the objects.
    pub(super) fn open(&mut self, closing: &[Closing]) -> Result<(Vec<f64>, f64, f64), SimError> {
        const SHARES: [f64; 9] = [0.08, 0.15, 0.22, 0.29, 0.36, 0.43, 0.5, 0.57, 0.64];
        let mut tried = Vec::new();
        for share in SHARES {
            let controls = self.closed_by(closing, share);
            let tips = self.take(&controls)?;
            tried.push((controls, self.opening(&tips)));
        }
        let widest = tried.iter().map(|(_, opening)| *opening).fold(0.0, f64::max);
        let reach = self.straight.iter().map(|(length, _)| *length).sum::<f64>() / self.straight.len().max(1) as f64;
        let scale = (reach / USUAL_REACH).min(widest / USUAL_OPENING);
        let scale = if (scale - 1.0).abs() <= NEAR_ONE { 1.0 } else { (scale * 20.0).round() / 20.0 };
        let scale = scale.clamp(SCALES[0], SCALES[1]);
        let wanted = OPENING * scale;
        let best = tried.into_iter().min_by(|a, b| (a.1 - wanted).abs().total_cmp(&(b.1 - wanted).abs()));
        let (controls, opening) = best.ok_or_else(|| refuse("the hand has no actuator"))?;
        Ok((controls, opening, scale))
    }

    pub(super) fn report(
        mut self,
        poses: &[Pose],
        closing: Vec<Closing>,
        (controls, opening, object_scale): (Vec<f64>, f64, f64),
        touching: &Arc<Model>,
    ) -> Result<Survey, SimError> {
        let tips = self.take(&controls)?;
        let model = Arc::clone(self.model);
        let hand_joints: Vec<JointId> = model.joints().filter(|&j| model.joint_name(j) != CARRIAGE).collect();
        let range = |j: JointId| self.highest[model.qpos_address(j)] - self.lowest[model.qpos_address(j)];
        let (moving, stuck): (Vec<JointId>, Vec<JointId>) = hand_joints.iter().partition(|&&j| range(j) > STUCK);
        let open_posture = hand_joints
            .iter()
            .map(|&j| {
                let q = self.data.qpos()[model.qpos_address(j)];
                let q = model.joint_range(j).map_or(q, |(low, high)| q.clamp(low, high));
                (model.joint_name(j), (q * 1e4).round() / 1e4)
            })
            .map(|(name, q)| (name.clone(), within(&model, &name, q)))
            .collect();
        let (mount, slide_range, in_the_way) = self.mount(poses, &tips, object_scale);
        let overlaps = self.overlaps(touching)?;
        let names = |joints: &[JointId]| joints.iter().map(|&j| model.joint_name(j)).collect();
        let fingers = self
            .chains
            .iter()
            .zip(&self.straight)
            .map(|(chain, &(reach, _))| Finger {
                body: model.body_name(chain.tip_body),
                tip: chain.tip.map(|v| (v * 1e5).round() / 1e5).into(),
                reach,
            })
            .collect();
        Ok(Survey {
            palm: model.body_name(self.palm),
            fingers,
            approach: self.approach.into(),
            closing: model.actuators().map(|id| model.actuator_name(id)).zip(closing).collect(),
            open_posture,
            opening,
            object_scale,
            mount,
            slide_range,
            moving: names(&moving),
            stuck: names(&stuck),
            in_the_way: in_the_way.into_iter().map(|body| model.body_name(body)).collect(),
            overlaps,
        })
    }

    /// Turns the direction of approach down and the fingers along x, and puts the tallest object under the open hand.
    fn mount(&self, poses: &[Pose], tips: &[Vector3<f64>], scale: f64) -> (Isometry3<f64>, [f64; 2], Vec<BodyId>) {
        let down = self.approach;
        let straight: Vector3<f64> = (0..self.chains.len())
            .map(|f| poses[self.straight[f].1].tips[f] - self.base(&self.chains[f]))
            .map(|v| v.try_normalize(1e-9).unwrap_or_else(Vector3::zeros))
            .sum();
        let level = |v: Vector3<f64>| (v - down * v.dot(&down)).try_normalize(0.3);
        let forward = level(straight)
            .map(|v| level(snap(&v)).unwrap_or(v))
            .or_else(|| [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().find_map(level))
            .unwrap_or_else(Vector3::x);
        let side = (-down).cross(&forward);
        let world_from_palm = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
            forward.transpose(),
            side.transpose(),
            -down.transpose(),
        ]));
        let turn =
            UnitQuaternion::from_rotation_matrix(&world_from_palm) * self.data.body_orientation(self.palm).inverse();
        // The carriage stands at the world's origin and is not turned, so `turn` is the mount's.
        let centre = tips.iter().sum::<Vector3<f64>>() / tips.len().max(1) as f64;
        let centre = turn * self.palm_pose().transform_point(&centre.into()).coords;
        let up = turn.inverse_transform_vector(&Vector3::z());
        let height = |g: GeomId| self.data.farthest_point(g, &-up).dot(&up);
        let (below_palm, above_palm): (Vec<GeomId>, Vec<GeomId>) = self
            .model
            .geoms()
            .filter(|&g| self.model.geom_collides(g))
            .partition(|&g| ancestors(self.model, self.model.geom_body(g)).any(|body| body == self.palm));
        let lowest = below_palm.iter().map(|&g| height(g)).fold(f64::INFINITY, f64::min);
        let mut in_the_way: Vec<BodyId> =
            above_palm.iter().filter(|&&g| height(g) < lowest).map(|&g| self.model.geom_body(g)).collect();
        in_the_way.dedup();
        let start = TALLEST * scale + ROOM;
        let round = |v: f64| (v * 1e4).round() / 1e4;
        let position = Vector3::new(round(-centre.x), round(-centre.y), round(start - lowest));
        let low = round(-start - PRESS);
        (Isometry3::from_parts(Translation3::from(position), turn), [low, round(low + TRAVEL)], in_the_way)
    }

    /// Finds the pairs of bodies that are in contact in the present posture or the initial one.
    fn overlaps(&self, model: &Arc<Model>) -> Result<Vec<(String, String)>, SimError> {
        let mut found = BTreeSet::new();
        let mut data = Data::new(model)?;
        for posture in [self.data.qpos(), self.model.qpos0()] {
            data.qpos_mut().copy_from_slice(posture);
            data.forward();
            for contact in data.contacts() {
                let [a, b] = contact.geoms.map(|geom| model.geom_body(geom));
                found.insert((a.min(b), a.max(b)));
            }
        }
        Ok(found.into_iter().map(|(a, b)| (model.body_name(a), model.body_name(b))).collect())
    }
}

/// Keeps a rounded position inside a joint's range.
fn within(model: &Model, joint: &str, q: f64) -> f64 {
    let range = model.joint(joint).ok().and_then(|id| model.joint_range(id));
    range.map_or(q, |(low, high)| q.clamp(low, high))
}

/// Returns the axis that a direction is near to, else the direction.
fn snap(direction: &Vector3<f64>) -> Vector3<f64> {
    let Some(unit) = direction.try_normalize(1e-9) else { return *direction };
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let near = axes.iter().flat_map(|a| [*a, -*a]).find(|axis| axis.dot(&unit) > SNAP_ANGLE.cos());
    near.unwrap_or(unit)
}
