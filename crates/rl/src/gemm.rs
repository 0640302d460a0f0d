//! The one matrix product of this crate, so that it can be swapped in one place: faer's, and [`sparse`](crate::sparse)'s
//! where the left factor has many zeros.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, Par};

use crate::epilogue::{Epilogue, Keep, each_row};
use crate::matrix::{Matrix, MatrixMut};
#[cfg(target_arch = "x86_64")]
use crate::sparse;

/// `(a: m x k, b: k x n) => out: m x n`, which is overwritten; on the calling thread.
///
/// # Panics
/// When the shapes do not fit one another.
pub(crate) fn gemm(mut out: MatrixMut<'_>, a: Matrix<'_>, b: Matrix<'_>) {
    if leaving_zeros_out(&mut out, a, b, Keep).is_err() {
        by_faer(&mut out, a, b);
    }
}

/// As [`gemm`], with something done to the values of the product as soon as they are there.
pub(crate) fn gemm_then(mut out: MatrixMut<'_>, a: Matrix<'_>, b: Matrix<'_>, epilogue: impl Epilogue) {
    if let Err(epilogue) = leaving_zeros_out(&mut out, a, b, epilogue) {
        by_faer(&mut out, a, b);
        each_row(out.data, out.cols, epilogue);
    }
}

/// Gives the epilogue back where the product is none for [`sparse`](crate::sparse).
fn leaving_zeros_out<E: Epilogue>(out: &mut MatrixMut<'_>, a: Matrix<'_>, b: Matrix<'_>, epilogue: E) -> Result<(), E> {
    let shapes = (out.rows, a.cols, out.cols);
    assert_eq!(shapes, (a.rows, b.rows, b.cols), "the shapes of a product do not fit one another");
    #[cfg(target_arch = "x86_64")]
    return sparse::product(out.data, a, b, epilogue);
    #[cfg(not(target_arch = "x86_64"))]
    Err(epilogue)
}

fn by_faer(out: &mut MatrixMut<'_>, a: Matrix<'_>, b: Matrix<'_>) {
    let out = MatMut::from_row_major_slice_mut(&mut *out.data, out.rows, out.cols);
    matmul(out, Accum::Replace, a.view(), b.view(), 1.0, Par::Seq);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::epilogue::{BiasRelu, ReluMaskSum};

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
            each_row(&mut apart, n, BiasRelu { bias: &bias });
            assert_eq!(fused, apart);
            assert!(fused.iter().any(|v| *v > 0.0) && fused.contains(&0.0));

            let activation = fused;
            let (mut fused, mut sum, mut apart_sum) = (vec![0.0; m * n], vec![0.0; n], vec![0.0; n]);
            let masked = ReluMaskSum { activation: &activation, sum: &mut sum };
            gemm_then(MatrixMut::new(&mut fused, m, n), a, b, masked);
            gemm(MatrixMut::new(&mut apart, m, n), a, b);
            each_row(&mut apart, n, ReluMaskSum { activation: &activation, sum: &mut apart_sum });
            assert_eq!((fused, sum), (apart, apart_sum));
        }
    }

    #[test]
    #[should_panic(expected = "do not fit")]
    fn shapes_that_do_not_fit_are_refused() {
        let values = [0.0; 6];
        gemm(MatrixMut::new(&mut [0.0; 4], 2, 2), Matrix::new(&values, 2, 3), Matrix::new(&values, 2, 3));
    }
}
