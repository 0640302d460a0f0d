//! The matrix product on processors with AVX-512.
//!
//! Columns of the right factor are copied to where they stay in the first cache, and multiplied from there. Each value of
//! a product is one chain of fused multiplications and additions, over the rows of the right factor in their order. So a
//! product is the same to the last digit by [`dense`] and by [`sparse`], and by faer where those rows are not many.
//!
//! # Source
//! Goto and van de Geijn 2008, *Anatomy of High-Performance Matrix Multiplication*, for the order of the loops.

mod dense;
mod panel;
mod sparse;

use pulp::x86::V4;
use pulp::{cast, f32x16};

use crate::epilogue::Epilogue;
use crate::gemm::Matrix;

/// Values in a vector register.
const LANES: usize = 16;
/// The fewest columns of a product that is made here: those of a tile.
pub(crate) const LEAST_COLUMNS: usize = dense::WIDTH;
/// The share of zeros in the left factor from which on they are left out.
const LEAST_ZEROS: f32 = 0.25;

/// `(a: m x k, b: k x n) => out: m x n`, which is overwritten.
///
/// # Panics
/// When the shapes do not fit one another.
pub(crate) fn product<E: Epilogue>(simd: V4, out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>, epilogue: E) {
    if b.cols >= sparse::LEAST_COLUMNS && share_of_zeros(a) >= LEAST_ZEROS {
        sparse::product(simd, out, a, b, epilogue);
    } else {
        dense::product(simd, out, a, b, epilogue);
    }
}

/// Estimates the share of a matrix's values that are zero: from one in a cache line, in some of the rows.
fn share_of_zeros(matrix: Matrix<'_>) -> f32 {
    let by_rows = matrix.by_rows();
    let (mut n, mut n_zeros) = (0u32, 0u32);
    // An odd distance, so that every column is looked at in some row.
    for row in (0..by_rows.rows).step_by(3) {
        for line in by_rows.row(row).chunks(LANES) {
            n_zeros += u32::from(line[row % line.len()] == 0.0);
            n += 1;
        }
    }
    n_zeros as f32 / n.max(1) as f32
}

#[inline(always)]
fn zero() -> f32x16 {
    cast([0.0f32; LANES])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::epilogue::{BiasRelu, Keep, ReluMaskSum};

    /// Numbers of which about `share` are zero.
    fn numbers(n: usize, seed: u32, share: f32) -> Vec<f32> {
        let spread = |i: u32| (i ^ seed).wrapping_mul(2_654_435_761).rotate_left(15).wrapping_mul(2_246_822_519) >> 8;
        let unit = |i: u32| spread(i) as f32 / (1 << 24) as f32;
        (0..n as u32).map(|i| if unit(2 * i) < share { 0.0 } else { 2.0 * unit(2 * i + 1) - 1.0 }).collect()
    }

    #[test]
    fn leaving_zeros_out_changes_no_digit() {
        let Some(simd) = V4::try_new() else { return eprintln!("skipped: this processor has no AVX-512") };
        let shapes = [1, 5, 16, 33, 256, 300].into_iter().flat_map(|m| [1, 7, 64, 94, 256, 300].map(|k| (m, k)));
        for (m, k, n) in shapes.flat_map(|(m, k)| [64, 94, 128, 200, 256].map(|n| (m, k, n))) {
            for share in [0.0, 0.5, 1.0] {
                let (a, b, bias) = (numbers(m * k, 1, share), numbers(k * n, 2, 0.0), numbers(n, 3, 0.0));
                for a in [Matrix::new(&a, m, k), Matrix::new(&a, k, m).t()] {
                    for b in [Matrix::new(&b, k, n), Matrix::new(&b, n, k).t()] {
                        let (mut all, mut some) = (vec![f32::NAN; m * n], vec![f32::NAN; m * n]);
                        dense::product(simd, &mut all, a, b, Keep);
                        sparse::product(simd, &mut some, a, b, Keep);
                        assert_eq!(all, some, "{m} x {k} x {n}");
                        let is_zero = some.iter().all(|v| *v == 0.0);
                        assert!(is_zero == (share == 1.0) || k < 64, "{m} x {k} x {n}");

                        dense::product(simd, &mut all, a, b, BiasRelu { bias: &bias });
                        sparse::product(simd, &mut some, a, b, BiasRelu { bias: &bias });
                        assert_eq!(all, some, "{m} x {k} x {n}, rectified");

                        let (activation, mut sums) = (some.clone(), [vec![0.0; n], vec![0.0; n]]);
                        let [sum_of_all, sum_of_some] = &mut sums;
                        let epilogue = ReluMaskSum { activation: &activation, sum: sum_of_all };
                        dense::product(simd, &mut all, a, b, epilogue);
                        let epilogue = ReluMaskSum { activation: &activation, sum: sum_of_some };
                        sparse::product(simd, &mut some, a, b, epilogue);
                        assert_eq!((&all, &sums[0]), (&some, &sums[1]), "{m} x {k} x {n}, masked");
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_not_a_number_is_no_zero() {
        let Some(simd) = V4::try_new() else { return eprintln!("skipped: this processor has no AVX-512") };
        let (mut a, b) = (vec![0.0; 20 * 70], numbers(70 * 128, 1, 0.0));
        a[3 * 70 + 68] = f32::NAN;
        let mut out = vec![0.0; 20 * 128];
        sparse::product(simd, &mut out, Matrix::new(&a, 20, 70), Matrix::new(&b, 70, 128), Keep);
        for (row, values) in out.chunks(128).enumerate() {
            assert!(values.iter().all(|v| v.is_nan() == (row == 3)), "row {row}");
        }
    }

    #[test]
    fn zeros_are_estimated_where_they_are() {
        for share in [0.0f32, 0.3, 0.5, 0.9, 1.0] {
            let values = numbers(256 * 256, 5, share);
            for matrix in [Matrix::new(&values, 256, 256), Matrix::new(&values, 256, 256).t()] {
                let estimate = share_of_zeros(matrix);
                assert!((estimate - share).abs() < 0.05, "{estimate} for {share}");
            }
        }
        // Units that are zero for a whole batch are columns of zeros.
        let mut columns = numbers(256 * 256, 5, 0.0);
        columns.iter_mut().enumerate().for_each(|(i, v)| *v = if i % 256 < 100 { 0.0 } else { *v });
        assert!((share_of_zeros(Matrix::new(&columns, 256, 256)) - 100.0 / 256.0).abs() < 0.05);
        assert_eq!(share_of_zeros(Matrix::new(&[], 0, 0)), 0.0);
    }
}
