//! The one matrix product of this crate, so that it can be swapped in one place: faer's, and [`sparse`](crate::sparse)'s
//! where the left factor has many zeros.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, Par};
use rayon::prelude::*;

use crate::epilogue::{Epilogue, Keep, each_row};
use crate::matrix::{Matrix, MatrixMut};
#[cfg(target_arch = "x86_64")]
use crate::sparse;

/// The fewest rows that are worth a thread of their own.
pub(crate) const LEAST_ROWS: usize = 64;
/// The fewest multiplications of a product that is divided.
const LEAST_MULTIPLICATIONS: usize = 1 << 20;

/// `(a: m x k, b: k x n) => out: m x n`, which is overwritten. The threads of the pool divide its rows among them, which
/// changes no digit.
///
/// # Panics
/// When the shapes do not fit one another.
pub(crate) fn gemm(out: MatrixMut<'_>, a: Matrix<'_>, b: Matrix<'_>) {
    gemm_then(out, a, b, Keep);
}

/// As [`gemm`], with something done to the values of the product as soon as they are there.
pub(crate) fn gemm_then(out: MatrixMut<'_>, a: Matrix<'_>, b: Matrix<'_>, epilogue: impl Epilogue) {
    let MatrixMut { data, rows, cols } = out;
    let shapes = (rows, a.cols, cols);
    assert_eq!(shapes, (a.rows, b.rows, b.cols), "the shapes of a product do not fit one another");
    if rows * cols * a.cols < LEAST_MULTIPLICATIONS {
        return part(data, 0, a, b, epilogue);
    }
    let each = rows.div_ceil(rayon::current_num_threads()).max(LEAST_ROWS);
    if each >= rows {
        return part(data, 0, a, b, epilogue);
    }
    data.par_chunks_mut(each * cols).enumerate().for_each(|(i, out)| {
        let first = i * each;
        part(out, first, a.part(first..rows.min(first + each), 0..a.cols), b, epilogue);
    });
}

/// Computes the rows of a product from row `first` on, those of `a`.
fn part<E: Epilogue>(out: &mut [f32], first: usize, a: Matrix<'_>, b: Matrix<'_>, epilogue: E) {
    #[cfg(target_arch = "x86_64")]
    if sparse::product(out, first, a, b, epilogue) {
        return;
    }
    let product = MatMut::from_row_major_slice_mut(&mut *out, a.rows, b.cols);
    matmul(product, Accum::Replace, a.view(), b.view(), 1.0, Par::Seq);
    if E::CHANGES {
        each_row(out, b.cols, first, epilogue);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::epilogue::{BiasRelu, ReluMask};

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
    fn an_epilogue_does_to_a_part_what_it_does_to_the_whole() {
        for (m, k, n) in [(29, 300, 94), (13, 16, 32), (8, 4, 21)] {
            let (mut a, b, bias) = (numbers(m * k, 1), numbers(k * n, 7), numbers(n, 9));
            a.iter_mut().for_each(|v| *v = v.max(0.0));
            let (a, b) = (Matrix::new(&a, m, k), Matrix::new(&b, k, n));
            let (mut fused, mut apart) = (vec![0.0; m * n], vec![0.0; m * n]);
            gemm_then(MatrixMut::new(&mut fused, m, n), a, b, BiasRelu { bias: &bias });
            gemm(MatrixMut::new(&mut apart, m, n), a, b);
            each_row(&mut apart, n, 0, BiasRelu { bias: &bias });
            assert_eq!(fused, apart);
            assert!(fused.iter().any(|v| *v > 0.0) && fused.contains(&0.0));

            let activation = fused;
            let (mut fused, mut apart) = (vec![0.0; m * n], vec![0.0; m * n]);
            let mask = ReluMask { activation: &activation, width: n };
            gemm_then(MatrixMut::new(&mut fused, m, n), a, b, mask);
            gemm(MatrixMut::new(&mut apart, m, n), a, b);
            each_row(&mut apart, n, 0, mask);
            assert_eq!(fused, apart);
        }
    }

    #[test]
    fn threads_change_no_digit() {
        let (m, k, n) = (300, 94, 200);
        let (a, b, activation) = (numbers(m * k, 1), numbers(k * n, 7), numbers(m * n, 9));
        // Zeros in places of each row's own.
        let activation: Vec<f32> = activation.iter().map(|v| v.max(0.0)).collect();
        let mask = ReluMask { activation: &activation, width: n };
        let rectified: Vec<f32> = a.iter().map(|v| v.max(0.0)).collect();
        for a in [&a, &rectified] {
            let products = [1, 2, 3, 8].map(|n_threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
                let mut out = vec![0.0; m * n];
                let (a, b) = (Matrix::new(a, m, k), Matrix::new(&b, k, n));
                pool.install(|| gemm_then(MatrixMut::new(&mut out, m, n), a, b, mask));
                out
            });
            assert!(products[0].iter().zip(&activation).all(|(v, a)| (*v == 0.0) == (*a == 0.0)));
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
