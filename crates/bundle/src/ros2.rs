//! Files for ROS 2: the mean grasps and the numbers of a synergy as motions of a hand's joints.
//!
//! A joint controller moves joints, and a synergy commands actuators. A joint that an actuator drives alone is sent where the
//! command leads it, beyond the surface of the object: so it presses. Joints that share an actuator take the posture nearest
//! to the mean one that has the actuator's command.

use std::collections::BTreeSet;

use eigenhand_posture::ActuationMap;
use eigenhand_synergy::{NamedGrasp, SynergyFile};
use serde::Serialize;

/// Smallest distance between two knots, in rad or m: nearer ones are one knot.
const LEAST_STEP: f64 = 1e-6;
/// Seconds from the start to the open, the closed, and the holding hand.
const TIMES: [f64; 3] = [1.0, 2.0, 2.5];
/// Rounds in which joints that share an actuator settle on its command.
const ROUNDS: usize = 20;
/// Seconds after which a controller's state is too old (`state_timeout_sec`).
const STATE_TIMEOUT: f64 = 0.5;

/// A synergy as motions of joints.
pub struct Ros2<'a> {
    file: &'a SynergyFile,
    /// Names of the joints that actuators move.
    names: Vec<&'a str>,
    /// Where each stands in a posture.
    indices: Vec<usize>,
    /// For each of the synergy's actuators that hold a position: its index, weights of the posture's joints, and offset.
    rows: Vec<(usize, &'a [f64], f64)>,
    /// The grasps with all numbers, each with a name that ROS accepts and that nothing else has.
    grasps: Vec<(String, &'a NamedGrasp)>,
}

/// Knots of a path, each with its name and its positions.
type Knots = Vec<(&'static str, Vec<f64>)>;

/// `trajectory_msgs/msg/JointTrajectory`.
#[derive(Serialize)]
pub struct JointTrajectory {
    header: Header,
    joint_names: Vec<String>,
    points: Vec<Point>,
}

#[derive(Serialize, Default)]
struct Header {
    stamp: Time,
    frame_id: String,
}

#[derive(Serialize, Default)]
struct Time {
    sec: i32,
    nanosec: u32,
}

#[derive(Serialize)]
struct Point {
    positions: Vec<f64>,
    velocities: Vec<f64>,
    accelerations: Vec<f64>,
    effort: Vec<f64>,
    time_from_start: Time,
}

impl<'a> Ros2<'a> {
    /// Returns none if the synergy has no joint positions, or no actuator holds a position.
    pub fn of(actuation: &'a ActuationMap, file: &'a SynergyFile) -> Option<Ros2<'a>> {
        let joints = &file.joint_map.as_ref()?.joints;
        let row = |(i, actuator): (usize, &'a str)| {
            let at = actuation.actuators.iter().position(|name| name == actuator)?;
            let weights = actuation.matrix[at].as_slice();
            let moves = weights.len() == joints.len() && weights.iter().any(|weight| *weight != 0.0);
            moves.then(|| (i, weights, actuation.offset[at]))
        };
        let actuators = file.synergy.joints().iter().map(|actuator| actuator.name.as_str());
        let rows: Vec<_> = actuators.enumerate().filter_map(row).collect();
        let is_moved = |j: &usize| rows.iter().any(|(_, weights, _)| weights[*j] != 0.0);
        let indices: Vec<usize> = (0..joints.len()).filter(is_moved).collect();
        let names = indices.iter().map(|&j| joints[j].name.as_str()).collect();
        let k = file.synergy.n_components();
        let mut taken: BTreeSet<String> = (1..=k).map(number_name).collect();
        let named = |grasp: &'a NamedGrasp| {
            let mut name = token(&grasp.object);
            while !taken.insert(name.clone()) {
                name.push('_');
            }
            (name, grasp)
        };
        let grasps = file.grasps.iter().filter(|grasp| grasp.numbers == k).map(named).collect();
        (!indices.is_empty()).then_some(Ros2 { file, names, indices, rows, grasps })
    }

    /// (numbers) => positions of the joints, in rad or m
    fn positions(&self, z: &[f64]) -> Vec<f64> {
        let Some(map) = &self.file.joint_map else { return Vec::new() };
        let (command, mut posture) = (self.file.synergy.decode(z), map.decode(z));
        // What a joint at its limit cannot do, the others do in the next round.
        for _ in 0..ROUNDS {
            for (i, weights, offset) in &self.rows {
                let squares: f64 = weights.iter().map(|weight| weight * weight).sum();
                let reached: f64 = weights.iter().zip(&posture).map(|(weight, q)| weight * q).sum::<f64>() + offset;
                let missing = (command[*i] - reached) / squares;
                posture.iter_mut().zip(*weights).for_each(|(q, weight)| *q += weight * missing);
            }
            posture.iter_mut().zip(&map.joints).for_each(|(q, joint)| *q = joint.clamp(*q));
        }
        self.indices.iter().map(|&j| posture[j]).collect()
    }

    /// Returns the parameters of `grasp_synergy_adapter`, a ROS 2 node by S. Kwon: a profile for each grasp, from the open to
    /// the holding hand, and one for each number, from its least to its greatest value.
    ///
    /// # Source
    /// The README of <https://github.com/shkwon98/grasp_synergy_adapter>, parameters and grasp profiles.
    pub fn profiles(&self) -> String {
        let synergy = &self.file.synergy;
        let grasps = self.grasps.iter().map(|(name, grasp)| {
            let moments = [("pre_grasp", &grasp.open), ("closed", &grasp.closed), ("held", &grasp.held)];
            let knots: Knots = moments.into_iter().map(|(name, moment)| (name, self.positions(&moment.z))).collect();
            (name.clone(), knots)
        });
        let numbers = (0..synergy.n_components()).map(|i| {
            let at = |value: f64| {
                let mut z = vec![0.0; synergy.n_components()];
                z[i] = value;
                self.positions(&z)
            };
            let (least, greatest) = (synergy.coefficient_min()[i], synergy.coefficient_max()[i]);
            let knots = vec![("least", at(least)), ("zero", at(0.0)), ("greatest", at(greatest))];
            (number_name(i + 1), knots)
        });
        let paths: Vec<(String, Vec<(f64, Knot)>)> = grasps
            .chain(numbers)
            .map(|(name, knots)| (name, spaced(knots)))
            .filter(|(_, path)| path.len() > 1)
            .collect();
        let listed = |names: &mut dyn Iterator<Item = &str>| names.map(quoted).collect::<Vec<_>>().join(", ");
        let mut text = format!(
            "# Profiles for the ROS 2 node grasp_synergy_adapter (https://github.com/shkwon98/grasp_synergy_adapter), of the hand {}.\n\
             # A profile of an object goes from the open hand (0.0) to the hand that holds it (1.0); number_I moves the I-th number\n\
             # of the synergy from its least to its greatest value. Positions are in rad, or m for a sliding joint. They lie beyond\n\
             # the object's surface where the hand presses.\n\
             /**/grasp_synergy_adapter:\n  ros__parameters:\n    synergy_joint: synergy\n    joints: [{}]\n    \
             state_timeout_sec: {STATE_TIMEOUT:?}\n    grasp_names: [{}]\n    grasps:\n",
            self.file.hand,
            listed(&mut self.names.iter().copied()),
            listed(&mut paths.iter().map(|(name, _)| name.as_str())),
        );
        for (name, path) in &paths {
            let knots = listed(&mut path.iter().map(|(_, (knot, _))| *knot));
            text.push_str(&format!("      {}:\n        knot_names: [{knots}]\n        knots:\n", quoted(name)));
            for (coordinate, (knot, positions)) in path {
                let positions = positions.iter().map(|q| format!("{q:.9}")).collect::<Vec<_>>().join(", ");
                text.push_str(&format!(
                    "          {knot}:\n            coordinate: {coordinate:.6}\n            positions: [{positions}]\n"
                ));
            }
        }
        text
    }

    /// Returns the trajectory of each grasp, with a name that files and ROS accept.
    pub fn trajectories(&self) -> Vec<(String, JointTrajectory)> {
        let trajectory = |grasp: &NamedGrasp| JointTrajectory {
            header: Header::default(),
            joint_names: self.names.iter().map(|&name| name.to_owned()).collect(),
            points: [&grasp.open, &grasp.closed, &grasp.held]
                .into_iter()
                .zip(TIMES)
                .map(|(moment, seconds)| Point {
                    positions: self.positions(&moment.z),
                    velocities: Vec::new(),
                    accelerations: Vec::new(),
                    effort: Vec::new(),
                    time_from_start: Time { sec: seconds as i32, nanosec: (seconds.fract() * 1e9).round() as u32 },
                })
                .collect(),
        };
        self.grasps.iter().map(|(name, grasp)| (name.clone(), trajectory(grasp))).collect()
    }
}

/// A knot: its name and its positions.
type Knot = (&'static str, Vec<f64>);

/// Gives each knot a coordinate from 0 to 1 by the length of the path to it, and drops knots that do not move the hand.
fn spaced(knots: Knots) -> Vec<(f64, Knot)> {
    let mut path: Vec<(f64, Knot)> = Vec::new();
    for knot in knots {
        let Some((length, (_, last))) = path.last() else {
            path.push((0.0, knot));
            continue;
        };
        let step = last.iter().zip(&knot.1).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        if step > LEAST_STEP {
            path.push((length + step, knot));
        }
    }
    let whole = path.last().map_or(1.0, |(length, _)| *length);
    path.iter_mut().for_each(|(length, _)| *length /= whole);
    path
}

/// Returns the name of the profile of a number, from 1 on.
fn number_name(number: usize) -> String {
    format!("number_{number}")
}

/// Returns a name that ROS accepts: letters, digits and `_`, no digit first.
fn token(name: &str) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let token: String = name.chars().map(allowed).collect();
    if token.starts_with(|c: char| c.is_ascii_digit()) { format!("_{token}") } else { token }
}

/// Returns a text as YAML in double quotes, which are those of JSON.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
