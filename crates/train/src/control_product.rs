//! The control synergy as a run exports it: with the map to joint positions, the recommended numbers and the mean grasps.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_synergy::{
    Import, JointInfo, JointMap, Moment, MotionRecord, NamedGrasp, Recommended, Space, Synergy, SynergyFile,
};

use crate::actuators::HandActuators;
use crate::control::control_space;
use crate::drive::is_nearly;
use crate::error::TrainError;

/// Numbers are recommended if they give at least this share of the opening.
const LEAST_OPENING: f64 = 0.5;

/// A control synergy as it is exported.
pub(crate) struct ControlProduct {
    pub synergy: Synergy,
    pub commands: Vec<Vec<f64>>,
    pub joint_map: JointMap,
    pub recommended: Option<Recommended>,
    pub grasps: Vec<NamedGrasp>,
}

impl ControlProduct {
    /// (motions that the space describes, motions of the policy, and those with fewer numbers) => the product, with the joint
    /// positions and grasps of the policy; none while there are too few motions
    ///
    /// A policy without a success has no grasps. The joint positions are then those of the motions that the space describes.
    ///
    /// # Errors
    /// [`TrainError::Synergy`].
    pub fn of(
        actuators: &HandActuators,
        joints: &[JointInfo],
        described: &[MotionRecord],
        motions: &[MotionRecord],
        with_fewer: &[(usize, Vec<MotionRecord>)],
        components: usize,
    ) -> Result<Option<ControlProduct>, TrainError> {
        let Some(mut synergy) = control_space(&actuators.coordinates, described, components)? else { return Ok(None) };
        let commands_of = |steps: &[MotionRecord]| steps.iter().map(|step| step.command.clone()).collect::<Vec<_>>();
        let measured = if motions.is_empty() { described } else { motions };
        let postures: Vec<_> = measured.iter().map(|step| step.posture.as_slice()).collect();
        let mut joint_map = JointMap::fit(&synergy, &commands_of(measured), joints, &postures)?;
        let known = |name: &&String| joints.iter().any(|joint| joint.name == **name);
        joint_map.free.extend(actuators.free.iter().filter(known).cloned());
        synergy.widen(&commands_of(motions));
        let commands = commands_of(described);
        let with_all = (synergy.n_components(), motions);
        let counted = with_fewer.iter().map(|(k, motions)| (*k, motions.as_slice())).chain([with_all]);
        let grasps = counted.flat_map(|(k, motions)| mean_grasps(&synergy, actuators, k, motions)).collect();
        Ok(Some(ControlProduct { synergy, commands, joint_map, recommended: None, grasps }))
    }

    /// (success with 0, 1, 2... numbers, success with all joints, episodes of each) => recommends the fewest numbers that are
    /// nearly as good and open the hand, if there are such
    ///
    /// Where episodes begin with the open hand, success alone does not show that the numbers open it.
    pub fn recommend(&mut self, success: &[f64], all_joints: f64, episodes: u64) {
        let opening = opening_shares(&self.grasps, self.synergy.n_components());
        let enough = |&k: &usize| is_nearly(success[k], all_joints) && opening[k - 1] >= LEAST_OPENING;
        let Some(components) = (1..success.len().min(opening.len() + 1)).find(enough) else { return };
        let reason = format!(
            "with {components} number{} {:.1} % of {episodes} episodes succeed, with all joints {:.1} %; share of the \
             opening {:.0} %",
            if components == 1 { "" } else { "s" },
            100.0 * success[components],
            100.0 * all_joints,
            100.0 * opening[components - 1]
        );
        self.recommended = Some(Recommended { components, reason });
    }

    /// Reads the directory that a run exported.
    ///
    /// # Errors
    /// [`TrainError::Synergy`] for a file that is missing or damaged, [`TrainError::Damaged`] for a synergy of postures.
    pub fn read(directory: &Path) -> Result<ControlProduct, TrainError> {
        let Import { file, samples } = eigenhand_synergy::import(directory)?;
        match file {
            SynergyFile {
                space: Space::Commands, synergy, joint_map: Some(joint_map), recommended, grasps, ..
            } => Ok(ControlProduct { synergy, commands: samples, joint_map, recommended, grasps }),
            _ => Err(TrainError::Damaged {
                path: directory.to_owned(),
                reason: "it holds no control synergy with a joint map".to_owned(),
                mend: "restore the run's files".to_owned(),
            }),
        }
    }
}

/// Returns the share of the squared distance between the open and the holding hand that lies in the first component, in the
/// first two, and so on, over the grasps with all `k` numbers.
fn opening_shares(grasps: &[NamedGrasp], k: usize) -> Vec<f64> {
    let mut squares = vec![0.0; k];
    for NamedGrasp { open, held, .. } in grasps.iter().filter(|grasp| grasp.numbers == k) {
        let way = open.z.iter().zip(&held.z).map(|(open, held)| open - held);
        squares.iter_mut().zip(way).for_each(|(sum, difference)| *sum += difference * difference);
    }
    let all: f64 = squares.iter().sum();
    let mut so_far = 0.0;
    let share = |square: f64| {
        so_far += square;
        if all > 0.0 { so_far / all } else { 0.0 }
    };
    squares.into_iter().map(share).collect()
}

/// Returns the mean grasp of each object with the first `k` numbers, in the order of the objects' names.
fn mean_grasps(synergy: &Synergy, actuators: &HandActuators, k: usize, motions: &[MotionRecord]) -> Vec<NamedGrasp> {
    let mut of_object: BTreeMap<&str, Vec<&[MotionRecord]>> = BTreeMap::new();
    for motion in motions.chunk_by(|a, b| a.episode == b.episode) {
        of_object.entry(motion[0].object.as_str()).or_default().push(motion);
    }
    // A policy may close while the hand comes down. So its commands lead elsewhere than to the posture in which the hand
    // then is.
    let opening = |step: &MotionRecord| MotionRecord {
        command: actuators.commands_that_hold(&step.posture, &step.command),
        ..step.clone()
    };
    let mean = |moments: &[&MotionRecord]| {
        let average = |rows: Vec<Vec<f64>>| -> Vec<f64> {
            let n = rows.len() as f64;
            (0..rows[0].len()).map(|i| rows.iter().map(|row| row[i]).sum::<f64>() / n).collect()
        };
        Moment {
            z: average(moments.iter().map(|step| synergy.encode(&step.command)[..k].to_vec()).collect()),
            q: average(moments.iter().map(|step| step.posture.clone()).collect()),
        }
    };
    let grasp = |(object, motions): (&str, Vec<&[MotionRecord]>)| {
        let first = |motion: &&'_ [MotionRecord]| -> usize { motion.iter().position(|s| s.held).unwrap_or(0) };
        // A hand that starts closed opens first.
        let most_open = |motion: &&[MotionRecord]| {
            let distance = |step: &MotionRecord| actuators.distance_to_open(&step.posture);
            let approach = &motion[..first(motion).max(1)];
            opening(approach.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(&motion[0]))
        };
        let open: Vec<MotionRecord> = motions.iter().map(most_open).collect();
        let closed: Vec<&MotionRecord> =
            motions.iter().map(|motion| &motion[first(motion).saturating_sub(1)]).collect();
        let held: Vec<&MotionRecord> = motions.iter().map(|motion| &motion[motion.len() - 1]).collect();
        NamedGrasp {
            object: object.to_owned(),
            numbers: k,
            motions: motions.len(),
            open: mean(&open.iter().collect::<Vec<_>>()),
            closed: mean(&closed),
            held: mean(&held),
        }
    };
    of_object.into_iter().map(grasp).collect()
}

#[cfg(test)]
mod tests {
    use eigenhand_synergy::Unit;

    use super::*;

    #[test]
    fn numbers_are_recommended_if_they_lift_and_open() {
        let joint = |name: &str| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 };
        let joints = ["a", "b", "c"].map(joint);
        let commands = vec![vec![3.0, 0.0, 0.0], vec![-3.0, 0.0, 0.0], vec![0.0, 2.0, 0.0], vec![0.0, -2.0, 1.0]];
        let synergy = Synergy::fit(&joints, &commands, 3).unwrap();
        let joint_map = JointMap::fit(&synergy, &commands, &joints, &commands).unwrap();
        let moment = |z: &[f64]| Moment { z: z.to_vec(), q: Vec::new() };
        let grasp = |open: &[f64], held: &[f64]| NamedGrasp {
            object: "cube".to_owned(),
            numbers: open.len(),
            motions: 1,
            open: moment(open),
            closed: moment(held),
            held: moment(held),
        };
        // Squared distances of the two grasps: 1 + 1, 1 + 4 and 1 + 0.
        let grasps =
            vec![grasp(&[9.0], &[0.0]), grasp(&[1.0, 2.0, 0.0], &[0.0, 1.0, 1.0]), grasp(&[0.0; 3], &[1.0, 2.0, 0.0])];
        assert_eq!(opening_shares(&grasps, 3), [2.0 / 8.0, 7.0 / 8.0, 1.0]);
        let mut product = ControlProduct { synergy, commands, joint_map, recommended: None, grasps };
        product.recommend(&[0.1, 0.96, 0.97, 0.98], 0.97, 200);
        let Recommended { components, reason } = product.recommended.clone().unwrap();
        assert_eq!(components, 2, "one number lifts but does not open");
        assert!(reason.contains("97.0 % of 200") && reason.contains("opening 88 %"), "{reason}");
        product.recommended = None;
        product.recommend(&[0.1, 0.2, 0.3, 0.4], 0.97, 200);
        assert_eq!(product.recommended, None);
    }

    #[test]
    fn a_settled_space_without_successes_of_the_policy_has_a_joint_map_and_no_grasps() {
        let actuators = crate::actuators::tests::actuators();
        let joint = |name: &str| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 };
        let step = |at: u32| MotionRecord {
            episode: 0,
            object: "cube".to_owned(),
            step: at,
            held: at > 1,
            posture: vec![0.0, 0.2 * f64::from(at)],
            command: vec![0.1 * f64::from(at); actuators.coordinates.len()],
        };
        let described: Vec<MotionRecord> = (0..4).map(step).collect();
        let product =
            ControlProduct::of(&actuators, &[joint("a"), joint("b")], &described, &[], &[], 1).unwrap().unwrap();
        assert!(product.grasps.is_empty());
        let z = product.synergy.encode(&described[3].command);
        assert!((product.joint_map.decode(&z)[1] - 0.6).abs() < 1e-6, "{:?}", product.joint_map.decode(&z));
    }

    #[test]
    fn a_grasp_opens_where_the_hand_is_nearest_to_the_open_one_before_it_holds() {
        // The hand's joint is the second of a posture, and the hand is open at 0.5.
        let actuators = crate::actuators::tests::actuators();
        let step = |at: u32, joint: f64, held| MotionRecord {
            episode: 0,
            object: "cube".to_owned(),
            step: at,
            held,
            posture: vec![0.1 * f64::from(at), joint],
            command: vec![f64::from(at), 0.1 + joint, 2.0],
        };
        let motion = [step(0, 1.2, false), step(1, 0.6, false), step(2, 0.9, false), step(3, 0.5, true)];
        let commands: Vec<Vec<f64>> = motion.iter().map(|step| step.command.clone()).collect();
        let synergy = Synergy::fit(&actuators.coordinates, &commands, 2).unwrap();
        let grasps = mean_grasps(&synergy, &actuators, 2, &motion);
        assert_eq!(grasps.len(), 1);
        let NamedGrasp { open, closed, held, .. } = &grasps[0];
        assert_eq!([&open.q, &closed.q, &held.q], [1, 2, 3].map(|i| &motion[i].posture));
        let commands = actuators.commands_that_hold(&motion[1].posture, &motion[1].command);
        assert_eq!(open.z, synergy.encode(&commands), "they hold the posture");
        assert_ne!(open.z, synergy.encode(&motion[1].command));
    }
}
