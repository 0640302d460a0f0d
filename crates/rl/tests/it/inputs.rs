//! The normaliser against the textbook formulas.

use eigenhand_rl::{NormalizerConfig, RunningNormalizer, rng};
use rand::RngExt;

use crate::{NORMALIZER, assert_close};

const DIM: usize = 3;

/// Rows whose dimensions differ in centre and spread; the last one is constant.
fn rows(n: usize) -> Vec<f32> {
    let mut draws = rng::stream(7, "rows", 0);
    (0..n).flat_map(|_| [draws.random_range(90.0..110.0), draws.random_range(-0.5..0.5), 4.0]).collect()
}

#[test]
fn mean_and_deviation_over_several_updates() {
    let rows = rows(1000);
    let mut normalizer = RunningNormalizer::new(NORMALIZER, DIM);
    for part in rows.chunks(DIM * 77) {
        normalizer.update(part);
    }
    assert_eq!(normalizer.count(), 1000);
    for d in 0..DIM {
        let column: Vec<f64> = rows.chunks(DIM).map(|row| f64::from(row[d])).collect();
        let mean = column.iter().sum::<f64>() / 1000.0;
        let std = (column.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / 1000.0).sqrt();
        assert_close("mean", f64::from(normalizer.mean()[d]), mean, 1e-6);
        assert_close("std", f64::from(normalizer.std()[d]), std.max(0.01), 1e-6);
        let (row, mut out) = (&rows[..DIM], [0.0; DIM]);
        normalizer.normalize(row, &mut out);
        assert_close("normalised", f64::from(out[d]), (f64::from(row[d]) - mean) / std.max(0.01), 1e-4);
    }
}

#[test]
fn values_are_clipped_before_and_after() {
    let config = NormalizerConfig { epsilon: 0.5, norm_clip: 2.0, raw_clip: 10.0 };
    let mut normalizer = RunningNormalizer::new(config, 2);
    normalizer.update(&[1e9, 1.0, -1e9, 1.0]);
    assert_eq!(normalizer.mean(), [0.0, 1.0]);
    assert_eq!(normalizer.std(), [10.0, 0.5]);
    let mut out = [0.0; 2];
    normalizer.normalize(&[1e9, 1.5], &mut out);
    assert_eq!(out, [1.0, 1.0]);
    normalizer.normalize(&[-5.0, 9.0], &mut out);
    assert_eq!(out, [-0.5, 2.0]);
}

#[test]
fn without_data_only_the_clips_act() {
    let normalizer = RunningNormalizer::new(NORMALIZER, 2);
    let mut out = [0.0; 2];
    normalizer.normalize(&[0.25, -1000.0], &mut out);
    assert_eq!(out, [0.25, -5.0]);
}

#[test]
fn constants_must_be_positive() {
    let error = NormalizerConfig { norm_clip: 0.0, ..NORMALIZER }.validate().unwrap_err();
    assert!(error.to_string().contains("norm_clip"), "{error}");
}
