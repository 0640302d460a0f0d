//! Measures a hand by moving it.

use std::collections::BTreeMap;
use std::sync::Arc;

use eigenhand_mujoco::{BodyId, Data, Model};
use nalgebra::{Isometry3, Translation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::fingers::{Chain, base_of};
use super::stand::TIMESTEP;
use crate::error::{OnboardError, refuse};

mod closing;
mod jaw;
mod placing;

/// Number of random postures.
const POSTURES: usize = 40;
/// Time in s that the hand has to reach a posture.
const SETTLE_TIME: f64 = 1.0;
/// Shortest and longest finger in m, and the least distance in m by which some fingertip must move.
const REACHES: [f64; 2] = [0.005, 0.6];
const TRAVELS: f64 = 0.004;
/// A direction within this angle (rad) of an axis of the palm is taken to be that axis.
const SNAP_ANGLE: f64 = 0.7;
/// A finger is nearly straight if it has at least this share of its length.
const NEARLY: f64 = 0.85;
/// A link guides another finger if its end stays within this distance (m) of a joint of that finger.
const GUIDED: f64 = 0.025;
const SEED: u64 = 7;

/// A posture: the commands, and the fingertips in the palm's frame.
pub(super) struct Pose {
    controls: Vec<f64>,
    tips: Vec<Vector3<f64>>,
}

/// A movement of one actuator: index of the posture, of the actuator, and which end of its range it moves to.
type Nudge = (usize, usize, usize);

/// A straight finger.
struct Straight {
    /// Length in m.
    length: f64,
    /// Index of the posture in which it is straight.
    pose: usize,
    /// Whether it points in the direction of approach at zero commands. Such a finger may curl to either side; it
    /// closes when it curls towards the grasp.
    hangs: bool,
}

/// The hand under examination.
pub(super) struct Lab<'a> {
    model: &'a Arc<Model>,
    palm: BodyId,
    data: Data,
    chains: Vec<Chain>,
    /// For each finger, the largest distance of its tip from the nearest joint of another finger.
    guided: Vec<f64>,
    ranges: Vec<(f64, f64)>,
    /// Direction of approach and centre of the grasp in the palm's frame.
    approach: Vector3<f64>,
    grasp: Vector3<f64>,
    straight: Vec<Straight>,
    nudges: BTreeMap<Nudge, Vec<Vector3<f64>>>,
    lowest: Vec<f64>,
    highest: Vec<f64>,
}

impl<'a> Lab<'a> {
    pub(super) fn new(model: &'a Arc<Model>, palm: BodyId) -> Result<Self, OnboardError> {
        let ranges = model
            .actuators()
            .map(|id| {
                let name = model.actuator_name(id);
                model
                    .control_range(id)
                    .ok_or_else(|| refuse(format!("actuator {name:?} has no control range: give it a ctrlrange")))
            })
            .collect::<Result<Vec<_>, _>>()?;
        if ranges.is_empty() {
            return Err(refuse(
                "no actuator moves the hand: add one to the file, on a joint that follows no other joint",
            ));
        }
        let data = Data::new(model)?;
        Ok(Lab {
            model,
            palm,
            data,
            chains: Vec::new(),
            guided: Vec::new(),
            ranges,
            approach: Vector3::z(),
            grasp: Vector3::zeros(),
            straight: Vec::new(),
            nudges: BTreeMap::new(),
            lowest: vec![f64::INFINITY; model.nq()],
            highest: vec![f64::NEG_INFINITY; model.nq()],
        })
    }

    /// Holds controls until the hand has settled, and returns the fingertips in the palm's frame.
    fn take(&mut self, controls: &[f64]) -> Result<Vec<Vector3<f64>>, OnboardError> {
        self.data.reset();
        self.data.ctrl_mut().copy_from_slice(controls);
        for _ in 0..(SETTLE_TIME / TIMESTEP) as usize {
            self.data.step();
        }
        if self.data.warnings().bad_state > 0 || self.data.qpos().iter().any(|q| !q.is_finite()) {
            return Err(refuse(
                "the simulation diverges when the hand's own actuators move it, without contacts or gravity: give its \
                 joints damping and armature, or its actuators less gain",
            ));
        }
        for (i, &q) in self.data.qpos().iter().enumerate() {
            self.lowest[i] = self.lowest[i].min(q);
            self.highest[i] = self.highest[i].max(q);
        }
        Ok(self.tips())
    }

    /// Returns the fingertips in the palm's frame.
    fn tips(&self) -> Vec<Vector3<f64>> {
        let palm_from_world = self.palm_pose().inverse();
        let tip = |chain: &Chain| {
            let turned = self.data.body_orientation(chain.tip_body) * chain.tip;
            palm_from_world.transform_point(&(self.data.body_position(chain.tip_body) + turned).into()).coords
        };
        self.chains.iter().map(tip).collect()
    }

    fn palm_pose(&self) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::from(self.data.body_position(self.palm)),
            self.data.body_orientation(self.palm),
        )
    }

    /// Returns the base of a finger in the palm's frame.
    fn base(&self, chain: &Chain) -> Vector3<f64> {
        let base = base_of(self.model, &self.data, self.palm, chain.first_joint);
        self.palm_pose().inverse_transform_point(&base.into()).coords
    }

    /// Takes the posture at zero commands, in which most hands are open, and random postures.
    pub(super) fn postures(&mut self, chains: Vec<Chain>) -> Result<Vec<Pose>, OnboardError> {
        self.chains = chains;
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let zero: Vec<f64> = self.ranges.iter().map(|&(low, high)| 0.0_f64.clamp(low, high)).collect();
        let mut commands = vec![zero];
        commands.extend((0..POSTURES).map(|_| {
            self.ranges.iter().map(|&(low, high)| low + (high - low) * random.random_range(0.0..=1.0)).collect()
        }));
        self.guided = vec![0.0; self.chains.len()];
        let mut poses = Vec::with_capacity(commands.len());
        for controls in commands {
            let tips = self.take(&controls)?;
            let pose = self.palm_pose();
            for (finger, tip) in tips.iter().enumerate() {
                let apart = self.apart_from_joints(finger, &pose.transform_point(&(*tip).into()).coords);
                self.guided[finger] = self.guided[finger].max(apart);
            }
            poses.push(Pose { tips, controls });
        }
        Ok(poses)
    }

    /// Returns the mean position of a fingertip.
    fn mean_tip(poses: &[Pose], finger: usize) -> Vector3<f64> {
        poses.iter().map(|pose| pose.tips[finger]).sum::<Vector3<f64>>() / poses.len().max(1) as f64
    }

    /// Returns the distance from the base of a finger to its tip in a posture.
    fn length(&self, finger: usize, pose: &Pose) -> f64 {
        (pose.tips[finger] - self.base(&self.chains[finger])).norm()
    }

    /// Lists directions in which the hand may approach an object, in the palm's frame, the likeliest first: the hint alone,
    /// or else the mean direction of the fingers over all postures, the direction in which they are long, that into which
    /// they bend, and the one between.
    pub(super) fn approaches(&self, poses: &[Pose], hint: Option<[f64; 3]>) -> Result<Vec<Vector3<f64>>, OnboardError> {
        const BENDS: f64 = 0.15;
        const ANOTHER: f64 = 0.3;
        let unknown =
            || refuse("could not identify the direction of approach; give it with --approach, such as --approach +z");
        if let Some(given) = hint {
            return Ok(vec![Vector3::from(given).try_normalize(1e-6).ok_or_else(unknown)?]);
        }
        let (mut mean, mut along, mut bent) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        for finger in 0..self.chains.len() {
            let base = self.base(&self.chains[finger]);
            let reach = poses.iter().map(|pose| self.length(finger, pose)).fold(1e-6, f64::max);
            let mut outward = (Self::mean_tip(poses, finger) - base) / reach;
            if let Some(axis) = self.slide_axis(finger) {
                outward -= axis * outward.dot(&axis);
            }
            mean += outward;
            let longest = poses.iter().max_by(|a, b| self.length(finger, a).total_cmp(&self.length(finger, b)));
            let straight = poses.first().filter(|pose| self.length(finger, pose) >= NEARLY * reach).or(longest);
            let Some(straight) = straight.map(|pose| pose.tips[finger]) else { continue };
            let direction = (straight - base).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
            along += direction;
            let curl = (Self::mean_tip(poses, finger) - straight) / reach;
            bent += curl - direction * curl.dot(&direction);
        }
        let n_fingers = self.chains.len().max(1) as f64;
        let mut candidates = Vec::new();
        if let Some(fixed) = (0..self.chains.len()).find(|&finger| self.chains[finger].fixed) {
            // The gap between the jaws is towards the tip of the jaw that does not move.
            candidates.push(snap(&(Self::mean_tip(poses, fixed) - self.base(&self.chains[fixed]))));
        }
        candidates.push(snap(&mean));
        if bent.norm() > BENDS * n_fingers {
            let unit = |v: Vector3<f64>| v.try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
            candidates.extend([snap(&bent), snap(&along), unit(bent) + unit(along)]);
        }
        let mut found: Vec<Vector3<f64>> = Vec::new();
        for candidate in candidates.into_iter().filter_map(|candidate| candidate.try_normalize(1e-6)) {
            if found.iter().all(|other| other.angle(&candidate) > ANOTHER) {
                found.push(candidate);
            }
        }
        if found.is_empty() { Err(unknown()) } else { Ok(found) }
    }

    /// Sets the direction of approach.
    pub(super) fn set_approach(&mut self, approach: Vector3<f64>) {
        self.approach = approach;
    }

    /// Leaves out links that only guide a neighbouring finger: they follow other joints, and in every posture their end
    /// is at a joint of that finger.
    pub(super) fn leave_out_guides(&mut self, poses: &mut [Pose]) {
        let stays: Vec<bool> =
            self.chains.iter().zip(&self.guided).map(|(chain, &apart)| !chain.follows || apart > GUIDED).collect();
        if !stays.contains(&true) {
            return;
        }
        let mut at = stays.iter();
        self.chains.retain(|_| at.next().copied().unwrap_or(true));
        for pose in poses {
            let mut at = stays.iter();
            pose.tips.retain(|_| at.next().copied().unwrap_or(true));
        }
    }

    /// Returns a fingertip's distance in m from the nearest joint of another finger, in the present posture. A distance
    /// along the axis of its own joint counts more, because fingers side by side are a finger's width apart.
    fn apart_from_joints(&self, finger: usize, tip: &Vector3<f64>) -> f64 {
        const SIDEWAYS: f64 = 2.5;
        let axis = self.data.joint_axis(self.chains[finger].first_joint);
        let others = (0..self.chains.len()).filter(|&other| other != finger);
        let anchors = others.flat_map(|other| self.chains[other].hinges.iter().map(|&j| self.data.joint_anchor(j)));
        let distance = |anchor: Vector3<f64>| {
            let away = tip - anchor;
            let sideways = away.dot(&axis).abs();
            (away.norm_squared() - sideways * sideways).max(0.0).sqrt().hypot(SIDEWAYS * sideways)
        };
        anchors.map(distance).fold(f64::INFINITY, f64::min)
    }

    /// Finds the centre of the grasp, and for each finger a posture in which it is nearly straight.
    ///
    /// This is the posture at zero commands if the finger then points in the direction of approach. Otherwise it is the
    /// posture whose tip is farthest from the centre of the grasp.
    pub(super) fn straighten(&mut self, poses: &[Pose]) {
        let n_fingers = self.chains.len();
        let fixed = (0..n_fingers).find(|&f| self.chains[f].fixed);
        let middle =
            || (0..n_fingers).map(|f| Self::mean_tip(poses, f)).sum::<Vector3<f64>>() / n_fingers.max(1) as f64;
        // A single finger closes against the jaw that does not move.
        self.grasp = fixed.map_or_else(middle, |f| Self::mean_tip(poses, f));
        self.straight = (0..n_fingers)
            .map(|f| {
                let longest = poses.iter().map(|pose| self.length(f, pose)).fold(0.0, f64::max);
                let away = |&i: &usize| (poses[i].tips[f] - self.grasp).norm();
                let farthest = (0..poses.len())
                    .filter(|&i| self.length(f, &poses[i]) >= NEARLY * longest)
                    .max_by(|a, b| away(a).total_cmp(&away(b)));
                let along = (poses[0].tips[f] - self.base(&self.chains[f])).dot(&self.approach);
                let hangs = along >= NEARLY * longest;
                Straight { length: longest, pose: if hangs { 0 } else { farthest.unwrap_or(0) }, hangs }
            })
            .collect();
    }

    /// Refuses fingers that cannot hold an object of a few centimetres.
    pub(super) fn check_fingers(&self, poses: &[Pose]) -> Result<(), OnboardError> {
        let travel = |f: usize| poses.iter().map(|pose| (pose.tips[f] - poses[0].tips[f]).norm()).fold(0.0, f64::max);
        let widest = (0..self.chains.len()).map(travel).fold(0.0, f64::max);
        if widest < TRAVELS {
            return Err(refuse(format!(
                "no fingertip moves by more than {:.1} mm, whatever the commands: check that the ranges of joints and \
                 controls are in the unit that the file declares",
                1000.0 * widest
            )));
        }
        for (chain, straight) in self.chains.iter().zip(&self.straight) {
            let body = self.model.body_name(chain.tip_body);
            let [shortest, longest] = REACHES;
            if straight.length > longest || straight.length < shortest {
                return Err(refuse(format!(
                    "fingers longer than {:.0} cm or shorter than {:.0} mm are refused, and the finger that ends at {body:?} \
                     is {:.2} cm long. Usually the file is in another unit, or holds a whole robot: scale its lengths to \
                     metres (meshes in millimetres by 0.001), or name the palm with --palm",
                    100.0 * longest,
                    1000.0 * shortest,
                    100.0 * straight.length
                )));
            }
        }
        Ok(())
    }

    /// Returns the direction in which a jaw slides, in the palm's frame; none for a finger that turns.
    fn slide_axis(&self, finger: usize) -> Option<Vector3<f64>> {
        let joint = self.chains[finger].slide.filter(|_| !self.chains[finger].fixed)?;
        Some(self.palm_pose().inverse_transform_vector(&self.data.joint_axis(joint)))
    }

    /// Returns the part of a vector that is perpendicular to the approach.
    fn across(&self, v: Vector3<f64>) -> Vector3<f64> {
        v - self.approach * v.dot(&self.approach)
    }
}

/// Returns the axis near a direction (see [`SNAP_ANGLE`]), or the direction itself if no axis is near.
fn snap(direction: &Vector3<f64>) -> Vector3<f64> {
    let Some(unit) = direction.try_normalize(1e-9) else { return *direction };
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let near = axes.iter().flat_map(|a| [*a, -*a]).find(|axis| axis.dot(&unit) > SNAP_ANGLE.cos());
    near.unwrap_or(unit)
}
