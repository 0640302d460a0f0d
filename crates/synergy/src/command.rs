//! The commands that a synergy can give.

use crate::{ActuationMap, Synergy};

/// A direction is left out if its part outside the earlier directions is shorter than this.
const DEPENDENT: f64 = 1e-6;

/// The affine space of the commands `matrix (mean + z components) + offset`, for all `z` and without clamps.
///
/// A distance from this space has the unit of the postures (rad and m count alike): each command is divided by the norm
/// of its actuator's row of the matrix. An actuator with a row of zeros holds no posture and adds no distance.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandSpace {
    centre: Vec<f64>,
    metric: Vec<f64>,
}

impl CommandSpace {
    /// Returns the space of the commands that a synergy gives through an actuation map.
    ///
    /// # Panics
    /// When the map has another number of joints than the synergy.
    pub fn new(synergy: &Synergy, actuation: &ActuationMap) -> Self {
        let nu = actuation.matrix.len();
        let product = |row: &[f64], q: &[f64]| -> f64 {
            assert_eq!(row.len(), q.len(), "one number for each joint is needed");
            dot(row, q)
        };
        let per_command: Vec<f64> = (actuation.matrix.iter())
            .map(|row| dot(row, row).sqrt())
            .map(|length| if length > 0.0 { length.recip() } else { 0.0 })
            .collect();
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for i in 0..synergy.n_components() {
            let rows = actuation.matrix.iter().zip(&per_command);
            let mut direction: Vec<f64> = rows.map(|(row, scale)| scale * product(row, synergy.component(i))).collect();
            for known in &basis {
                let along = dot(known, &direction);
                direction.iter_mut().zip(known).for_each(|(d, k)| *d -= along * k);
            }
            let length = dot(&direction, &direction).sqrt();
            if length > DEPENDENT {
                direction.iter_mut().for_each(|d| *d /= length);
                basis.push(direction);
            }
        }
        let mut metric = vec![0.0; nu * nu];
        for i in 0..nu {
            for j in 0..nu {
                let outside = f64::from(u8::from(i == j)) - basis.iter().map(|b| b[i] * b[j]).sum::<f64>();
                metric[i * nu + j] = per_command[i] * outside * per_command[j];
            }
        }
        let offset = actuation.matrix.iter().zip(&actuation.offset);
        let centre = offset.map(|(row, offset)| product(row, synergy.mean()) + offset).collect();
        CommandSpace { centre, metric }
    }

    /// Returns the command of the mean posture, one number for each actuator.
    pub fn centre(&self) -> &[f64] {
        &self.centre
    }

    /// Returns the symmetric matrix `G` of the squared distance `(ctrl - centre)^T G (ctrl - centre)`.
    ///
    /// # Shapes
    /// nu x nu, row-major.
    pub fn metric(&self) -> &[f64] {
        &self.metric
    }

    /// Returns the distance of a command from the space, in rad or m.
    ///
    /// # Panics
    /// When `ctrl` does not have one number for each actuator.
    pub fn distance(&self, ctrl: &[f64]) -> f64 {
        assert_eq!(ctrl.len(), self.centre.len(), "one number for each actuator is needed");
        let deviation: Vec<f64> = ctrl.iter().zip(&self.centre).map(|(u, c)| u - c).collect();
        let rows = self.metric.chunks_exact(ctrl.len().max(1));
        rows.zip(&deviation).map(|(row, d)| d * dot(row, &deviation)).sum::<f64>().max(0.0).sqrt()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{JointInfo, Unit};

    /// A hand with four joints: the first two are coupled and share an actuator. The last actuator holds no joint.
    fn space(n_components: usize) -> (Synergy, ActuationMap, CommandSpace) {
        let joints = ["a", "b", "c", "d"].map(|name| JointInfo {
            name: name.to_owned(),
            unit: Unit::Radian,
            lower: -9.0,
            upper: 9.0,
        });
        let postures: Vec<[f64; 4]> = (0..40)
            .map(|i| {
                let (x, y) = (f64::from(i).sin(), f64::from(i * i).cos());
                [x, x, 0.5 * y + 0.2 * x, 0.1 * (f64::from(i) * 1.7).sin() + 0.3]
            })
            .collect();
        let synergy = Synergy::fit(&joints, &postures, n_components).unwrap();
        let actuation = ActuationMap {
            actuators: ["ab", "c", "d", "motor"].map(str::to_owned).to_vec(),
            control_min: vec![-9.0; 4],
            control_max: vec![9.0; 4],
            matrix: vec![
                vec![1.0, 1.0, 0.0, 0.0],
                vec![0.0, 0.0, 3.0, 0.0],
                vec![0.0, 0.0, 0.0, 1.0],
                vec![0.0, 0.0, 0.0, 0.0],
            ],
            offset: vec![0.0, 0.5, 0.0, 0.0],
        };
        let space = CommandSpace::new(&synergy, &actuation);
        (synergy, actuation, space)
    }

    #[test]
    fn what_the_synergy_commands_is_in_its_space() {
        for n_components in 1..4 {
            let (synergy, actuation, space) = space(n_components);
            let z: Vec<f64> = (0..n_components).map(|i| 0.7 - 0.4 * i as f64).collect();
            assert!(space.distance(&actuation.control(&synergy.decode_unclamped(&z))) < 1e-7);
            assert!(space.distance(space.centre()) < 1e-12);
        }
    }

    #[test]
    fn a_distance_has_the_unit_of_the_postures() {
        let (synergy, _, space) = space(1);
        // The least-squares distance from the line, in commands divided by the length of their rows.
        let direction = [2f64.sqrt() * synergy.component(0)[0], synergy.component(0)[2], synergy.component(0)[3]];
        let moved = [0.3, -0.6, 0.2];
        let scaled = [moved[0] / 2f64.sqrt(), moved[1] / 3.0, moved[2]];
        let along = dot(&direction, &scaled) / dot(&direction, &direction).sqrt();
        let expected = (dot(&scaled, &scaled) - along * along).sqrt();
        let mut ctrl = space.centre().to_vec();
        ctrl.iter_mut().zip(moved).for_each(|(u, by)| *u += by);
        assert!((space.distance(&ctrl) - expected).abs() < 1e-12);
        ctrl[3] += 5.0;
        assert!((space.distance(&ctrl) - expected).abs() < 1e-12, "a motor adds no distance");
    }

    #[test]
    fn directions_that_no_actuator_follows_add_nothing() {
        let (_, _, space) = space(4);
        assert!(space.metric().iter().all(|g| g.abs() < 1e-9), "{:?}", space.metric());
    }
}
