//! The numerics of the analysis: covariance, eigenvectors and their signs.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par, Side};

use crate::SynergyError;

/// In the sign rule, entries are tied if their absolute values differ from the largest by at most this share of it.
const SIGN_TIE: f64 = 1e-9;

/// (symmetric covariance: n x n, k <= n) => (components: k x n row-major, all eigenvalues, falling: n)
pub(crate) fn principal_components(covariance: &Mat<f64>, k: usize) -> Result<(Vec<f64>, Vec<f64>), SynergyError> {
    let failed = || SynergyError::Decomposition { what: "covariance" };
    let n_joints = covariance.nrows();
    let finite = |j| covariance.col_as_slice(j).iter().all(|entry| entry.is_finite());
    if !(0..n_joints).all(finite) {
        return Err(failed());
    }
    let decomposition = covariance.self_adjoint_eigen(Side::Lower).map_err(|_| failed())?;
    // faer sorts eigenvalues in rising order. Those of a covariance can be negative only by rounding.
    let ascending = decomposition.S().column_vector();
    let eigenvalues = (0..n_joints).rev().map(|i| ascending[i].max(0.0)).collect();
    let mut components = Vec::with_capacity(k * n_joints);
    for i in (n_joints - k..n_joints).rev() {
        let column: Vec<f64> = decomposition.U().col(i).iter().copied().collect();
        let sign = sign_of_largest(&column);
        components.extend(column.iter().map(|loading| sign * loading));
    }
    Ok((components, eigenvalues))
}

/// (postures: N x n, N >= 2) => (mean: n, sample covariance: n x n)
pub(super) fn mean_and_covariance<P: AsRef<[f64]>>(postures: &[P], n_joints: usize) -> (Vec<f64>, Mat<f64>) {
    let mut mean = vec![0.0; n_joints];
    for posture in postures {
        for (sum, q) in mean.iter_mut().zip(posture.as_ref()) {
            *sum += q;
        }
    }
    for sum in &mut mean {
        *sum /= postures.len() as f64;
    }
    let centred = Mat::from_fn(n_joints, postures.len(), |joint, row| postures[row].as_ref()[joint] - mean[joint]);
    (mean, covariance(&centred))
}

/// (samples minus their mean: n x N, N >= 2) => sample covariance: n x n
///
/// It is not generic, so that the callers of generic functions do not compile the product again.
fn covariance(centred: &Mat<f64>) -> Mat<f64> {
    let mut covariance = Mat::zeros(centred.nrows(), centred.nrows());
    let scale = 1.0 / (centred.ncols() - 1) as f64;
    matmul(&mut covariance, Accum::Replace, centred, centred.transpose(), scale, Par::Seq);
    covariance
}

/// (eigenvalues, falling: n) => contribution rates of the first k
pub(super) fn contribution_rates(eigenvalues: &[f64], k: usize) -> Vec<f64> {
    let total: f64 = eigenvalues.iter().sum();
    eigenvalues[..k].iter().map(|l| if total > 0.0 { l / total } else { 0.0 }).collect()
}

/// (a component) => the factor, 1 or -1, with which it fulfils the sign rule
fn sign_of_largest(component: &[f64]) -> f64 {
    let largest = component.iter().fold(0.0_f64, |largest, loading| largest.max(loading.abs()));
    let first = component.iter().find(|loading| loading.abs() >= largest * (1.0 - SIGN_TIE));
    if first.is_some_and(|loading| *loading < 0.0) { -1.0 } else { 1.0 }
}
