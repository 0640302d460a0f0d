//! The joint positions to which the commands of a control synergy lead.

use faer::Mat;
use faer::linalg::solvers::Solve;
use serde::{Deserialize, Serialize};

use crate::joint::{check_joints, check_posture};
use crate::pca::check_numbers;
use crate::{JointInfo, Synergy, SynergyError};

/// The affine map `q = clamp(mean + z matrix)` from a synergy's coefficients to joint positions.
///
/// Commands alone do not tell where a hand is: contacts stop its fingers. This map is the least-squares fit to measured
/// postures.
///
/// # Shapes
/// For `k` coefficients and `n` joints: `mean` n, `matrix` k x n.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointMap {
    /// The joints, with units and limits.
    pub joints: Vec<JointInfo>,
    /// Names of joints that no command moves, such as that of the slide, which stands for the arm.
    #[serde(default)]
    pub free: Vec<String>,
    /// The joint positions at coefficients of zero.
    pub mean: Vec<f64>,
    /// The change of the joint positions with each coefficient.
    pub matrix: Vec<Vec<f64>>,
}

/// Ridge of the fit, relative to the mean variance of the coefficients: directions that hardly vary get no slope.
const RIDGE: f64 = 1e-9;

/// A number moves no joint if the squares of its slopes are below this share of those of the number that moves most.
const STILL: f64 = 1e-12;

impl JointMap {
    /// Fits the map to commands and to the postures measured beside them.
    ///
    /// # Errors
    /// Lists of different lengths, fewer than two samples, or a posture of the wrong length or with a number that is not
    /// finite.
    pub fn fit<C: AsRef<[f64]>, P: AsRef<[f64]>>(
        synergy: &Synergy,
        commands: &[C],
        joints: &[JointInfo],
        postures: &[P],
    ) -> Result<JointMap, SynergyError> {
        check_joints(joints)?;
        if commands.len() != postures.len() {
            return Err(SynergyError::invalid("number of postures", commands.len().to_string(), postures.len()));
        }
        if commands.len() < 2 {
            return Err(SynergyError::invalid("number of samples", "at least 2", commands.len()));
        }
        for (row, posture) in postures.iter().enumerate() {
            check_posture(posture.as_ref(), joints.len(), row)?;
        }
        let (n_samples, k, n) = (commands.len(), synergy.n_components(), joints.len());
        let coefficients: Vec<Vec<f64>> = commands.iter().map(|command| synergy.encode(command.as_ref())).collect();
        let mean_of = |values: &dyn Fn(usize) -> f64| (0..n_samples).map(values).sum::<f64>() / n_samples as f64;
        let z_mean: Vec<f64> = (0..k).map(|i| mean_of(&|row| coefficients[row][i])).collect();
        let q_mean: Vec<f64> = (0..n).map(|j| mean_of(&|row| postures[row].as_ref()[j])).collect();
        let z = Mat::from_fn(n_samples, k, |row, i| coefficients[row][i] - z_mean[i]);
        let q = Mat::from_fn(n_samples, n, |row, j| postures[row].as_ref()[j] - q_mean[j]);
        let slopes = slopes(&z, &q, RIDGE)?;
        let matrix: Vec<Vec<f64>> = (0..k).map(|i| (0..n).map(|j| slopes[(i, j)]).collect()).collect();
        // The coefficients need not have the mean 0: the space can describe other samples.
        let at_zero = |j: usize| q_mean[j] - (0..k).map(|i| z_mean[i] * matrix[i][j]).sum::<f64>();
        Ok(JointMap { joints: joints.to_vec(), free: Vec::new(), mean: (0..n).map(at_zero).collect(), matrix })
    }

    /// Returns the joint positions of a set of coefficients, clamped to the joints' limits.
    ///
    /// # Panics
    /// When `coefficients` does not have one number for each row of the matrix.
    pub fn decode(&self, coefficients: &[f64]) -> Vec<f64> {
        assert_eq!(coefficients.len(), self.matrix.len(), "one coefficient for each component is needed");
        let mut posture = self.mean.clone();
        for (row, z) in self.matrix.iter().zip(coefficients) {
            posture.iter_mut().zip(row).for_each(|(q, slope)| *q += z * slope);
        }
        posture.iter().zip(&self.joints).map(|(q, joint)| joint.clamp(*q)).collect()
    }

    /// Returns the coefficients whose joint positions are nearest to a measured posture, in the sense of least squares; rad
    /// and m count alike. The joints in [`free`](Self::free) do not count.
    ///
    /// # Errors
    /// A posture of the wrong length or with a number that is not finite, or joints that do not determine the coefficients.
    pub fn encode(&self, posture: &[f64]) -> Result<Vec<f64>, SynergyError> {
        check_posture(posture, self.joints.len(), 0)?;
        let used: Vec<usize> = (0..self.joints.len()).filter(|&j| !self.free.contains(&self.joints[j].name)).collect();
        let k = self.matrix.len();
        if used.len() < k {
            let expected = format!("at least {k}, one for each number");
            return Err(SynergyError::invalid("joints that commands move", expected, used.len()));
        }
        let squares: Vec<f64> =
            self.matrix.iter().map(|row| used.iter().map(|&j| row[j] * row[j]).sum::<f64>()).collect();
        let largest = squares.iter().copied().fold(0.0, f64::max);
        if let Some(i) = squares.iter().position(|square| *square <= STILL * largest) {
            let expected = "a number that moves a joint; use fewer numbers";
            return Err(SynergyError::invalid(format!("joint_map.matrix[{i}]"), expected, "one that moves none"));
        }
        let slopes_of = Mat::from_fn(used.len(), k, |row, i| self.matrix[i][used[row]]);
        let moved = Mat::from_fn(used.len(), 1, |row, _| posture[used[row]] - self.mean[used[row]]);
        let z = slopes(&slopes_of, &moved, 0.0)?;
        Ok((0..k).map(|i| z[(i, 0)]).collect())
    }

    pub(crate) fn check(&self, k: usize) -> Result<(), SynergyError> {
        check_joints(&self.joints)?;
        if let Some(name) = self.free.iter().find(|name| !self.joints.iter().any(|joint| joint.name == **name)) {
            return Err(SynergyError::invalid("joint_map.free", "names of joints", name));
        }
        check_numbers("joint_map.mean", &self.mean, self.joints.len())?;
        if self.matrix.len() != k {
            return Err(SynergyError::invalid("rows of joint_map.matrix", k.to_string(), self.matrix.len()));
        }
        let n = self.joints.len();
        let mut rows = self.matrix.iter().enumerate();
        rows.try_for_each(|(i, row)| check_numbers(&format!("joint_map.matrix[{i}]"), row, n))
    }
}

/// (coefficients: N x k, joint positions: N x n, both minus their means; ridge) => slopes of the least squares: k x n
fn slopes(z: &Mat<f64>, q: &Mat<f64>, ridge: f64) -> Result<Mat<f64>, SynergyError> {
    let k = z.ncols();
    let mut gram = z.transpose() * z;
    let ridge = ridge * (0..k).map(|i| gram[(i, i)]).sum::<f64>() / k as f64 + f64::MIN_POSITIVE;
    for i in 0..k {
        gram[(i, i)] += ridge;
    }
    let factors = gram.llt(faer::Side::Lower).map_err(|_| SynergyError::Decomposition { what: "joint map" })?;
    Ok(factors.solve(z.transpose() * q))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Unit;

    #[test]
    fn the_map_of_joints_that_follow_their_commands_is_exact() {
        let joint = |name: &str| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: -2.0, upper: 2.0 };
        let commands: Vec<[f64; 3]> = (0..50)
            .map(|i| [f64::from(i).sin(), 0.5 * f64::from(i).sin() + 0.3 * f64::from(i * i).cos(), 0.7])
            .collect();
        let follow = |u: &[f64]| vec![0.5 * u[0] + 0.1, u[1] - u[0], u[2], 3.0 * u[0]];
        let postures: Vec<Vec<f64>> = commands.iter().map(|u| follow(u)).collect();
        let synergy = Synergy::fit(&["u", "v", "w"].map(joint), &commands, 2).unwrap();
        let map = JointMap::fit(&synergy, &commands, &["a", "b", "c", "d"].map(joint), &postures).unwrap();
        for command in [[0.3, -0.2, 0.7], [-0.5, 0.1, 0.7]] {
            let found = map.decode(&synergy.encode(&command));
            for ((found, expected), joint) in found.iter().zip(follow(&command)).zip(&map.joints) {
                assert!((found - joint.clamp(expected)).abs() < 1e-6, "{found} {expected}");
            }
            // The way back: the posture of these coefficients has them.
            let back = map.encode(&found).unwrap();
            assert!(back.iter().zip(synergy.encode(&command)).all(|(a, b)| (a - b).abs() < 1e-9), "{back:?}");
            let mut elsewhere = found.clone();
            elsewhere[3] += 5.0;
            let without = JointMap { free: vec!["d".to_owned()], ..map.clone() };
            assert_eq!(
                without.encode(&elsewhere).unwrap(),
                without.encode(&found).unwrap(),
                "a free joint does not count"
            );
            assert_ne!(map.encode(&elsewhere).unwrap(), back);
        }
        let too_few = JointMap { free: ["a", "b", "d"].map(str::to_owned).to_vec(), ..map.clone() };
        assert!(too_few.encode(&[0.0; 4]).is_err(), "one joint does not tell two coefficients");
        assert!(map.encode(&[0.0; 3]).is_err());
        assert!(JointMap::fit(&synergy, &commands[..9], &["a"].map(joint), &postures).is_err());
    }
}
