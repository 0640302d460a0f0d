//! The map from a posture to the actuator commands that hold it.

use eigenhand_posture::{ActuationMap, JointInfo, Unit};

use crate::hand::Hand;
use crate::parts::{HandActuator, Transmission};

impl Hand {
    /// Computes the map from a posture to actuator commands: a row for each actuator, the slide's first and then the
    /// model's in document order.
    ///
    /// A driven joint outside the posture follows its coupling if the coupling is linear and its driver is in the
    /// posture; otherwise it stays in the open posture.
    ///
    /// # Source
    /// At rest a position servo's force vanishes: `gain * ctrl = stiffness * length - bias`, and MuJoCo's actuator length
    /// is gear times joint position, or gear times the sum of coefficient and joint position for a fixed tendon.
    pub fn actuation(&self) -> ActuationMap {
        let joints: Vec<String> = self.posture.iter().map(|j| j.name.clone()).collect();
        let slide = &self.manifest.slide;
        let slide_column = joints.iter().position(|name| *name == slide.name);
        let mut map = ActuationMap {
            actuators: vec![slide.name.clone()],
            matrix: vec![(0..joints.len()).map(|i| f64::from(u8::from(Some(i) == slide_column))).collect()],
            offset: vec![if slide_column.is_some() { 0.0 } else { slide.start }],
            control_min: vec![slide.range[0]],
            control_max: vec![slide.range[1]],
        };
        for actuator in &self.actuators {
            let (coefficients, offset) = self.row(actuator, &joints).unwrap_or_else(|| (vec![0.0; joints.len()], 0.0));
            map.actuators.push(actuator.name.clone());
            map.matrix.push(coefficients);
            map.offset.push(offset);
            map.control_min.push(actuator.ctrlrange.0);
            map.control_max.push(actuator.ctrlrange.1);
        }
        map
    }

    /// Returns the coordinates of a command: the hand's actuators, without the slide's. The unit is that of the first joint of
    /// the posture on which an actuator acts, otherwise rad.
    pub fn command_coordinates(&self) -> Vec<JointInfo> {
        let map = self.actuation();
        let coordinate = |i: usize| {
            let joint = map.matrix[i].iter().position(|weight| *weight != 0.0);
            let unit = joint.map_or(Unit::Radian, |joint| self.posture[joint].unit);
            JointInfo { name: map.actuators[i].clone(), unit, lower: map.control_min[i], upper: map.control_max[i] }
        };
        (1..map.actuators.len()).map(coordinate).collect()
    }

    /// Returns the names of the joints that move with an actuator: those on which it acts, and those that follow them. None for
    /// an actuator that acts on something else, such as a spatial tendon, and for a name that no actuator has.
    pub fn joints_moved_by(&self, actuator: &str) -> Option<Vec<String>> {
        let actuator = self.actuators.iter().find(|known| known.name == actuator)?;
        let mut joints: Vec<String> = match &actuator.transmission {
            Transmission::Joint(joint) => vec![joint.clone()],
            Transmission::FixedTendon { terms, .. } => terms.iter().map(|(joint, _)| joint.clone()).collect(),
            Transmission::Other(_) => return None,
        };
        // Followers of followers are found as the list grows.
        let mut next = 0;
        while let Some(driver) = joints.get(next).cloned() {
            let followers = self.couplings.iter().filter(|coupling| coupling.driver.as_ref() == Some(&driver));
            let new: Vec<String> =
                followers.map(|coupling| coupling.dependent.clone()).filter(|name| !joints.contains(name)).collect();
            joints.extend(new);
            next += 1;
        }
        Some(joints)
    }

    /// Returns the joints of postures that none of these actuators moves, such as that of the slide, which stands for the arm.
    pub fn joints_free_of<'a>(&self, actuators: impl Iterator<Item = &'a str>) -> Vec<String> {
        let moved: Option<Vec<Vec<String>>> = actuators.map(|name| self.joints_moved_by(name)).collect();
        let is_free = |name: &String| match &moved {
            Some(moved) => !moved.iter().flatten().any(|joint| joint == name),
            // What moves with such an actuator is not known.
            None => *name == self.manifest.slide.name,
        };
        self.posture.iter().map(|joint| joint.name.clone()).filter(is_free).collect()
    }

    /// Returns the row and the offset of an actuator; none where it holds no position.
    fn row(&self, actuator: &HandActuator, joints: &[String]) -> Option<(Vec<f64>, f64)> {
        let servo = actuator.servo?;
        let scale = actuator.gear * servo.stiffness / servo.gain;
        let mut row = (vec![0.0; joints.len()], -servo.bias / servo.gain);
        match &actuator.transmission {
            Transmission::Joint(joint) => self.add_term(joint, scale, joints, &mut row),
            Transmission::FixedTendon { terms, .. } => {
                terms
                    .iter()
                    .for_each(|(joint, coefficient)| self.add_term(joint, scale * coefficient, joints, &mut row));
            }
            Transmission::Other(_) => return None,
        }
        Some(row)
    }

    fn add_term(&self, joint: &str, scale: f64, joints: &[String], (row, offset): &mut (Vec<f64>, f64)) {
        let column = |name: &str| joints.iter().position(|j| j == name);
        if let Some(i) = column(joint) {
            row[i] += scale;
            return;
        }
        let linear =
            self.couplings.iter().find(|c| c.dependent == joint && c.polynomial[2..].iter().all(|a| *a == 0.0));
        if let Some((coupling, i)) = linear.and_then(|c| Some((c, column(c.driver.as_ref()?)?))) {
            row[i] += scale * coupling.polynomial[1];
            *offset += scale * coupling.evaluate(0.0);
            return;
        }
        *offset += scale * self.open_posture().get(joint).copied().unwrap_or(0.0);
    }
}
