//! Which end of an actuator's range closes the hand.

use nalgebra::Vector3;

use super::{Lab, Nudge, Pose};
use crate::error::OnboardError;
use crate::survey::findings::Closing;

/// An actuator closes a finger if its effect on the fingertip's distance from the grasp is above this share of the
/// largest effect on that finger.
const NEUTRAL: f64 = 0.16;

impl Lab<'_> {
    /// Tells for each actuator which end of its range brings the tips of straight fingers nearer to the grasp.
    pub(in crate::survey) fn closing(&mut self, poses: &[Pose]) -> Result<Vec<Closing>, OnboardError> {
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
                    ends[end] = self.nudged((start, actuator, end), &controls)?[finger];
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

    /// Returns the fingertips after one actuator was moved from a posture. Fingers and directions of approach share what
    /// was measured.
    fn nudged(&mut self, which: Nudge, controls: &[f64]) -> Result<Vec<Vector3<f64>>, OnboardError> {
        if let Some(tips) = self.nudges.get(&which) {
            return Ok(tips.clone());
        }
        let tips = self.take(controls)?;
        self.nudges.insert(which, tips.clone());
        Ok(tips)
    }

    /// Returns the direction that spans, together with the approach, the plane in which a finger bends.
    ///
    /// It runs along the straight finger, or towards the grasp if the finger points in the direction of approach. A jaw
    /// that slides moves along its own axis. Motion out of this plane spreads the fingers.
    fn plane(&self, finger: usize, tip: &Vector3<f64>) -> Vector3<f64> {
        const LEAST: f64 = 0.35;
        let slides = self.slide_axis(finger).and_then(|axis| self.across(axis).try_normalize(LEAST));
        if let Some(axis) = slides {
            return axis;
        }
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
}
