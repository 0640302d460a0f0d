//! The matrix product for a left factor with many zeros, which it skips. Half or more of the rectified activations and of
//! their gradients are zero, at different places in each row. So each row of the product is computed by itself.
//!
//! Columns of the right factor are copied to a panel that stays in the first-level cache. Each value of the product is one chain
//! of fused multiplications and additions, in the order of the right factor's rows. Its digits are those of faer's product,
//! unless there are so many rows that faer adds them in parts. An infinite value is skipped if it is only multiplied by
//! zeros.
//!
//! # Source
//! Goto and van de Geijn 2008, *Anatomy of High-Performance Matrix Multiplication*, for the order of the loops.

mod registers;

use std::ops::Range;

use pulp::NullaryFnOnce;
use pulp::x86::{V3, V4};

use crate::matrix::Matrix;
use registers::{Registers, load, store};

/// The largest share of the multiplications that may remain, those with the zeros that fill a panel up included. With more,
/// this product is not faster than faer's.
const MOST_MULTIPLICATIONS: f32 = 0.75;
/// Values in a cache line.
const LINE: usize = 16;

/// Registers in a row of a panel. A row of the product has as many sums, so that no sum waits for its last addition.
const VECTORS: usize = 8;
/// The most rows of a panel, which is the number of bits of a mask. With registers of 512 bits a panel fills a first-level
/// cache of 32 KiB.
const DEPTH: usize = u64::BITS as usize;
/// The most rows of the left factor in one copy.
const ROWS: usize = 256;

/// Computes `(a: m x k, b: k x n) => out: m x n`, which is overwritten, and returns `true`. Returns `false` and does nothing
/// if another product is as fast, because `a` has few zeros or `b` few columns, or if the processor has no AVX2.
///
/// # Panics
/// If the shapes do not fit.
pub(crate) fn product(out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>) -> bool {
    let nonzero = 1.0 - share_of_zeros(a);
    if let Some(simd) = V4::try_new() {
        Product { simd, out, a, b }.run(nonzero)
    } else if let Some(simd) = V3::try_new() {
        Product { simd, out, a, b }.run(nonzero)
    } else {
        false
    }
}

/// Estimates the share of zeros in a matrix from one value of each cache line of some rows. It is 0 for an empty matrix.
fn share_of_zeros(matrix: Matrix<'_>) -> f32 {
    let by_rows = matrix.by_rows();
    let (mut n, mut n_zeros) = (0u32, 0u32);
    // The distance is odd, so that every column counts in some row.
    for row in (0..by_rows.rows).step_by(3) {
        for line in by_rows.row(row).chunks(LINE) {
            n_zeros += u32::from(line[row % line.len()] == 0.0);
            n += 1;
        }
    }
    n_zeros as f32 / n.max(1) as f32
}

struct Product<'a, S> {
    simd: S,
    out: &'a mut [f32],
    a: Matrix<'a>,
    b: Matrix<'a>,
}

impl<S: Registers> NullaryFnOnce for Product<'_, S> {
    type Output = ();

    #[inline(always)]
    fn call(mut self) {
        let mut left = Left { values: [[0.0; DEPTH]; ROWS], nonzero: [0; ROWS] };
        let mut panel = Panel([[self.simd.splat_f32s(0.0); VECTORS]; DEPTH]);
        for first in (0..self.a.rows).step_by(ROWS) {
            let rows = first..self.a.rows.min(first + ROWS);
            for first in (0..self.b.rows).step_by(DEPTH) {
                let depths = first..self.b.rows.min(first + DEPTH);
                left.copy(self.simd, self.a.part(rows.clone(), depths.clone()));
                for first in (0..self.b.cols).step_by(Panel::<S>::WIDTH) {
                    let columns = first..self.b.cols.min(first + Panel::<S>::WIDTH);
                    panel.copy(self.simd, self.b.part(depths.clone(), columns.clone()));
                    self.multiply(&left, &panel, rows.clone(), depths.clone(), columns);
                }
            }
        }
    }
}

impl<S: Registers> Product<'_, S> {
    /// Computes the product and returns `true` if that is worth while with this share of non-zeros in the left factor.
    fn run(self, nonzero: f32) -> bool {
        let n_columns = self.b.cols.next_multiple_of(Panel::<S>::WIDTH);
        if nonzero * n_columns as f32 > MOST_MULTIPLICATIONS * self.b.cols as f32 {
            return false;
        }
        self.simd.run(self);
        true
    }

    /// Multiplies rows of the left factor with the panel.
    #[inline(always)]
    fn multiply(
        &mut self,
        left: &Left,
        panel: &Panel<S>,
        rows: Range<usize>,
        depths: Range<usize>,
        columns: Range<usize>,
    ) {
        let Self { simd, b, .. } = *self;
        for ((row, values), nonzero) in rows.zip(&left.values).zip(&left.nonzero) {
            let out = &mut self.out[row * b.cols..][columns.clone()];
            let mut sums = [simd.splat_f32s(0.0); VECTORS];
            if depths.start > 0 {
                sums = load_wide(simd, out);
            }
            let mut left_over = *nonzero;
            while left_over != 0 {
                let p = left_over.trailing_zeros() as usize;
                left_over &= left_over - 1;
                let x = simd.splat_f32s(values[p]);
                for (sum, b) in sums.iter_mut().zip(&panel.0[p]) {
                    *sum = simd.mul_add_e_f32s(x, *b, *sum);
                }
            }
            store_wide(simd, out, sums);
        }
    }
}

/// A part of the left factor, by rows.
#[repr(align(64))]
struct Left {
    values: [[f32; DEPTH]; ROWS],
    /// A bit for each value of a row that is not zero.
    nonzero: [u64; ROWS],
}

impl Left {
    #[inline(always)]
    fn copy<S: Registers>(&mut self, simd: S, from: Matrix<'_>) {
        if from.col_stride == 1 {
            for (row, to) in self.values[..from.rows].iter_mut().enumerate() {
                to[..from.cols].copy_from_slice(from.row(row));
            }
        } else {
            let columns = from.t();
            for (i, to) in self.values[..from.rows].chunks_mut(S::F32_LANES).enumerate() {
                for first in (0..from.cols).step_by(S::F32_LANES) {
                    let n = S::F32_LANES.min(from.cols - first);
                    let mut square = S::ZERO_SQUARE;
                    for (p, values) in square.as_mut()[..n].iter_mut().enumerate() {
                        *values = load(simd, &columns.row(first + p)[i * S::F32_LANES..][..to.len()]);
                    }
                    for (to, values) in to.iter_mut().zip(simd.transposed(square)) {
                        store(simd, &mut to[first..][..n], values);
                    }
                }
            }
        }
        for (values, nonzero) in self.values[..from.rows].iter().zip(&mut self.nonzero) {
            *nonzero = 0;
            for (i, values) in values[..from.cols].chunks(S::F32_LANES).enumerate() {
                *nonzero |= simd.nonzero(load(simd, values)) << (i * S::F32_LANES);
            }
        }
    }
}

/// A part of the right factor, by rows. Zeros follow its last column.
#[repr(align(64))]
struct Panel<S: Registers>([[S::f32s; VECTORS]; DEPTH]);

impl<S: Registers> Panel<S> {
    /// The most columns.
    const WIDTH: usize = VECTORS * S::F32_LANES;

    #[inline(always)]
    fn copy(&mut self, simd: S, from: Matrix<'_>) {
        let panel = &mut self.0[..from.rows];
        if from.col_stride == 1 {
            for (row, to) in panel.iter_mut().enumerate() {
                *to = load_wide(simd, from.row(row));
            }
            return;
        }
        let columns = from.t();
        for part in 0..VECTORS {
            for first in (0..from.rows).step_by(S::F32_LANES) {
                let rows = &mut panel[first..];
                let n = rows.len().min(S::F32_LANES);
                let mut square = S::ZERO_SQUARE;
                for (column, values) in (part * S::F32_LANES..from.cols).zip(square.as_mut()) {
                    *values = load(simd, &columns.row(column)[first..][..n]);
                }
                for (to, values) in rows.iter_mut().zip(simd.transposed(square)) {
                    to[part] = values;
                }
            }
        }
    }
}

/// Reads the registers of a row. Zeros follow the last value.
// Every loop is over all registers, because only then the compiler keeps the array in registers.
#[inline(always)]
fn load_wide<S: Registers>(simd: S, from: &[f32]) -> [S::f32s; VECTORS] {
    match S::as_simd_f32s(from).0.first_chunk() {
        Some(whole) => *whole,
        None => {
            let mut wide = [simd.splat_f32s(0.0); VECTORS];
            for (j, to) in wide.iter_mut().enumerate() {
                *to = load(simd, &from[(j * S::F32_LANES).min(from.len())..]);
            }
            wide
        }
    }
}

/// Writes the registers of a row, as far as `to` is long.
#[inline(always)]
fn store_wide<S: Registers>(simd: S, to: &mut [f32], values: [S::f32s; VECTORS]) {
    match S::as_mut_simd_f32s(to).0.first_chunk_mut() {
        Some(whole) => *whole = values,
        None => {
            for (to, values) in to.chunks_mut(S::F32_LANES).zip(values) {
                store(simd, to, values);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of which about `share` are zero.
    fn numbers(n: usize, seed: u32, share: f32) -> Vec<f32> {
        let spread = |i: u32| (i ^ seed).wrapping_mul(2_654_435_761).rotate_left(15).wrapping_mul(2_246_822_519) >> 8;
        let unit = |i: u32| spread(i) as f32 / (1 << 24) as f32;
        (0..n as u32).map(|i| if unit(2 * i) < share { 0.0 } else { 2.0 * unit(2 * i + 1) - 1.0 }).collect()
    }

    /// The same product, value by value.
    fn plain(a: Matrix<'_>, b: Matrix<'_>) -> Vec<f32> {
        let mut out = Vec::new();
        for (i, j) in (0..a.rows).flat_map(|i| (0..b.cols).map(move |j| (i, j))) {
            let row = a.data[i * a.row_stride..].iter().step_by(a.col_stride);
            let column = b.data[j * b.col_stride..].iter().step_by(b.row_stride);
            out.push(row.zip(column).take(b.rows).fold(0.0f32, |sum, (x, y)| x.mul_add(*y, sum)));
        }
        out
    }

    fn check<S: Registers>(simd: S, m: usize, k: usize, n: usize) {
        let (a, b) = (numbers(m * k, 1, 0.5), numbers(k * n, 2, 0.0));
        for a in [Matrix::new(&a, m, k), Matrix::new(&a, k, m).t()] {
            for b in [Matrix::new(&b, k, n), Matrix::new(&b, n, k).t()] {
                let mut out = vec![f32::NAN; m * n];
                simd.run(Product { simd, out: &mut out, a, b });
                assert_eq!(out, plain(a, b), "{m} x {k} x {n}");
            }
        }
    }

    fn check_all<S: Registers>(simd: Option<S>, name: &str) {
        let Some(simd) = simd else { return eprintln!("skipped: this processor has no {name}") };
        let shapes = [1, 5, 33, 300].into_iter().flat_map(|m| [1, 7, 64, 94, 300].map(|k| (m, k)));
        for (m, k, n) in shapes.flat_map(|(m, k)| [1, 64, 94, 200].map(|n| (m, k, n))) {
            check(simd, m, k, n);
        }
        check(simd, 256, 256, 256);
    }

    #[test]
    fn products_are_right_to_the_last_digit_with_avx2() {
        check_all(V3::try_new(), "AVX2");
    }

    #[test]
    fn products_are_right_to_the_last_digit_with_avx512() {
        check_all(V4::try_new(), "AVX-512");
    }

    #[test]
    fn products_are_made_here_where_there_are_zeros() {
        let shares = [0.1, 0.5, 0.9].map(|share| numbers(128 * 128, 1, share));
        let [few, half, most] = shares.each_ref().map(|values| Matrix::new(values, 128, 128));
        let mut out = vec![0.0; 128 * 128];
        let mut is_made = |a: Matrix<'_>, n| product(&mut out[..128 * n], a, few.part(0..128, 0..n));
        let here = V3::try_new().is_some();
        assert_eq!([is_made(few, 128), is_made(half, 128), is_made(most, 128)], [false, here, here]);
        assert_eq!([is_made(half, 32), is_made(most, 32), is_made(most, 1)], [false, here, false]);
    }

    #[test]
    fn what_is_not_a_number_is_no_zero() {
        let (mut a, b) = (vec![0.0; 20 * 70], numbers(70 * 128, 1, 0.0));
        a[3 * 70 + 68] = f32::NAN;
        let mut out = vec![0.0; 20 * 128];
        if !product(&mut out, Matrix::new(&a, 20, 70), Matrix::new(&b, 70, 128)) {
            return eprintln!("skipped: this processor has no AVX2");
        }
        for (row, values) in out.chunks(128).enumerate() {
            assert!(values.iter().all(|v| v.is_nan() == (row == 3)), "row {row}");
        }
    }

    #[test]
    fn zeros_are_estimated() {
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
