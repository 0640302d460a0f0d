//! Products in which the zeros of the left factor are left out. Rectified activations and their gradients are zero by half
//! or more, each row in other places, so a row of the product is summed up by itself.
//!
//! A product with zero changes no sum, unless the other factor is infinite or not a number: then it is left out, too.

use std::ops::Range;

use pulp::x86::V4;
use pulp::{NullaryFnOnce, cast, f32x16};

use super::panel::{Panel, Wide, add_product, load_wide, transposed};
use super::{LANES, zero};
use crate::epilogue::{Epilogue, load, store};
use crate::gemm::Matrix;

/// Registers in a row of a panel: as many sums, so that none waits for its last addition.
const VECTORS: usize = 8;
/// Columns of a panel.
const WIDTH: usize = VECTORS * LANES;
/// The fewest columns of a product for which a panel is worth its width.
pub(super) const LEAST_COLUMNS: usize = WIDTH / 2;
/// The most rows of the right factor that are copied at a time: the bits of a mask, with which the copy fills a first cache
/// of 32 KiB.
const DEPTH: usize = u64::BITS as usize;
/// The most rows of the left factor that are copied at a time.
const ROWS: usize = 256;

/// A part of the left factor, by rows.
#[repr(align(64))]
struct Left {
    values: [[f32; DEPTH]; ROWS],
    /// A bit for each value of a row that is not zero.
    nonzero: [u64; ROWS],
}

/// See [`super::product`].
pub(super) fn product<E: Epilogue>(simd: V4, out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>, epilogue: E) {
    simd.vectorize(Product { simd, out, a, b, epilogue });
}

struct Product<'a, E> {
    simd: V4,
    out: &'a mut [f32],
    a: Matrix<'a>,
    b: Matrix<'a>,
    epilogue: E,
}

impl<E: Epilogue> NullaryFnOnce for Product<'_, E> {
    type Output = ();

    #[inline(always)]
    fn call(mut self) {
        let mut left = Left { values: [[0.0; DEPTH]; ROWS], nonzero: [0; ROWS] };
        let mut panel = Panel::<VECTORS, DEPTH>::new();
        for first in (0..self.a.rows).step_by(ROWS) {
            let rows = first..self.a.rows.min(first + ROWS);
            for depth in (0..self.b.rows).step_by(DEPTH) {
                let n = DEPTH.min(self.b.rows - depth);
                left.copy(self.simd, self.a.part(rows.clone(), depth..depth + n));
                for column in (0..self.b.cols).step_by(WIDTH) {
                    panel.copy(self.simd, self.b, depth, n, column);
                    self.multiply(&left, &panel, rows.clone(), depth, column);
                }
            }
        }
    }
}

impl<E: Epilogue> Product<'_, E> {
    /// Multiplies rows of the left factor with the panel.
    #[inline(always)]
    fn multiply(
        &mut self,
        left: &Left,
        panel: &Panel<VECTORS, DEPTH>,
        rows: Range<usize>,
        depth: usize,
        column: usize,
    ) {
        let Self { simd, b, .. } = *self;
        let is_last = depth + DEPTH >= b.rows;
        let width = WIDTH.min(b.cols - column);
        for ((row, values), nonzero) in rows.zip(&left.values).zip(&left.nonzero) {
            let out = &mut self.out[row * b.cols + column..][..width];
            let mut sums: Wide<VECTORS> = [zero(); VECTORS];
            if depth > 0 {
                sums = load_wide(simd, out);
            }
            let mut left_over = *nonzero;
            while left_over != 0 {
                let p = left_over.trailing_zeros() as usize;
                left_over &= left_over - 1;
                add_product(simd, &mut sums, values[p], &panel.0[p]);
            }
            if is_last {
                for (j, sum) in sums.iter_mut().enumerate().take(width.div_ceil(LANES)) {
                    *sum = self.epilogue.apply(simd, row, column + j * LANES, *sum);
                }
            }
            match out.first_chunk_mut::<WIDTH>() {
                Some(out) => *out = cast(sums),
                None => {
                    for (out, sum) in out.chunks_mut(LANES).zip(sums) {
                        store(simd, out, sum);
                    }
                }
            }
        }
    }
}

impl Left {
    /// Copies a matrix of at most `ROWS` x `DEPTH` values.
    #[inline(always)]
    fn copy(&mut self, simd: V4, from: Matrix<'_>) {
        if from.col_stride == 1 {
            for (row, to) in self.values[..from.rows].iter_mut().enumerate() {
                to[..from.cols].copy_from_slice(from.row(row));
            }
        } else {
            let columns = from.t();
            for (i, to) in self.values[..from.rows].chunks_mut(LANES).enumerate() {
                for first in (0..from.cols).step_by(LANES) {
                    let n = LANES.min(from.cols - first);
                    let mut turned = [zero(); LANES];
                    for (p, values) in turned[..n].iter_mut().enumerate() {
                        *values = load(simd, &columns.row(first + p)[i * LANES..][..to.len()]);
                    }
                    for (to, values) in to.iter_mut().zip(transposed(simd, turned)) {
                        store(simd, &mut to[first..][..n], values);
                    }
                }
            }
        }
        for (values, nonzero) in self.values[..from.rows].iter().zip(&mut self.nonzero) {
            *nonzero = 0;
            for (i, values) in values[..from.cols].chunks(LANES).enumerate() {
                let values: f32x16 = load(simd, values);
                let bits = simd.avx512f._mm512_cmpneq_ps_mask(cast(values), cast(zero()));
                *nonzero |= u64::from(bits) << (i * LANES);
            }
        }
    }
}
