//! What a set of grasp postures holds: how much they vary, and how much of that the objects and a few components
//! account for.

use faer::Mat;
use serde::{Deserialize, Serialize};

use crate::SynergyError;
use crate::joint::check_posture;
use crate::pca::{mean_and_covariance, principal_components};

/// Folds of the cross-validation. An object with fewer postures is not named, because a fold would lack it.
const FOLDS: usize = 10;

/// What a set of grasp postures holds.
///
/// Two sets with the same contribution rates can differ in content: if every grasp is almost the same posture, a few
/// components express all of them, but they do not adapt the hand to an object.
///
/// **Cross-validation.** The postures are sorted by object; those of one object keep their order. Posture `i` of this
/// list is in fold `i mod 10`, so each fold has its share of each object. Means and components are fitted to nine folds
/// and judged on the tenth, ten times. No random number is drawn.
///
/// ```
/// use eigenhand_synergy::Content;
///
/// // Two objects; the last number of a posture is a slide, which does not count.
/// let grasps: Vec<(&str, [f64; 3])> = (0..20)
///     .map(|i| if i % 2 == 0 { ("cube", [0.1, 0.2, 9.0]) } else { ("disc", [0.7, 0.2, 5.0]) })
///     .collect();
/// let content = Content::new(&grasps, &[0, 1], 1)?;
/// assert_eq!(content.naming_accuracy, Some(1.0));
/// assert!(content.between_objects.is_some_and(|share| share > 0.999));
/// # Ok::<(), eigenhand_synergy::SynergyError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Content {
    /// Number of postures, `N`.
    pub n_postures: usize,
    /// Number of objects among them, `G`.
    pub n_objects: usize,
    /// Number of joints that count, `n`.
    pub n_joints: usize,
    /// Number of components, `k`; at most `n`.
    pub n_components: usize,
    /// Sum of the joints' sample variances (divisor N - 1), in rad^2; 0 for fewer than two postures. A joint that
    /// slides counts in m^2.
    pub total_variance: f64,
    /// Share of the sum of squares about the mean that lies between the objects' means, 0 to 1 (eta squared). Without
    /// any effect of the object its expected value is (G - 1) / (N - 1), and not 0. None for fewer than two objects, or
    /// if the postures do not vary.
    pub between_objects: Option<f64>,
    /// The same share without that bias (epsilon squared): its expected value is 0 without any effect of the object,
    /// so it can be below 0. None also if no object has two postures.
    pub between_objects_adjusted: Option<f64>,
    /// Participation ratio of the covariance's eigenvalues, 1 to n: `m` if `m` directions vary alike and the others
    /// not at all. It is at most N - 1, so few postures give too low a value. None if the postures do not vary.
    pub participation_ratio: Option<f64>,
    /// Number of objects with at least 10 postures, which are those that are named.
    pub n_named_objects: usize,
    /// Accuracy of naming the object of a posture from its `k` coefficients, 0 to 1, cross-validated over the postures
    /// of the named objects. The name is that of the nearest class mean (Euclidean distance); if `m` classes are
    /// equally near, the right one among them counts 1 / m. It is the balanced accuracy: the mean over the objects of
    /// the share of postures that are named right, so it does not depend on how many postures each object has. None
    /// for fewer than two named objects, or if nine folds together have `k` postures or fewer.
    pub naming_accuracy: Option<f64>,
    /// Expected value of [`Content::naming_accuracy`] for any naming that does not look at the posture:
    /// 1 / `n_named_objects`. None where that is none.
    pub naming_chance: Option<f64>,
    /// Share of the held-out postures' sum of squares about the training mean that lies in the `k` components fitted to
    /// the training postures, 0 to 1. None for fewer than 10 postures, if nine folds together have `k` postures or
    /// fewer, or if the postures do not vary.
    pub held_out_contribution: Option<f64>,
}

impl Content {
    /// Computes the content of `postures`, each with the name of its object, in the joints whose indices are `joints`.
    ///
    /// `joints` should leave out the slide that stands for the arm. `k` is clamped to the number of joints.
    ///
    /// # Errors
    /// No joint, an index that occurs twice or is beyond the postures; postures of unequal lengths or with a number
    /// that is not finite, or so large that its square is not; `k == 0`; a decomposition that does not converge.
    ///
    /// # Source
    /// Share between objects: the squared correlation ratio of Pearson (1905), over all joints; without bias: Kelley,
    /// *An unbiased correlation ratio measure*, PNAS 21 (1935). Participation ratio: Gao et al., *A theory of
    /// multineuronal dimensionality, dynamics and measurement* (2017). Naming the object from a grasp's components:
    /// Santello et al., *Postural hand synergies for tool use*, J. Neurosci. 18 (1998).
    pub fn new<L: AsRef<str>, P: AsRef<[f64]>>(
        postures: &[(L, P)],
        joints: &[usize],
        k: usize,
    ) -> Result<Self, SynergyError> {
        check(postures, joints)?;
        if k == 0 {
            return Err(SynergyError::NoComponents);
        }
        let k = k.min(joints.len());
        let sorted = rows(postures, joints);
        let rows: Vec<&Row> = sorted.iter().collect();
        let (n_postures, n_objects) = (rows.len(), rows.last().map_or(0, |row| row.object + 1));
        let (total_variance, participation_ratio) = variance(&rows, joints.len())?;
        let varies = total_variance > 0.0;
        let between_objects = (varies && n_objects > 1).then(|| between_objects(&rows));
        let adjusted = |share: f64| {
            let (total, within) = (n_postures - 1, n_postures - n_objects);
            (within > 0).then(|| 1.0 - (1.0 - share) * total as f64 / within as f64)
        };
        let named: Vec<&Row> = groups(&rows).filter(|group| group.len() >= FOLDS).flatten().copied().collect();
        let n_named_objects = groups(&named).count();
        let naming_accuracy =
            if n_named_objects > 1 && is_enough(named.len(), k) { Some(naming_accuracy(&named, k)?) } else { None };
        let held_out_contribution =
            if varies && is_enough(n_postures, k) { held_out_contribution(&rows, k)? } else { None };
        Ok(Content {
            n_postures,
            n_objects,
            n_joints: joints.len(),
            n_components: k,
            total_variance,
            between_objects,
            between_objects_adjusted: between_objects.and_then(adjusted),
            participation_ratio,
            n_named_objects,
            naming_accuracy,
            naming_chance: naming_accuracy.map(|_| 1.0 / n_named_objects as f64),
            held_out_contribution,
        })
    }
}

/// A posture in the joints that count.
struct Row {
    object: usize,
    posture: Vec<f64>,
}

impl AsRef<[f64]> for Row {
    fn as_ref(&self) -> &[f64] {
        &self.posture
    }
}

fn check<L, P: AsRef<[f64]>>(postures: &[(L, P)], joints: &[usize]) -> Result<(), SynergyError> {
    let fail = |message: String| Err(SynergyError::Joints { message });
    if joints.is_empty() {
        return fail("at least one joint must count".to_owned());
    }
    if let Some(i) = (1..joints.len()).find(|&i| joints[..i].contains(&joints[i])) {
        return fail(format!("the index {} occurs twice", joints[i]));
    }
    let Some((_, first)) = postures.first() else { return Ok(()) };
    let length = first.as_ref().len();
    if let Some(joint) = joints.iter().find(|joint| **joint >= length) {
        return fail(format!("there is no joint {joint}: a posture has {length} numbers, counted from 0"));
    }
    postures.iter().enumerate().try_for_each(|(row, (_, posture))| check_posture(posture.as_ref(), length, row))
}

/// Returns the postures, sorted by object and minus the first of them. So postures that are all equal are exactly zero,
/// and rounding cannot pass for variance.
fn rows<L: AsRef<str>, P: AsRef<[f64]>>(postures: &[(L, P)], joints: &[usize]) -> Vec<Row> {
    let mut sorted: Vec<(&str, &[f64])> = postures.iter().map(|(name, q)| (name.as_ref(), q.as_ref())).collect();
    sorted.sort_by_key(|(name, _)| *name);
    let mut rows: Vec<Row> = Vec::with_capacity(sorted.len());
    for (i, (name, q)) in sorted.iter().enumerate() {
        let object = match i.checked_sub(1) {
            None => 0,
            Some(before) => rows[before].object + usize::from(sorted[before].0 != *name),
        };
        let posture = joints.iter().map(|&joint| q[joint] - sorted[0].1[joint]).collect();
        rows.push(Row { object, posture });
    }
    rows
}

/// (rows) => (sum of the sample variances, participation ratio of the covariance's eigenvalues)
fn variance(rows: &[&Row], n_joints: usize) -> Result<(f64, Option<f64>), SynergyError> {
    if rows.len() < 2 {
        return Ok((0.0, None));
    }
    let (_, covariance) = mean_and_covariance(rows, n_joints)?;
    let total: f64 = (0..n_joints).map(|i| covariance[(i, i)]).sum();
    if !total.is_finite() {
        return Err(SynergyError::Decomposition { what: "covariance" });
    }
    // The squares of a symmetric matrix's entries have the same sum as the squares of its eigenvalues.
    let squares = |covariance: &Mat<f64>| -> f64 {
        (0..n_joints).flat_map(|j| covariance.col_as_slice(j)).map(|entry| (entry / total).powi(2)).sum()
    };
    Ok((total, (total > 0.0).then(|| squares(&covariance).recip())))
}

/// (rows, sorted by object, which vary) => sum of squares between the objects' means / sum of squares
fn between_objects(rows: &[&Row]) -> f64 {
    let all = mean(rows);
    let (mut between, mut within) = (0.0, 0.0);
    for group in groups(rows) {
        let own = mean(group);
        between += group.len() as f64 * squared_distance(&own, &all);
        within += group.iter().map(|row| squared_distance(&row.posture, &own)).sum::<f64>();
    }
    between / (between + within)
}

/// Returns the rows of each object.
fn groups<'a, 'b>(rows: &'b [&'a Row]) -> impl Iterator<Item = &'b [&'a Row]> {
    rows.chunk_by(|a, b| a.object == b.object)
}

/// Tells whether every fold holds a posture, and the other folds more than `k`.
fn is_enough(n_postures: usize, k: usize) -> bool {
    n_postures >= FOLDS && n_postures - n_postures.div_ceil(FOLDS) > k
}

/// Splits rows into those of a fold and those for training.
fn split<'a>(rows: &[&'a Row], fold: usize) -> (Vec<&'a Row>, Vec<&'a Row>) {
    let of = |held: bool| {
        let chosen = rows.iter().enumerate().filter(move |(i, _)| (i % FOLDS == fold) == held);
        chosen.map(|(_, row)| *row).collect()
    };
    (of(true), of(false))
}

/// (rows of the named objects) => mean over the objects of the share of held-out postures that are named right
fn naming_accuracy(rows: &[&Row], k: usize) -> Result<f64, SynergyError> {
    let mut right = vec![0.0; rows.last().map_or(0, |row| row.object + 1)];
    for fold in 0..FOLDS {
        let (held, training) = split(rows, fold);
        let space = Space::fit(&training, k)?;
        let means: Vec<(usize, Vec<f64>)> = groups(&training).map(|g| (g[0].object, space.encode(&mean(g)))).collect();
        for row in held {
            let z = space.encode(&row.posture);
            let distances: Vec<f64> = means.iter().map(|(_, mean)| squared_distance(mean, &z)).collect();
            let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
            let nearest = means.iter().zip(&distances).filter(|(_, distance)| **distance == least);
            let names: Vec<usize> = nearest.map(|((object, _), _)| *object).collect();
            if names.contains(&row.object) {
                right[row.object] += 1.0 / names.len() as f64;
            }
        }
    }
    let shares: Vec<f64> = groups(rows).map(|group| right[group[0].object] / group.len() as f64).collect();
    Ok(shares.iter().sum::<f64>() / shares.len() as f64)
}

/// (rows) => share of the held-out postures' sum of squares that lies in the components; none if it is zero
fn held_out_contribution(rows: &[&Row], k: usize) -> Result<Option<f64>, SynergyError> {
    let (mut inside, mut total) = (0.0, 0.0);
    for fold in 0..FOLDS {
        let (held, training) = split(rows, fold);
        let space = Space::fit(&training, k)?;
        for row in held {
            inside += space.encode(&row.posture).iter().map(|z| z * z).sum::<f64>();
            total += squared_distance(&row.posture, &space.mean);
        }
    }
    Ok((total > 0.0).then(|| (inside / total).min(1.0)))
}

/// Mean and components of the training postures.
struct Space {
    mean: Vec<f64>,
    /// k x n, row-major.
    components: Vec<f64>,
}

impl Space {
    fn fit(rows: &[&Row], k: usize) -> Result<Self, SynergyError> {
        let n_joints = rows.first().map_or(0, |row| row.posture.len());
        let (mean, covariance) = mean_and_covariance(rows, n_joints)?;
        let (components, _) = principal_components(&covariance, k)?;
        Ok(Space { mean, components })
    }

    fn encode(&self, posture: &[f64]) -> Vec<f64> {
        let along = |c: &[f64]| c.iter().zip(posture).zip(&self.mean).map(|((c, q), mean)| c * (q - mean)).sum();
        self.components.chunks_exact(self.mean.len()).map(along).collect()
    }
}

fn mean(rows: &[&Row]) -> Vec<f64> {
    let mut mean = vec![0.0; rows.first().map_or(0, |row| row.posture.len())];
    for row in rows {
        mean.iter_mut().zip(&row.posture).for_each(|(sum, q)| *sum += q / rows.len() as f64);
    }
    mean
}

fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}
