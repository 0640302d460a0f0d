//! Compares two synergy spaces over the same joints.

use faer::{Mat, MatRef, Par};

use crate::joint::check_same_joints;
use crate::pca::mean_and_covariance;
use crate::{Synergy, SynergyError};

/// Returns the principal angles between two spaces in rising order, one for each component of the smaller space.
///
/// An angle of 0 means that both spaces share a direction. An angle of pi/2 means that the larger space lacks a
/// direction of the smaller one. Small angles are computed from their sines, so that they are accurate near 0 too.
///
/// # Units
/// Radians.
///
/// # Errors
/// [`SynergyError::JointMismatch`] when the joints' names or units differ, or a decomposition that does not converge.
///
/// # Source
/// A. Bjorck and G. H. Golub, Numerical methods for computing angles between linear subspaces, Math. Comp. 27 (1973).
pub fn principal_angles(a: &Synergy, b: &Synergy) -> Result<Vec<f64>, SynergyError> {
    check_same_joints(a.joints(), b.joints())?;
    let (large, small) = if a.n_components() < b.n_components() { (b, a) } else { (a, b) };
    let large = MatRef::from_row_major_slice(large.components(), large.n_components(), large.n_joints());
    let small = MatRef::from_row_major_slice(small.components(), small.n_components(), small.n_joints());
    angles_between(large, small)
}

/// (orthonormal rows: k x n, orthonormal rows: m x n, m <= k) => principal angles in rad, rising: m
pub(crate) fn angles_between(large: MatRef<'_, f64>, small: MatRef<'_, f64>) -> Result<Vec<f64>, SynergyError> {
    let overlap: Mat<f64> = small * large.transpose();
    let mut outside = small.to_owned();
    faer::linalg::matmul::matmul(&mut outside, faer::Accum::Add, &overlap, large, -1.0, Par::Seq);
    let cosines = singular_values(&overlap)?;
    let sines = singular_values(&outside)?;
    // Both lists are in falling order, and the largest cosine belongs to the smallest sine.
    Ok(cosines.iter().zip(sines.iter().rev()).map(|(cosine, sine)| sine.atan2(*cosine)).collect())
}

/// Returns, for `i` from 1 to `k`, the share of the variance of `postures` about their own mean that lies in the first
/// `i` components of `space`.
///
/// For the postures that `space` was fitted to, these are the running sums of its contribution rates.
///
/// # Errors
/// Fewer than two postures, one of the wrong length or with a number that is not finite, or
/// [`SynergyError::NoVariance`].
pub fn cumulative_explained_variance<P: AsRef<[f64]>>(
    space: &Synergy,
    postures: &[P],
) -> Result<Vec<f64>, SynergyError> {
    let n_joints = space.n_joints();
    let (_, covariance) = mean_and_covariance(postures, n_joints)?;
    let total: f64 = (0..n_joints).map(|i| covariance[(i, i)]).sum();
    if total <= 0.0 {
        return Err(SynergyError::NoVariance);
    }
    let mut sum = 0.0;
    let shares = (0..space.n_components()).map(|i| {
        let component = space.component(i);
        // The variance along a component c: c S c^T.
        let along = |i: usize| (0..n_joints).map(|j| covariance[(i, j)] * component[j]).sum::<f64>();
        let variance: f64 = (0..n_joints).map(|i| component[i] * along(i)).sum();
        sum += variance / total;
        sum
    });
    Ok(shares.collect())
}

fn singular_values(matrix: &Mat<f64>) -> Result<Vec<f64>, SynergyError> {
    matrix.singular_values().map_err(|_| SynergyError::Decomposition { what: "overlap of two spaces" })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::{JointInfo, Unit};

    fn joints(n: usize) -> Vec<JointInfo> {
        (0..n).map(|i| JointInfo { name: format!("j{i}"), unit: Unit::Radian, lower: -9.0, upper: 9.0 }).collect()
    }

    /// Postures that vary along each of the given orthogonal directions, each with its own amplitude.
    fn along(directions: &[(f64, Vec<f64>)]) -> Vec<Vec<f64>> {
        directions
            .iter()
            .flat_map(|(amplitude, d)| [1.0, -1.0].map(|sign| d.iter().map(|x| sign * amplitude * x).collect()))
            .collect()
    }

    fn axis(n: usize, i: usize) -> Vec<f64> {
        (0..n).map(|j| if i == j { 1.0 } else { 0.0 }).collect()
    }

    #[test]
    fn angles_are_those_of_a_known_rotation() {
        for angle in [0.0_f64, 1e-12, 1e-6, 0.3, 1.2, FRAC_PI_2] {
            let a = Synergy::fit(&joints(4), &along(&[(2.0, axis(4, 0)), (1.0, axis(4, 1))]), 2).unwrap();
            let tilted = vec![angle.cos(), 0.0, angle.sin(), 0.0];
            let b = Synergy::fit(&joints(4), &along(&[(2.0, tilted), (1.0, axis(4, 1))]), 2).unwrap();
            for angles in [principal_angles(&a, &b).unwrap(), principal_angles(&b, &a).unwrap()] {
                assert_eq!(angles.len(), 2);
                assert!(angles[0].abs() < 1e-14 && (angles[1] - angle).abs() < 1e-14, "{angle}: {angles:?}");
            }
        }
    }

    #[test]
    fn spaces_of_different_sizes_and_joints() {
        let postures = along(&[(3.0, axis(3, 0)), (2.0, axis(3, 1)), (1.0, axis(3, 2))]);
        let one = Synergy::fit(&joints(3), &postures, 1).unwrap();
        let two = Synergy::fit(&joints(3), &postures, 2).unwrap();
        assert_eq!(principal_angles(&one, &two).unwrap().len(), 1);
        assert!(principal_angles(&two, &one).unwrap()[0] < 1e-14);
        let mut renamed = joints(3);
        renamed[1].name = "other".to_owned();
        let other = Synergy::fit(&renamed, &postures, 2).unwrap();
        let message = principal_angles(&one, &other).unwrap_err().to_string();
        assert!(message.contains("j1") && message.contains("other"), "{message}");
    }

    #[test]
    fn shares_of_own_postures_are_the_contribution_rates() {
        let postures = along(&[(3.0, axis(3, 0)), (2.0, axis(3, 1)), (1.0, axis(3, 2))]);
        let space = Synergy::fit(&joints(3), &postures, 2).unwrap();
        let shares = cumulative_explained_variance(&space, &postures).unwrap();
        assert!((shares[0] - 9.0 / 14.0).abs() < 1e-14 && (shares[1] - 13.0 / 14.0).abs() < 1e-14);
        assert!((shares[1] - space.contribution_sum()).abs() < 1e-14);

        // Postures that vary where the space has nothing; their mean does not matter.
        let outside: Vec<Vec<f64>> = [0.0, 1.0, 2.0].map(|x| vec![5.0, 5.0, x]).to_vec();
        assert!(cumulative_explained_variance(&space, &outside).unwrap()[1].abs() < 1e-14);
        let still = [vec![1.0, 1.0, 1.0], vec![1.0, 1.0, 1.0]];
        assert!(matches!(cumulative_explained_variance(&space, &still), Err(SynergyError::NoVariance)));
    }
}
