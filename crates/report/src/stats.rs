//! Statistics over few runs.

use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use crate::permutation::Permutation;

/// Resamples of a bootstrap.
pub const RESAMPLES: usize = 20_000;
/// Seed of all random numbers of a report, so that the same runs always give the same report.
pub const SEED: u64 = 2021;
/// Share of the resamples that lie outside an interval.
const OUTSIDE: f64 = 0.05;
/// Least number of values for an interval.
pub const FEWEST: usize = 3;
/// A permutation test speaks for a difference if its p is below this.
pub const SIGNIFICANT: f64 = 0.05;

/// Summary of the values of some runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Number of values.
    pub n: usize,
    /// Their interquartile mean.
    pub iqm: f64,
    /// Its 95 % bootstrap interval, if there are enough values.
    pub interval: Option<[f64; 2]>,
    /// Median of the values.
    pub median: f64,
    /// Least value.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
}

/// The difference between two groups of values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Contrast {
    /// Interquartile mean of the second group minus that of the first.
    pub difference: f64,
    /// Its 95 % bootstrap interval, if both groups have enough values.
    pub interval: Option<[f64; 2]>,
    /// The permutation test of the difference of means.
    pub permutation: Permutation,
}

/// What a difference between two groups of values supports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// There is no interval.
    NoInterval,
    /// The groups are so small that no permutation test could support a difference.
    TooFewForTest,
    /// Interval and test both support that the second group is greater.
    Greater,
    /// Interval and test both support that the second group is smaller.
    Smaller,
    /// One of interval and test supports a difference and the other does not, or they point to different sides.
    Disagree,
    /// Neither supports a difference.
    Open,
}

impl Contrast {
    /// Tells whether the interval excludes zero; `None` without an interval.
    pub fn excludes_zero(&self) -> Option<bool> {
        self.interval.map(|[low, high]| low > 0.0 || high < 0.0)
    }

    /// Tells whether the permutation test speaks for a difference.
    pub fn is_significant(&self) -> bool {
        self.permutation.p < SIGNIFICANT
    }

    /// Returns what the difference supports: something only where the interval excludes zero, `p` is below
    /// 0.05, and both point to the same side.
    pub fn verdict(&self) -> Verdict {
        let Some([low, high]) = self.interval else { return Verdict::NoInterval };
        let (above, below) = (low > 0.0, high < 0.0);
        let side = self.permutation.difference_of_means;
        match self.is_significant() {
            _ if self.permutation.least_p >= SIGNIFICANT => Verdict::TooFewForTest,
            true if above && side > 0.0 => Verdict::Greater,
            true if below && side < 0.0 => Verdict::Smaller,
            false if !above && !below => Verdict::Open,
            _ => Verdict::Disagree,
        }
    }
}

/// (values, q) => quantile, linear between the two nearest values
///
/// # Source
/// Hyndman and Fan 1996, type 7; the default of NumPy and R.
pub fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let position = q.clamp(0.0, 1.0) * last as f64;
    let (below, above) = (position.floor() as usize, position.ceil() as usize);
    let (low, high) = (*sorted.get(below)?, *sorted.get(above)?);
    Some(low + (position - below as f64) * (high - low))
}

/// (values) => median
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(&sorted(values), 0.5)
}

/// (values) => mean of the middle half
///
/// Of `n` values, the lowest and the highest `n / 4`, rounded down, are left out; of fewer than 4 values, none.
///
/// # Source
/// Agarwal et al. 2021, *Deep reinforcement learning at the edge of the statistical precipice*; `scipy.stats.trim_mean`
/// with 0.25, as their package has it.
pub fn interquartile_mean(values: &[f64]) -> Option<f64> {
    let sorted = sorted(values);
    let cut = sorted.len() / 4;
    let middle = &sorted[cut..sorted.len() - cut];
    (!middle.is_empty()).then(|| middle.iter().sum::<f64>() / middle.len() as f64)
}

/// Interquartile means of resampled groups.
pub struct Bootstrap {
    groups: Vec<Vec<f64>>,
    /// For each group, the interquartile mean of each resample.
    resampled: Vec<Vec<f64>>,
}

impl Bootstrap {
    /// Resamples each group separately (the groups are the strata), with replacement and to its own size.
    pub fn new(groups: Vec<Vec<f64>>) -> Bootstrap {
        let resampled = groups
            .iter()
            .enumerate()
            .map(|(stratum, values)| {
                let mut rng = ChaCha8Rng::seed_from_u64(SEED);
                rng.set_stream(stratum as u64);
                let mut resample = vec![0.0; values.len()];
                (0..if values.len() < FEWEST { 0 } else { RESAMPLES })
                    .filter_map(|_| {
                        resample.iter_mut().for_each(|slot| *slot = values[rng.random_range(0..values.len())]);
                        interquartile_mean(&resample)
                    })
                    .collect()
            })
            .collect();
        Bootstrap { groups, resampled }
    }

    /// Summarises a group; `None` for a group without values.
    pub fn estimate(&self, group: usize) -> Option<Estimate> {
        let values = sorted(self.groups.get(group)?);
        Some(Estimate {
            n: values.len(),
            iqm: interquartile_mean(&values)?,
            interval: interval(self.resampled.get(group)?.clone()),
            median: quantile(&values, 0.5)?,
            min: *values.first()?,
            max: *values.last()?,
        })
    }

    /// Returns the difference of the second group minus the first; `None` when one has no values.
    pub fn contrast(&self, first: usize, second: usize) -> Option<Contrast> {
        let mean = |group: usize| interquartile_mean(self.groups.get(group)?);
        let (a, b) = (self.resampled.get(first)?, self.resampled.get(second)?);
        let differences = a.iter().zip(b).map(|(a, b)| b - a).collect();
        Some(Contrast {
            difference: mean(second)? - mean(first)?,
            interval: interval(differences),
            permutation: Permutation::new(self.groups.get(first)?, self.groups.get(second)?)?,
        })
    }
}

/// Returns the middle 95 % of resampled statistics.
fn interval(mut resampled: Vec<f64>) -> Option<[f64; 2]> {
    resampled.sort_by(f64::total_cmp);
    Some([quantile(&resampled, OUTSIDE / 2.0)?, quantile(&resampled, 1.0 - OUTSIDE / 2.0)?])
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;

    // Success rates of five and of eight runs. The expected numbers come from NumPy and SciPy, the expected intervals
    // from all possible resamples, or from 200,000 of them.
    const FIVE: [f64; 5] = [0.9, 0.815, 0.68, 0.95, 0.77];
    const EIGHT: [f64; 8] = [0.59, 0.825, 0.7, 0.66, 0.74, 0.61, 0.88, 0.79];

    fn close(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance
    }

    #[test]
    fn quantiles_are_numpys() {
        for (values, expected) in [(FIVE.as_slice(), [0.689, 0.77, 0.93]), (&EIGHT, [0.5935, 0.6475, 0.8415])] {
            for (q, expected) in [0.025, 0.25, 0.9].into_iter().zip(expected) {
                let found = quantile(&sorted(values), q).expect("values");
                assert!(close(found, expected, 1e-12), "{q}: {found} is not {expected}");
            }
        }
        assert_eq!((median(&FIVE), median(&EIGHT)), (Some(0.815), Some(0.72)));
        assert_eq!((quantile(&[], 0.5), median(&[3.0])), (None, Some(3.0)));
    }

    #[test]
    fn the_interquartile_mean_is_scipys_trimmed_mean() {
        for (values, expected) in [
            (FIVE.as_slice(), 0.828_333_333_333_333_3),
            (&EIGHT, 0.7225),
            (&[0.1, 0.2, 0.6], 0.3),
            (&[0.0, 0.5, 0.7, 1.0], 0.6),
        ] {
            let found = interquartile_mean(values).expect("values");
            assert!(close(found, expected, 1e-12), "{found} is not {expected}");
        }
        assert_eq!(interquartile_mean(&[]), None);
    }

    #[test]
    fn intervals_are_those_of_all_resamples() {
        let bootstrap = Bootstrap::new(vec![EIGHT.to_vec(), FIVE.to_vec()]);
        let check = |found: Option<[f64; 2]>, expected: [f64; 2]| {
            let found = found.expect("enough values");
            let near = found.iter().zip(expected).all(|(a, b)| close(*a, b, 0.008));
            assert!(near, "{found:?} is not {expected:?}");
        };
        let five = bootstrap.estimate(1).expect("values");
        check(five.interval, [0.71, 0.9333]);
        check(bootstrap.estimate(0).expect("values").interval, [0.6325, 0.8088]);
        let contrast = bootstrap.contrast(0, 1).expect("values");
        assert!(close(contrast.difference, 0.105_833_333, 1e-6));
        check(contrast.interval, [-0.0375, 0.2408]);
        assert_eq!((contrast.excludes_zero(), contrast.verdict()), (Some(false), Verdict::Open));
        assert_eq!(contrast.permutation.p, 164.0 / 1287.0);
        assert_eq!((five.n, five.median, five.min, five.max), (5, 0.815, 0.68, 0.95));
    }

    #[test]
    fn intervals_are_the_same_every_time_and_the_groups_are_independent() {
        let both = |groups: [&[f64]; 2]| Bootstrap::new(groups.map(<[f64]>::to_vec).to_vec());
        let (a, b) = (both([&FIVE, &EIGHT]), both([&FIVE, &EIGHT]));
        assert_eq!((a.estimate(1), a.contrast(0, 1)), (b.estimate(1), b.contrast(0, 1)));
        let same = both([&FIVE, &FIVE]).contrast(0, 1).expect("values");
        let [low, high] = same.interval.expect("enough values");
        assert!(
            same.difference == 0.0 && low < -0.05 && high > 0.05,
            "the groups are resampled apart: {low} to {high}"
        );
    }

    #[test]
    fn a_clear_difference_excludes_zero_and_too_few_values_say_nothing() {
        let bootstrap = Bootstrap::new(vec![vec![0.5, 0.52, 0.54], vec![0.9, 0.91, 0.95], vec![0.2, 0.9], vec![]]);
        assert_eq!(bootstrap.contrast(0, 1).and_then(|c| c.excludes_zero()), Some(true));
        assert_eq!(bootstrap.contrast(1, 0).and_then(|c| c.excludes_zero()), Some(true));
        let few = bootstrap.contrast(0, 2).expect("values");
        assert_eq!((few.interval, few.excludes_zero(), few.verdict()), (None, None, Verdict::NoInterval));
        assert_eq!((bootstrap.contrast(0, 3), bootstrap.estimate(3)), (None, None));
        assert_eq!(bootstrap.estimate(2).and_then(|e| e.interval), None);
    }

    #[test]
    fn a_difference_is_supported_only_where_interval_and_test_agree() {
        let verdict = |a: &[f64], b: &[f64]| {
            let contrast = Bootstrap::new(vec![a.to_vec(), b.to_vec()]).contrast(0, 1).expect("values");
            (contrast.excludes_zero(), contrast.verdict())
        };
        let (low, high) = ([0.5, 0.52, 0.54, 0.5, 0.53], [0.9, 0.91, 0.95, 0.93, 0.92]);
        assert_eq!(verdict(&low, &high), (Some(true), Verdict::Greater));
        assert_eq!(verdict(&high, &low), (Some(true), Verdict::Smaller));
        assert_eq!(verdict(&low, &low), (Some(false), Verdict::Open));
        // Three against three: the interval is clear, but the least p is 0.1.
        assert_eq!(verdict(&low[..3], &high[..3]), (Some(true), Verdict::TooFewForTest));
        assert_eq!(verdict(&low[..3], &high[..4]), (Some(true), Verdict::Greater));
        // The final success of docs/results/runs.csv: p is 16 / 252.
        let measured = verdict(&[0.98, 0.935, 0.925, 0.95, 0.955], &[0.98, 0.97, 0.97, 0.965, 0.98]);
        assert_eq!(measured, (Some(true), Verdict::Disagree));
        // The other way round, and with opposite signs.
        let of = |interval: [f64; 2], difference_of_means: f64, p: f64| {
            let permutation = Permutation { difference_of_means, p, least_p: 0.008, n_relabellings: 252, exact: true };
            Contrast { difference: 0.1, interval: Some(interval), permutation }.verdict()
        };
        assert_eq!(of([-0.01, 0.2], 0.1, 0.03), Verdict::Disagree);
        assert_eq!(of([0.01, 0.2], -0.1, 0.03), Verdict::Disagree);
        assert_eq!([of([0.01, 0.2], 0.1, 0.05), of([0.01, 0.2], 0.1, 0.049)], [Verdict::Disagree, Verdict::Greater]);
    }
}
