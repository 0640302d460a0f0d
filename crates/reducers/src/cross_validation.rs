//! How well reducers reconstruct samples that they have not seen.

use std::collections::BTreeMap;

use eigenhand_synergy::SynergyError;
use serde::Serialize;

use crate::Reducer;

/// A sample, and the group of which it is part: samples of a group, such as the steps of one grasp, resemble each other, so
/// they are held out together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<'a> {
    /// Its coordinates.
    pub values: &'a [f64],
    /// Its group.
    pub group: u64,
}

/// How well a reducer reconstructs held-out samples.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reconstruction {
    /// Name of the reducer.
    pub reducer: &'static str,
    /// Numbers of its space.
    pub k: usize,
    /// Root of the mean squared error of a coordinate, in the unit of the coordinates.
    pub error: f64,
    /// Share of the samples' sum of squares about the mean of the others that the reconstruction has, at most 1; none if they
    /// do not vary.
    pub share: Option<f64>,
    /// Mean of the natural logarithm of the held-out samples' density; none for a reducer without a density.
    pub log_density: Option<f64>,
}

/// Holds out one fold after another, fits each reducer with each of `numbers` to the others, and measures it on the fold.
/// Group `i`, in the order of their numbers, is in fold `i mod folds`. `progress` is called after each fit, with the number
/// of fits so far and in all.
///
/// # Errors
/// [`SynergyError::TooFewPostures`] for fewer groups than folds, and those of [`Reducer::fit`].
pub fn cross_validate(
    reducers: &[Box<dyn Reducer>],
    samples: &[Sample<'_>],
    numbers: &[usize],
    folds: usize,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Vec<Reconstruction>, SynergyError> {
    let groups: BTreeMap<u64, usize> = samples.iter().map(|sample| (sample.group, 0)).collect();
    let fold_of: BTreeMap<u64, usize> =
        groups.keys().enumerate().map(|(i, group)| (*group, i % folds.max(1))).collect();
    if folds < 2 || fold_of.len() < folds {
        return Err(SynergyError::TooFewPostures { expected: folds.max(2), got: fold_of.len() });
    }
    let fits = reducers.len() * numbers.len() * folds;
    let mut done = 0;
    let mut found = Vec::new();
    for &k in numbers {
        for reducer in reducers {
            let mut sums = Sums::default();
            for fold in 0..folds {
                let (held, fitted): (Vec<&Sample<'_>>, _) =
                    samples.iter().partition(|sample| fold_of[&sample.group] == fold);
                sums.add(reducer.as_ref(), &values(&fitted), &values(&held), k)?;
                done += 1;
                progress(done, fits);
            }
            found.push(sums.result(reducer.name(), k));
        }
    }
    Ok(found)
}

/// Sums over held-out samples.
#[derive(Default)]
struct Sums {
    samples: u64,
    coordinates: u64,
    squared_error: f64,
    /// Squared distances to the mean of the samples to which the space was fitted.
    squared: f64,
    log_density: Option<f64>,
    without_density: bool,
}

impl Sums {
    fn add(&mut self, reducer: &dyn Reducer, fitted: &[&[f64]], held: &[&[f64]], k: usize) -> Result<(), SynergyError> {
        let space = reducer.fit(fitted, k)?;
        let mut mean = vec![0.0; fitted.first().map_or(0, |sample| sample.len())];
        for sample in fitted {
            mean.iter_mut().zip(*sample).for_each(|(mean, x)| *mean += x / fitted.len() as f64);
        }
        for sample in held {
            self.samples += 1;
            self.coordinates += sample.len() as u64;
            self.squared_error += squared_distance(sample, &space.decode(&space.encode(sample)));
            self.squared += squared_distance(sample, &mean);
            match space.log_density(sample) {
                Some(density) => *self.log_density.get_or_insert(0.0) += density,
                None => self.without_density = true,
            }
        }
        Ok(())
    }

    fn result(&self, reducer: &'static str, k: usize) -> Reconstruction {
        Reconstruction {
            reducer,
            k,
            error: (self.squared_error / self.coordinates.max(1) as f64).sqrt(),
            share: (self.squared > 0.0).then(|| 1.0 - self.squared_error / self.squared),
            log_density: self.log_density.filter(|_| !self.without_density).map(|sum| sum / self.samples.max(1) as f64),
        }
    }
}

fn values<'a>(samples: &[&Sample<'a>]) -> Vec<&'a [f64]> {
    samples.iter().map(|sample| sample.values).collect()
}

fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pca, Ppca};

    #[test]
    fn groups_are_held_out_as_a_whole() -> Result<(), SynergyError> {
        // Each group varies along a coordinate of its own, which the other groups do not have.
        let rows: Vec<(u64, [f64; 2])> =
            (0..20).map(|i| (i / 10, if i < 10 { [i as f64, 0.0] } else { [0.0, i as f64] })).collect();
        let samples: Vec<Sample<'_>> = rows.iter().map(|(group, row)| Sample { values: row, group: *group }).collect();
        let mut calls = Vec::new();
        let reducers: [Box<dyn Reducer>; 2] = [Box::new(Pca), Box::new(Ppca)];
        let found = cross_validate(&reducers, &samples, &[1, 2], 2, &mut |done, all| calls.push((done, all)))?;
        assert_eq!(calls.last(), Some(&(8, 8)));
        assert!(found[0].share.is_some_and(|share| share < 0.5), "{:?}", found[0]);
        let whole =
            |result: &Reconstruction| result.error < 1e-9 && result.share.is_some_and(|share| share > 1.0 - 1e-9);
        // Nothing varied along the held-out coordinate, so PPCA expects nothing there, with any number of components.
        assert_eq!((found[2].reducer, whole(&found[2])), ("pca", true), "{found:?}");
        assert_eq!((found[3].reducer, whole(&found[3])), ("ppca", false), "{found:?}");
        Ok(())
    }

    #[test]
    fn fewer_groups_than_folds_are_refused() {
        let row = [0.0, 1.0];
        let samples = [Sample { values: &row, group: 0 }, Sample { values: &row, group: 0 }];
        let reducers: [Box<dyn Reducer>; 1] = [Box::new(Pca)];
        assert!(cross_validate(&reducers, &samples, &[1], 2, &mut |_, _| ()).is_err());
    }
}
