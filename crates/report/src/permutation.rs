//! The permutation test of a difference between two groups of values.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use crate::stats::SEED;

/// With at most this number of relabellings, all are counted; else this number of them is drawn.
pub const MOST_RELABELLINGS: u64 = 200_000;
/// Stream of the random numbers, beside those of the bootstrap's groups.
const STREAM: u64 = u64::MAX;
/// Statistics that differ by less than this share of the values' size are equal but for rounding.
const ROUNDING: f64 = 1e-12;

/// The two-sided permutation test of the difference of two means.
///
/// If the groups do not differ, every way to divide the values into groups of these sizes is as likely as the one that
/// was seen. `p` is the share of the divisions whose means differ by as much as those of the groups, or more.
///
/// # Source
/// Fisher, *The design of experiments*, 1935, section 21; Pitman 1937.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Permutation {
    /// Mean of the second group minus that of the first.
    pub difference_of_means: f64,
    /// Share of the relabellings with a difference of means at least as large, in absolute value. Of a sample of `m`
    /// relabellings of which `b` are as large, it is (b + 1) / (m + 1) (Phipson and Smyth 2010).
    pub p: f64,
    /// Least `p` that groups of these sizes can have: 1 / C(n + m, n), and twice as much for groups of equal size.
    pub least_p: f64,
    /// Number of relabellings that were counted.
    pub n_relabellings: u64,
    /// Whether these are all relabellings, and not a sample.
    pub exact: bool,
}

impl Permutation {
    /// Tests two groups; `None` when one has no values.
    pub fn new(first: &[f64], second: &[f64]) -> Option<Permutation> {
        if first.is_empty() || second.is_empty() {
            return None;
        }
        let values: Vec<f64> = first.iter().chain(second).copied().collect();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let centre = mean(&values);
        let centred: Vec<f64> = values.iter().map(|value| value - centre).collect();
        // With a common mean of zero, the difference of the means is proportional to the sum of either group.
        let size: f64 = centred.iter().map(|value| value.abs()).sum();
        let least = centred[..first.len()].iter().sum::<f64>().abs() - ROUNDING * size;
        let chosen = first.len().min(second.len());
        let all = binomial(values.len(), chosen);
        let exact = all <= MOST_RELABELLINGS as f64;
        let p = if exact { share_of_all(&centred, chosen, least) } else { share_of_sample(&centred, chosen, least) };
        Some(Permutation {
            difference_of_means: mean(second) - mean(first),
            p,
            least_p: if first.len() == second.len() { 2.0 / all } else { 1.0 / all },
            n_relabellings: if exact { all as u64 } else { MOST_RELABELLINGS },
            exact,
        })
    }
}

/// (n, k) => number of subsets of k of n things; exact up to 2^53
fn binomial(n: usize, k: usize) -> f64 {
    (1..=k).fold(1.0, |product, i| product * (n - k + i) as f64 / i as f64)
}

/// (centred values, k, least absolute sum) => share of all subsets of k values that reach it
fn share_of_all(centred: &[f64], k: usize, least: f64) -> f64 {
    let n = centred.len();
    let mut subset: Vec<usize> = (0..k).collect();
    let (mut reached, mut all) = (0_u64, 0_u64);
    loop {
        all += 1;
        reached += u64::from(reaches(subset.iter().map(|&i| centred[i]), least));
        // The next subset in lexicographic order.
        let Some(place) = (0..k).rev().find(|&place| subset[place] < n - k + place) else { break };
        let next = subset[place] + 1;
        subset[place..].iter_mut().enumerate().for_each(|(i, index)| *index = next + i);
    }
    reached as f64 / all as f64
}

/// (centred values, k, least absolute sum) => estimate of the share of all subsets of k values that reach it
fn share_of_sample(centred: &[f64], k: usize, least: f64) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    rng.set_stream(STREAM);
    let mut values = centred.to_vec();
    let mut reached = 0_u64;
    for _ in 0..MOST_RELABELLINGS {
        for i in 0..k {
            values.swap(i, rng.random_range(i..centred.len()));
        }
        reached += u64::from(reaches(values[..k].iter().copied(), least));
    }
    (reached + 1) as f64 / (MOST_RELABELLINGS + 1) as f64
}

/// Tells whether a sum reaches `least`. One that is not a number does, so that it speaks for no difference.
fn reaches(values: impl Iterator<Item = f64>, least: f64) -> bool {
    let sum = values.sum::<f64>().abs();
    sum.is_nan() || least.is_nan() || sum >= least
}

#[cfg(test)]
mod tests {
    use super::*;

    fn test(first: &[f64], second: &[f64]) -> Permutation {
        Permutation::new(first, second).expect("values")
    }

    #[test]
    fn p_is_scipys() {
        // scipy.stats.permutation_test of |mean(y) - mean(x)| with alternative="greater", over all relabellings.
        const FIVE: [f64; 5] = [0.9, 0.815, 0.68, 0.95, 0.77];
        const EIGHT: [f64; 8] = [0.59, 0.825, 0.7, 0.66, 0.74, 0.61, 0.88, 0.79];
        for (first, second, reached, all) in [
            (EIGHT.as_slice(), FIVE.as_slice(), 164.0, 1287),
            (&FIVE, &EIGHT, 164.0, 1287),
            (&[0.5, 0.52, 0.54], &[0.9, 0.91, 0.95], 2.0, 20),
            (&[0.5, 0.52, 0.54, 0.5], &[0.9, 0.91, 0.95], 1.0, 35),
            (&[0.1, 0.2, 0.3, 0.4, 0.5], &[0.35, 0.45, 0.55, 0.65, 0.75], 14.0, 252),
            // Ties count, though sums of the same values in another order are rounded differently.
            (&[0.5, 0.5, 0.5], &[0.5, 0.5, 0.6], 20.0, 20),
            (&[0.1; 4], &[0.1; 4], 70.0, 70),
        ] {
            let found = test(first, second);
            assert_eq!((found.p, found.n_relabellings, found.exact), (reached / all as f64, all, true));
        }
        assert!((test(&EIGHT, &FIVE).difference_of_means - 0.098_625).abs() < 1e-12);
    }

    #[test]
    fn the_least_p_is_that_of_groups_that_do_not_overlap() {
        for (n, m, least) in [(3, 3, 0.1), (3, 4, 1.0 / 35.0), (4, 4, 2.0 / 70.0), (1, 4, 0.2), (5, 5, 2.0 / 252.0)] {
            let apart: Vec<f64> =
                (0..n + m).map(|i| if i < n { 0.1 * i as f64 } else { 9.0 + 0.1 * i as f64 }).collect();
            let found = test(&apart[..n], &apart[n..]);
            assert!((found.least_p - least).abs() < 1e-15 && (found.p - least).abs() < 1e-15, "{found:?}");
        }
        assert_eq!(Permutation::new(&[], &[1.0]), None);
    }

    #[test]
    fn too_many_relabellings_are_sampled() {
        let group = |n: usize, shift: f64| -> Vec<f64> { (0..n).map(|i| (i as f64 * 2.4).sin() + shift).collect() };
        // C(20, 10) = 184,756 relabellings are counted, C(22, 11) = 705,432 are not.
        assert!(test(&group(10, 0.0), &group(10, 0.4)).exact);
        let sampled = test(&group(11, 0.0), &group(11, 0.4));
        assert_eq!((sampled.exact, sampled.n_relabellings), (false, MOST_RELABELLINGS));
        assert_eq!(sampled, test(&group(11, 0.0), &group(11, 0.4)), "the sample is always the same");
        let centred: Vec<f64> = {
            let values = [group(11, 0.0), group(11, 0.4)].concat();
            values.iter().map(|value| value - values.iter().sum::<f64>() / 22.0).collect()
        };
        let least = centred[..11].iter().sum::<f64>().abs() - 1e-9;
        let exact = share_of_all(&centred, 11, least);
        // Four standard deviations of a share of 200,000 draws.
        let tolerance = 4.0 * (exact * (1.0 - exact) / MOST_RELABELLINGS as f64).sqrt();
        assert!((sampled.p - exact).abs() < tolerance, "{} {exact}", sampled.p);
        // However clear the difference, a sample never gives 0.
        let clear = test(&group(11, 0.0), &group(11, 99.0));
        assert!(clear.p > 0.0 && clear.p < 1e-4 && clear.least_p < 1e-5, "{clear:?}");
    }

    #[test]
    fn values_that_are_no_numbers_show_no_difference() {
        assert_eq!(test(&[0.1, f64::NAN, 0.2], &[5.0, 6.0, 7.0]).p, 1.0);
    }
}
