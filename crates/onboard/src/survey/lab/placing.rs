//! Places the open hand above the plane: how far it is closed, which size of object fits, and how it is mounted.

use std::collections::BTreeSet;
use std::sync::Arc;

use eigenhand_mujoco::{BodyId, Data, GeomId, JointId, Model};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{Lab, Pose, SETTLE_TIME, snap};
use crate::error::{OnboardError, refuse};
use crate::survey::findings::{Closing, Finger, Survey};
use crate::survey::fingers::ancestors;
use crate::survey::stand::{CARRIAGE, TIMESTEP};

/// Length of a finger and opening between fingertips, both in m, that suit objects of scale 1.
const USUAL_REACH: f64 = 0.1;
const USUAL_OPENING: f64 = 0.11;
/// Opening in m of the open posture, for objects of scale 1.
const OPENING: f64 = 0.13;
/// A scale that differs from 1 by at most this becomes 1. With a smaller opening, the larger objects leave too little
/// room beside them.
const NEAR_ONE: f64 = 0.2;
/// An opening that differs from the wanted one by at most this share is near it.
const NEAR_OPENING: f64 = 0.25;
/// Smallest and largest scale of the objects.
const SCALES: [f64; 2] = [0.3, 1.0];
/// Height in m of the tallest object of scale 1, and the room above it.
const TALLEST: f64 = 0.095;
const ROOM: f64 = 0.012;
/// Depth in m below the plane to which the slide can push the hand, and the length in m of the slide.
const PRESS: f64 = 0.005;
const TRAVEL: f64 = 0.22;
/// A joint that moves less than this (rad, m) over all postures is stuck.
const STUCK: f64 = 1e-4;

/// A posture of the open hand.
pub(in crate::survey) struct Open {
    qpos: Vec<f64>,
    tips: Vec<Vector3<f64>>,
    /// Distance in m between opposing fingertips.
    opening: f64,
    /// Factor on the objects' lengths.
    scale: f64,
}

fn middle(points: &[Vector3<f64>]) -> Vector3<f64> {
    points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64
}

impl Lab<'_> {
    /// Returns the controls that close the hand by a share of each closing actuator's range.
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

    /// Returns the opening: twice the mean distance of the tips from the line of approach through their centre.
    fn opening(&self, tips: &[Vector3<f64>]) -> f64 {
        let centre = middle(tips);
        2.0 * tips.iter().map(|tip| self.across(tip - centre).norm()).sum::<f64>() / tips.len().max(1) as f64
    }

    /// Tells whether a fingertip has passed to the other side of the grasp. `straight` are the tips of straight fingers.
    fn crossed(&self, tips: &[Vector3<f64>], straight: &[Vector3<f64>]) -> bool {
        const ASIDE: f64 = 0.3;
        const PAST: f64 = 0.2;
        let sides: Vec<Vector3<f64>> = straight.iter().map(|tip| self.across(tip - middle(straight))).collect();
        let widest = sides.iter().map(|side| side.norm()).fold(0.0, f64::max);
        // A finger near the middle, such as one of a row, is on no side.
        tips.iter().zip(&sides).filter(|(_, side)| side.norm() > ASIDE * widest).any(|(tip, side)| {
            let own = self.across(tip - middle(tips)).dot(side) / side.norm_squared();
            own < -PAST
        })
    }

    /// Takes the posture in which the closing actuators are at a share of their range.
    fn open_at(&mut self, closing: &[Closing], share: f64) -> Result<Open, OnboardError> {
        let controls = self.closed_by(closing, share);
        let tips = self.take(&controls)?;
        Ok(Open { qpos: self.data.qpos().to_vec(), opening: self.opening(&tips), tips, scale: 1.0 })
    }

    /// Chooses the open posture, and the scale of the objects.
    ///
    /// A motor that pulls against springs has no posture between its ends, so postures along its way from the open end
    /// to the closed one are tried too.
    pub(in crate::survey) fn open(&mut self, poses: &[Pose], closing: &[Closing]) -> Result<Open, OnboardError> {
        const SHARES: [f64; 9] = [0.08, 0.15, 0.22, 0.29, 0.36, 0.43, 0.5, 0.57, 0.64];
        let straight: Vec<Vector3<f64>> =
            self.straight.iter().enumerate().map(|(f, straight)| poses[straight.pose].tips[f]).collect();
        let mut tried = SHARES.iter().map(|&share| self.open_at(closing, share)).collect::<Result<Vec<_>, _>>()?;
        let uncrossed = |open: &Open| !self.crossed(&open.tips, &straight);
        if tried.iter().any(uncrossed) {
            tried.retain(uncrossed);
        }
        let widest = tried.iter().map(|open| open.opening).fold(0.0, f64::max);
        let reach =
            self.straight.iter().map(|straight| straight.length).sum::<f64>() / self.straight.len().max(1) as f64;
        let scale = (reach / USUAL_REACH).min(widest / USUAL_OPENING);
        let scale = if (scale - 1.0).abs() <= NEAR_ONE { 1.0 } else { (scale * 20.0).round() / 20.0 };
        let scale = scale.clamp(SCALES[0], SCALES[1]);
        let wanted = OPENING * scale;
        let near = |open: &Open| (open.opening - wanted).abs() <= NEAR_OPENING * wanted;
        if widest > wanted && !tried.iter().any(near) {
            let on_the_way = self.on_the_way(closing)?;
            tried.extend(on_the_way.into_iter().filter(|open| !self.crossed(&open.tips, &straight)));
        }
        let best = tried.into_iter().min_by(|a, b| (a.opening - wanted).abs().total_cmp(&(b.opening - wanted).abs()));
        let best = best.ok_or_else(|| refuse("the hand has no actuator"))?;
        Ok(Open { scale, ..best })
    }

    /// Lists postures on the way from the open hand to the closed one.
    fn on_the_way(&mut self, closing: &[Closing]) -> Result<Vec<Open>, OnboardError> {
        self.take(&self.closed_by(closing, 0.0))?;
        let closed = self.closed_by(closing, 1.0);
        self.data.ctrl_mut().copy_from_slice(&closed);
        let mut found = Vec::new();
        for _ in 0..(SETTLE_TIME / TIMESTEP) as usize {
            self.data.step();
            let tips = self.tips();
            found.push(Open { qpos: self.data.qpos().to_vec(), opening: self.opening(&tips), tips, scale: 1.0 });
        }
        Ok(found)
    }

    pub(in crate::survey) fn report(
        &mut self,
        poses: &[Pose],
        closing: &[Closing],
        open: &Open,
        touching: &Arc<Model>,
    ) -> Result<Survey, OnboardError> {
        let (opening, object_scale) = (open.opening, open.scale);
        self.data.reset();
        self.data.qpos_mut().copy_from_slice(&open.qpos);
        self.data.forward();
        let tips = self.tips();
        let model = Arc::clone(self.model);
        let hand_joints: Vec<JointId> = model.joints().filter(|&j| model.joint_name(j) != CARRIAGE).collect();
        let range = |j: JointId| self.highest[model.qpos_address(j)] - self.lowest[model.qpos_address(j)];
        let (moving, stuck): (Vec<JointId>, Vec<JointId>) = hand_joints.iter().partition(|&&j| range(j) > STUCK);
        let open_posture = hand_joints
            .iter()
            .map(|&j| {
                let q = (self.data.qpos()[model.qpos_address(j)] * 1e4).round() / 1e4;
                // A servo or rounding may push a joint past its range.
                let q = model.joint_range(j).map_or(q, |(low, high)| q.clamp(low, high));
                (model.joint_name(j), q)
            })
            .collect();
        let (mount, slide_range, in_the_way) = self.mount(poses, &tips, object_scale);
        let overlaps = self.overlaps(touching)?;
        let names = |joints: &[JointId]| joints.iter().map(|&j| model.joint_name(j)).collect();
        let fingers = self
            .chains
            .iter()
            .zip(&self.straight)
            .map(|(chain, straight)| Finger {
                body: model.body_name(chain.tip_body),
                tip: chain.tip.map(|v| (v * 1e5).round() / 1e5).into(),
                reach: straight.length,
            })
            .collect();
        Ok(Survey {
            palm: model.body_name(self.palm),
            fingers,
            approach: self.approach.into(),
            closing: model.actuators().map(|id| model.actuator_name(id)).zip(closing.iter().copied()).collect(),
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

    /// Mounts the hand: the approach points down, the fingers along x, and the tallest object fits under the open hand.
    ///
    /// Returns the mount, the range of the slide, and the bodies that would touch the plane before the hand.
    fn mount(&self, poses: &[Pose], tips: &[Vector3<f64>], scale: f64) -> (Isometry3<f64>, [f64; 2], Vec<BodyId>) {
        let down = self.approach;
        let straight: Vector3<f64> = (0..self.chains.len())
            .map(|f| poses[self.straight[f].pose].tips[f] - self.base(&self.chains[f]))
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
        // The carriage is at the world's origin and not rotated, so `turn` is also the rotation of the mount.
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
    fn overlaps(&self, model: &Arc<Model>) -> Result<Vec<(String, String)>, OnboardError> {
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
