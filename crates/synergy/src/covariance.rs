//! Mean and covariance of a stream of postures.

use crate::SynergyError;
use crate::joint::check_posture;

/// The running mean and covariance of postures, one rank-1 update each (Welford's recurrence).
///
/// The *sample* convention is used: the scatter is divided by `count - 1`, as `numpy.cov` and scikit-learn's `PCA`
/// do. Contribution rates and components do not depend on the convention.
///
/// # Source
/// B. P. Welford, Note on a method for calculating corrected sums of squares and products, Technometrics 4 (1962).
#[derive(Debug, Clone, PartialEq)]
pub struct RunningCovariance {
    count: usize,
    mean: Vec<f64>,
    /// Sum over the postures of the outer product of their deviations from the mean: n x n, row-major.
    scatter: Vec<f64>,
    deviation: Vec<f64>,
}

impl RunningCovariance {
    /// Returns the empty accumulator for postures of `n_joints` numbers.
    pub fn new(n_joints: usize) -> Self {
        RunningCovariance {
            count: 0,
            mean: vec![0.0; n_joints],
            scatter: vec![0.0; n_joints * n_joints],
            deviation: vec![0.0; n_joints],
        }
    }

    /// Adds one posture.
    ///
    /// # Errors
    /// A posture of another length, or with a number that is not finite; the accumulator is then unchanged.
    pub fn push(&mut self, posture: &[f64]) -> Result<(), SynergyError> {
        let n_joints = self.mean.len();
        check_posture(posture, n_joints, self.count)?;
        self.count += 1;
        let count = self.count as f64;
        for ((deviation, mean), &q) in self.deviation.iter_mut().zip(&mut self.mean).zip(posture) {
            *deviation = q - *mean;
            *mean += *deviation / count;
        }
        let weight = (count - 1.0) / count;
        if n_joints > 0 {
            for (row, &left) in self.scatter.chunks_exact_mut(n_joints).zip(&self.deviation) {
                let left = weight * left;
                for (entry, &right) in row.iter_mut().zip(&self.deviation) {
                    *entry += left * right;
                }
            }
        }
        Ok(())
    }

    /// Returns the number of postures added.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns the number of joints.
    pub fn n_joints(&self) -> usize {
        self.mean.len()
    }

    /// Returns the mean posture; zeros while there is none.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Returns the sample covariance, symmetric.
    ///
    /// # Shapes
    /// n x n, row-major.
    ///
    /// # Errors
    /// [`SynergyError::TooFewPostures`] before the second posture.
    pub fn covariance(&self) -> Result<Vec<f64>, SynergyError> {
        if self.count < MIN_POSTURES {
            return Err(SynergyError::TooFewPostures { expected: MIN_POSTURES, got: self.count });
        }
        let n_joints = self.mean.len();
        let divisor = (self.count - 1) as f64;
        // The two halves of the scatter differ by rounding; a covariance is symmetric to the last bit.
        Ok((0..n_joints * n_joints)
            .map(|i| {
                let (row, column) = (i / n_joints, i % n_joints);
                self.scatter[row.max(column) * n_joints + row.min(column)] / divisor
            })
            .collect())
    }
}

/// The fewest postures that have a sample covariance.
pub(crate) const MIN_POSTURES: usize = 2;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn batch(postures: &[Vec<f64>]) -> (Vec<f64>, Vec<f64>) {
        let (count, n) = (postures.len() as f64, postures[0].len());
        let mean: Vec<f64> = (0..n).map(|j| postures.iter().map(|q| q[j]).sum::<f64>() / count).collect();
        let covariance = (0..n * n)
            .map(|i| {
                let (a, b) = (i / n, i % n);
                postures.iter().map(|q| (q[a] - mean[a]) * (q[b] - mean[b])).sum::<f64>() / (count - 1.0)
            })
            .collect();
        (mean, covariance)
    }

    proptest! {
        #[test]
        fn running_equals_batch(
            postures in (1usize..8).prop_flat_map(|n| {
                prop::collection::vec(prop::collection::vec(-3.0..3.0f64, n), 2..60)
            }),
            offset in -1e3..1e3f64,
        ) {
            // A large common offset is what a naive sum of squares does not survive.
            let postures: Vec<Vec<f64>> =
                postures.iter().map(|q| q.iter().map(|x| x + offset).collect()).collect();
            let mut running = RunningCovariance::new(postures[0].len());
            for posture in &postures {
                running.push(posture).unwrap();
            }
            let (mean, covariance) = batch(&postures);
            prop_assert_eq!(running.count(), postures.len());
            for (a, b) in running.mean().iter().zip(&mean) {
                prop_assert!((a - b).abs() < 1e-10);
            }
            for (a, b) in running.covariance().unwrap().iter().zip(&covariance) {
                prop_assert!((a - b).abs() < 1e-10, "{a} {b}");
            }
        }
    }

    #[test]
    fn a_refused_posture_changes_nothing() {
        let mut running = RunningCovariance::new(2);
        running.push(&[1.0, 2.0]).unwrap();
        let before = running.clone();
        assert!(matches!(running.push(&[1.0]), Err(SynergyError::PostureLength { expected: 2, got: 1, .. })));
        assert!(matches!(
            running.push(&[1.0, f64::NAN]),
            Err(SynergyError::NonFinitePosture { row: 1, column: 1, .. })
        ));
        assert_eq!(running, before);
        assert!(matches!(running.covariance(), Err(SynergyError::TooFewPostures { got: 1, .. })));
    }
}
