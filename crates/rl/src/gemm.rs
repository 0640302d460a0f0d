//! The matrix product of this crate: faer's, or [`sparse`](crate::sparse)'s if the left factor has many zeros.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, Par};
use rayon::prelude::*;

use crate::matrix::{Matrix, MatrixMut};
#[cfg(target_arch = "x86_64")]
use crate::sparse;

/// The fewest rows for which another thread is worth while.
pub(crate) const LEAST_ROWS: usize = 64;
/// The fewest multiplications of a product that threads share.
const LEAST_MULTIPLICATIONS: usize = 1 << 20;

/// Computes `(a: m x k, b: k x n) => out: m x n`, which is overwritten. The threads of the pool divide the rows of `out`
/// among them. Their number changes no digit.
///
/// # Panics
/// If the shapes do not fit.
pub(crate) fn gemm(out: MatrixMut<'_>, a: Matrix<'_>, b: Matrix<'_>) {
    let MatrixMut { data, rows, cols } = out;
    assert_eq!((rows, a.cols, cols), (a.rows, b.rows, b.cols), "the shapes of the product do not fit");
    let each = rows.div_ceil(rayon::current_num_threads()).max(LEAST_ROWS);
    if rows * cols * a.cols < LEAST_MULTIPLICATIONS || each >= rows {
        return part(data, a, b);
    }
    data.par_chunks_mut(each * cols).enumerate().for_each(|(i, out)| {
        let first = i * each;
        part(out, a.part(first..rows.min(first + each), 0..a.cols), b);
    });
}

/// Computes a product on this thread.
fn part(out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>) {
    #[cfg(target_arch = "x86_64")]
    if sparse::product(out, a, b) {
        return;
    }
    let product = MatMut::from_row_major_slice_mut(out, a.rows, b.cols);
    matmul(product, Accum::Replace, a.view(), b.view(), 1.0, Par::Seq);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(n: usize, seed: u32) -> Vec<f32> {
        let spread = |i: u32| (i + seed).wrapping_mul(2_654_435_761) >> 8;
        (0..n as u32).map(|i| spread(i) as f32 / (1 << 23) as f32 - 1.0).collect()
    }

    fn transposed(values: &[f32], cols: usize) -> Vec<f32> {
        (0..values.len()).map(|i| values[i % (values.len() / cols) * cols + i / (values.len() / cols)]).collect()
    }

    #[test]
    fn products_of_all_shapes_and_layouts_are_right() {
        let sizes = [1, 5, 12, 13, 16, 31, 32, 33, 47, 94];
        let shapes = sizes.into_iter().chain([400]).flat_map(|m| [1, 7, 16, 21, 256, 300].map(|k| (m, k)));
        for (m, k, n) in shapes.flat_map(|(m, k)| sizes.map(|n| (m, k, n))) {
            let (a, b) = (numbers(m * k, 1), numbers(k * n, 7));
            let exact =
                |i: usize, j: usize| -> f64 { (0..k).map(|p| f64::from(a[i * k + p]) * f64::from(b[p * n + j])).sum() };
            let (a_t, b_t) = (transposed(&a, k), transposed(&b, n));
            for a in [Matrix::new(&a, m, k), Matrix::new(&a_t, k, m).t()] {
                for b in [Matrix::new(&b, k, n), Matrix::new(&b_t, n, k).t()] {
                    let mut out = vec![f32::NAN; m * n];
                    gemm(MatrixMut::new(&mut out, m, n), a, b);
                    for (i, v) in out.iter().enumerate() {
                        let error = (f64::from(*v) - exact(i / n, i % n)).abs();
                        assert!(error < 1e-6 * k as f64, "{m} x {k} x {n}, value {i}: error {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn strided_factors_are_read_where_they_are() {
        let (a, b) = (numbers(20 * 50, 3), numbers(40 * 70, 4));
        let (mut out, mut dense) = (vec![0.0; 20 * 64], vec![0.0; 20 * 64]);
        let cut = |values: &[f32], stride: usize, cols: usize| -> Vec<f32> {
            values.chunks(stride).flat_map(|row| row[..cols].to_vec()).collect()
        };
        gemm(MatrixMut::new(&mut out, 20, 64), Matrix::strided(&a, 20, 40, 50), Matrix::strided(&b, 40, 64, 70));
        let (a, b) = (cut(&a, 50, 40), cut(&b, 70, 64));
        gemm(MatrixMut::new(&mut dense, 20, 64), Matrix::new(&a, 20, 40), Matrix::new(&b, 40, 64));
        assert_eq!(out, dense);
    }

    #[test]
    fn threads_change_no_digit() {
        let (m, k, n) = (300, 94, 200);
        let (a, b) = (numbers(m * k, 1), numbers(k * n, 7));
        let rectified: Vec<f32> = a.iter().map(|v| v.max(0.0)).collect();
        for a in [&a, &rectified] {
            let products = [1, 2, 3, 8].map(|n_threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
                let mut out = vec![0.0; m * n];
                let (a, b) = (Matrix::new(a, m, k), Matrix::new(&b, k, n));
                pool.install(|| gemm(MatrixMut::new(&mut out, m, n), a, b));
                out
            });
            assert!(products.iter().all(|product| *product == products[0]));
        }
    }

    #[test]
    #[should_panic(expected = "do not fit")]
    fn shapes_that_do_not_fit_are_refused() {
        let values = [0.0; 6];
        gemm(MatrixMut::new(&mut [0.0; 4], 2, 2), Matrix::new(&values, 2, 3), Matrix::new(&values, 2, 3));
    }
}
