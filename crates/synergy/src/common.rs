//! Compares two spaces on the joints that both have.

use faer::{Mat, MatRef};
use serde::Serialize;

use crate::compare::angles_between;
use crate::joint::check_posture;
use crate::{Synergy, SynergyError};

/// A direction that keeps less than this share of its length beside the directions before it adds nothing to them.
const INDEPENDENT: f64 = 1e-9;

/// Two spaces, compared on the joints whose name and unit both have. The directions of each space are cut to these joints
/// and made orthonormal in their order; a direction that then depends on those before it is left out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Names of the joints that both spaces have, in the order of the first space.
    pub joints: Vec<String>,
    /// Names of the joints that only the first or only the second space has.
    pub alone: [Vec<String>; 2],
    /// Principal angles between the spaces in rad, rising, one for each direction of the smaller space.
    pub angles: Vec<f64>,
    /// Absolute cosine between component `i` of the first space and component `j` of the second, each cut to the joints,
    /// 0 to 1: `cosines[i][j]`. A component that does not move these joints has 0.
    pub cosines: Vec<Vec<f64>>,
    /// How well the spaces describe the samples of the first and of the second; none where the samples are not known.
    pub explained: [Option<Explained>; 2],
}

/// Share of the samples' variance about their mean that lies in the first direction of a space, in the first two, and so on,
/// 0 to 1.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Explained {
    /// In the samples' own space.
    pub own: Vec<f64>,
    /// In the other space.
    pub other: Vec<f64>,
}

/// A space and the samples to which it was fitted, if they are known.
#[derive(Debug, Clone, Copy)]
pub struct Compared<'a> {
    /// The space.
    pub synergy: &'a Synergy,
    /// Samples with one number for each joint, N x n.
    pub samples: Option<&'a [Vec<f64>]>,
}

impl Comparison {
    /// Compares two spaces.
    ///
    /// # Errors
    /// [`SynergyError::NothingInCommon`] if no joint has the same name and unit in both, or if no direction of a space moves
    /// these joints; a sample of the wrong length or with a number that is not finite; a decomposition that does not converge.
    ///
    /// # Source
    /// Principal angles: Bjorck and Golub (1973), see [`principal_angles`](crate::principal_angles).
    pub fn of(a: Compared<'_>, b: Compared<'_>) -> Result<Comparison, SynergyError> {
        let find = |joint: &crate::JointInfo| {
            b.synergy.joints().iter().position(|other| other.name == joint.name && other.unit == joint.unit)
        };
        let pairs: Vec<(usize, usize)> =
            a.synergy.joints().iter().enumerate().filter_map(|(i, joint)| Some((i, find(joint)?))).collect();
        let columns: [Vec<usize>; 2] = [pairs.iter().map(|p| p.0).collect(), pairs.iter().map(|p| p.1).collect()];
        let names = |side: usize, synergy: &Synergy, common: bool| -> Vec<String> {
            let of_side = |i: &usize| columns[side].contains(i) == common;
            (0..synergy.n_joints()).filter(of_side).map(|i| synergy.joints()[i].name.clone()).collect()
        };
        let [first, second] = [cut(a.synergy, &columns[0]), cut(b.synergy, &columns[1])];
        let bases = [orthonormal(&first), orthonormal(&second)];
        if bases.iter().any(|basis| basis.iter().all(Option::is_none)) {
            return Err(SynergyError::NothingInCommon {
                first: names(0, a.synergy, false),
                second: names(1, b.synergy, false),
            });
        }
        let flat = |basis: &[Option<Vec<f64>>]| basis.iter().flatten().flatten().copied().collect::<Vec<f64>>();
        let n = pairs.len();
        let [rows_a, rows_b] = [flat(&bases[0]), flat(&bases[1])];
        let [matrix_a, matrix_b] =
            [&rows_a, &rows_b].map(|rows| MatRef::from_row_major_slice(rows.as_slice(), rows.len() / n, n));
        let (large, small) =
            if matrix_a.nrows() < matrix_b.nrows() { (matrix_b, matrix_a) } else { (matrix_a, matrix_b) };
        let explained = |of: Compared<'_>, side: usize| -> Result<Option<Explained>, SynergyError> {
            let Some(samples) = of.samples else { return Ok(None) };
            for (row, sample) in samples.iter().enumerate() {
                check_posture(sample, of.synergy.n_joints(), row)?;
            }
            let centred = centred(samples, &columns[side]);
            let shares = |basis: &[Option<Vec<f64>>]| shares(&centred, basis);
            Ok(Some(Explained { own: shares(&bases[side]), other: shares(&bases[1 - side]) }))
        };
        Ok(Comparison {
            joints: names(0, a.synergy, true),
            alone: [names(0, a.synergy, false), names(1, b.synergy, false)],
            angles: angles_between(large, small)?,
            cosines: first.iter().map(|x| second.iter().map(|y| cosine(x, y)).collect()).collect(),
            explained: [explained(a, 0)?, explained(b, 1)?],
        })
    }
}

/// (space, columns) => each component in these columns
fn cut(synergy: &Synergy, columns: &[usize]) -> Vec<Vec<f64>> {
    let rows = (0..synergy.n_components()).map(|i| synergy.component(i));
    rows.map(|row| columns.iter().map(|&j| row[j]).collect()).collect()
}

/// Gram-Schmidt, twice for accuracy; none for a direction that depends on those before it.
fn orthonormal(rows: &[Vec<f64>]) -> Vec<Option<Vec<f64>>> {
    let mut basis: Vec<Option<Vec<f64>>> = Vec::with_capacity(rows.len());
    for row in rows {
        let mut rest = row.clone();
        for _ in 0..2 {
            for known in basis.iter().flatten() {
                let along = dot(&rest, known);
                rest.iter_mut().zip(known).for_each(|(x, k)| *x -= along * k);
            }
        }
        let length = dot(&rest, &rest).sqrt();
        basis.push((length > INDEPENDENT).then(|| rest.iter().map(|x| x / length).collect()));
    }
    basis
}

/// (samples: N x n, columns) => the samples in these columns, minus their mean
fn centred(samples: &[Vec<f64>], columns: &[usize]) -> Mat<f64> {
    let n = samples.len().max(1) as f64;
    let mean: Vec<f64> = columns.iter().map(|&j| samples.iter().map(|sample| sample[j]).sum::<f64>() / n).collect();
    Mat::from_fn(samples.len(), columns.len(), |row, j| samples[row][columns[j]] - mean[j])
}

/// (centred samples, directions) => share of their sum of squares along the first direction, the first two, and so on
fn shares(centred: &Mat<f64>, basis: &[Option<Vec<f64>>]) -> Vec<f64> {
    let total: f64 = centred.col_iter().map(|column| column.iter().map(|x| x * x).sum::<f64>()).sum();
    let mut inside = 0.0;
    let along = |direction: &Option<Vec<f64>>| {
        let Some(direction) = direction else { return 0.0 };
        let projected = |row: usize| direction.iter().enumerate().map(|(j, d)| d * centred[(row, j)]).sum::<f64>();
        (0..centred.nrows()).map(|row| projected(row).powi(2)).sum()
    };
    let share = |direction| {
        inside += along(direction);
        if total > 0.0 { inside / total } else { 0.0 }
    };
    basis.iter().map(share).collect()
}

fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let lengths = (dot(a, a) * dot(b, b)).sqrt();
    if lengths > 0.0 { (dot(a, b) / lengths).abs().min(1.0) } else { 0.0 }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{JointInfo, Unit};

    fn space(names: &[&str], samples: &[Vec<f64>], k: usize) -> Synergy {
        let joint = |name: &&str| JointInfo { name: (*name).to_owned(), unit: Unit::Radian, lower: -9.0, upper: 9.0 };
        Synergy::fit(&names.iter().map(joint).collect::<Vec<_>>(), samples, k).expect("a space")
    }

    #[test]
    fn spaces_are_compared_on_the_joints_that_both_have() {
        // The first space moves a and b together, the second b alone; c and d are in one space only.
        let one = vec![vec![1.0, 1.0, 5.0], vec![-1.0, -1.0, 5.0], vec![2.0, 2.0, 5.0]];
        let two = vec![vec![3.0, 1.0, 0.0], vec![-3.0, 1.0, 0.0]];
        let (a, b) = (space(&["a", "b", "c"], &one, 1), space(&["b", "a", "d"], &two, 1));
        let found =
            Comparison::of(Compared { synergy: &a, samples: Some(&one) }, Compared { synergy: &b, samples: None })
                .expect("joints in common");
        assert_eq!((found.joints, found.alone), (vec!["a".into(), "b".into()], [vec!["c".into()], vec!["d".into()]]));
        let half = std::f64::consts::FRAC_PI_4;
        assert!((found.angles[0] - half).abs() < 1e-12 && found.angles.len() == 1, "{:?}", found.angles);
        assert!((found.cosines[0][0] - half.cos()).abs() < 1e-12, "{:?}", found.cosines);
        let explained = found.explained[0].clone().expect("samples");
        assert!((explained.own[0] - 1.0).abs() < 1e-12 && (explained.other[0] - 0.5).abs() < 1e-12, "{explained:?}");
        assert_eq!(found.explained[1], None);
    }

    #[test]
    fn spaces_without_a_joint_in_common_are_refused() {
        let samples = vec![vec![1.0], vec![2.0]];
        let (a, b) = (space(&["a"], &samples, 1), space(&["b"], &samples, 1));
        let compared = |synergy| Compared { synergy, samples: None };
        let error = Comparison::of(compared(&a), compared(&b)).expect_err("nothing in common").to_string();
        assert!(error.contains("a") && error.contains("same name"), "{error}");
    }
}
