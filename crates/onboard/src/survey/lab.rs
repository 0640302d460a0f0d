//! Measures a hand by moving it.

use std::sync::Arc;

use eigenhand_mujoco::{BodyId, Data, Model};
use nalgebra::{Isometry3, Translation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::findings::Closing;
use super::fingers::{Chain, base_of};
use super::stand::TIMESTEP;
use crate::error::{OnboardError, refuse};

mod placing;

/// Number of random postures.
const POSTURES: usize = 40;
/// Time in s that the hand has to reach a posture.
const SETTLE_TIME: f64 = 1.0;
/// An actuator closes a finger if its effect on the fingertip's distance from the grasp is above this share of the
/// largest effect on that finger.
const NEUTRAL: f64 = 0.16;
/// Shortest and longest finger in m, and the least distance in m by which some fingertip must move.
const REACHES: [f64; 2] = [0.005, 0.6];
const TRAVELS: f64 = 0.004;
/// A direction within this angle (rad) of an axis of the palm is taken to be that axis.
const SNAP_ANGLE: f64 = 0.7;
const SEED: u64 = 7;

/// A posture: the commands, and the fingertips in the palm's frame.
pub(super) struct Pose {
    controls: Vec<f64>,
    tips: Vec<Vector3<f64>>,
}

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
    ranges: Vec<(f64, f64)>,
    /// Direction of approach and centre of the grasp in the palm's frame.
    approach: Vector3<f64>,
    grasp: Vector3<f64>,
    straight: Vec<Straight>,
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
            ranges,
            approach: Vector3::z(),
            grasp: Vector3::zeros(),
            straight: Vec::new(),
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
        commands.into_iter().map(|controls| Ok(Pose { tips: self.take(&controls)?, controls })).collect()
    }

    /// Returns the mean position of a fingertip.
    fn mean_tip(poses: &[Pose], finger: usize) -> Vector3<f64> {
        poses.iter().map(|pose| pose.tips[finger]).sum::<Vector3<f64>>() / poses.len().max(1) as f64
    }

    /// Returns the distance from the base of a finger to its tip in a posture.
    fn length(&self, finger: usize, pose: &Pose) -> f64 {
        (pose.tips[finger] - self.base(&self.chains[finger])).norm()
    }

    /// Sets the direction of approach: the hint, or else the mean direction from base to tip over all fingers and
    /// postures.
    pub(super) fn approach(&mut self, poses: &[Pose], hint: Option<[f64; 3]>) -> Result<(), OnboardError> {
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
            refuse("could not identify the direction of approach; give it with --approach, such as --approach +z")
        })?;
        Ok(())
    }

    /// Leaves out links that only guide a neighbouring finger: they follow other joints and are much shorter than a
    /// finger.
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

    /// Finds the centre of the grasp, and for each finger a posture in which it is nearly straight.
    ///
    /// This is the posture at zero commands if the finger then points in the direction of approach. Otherwise it is the
    /// posture whose tip is farthest from the centre of the grasp.
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

    /// Tells for each actuator which end of its range brings the tips of straight fingers nearer to the grasp.
    pub(super) fn closing(&mut self, poses: &[Pose]) -> Result<Vec<Closing>, OnboardError> {
        const NUDGE: f64 = 0.25;
        // An actuator spreads a hanging finger, and does not close it, if it moves the tip mostly sideways.
        const TOWARDS: f64 = 0.2;
        // The strongest effect of each actuator on a finger, as a share of the largest effect of any actuator on that
        // finger.
        let mut strongest = vec![0.0_f64; self.ranges.len()];
        let starts: Vec<(usize, bool)> = self.straight.iter().map(|straight| (straight.pose, straight.hangs)).collect();
        for (finger, (start, hangs)) in starts.into_iter().enumerate() {
            let from = poses[start].controls.clone();
            let side = self.plane(finger, &poses[start].tips[finger]);
            let mut effects = Vec::with_capacity(self.ranges.len());
            for actuator in 0..self.ranges.len() {
                let (low, high) = self.ranges[actuator];
                let mut distance = [0.0; 2];
                let mut ends = [Vector3::zeros(); 2];
                for (end, sign) in [-1.0, 1.0].into_iter().enumerate() {
                    let mut controls = from.clone();
                    controls[actuator] = (from[actuator] + sign * NUDGE * (high - low)).clamp(low, high);
                    ends[end] = self.take(&controls)?[finger];
                    distance[end] = self.distance(&ends[end], &side);
                }
                let effect = distance[0] - distance[1];
                let spreads = hangs && effect.abs() < TOWARDS * (ends[1] - ends[0]).norm();
                effects.push(if spreads { 0.0 } else { effect });
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

    /// Returns the direction that spans, together with the approach, the plane in which a finger bends.
    ///
    /// It runs along the straight finger, or towards the grasp if the finger points in the direction of approach.
    /// Motion out of this plane spreads the fingers.
    fn plane(&self, finger: usize, tip: &Vector3<f64>) -> Vector3<f64> {
        const LEAST: f64 = 0.35;
        let base = self.base(&self.chains[finger]);
        let along = self.across((tip - base).try_normalize(1e-9).unwrap_or_else(Vector3::zeros));
        along.try_normalize(LEAST).unwrap_or_else(|| self.towards_grasp(finger))
    }

    /// Returns the direction from a finger's base to the grasp, perpendicular to the approach.
    fn towards_grasp(&self, finger: usize) -> Vector3<f64> {
        self.across(self.grasp - self.base(&self.chains[finger])).try_normalize(1e-9).unwrap_or_else(Vector3::zeros)
    }

    /// Returns a tip's distance from the grasp in the plane of the approach and `side`.
    fn distance(&self, tip: &Vector3<f64>, side: &Vector3<f64>) -> f64 {
        let away = tip - self.grasp;
        away.dot(&self.approach).hypot(away.dot(side))
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
