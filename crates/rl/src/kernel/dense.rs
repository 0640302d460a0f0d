//! Products summed up in tiles that are as large as the registers hold, so that every value read serves several of them.

use std::ops::Range;

use pulp::x86::V4;
use pulp::{NullaryFnOnce, cast};

use super::panel::{Panel, Wide, add_product, load_wide};
use super::{LANES, zero};
use crate::epilogue::{Epilogue, store};
use crate::gemm::Matrix;

/// Registers in a row of a tile.
const VECTORS: usize = 2;
/// Columns of a tile of the product.
pub(super) const WIDTH: usize = VECTORS * LANES;
/// Rows of a tile: its sums take 24 of the 32 vector registers.
const HEIGHT: usize = 12;
/// The most rows of the right factor that are copied at a time, so that a first cache of 48 KiB holds the copy beside the
/// rows of the left factor that it is multiplied with. In one of 32 KiB fewer rows are no faster: sums are stored more often.
const DEPTH: usize = 256;
/// The most rows of the left factor that are read again for each panel, so that they stay in the second cache.
const ROWS: usize = 22 * HEIGHT;

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
        let mut panel = Panel::<VECTORS, DEPTH>::new();
        for depth in (0..self.b.rows).step_by(DEPTH) {
            let n = DEPTH.min(self.b.rows - depth);
            let depths = depth..depth + n;
            touch(self.b.part(depths.clone(), 0..self.b.cols));
            for first in (0..self.a.rows).step_by(ROWS) {
                let rows = first..self.a.rows.min(first + ROWS);
                touch(self.a.part(rows.clone(), depths.clone()));
                let out = Matrix::new(self.out, self.a.rows, self.b.cols);
                touch(out.part(rows.clone(), 0..self.b.cols));
                for column in (0..self.b.cols).step_by(WIDTH) {
                    panel.copy(self.simd, self.b, depth, n, column);
                    self.multiply(&panel.0[..n], rows.clone(), depth, column);
                }
            }
        }
    }
}

impl<E: Epilogue> Product<'_, E> {
    /// Multiplies rows of the left factor with the panel.
    #[inline(always)]
    fn multiply(&mut self, panel: &[Wide<VECTORS>], rows: Range<usize>, depth: usize, column: usize) {
        let mut row = rows.start;
        while row < rows.end {
            // Tiles of eight rows are about as fast as those of twelve, and smaller ones are slower.
            row += match rows.end - row {
                16 | 8..HEIGHT => self.tile::<8>(panel, row, depth, column),
                HEIGHT.. => self.tile::<HEIGHT>(panel, row, depth, column),
                4.. => self.tile::<4>(panel, row, depth, column),
                _ => self.tile::<1>(panel, row, depth, column),
            };
        }
    }

    /// Multiplies `R` rows of the left factor with the panel; returns `R`.
    #[inline(always)]
    fn tile<const R: usize>(&mut self, panel: &[Wide<VECTORS>], row: usize, depth: usize, column: usize) -> usize {
        let Self { simd, a, b, .. } = *self;
        let width = WIDTH.min(b.cols - column);
        let mut sums = [[zero(); VECTORS]; R];
        if depth > 0 {
            for (r, sum) in sums.iter_mut().enumerate() {
                *sum = load_wide(simd, &self.out[(row + r) * b.cols + column..][..width]);
            }
        }
        if a.col_stride == 1 {
            sums = add_by_rows(simd, sums, &a.data[row * a.row_stride + depth..], a.row_stride, panel);
        } else {
            sums = add_by_columns(simd, sums, &a.data[depth * a.col_stride + row..], a.col_stride, panel);
        }
        let is_last = depth + panel.len() == b.rows;
        for (r, sum) in sums.iter_mut().enumerate() {
            let out = &mut self.out[(row + r) * b.cols + column..][..width];
            if is_last {
                sum[0] = self.epilogue.apply(simd, row + r, column, sum[0]);
                if width > LANES {
                    sum[1] = self.epilogue.apply(simd, row + r, column + LANES, sum[1]);
                }
            }
            match out.first_chunk_mut::<WIDTH>() {
                Some(out) => *out = cast(*sum),
                None => {
                    let (left, right) = out.split_at_mut(width.min(LANES));
                    store(simd, left, sum[0]);
                    store(simd, right, sum[1]);
                }
            }
        }
        R
    }
}

/// Reads a value of each cache line, one line after another. The processor foresees that and fetches the lines that are
/// in no cache of the core's own, which it does not where lines of several rows are read in turn.
#[inline(always)]
fn touch(matrix: Matrix<'_>) {
    let by_rows = matrix.by_rows();
    // Of bits, because arithmetic with subnormal numbers may be slow.
    let mut mixed = [0u32; 4];
    for row in 0..by_rows.rows {
        let (fours, rest) = by_rows.row(row).as_chunks::<{ 4 * LANES }>();
        for lines in fours {
            for (i, mix) in mixed.iter_mut().enumerate() {
                *mix ^= lines[i * LANES].to_bits();
            }
        }
        for line in rest.chunks(LANES) {
            mixed[0] ^= line[0].to_bits();
        }
    }
    std::hint::black_box(mixed);
}

#[inline(always)]
fn add_by_rows<const R: usize>(
    simd: V4,
    mut sums: [Wide<VECTORS>; R],
    values: &[f32],
    stride: usize,
    panel: &[Wide<VECTORS>],
) -> [Wide<VECTORS>; R] {
    // Slices of one length, so that no index is checked below.
    let mut rows = [values; R];
    for (r, row) in rows.iter_mut().enumerate() {
        *row = &values[r * stride..][..panel.len()];
    }
    for (p, b) in panel.iter().enumerate() {
        for (sum, row) in sums.iter_mut().zip(&rows) {
            add_product(simd, sum, row[p], b);
        }
    }
    sums
}

#[inline(always)]
fn add_by_columns<const R: usize>(
    simd: V4,
    mut sums: [Wide<VECTORS>; R],
    values: &[f32],
    stride: usize,
    panel: &[Wide<VECTORS>],
) -> [Wide<VECTORS>; R] {
    for (p, b) in panel.iter().enumerate() {
        for (sum, x) in sums.iter_mut().zip(&values[p * stride..][..R]) {
            add_product(simd, sum, *x, b);
        }
    }
    sums
}
