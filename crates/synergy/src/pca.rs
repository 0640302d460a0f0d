//! The synergy space: a principal component analysis of postures.

use faer::Mat;

use crate::JointInfo;
use crate::SynergyError;
use crate::joint::{check_joints, check_posture};
use crate::projector::Projector;

mod eigen;
mod parts;
pub(crate) use eigen::principal_components;
pub(crate) use parts::{SynergyParts, check_numbers};

/// A synergy space: the mean posture and the `k` orthonormal directions in which the postures vary most.
///
/// **Sign rule.** An eigenvector is determined up to its sign. Here, the entry with the row's largest absolute value is
/// positive. Entries that are equal up to a relative 1e-9 are tied, and the first of them counts.
///
/// # Source
/// Section 2.2 (the space and the error `e`), section 3.1 (five components) and section 3.2 (contribution rates) of
/// Higashi et al.
#[derive(Debug, Clone, PartialEq)]
pub struct Synergy {
    joints: Vec<JointInfo>,
    mean: Vec<f64>,
    components: Vec<f64>,
    eigenvalues: Vec<f64>,
    contribution: Vec<f64>,
    coefficient_min: Vec<f64>,
    coefficient_max: Vec<f64>,
    n_postures: usize,
    projector: Projector,
}

/// (postures: N x n) => (mean: n, sample covariance: n x n), after checking every posture
pub(crate) fn mean_and_covariance<P: AsRef<[f64]>>(
    postures: &[P],
    n_joints: usize,
) -> Result<(Vec<f64>, Mat<f64>), SynergyError> {
    /// The fewest postures that have a sample covariance.
    const LEAST: usize = 2;
    for (row, posture) in postures.iter().enumerate() {
        check_posture(posture.as_ref(), n_joints, row)?;
    }
    if postures.len() < LEAST {
        return Err(SynergyError::TooFewPostures { expected: LEAST, got: postures.len() });
    }
    Ok(eigen::mean_and_covariance(postures, n_joints))
}

/// Returns the last `window` of `postures`, or all if `window` is 0.
pub fn newest<P>(postures: &[P], window: usize) -> &[P] {
    let covered = if window == 0 { postures.len() } else { window };
    &postures[postures.len().saturating_sub(covered)..]
}

impl Synergy {
    /// Fits the space of `k` components to `postures`.
    ///
    /// `k` is clamped to the number of joints. Fewer independent postures than `k` are no error: the components beyond
    /// their rank are arbitrary orthonormal directions, and their explained variance is zero up to rounding.
    ///
    /// # Errors
    /// A bad joint list, fewer than two postures, a posture of the wrong length or with a number that is not finite,
    /// `k == 0`, or a decomposition that does not converge.
    pub fn fit<P: AsRef<[f64]>>(joints: &[JointInfo], postures: &[P], k: usize) -> Result<Self, SynergyError> {
        let n_joints = joints.len();
        let (mean, covariance) = mean_and_covariance(postures, n_joints)?;
        check_joints(joints)?;
        if k == 0 {
            return Err(SynergyError::NoComponents);
        }
        let k = k.min(n_joints);
        let (components, eigenvalues) = principal_components(&covariance, k)?;
        let mut synergy = Synergy {
            joints: joints.to_vec(),
            contribution: eigen::contribution_rates(&eigenvalues, k),
            projector: Projector::new(&mean, &components),
            mean,
            components,
            eigenvalues,
            coefficient_min: vec![f64::INFINITY; k],
            coefficient_max: vec![f64::NEG_INFINITY; k],
            n_postures: postures.len(),
        };
        synergy.widen(postures);
        Ok(synergy)
    }

    /// Returns the space of the first `k` components, at least one and at most all. It keeps the eigenvalues of all joints.
    pub fn first(&self, k: usize) -> Synergy {
        let k = k.clamp(1, self.n_components());
        let mut first = self.clone();
        first.components.truncate(k * self.n_joints());
        first.contribution.truncate(k);
        first.coefficient_min.truncate(k);
        first.coefficient_max.truncate(k);
        first.projector = Projector::new(&first.mean, &first.components);
        first
    }

    /// Widens the ranges of the coefficients so that they include those of further postures.
    ///
    /// # Panics
    /// When a posture does not have one number for each joint.
    pub fn widen<P: AsRef<[f64]>>(&mut self, postures: &[P]) {
        for posture in postures {
            for (i, z) in self.encode(posture.as_ref()).into_iter().enumerate() {
                self.coefficient_min[i] = self.coefficient_min[i].min(z);
                self.coefficient_max[i] = self.coefficient_max[i].max(z);
            }
        }
    }

    /// Fits the space of `k` components to the [`newest`] `window` of `postures`; none if there are `k` postures or
    /// fewer.
    ///
    /// # Errors
    /// As [`Synergy::fit`].
    pub fn fit_newest<P: AsRef<[f64]>>(
        joints: &[JointInfo],
        postures: &[P],
        k: usize,
        window: usize,
    ) -> Result<Option<Self>, SynergyError> {
        let covered = newest(postures, window);
        if covered.len() <= k {
            return Ok(None);
        }
        Self::fit(joints, covered, k).map(Some)
    }

    /// Builds a space from stored numbers, after a check of every length and relation.
    pub(crate) fn from_parts(parts: SynergyParts) -> Result<Self, SynergyError> {
        parts.check()?;
        let SynergyParts { joints, mean, components, eigenvalues, coefficient_min, coefficient_max, n_postures } =
            parts;
        let contribution = eigen::contribution_rates(&eigenvalues, components.len());
        let components = components.concat();
        let projector = Projector::new(&mean, &components);
        Ok(Synergy {
            joints,
            mean,
            components,
            eigenvalues,
            contribution,
            coefficient_min,
            coefficient_max,
            n_postures,
            projector,
        })
    }

    /// Returns the joints, in the order of a posture's numbers.
    pub fn joints(&self) -> &[JointInfo] {
        &self.joints
    }

    /// Returns the number of joints, `n`.
    pub fn n_joints(&self) -> usize {
        self.mean.len()
    }

    /// Returns the number of components, `k`.
    pub fn n_components(&self) -> usize {
        self.contribution.len()
    }

    /// Returns the number of postures that the space was fitted to.
    pub fn n_postures(&self) -> usize {
        self.n_postures
    }

    /// Returns the mean posture.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Returns the components, which are orthonormal rows in the order of falling explained variance.
    ///
    /// # Shapes
    /// k x n, row-major.
    pub fn components(&self) -> &[f64] {
        &self.components
    }

    /// Returns component `i`.
    ///
    /// # Panics
    /// When `i` is not below [`Synergy::n_components`].
    pub fn component(&self, i: usize) -> &[f64] {
        &self.components[i * self.n_joints()..(i + 1) * self.n_joints()]
    }

    /// Returns the sample variance along each component: the `k` largest eigenvalues of the covariance.
    pub fn explained_variance(&self) -> &[f64] {
        &self.eigenvalues[..self.n_components()]
    }

    /// Returns all `n` eigenvalues of the covariance, in falling order.
    pub fn eigenvalues(&self) -> &[f64] {
        &self.eigenvalues
    }

    /// Returns the sum of all eigenvalues.
    pub fn total_variance(&self) -> f64 {
        self.eigenvalues.iter().sum()
    }

    /// Returns the contribution rates `r_i = l_i / sum of all eigenvalues` of the `k` components; zeros when the
    /// postures do not vary.
    ///
    /// # Source
    /// Section 3.2.
    pub fn contribution(&self) -> &[f64] {
        &self.contribution
    }

    /// Returns the sum of the contribution rates.
    pub fn contribution_sum(&self) -> f64 {
        self.contribution.iter().sum()
    }

    /// Returns the least coefficient of each component over the postures; empty while unknown.
    pub fn coefficient_min(&self) -> &[f64] {
        &self.coefficient_min
    }

    /// Returns the greatest coefficient of each component over the postures; empty while unknown.
    pub fn coefficient_max(&self) -> &[f64] {
        &self.coefficient_max
    }

    /// Projects a posture: `z = (q - mean) C^T`.
    ///
    /// # Panics
    /// When `posture` does not have one number for each joint.
    pub fn encode(&self, posture: &[f64]) -> Vec<f64> {
        self.assert_length(posture.len());
        self.components
            .chunks_exact(self.n_joints())
            .map(|row| row.iter().zip(posture).zip(&self.mean).map(|((c, q), mean)| c * (q - mean)).sum())
            .collect()
    }

    /// Returns the posture of a set of coefficients, clamped to the joints' limits: `q = clamp(mean + z C)`.
    ///
    /// # Panics
    /// When `coefficients` does not have one number for each component.
    pub fn decode(&self, coefficients: &[f64]) -> Vec<f64> {
        let mut posture = self.decode_unclamped(coefficients);
        for (q, joint) in posture.iter_mut().zip(&self.joints) {
            *q = q.clamp(joint.lower, joint.upper);
        }
        posture
    }

    /// Returns the posture of a set of coefficients without clamping it: `q = mean + z C`.
    ///
    /// # Panics
    /// When `coefficients` does not have one number for each component.
    pub fn decode_unclamped(&self, coefficients: &[f64]) -> Vec<f64> {
        assert_eq!(coefficients.len(), self.n_components(), "one coefficient for each component is needed");
        let mut posture = self.mean.clone();
        for (row, z) in self.components.chunks_exact(self.n_joints()).zip(coefficients) {
            for (q, c) in posture.iter_mut().zip(row) {
                *q += z * c;
            }
        }
        posture
    }

    /// Returns the part of a posture that the space cannot express: `q - (mean + encode(q) C)`.
    ///
    /// # Panics
    /// When `posture` does not have one number for each joint.
    pub fn residual(&self, posture: &[f64]) -> Vec<f64> {
        let projected = self.decode_unclamped(&self.encode(posture));
        posture.iter().zip(projected).map(|(q, p)| q - p).collect()
    }

    /// Returns the approximation error `e` of a posture: the Euclidean norm of its residual over all joints.
    ///
    /// # Units
    /// Those of the joints: radians, and metres where a joint slides.
    ///
    /// # Panics
    /// When `posture` does not have one number for each joint.
    ///
    /// # Source
    /// Section 2.2.
    pub fn error(&self, posture: &[f64]) -> f64 {
        self.residual(posture).iter().map(|r| r * r).sum::<f64>().sqrt()
    }

    /// Returns the same error for a single-precision posture. It allocates nothing, for code that calls it millions of
    /// times.
    ///
    /// # Panics
    /// When `posture` does not have one number for each joint.
    pub fn error_f32(&self, posture: &[f32]) -> f32 {
        self.assert_length(posture.len());
        self.projector.error(posture)
    }

    /// Returns the mean of [`Synergy::error`] over `postures`; 0 if the list is empty.
    ///
    /// # Panics
    /// When a posture does not have one number for each joint.
    pub fn mean_error<P: AsRef<[f64]>>(&self, postures: &[P]) -> f64 {
        let sum: f64 = postures.iter().map(|posture| self.error(posture.as_ref())).sum();
        sum / postures.len().max(1) as f64
    }

    fn assert_length(&self, length: usize) {
        assert_eq!(length, self.n_joints(), "one number for each joint is needed");
    }
}
