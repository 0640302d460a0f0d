//! The matrix product on processors with AVX-512.
//!
//! A panel of the right factor is copied to where it stays in the first cache, and tiles of the product are summed up in
//! registers, each value over the rows of the panel in their order: to the last digit what faer gives for as many rows.
//!
//! # Source
//! Goto and van de Geijn 2008, *Anatomy of High-Performance Matrix Multiplication*, for the order of the loops.

use std::ops::Range;

use pulp::x86::V4;
use pulp::{NullaryFnOnce, Simd, cast, f32x16};

use crate::epilogue::{Epilogue, load, store};
use crate::gemm::Matrix;

/// Values in a vector register.
const LANES: usize = 16;
/// Columns of a tile of the product.
pub(crate) const WIDTH: usize = 2 * LANES;
/// Rows of a tile: its sums take 24 of the 32 vector registers.
const HEIGHT: usize = 12;
/// The most rows of the right factor that are copied at a time, so that the copy stays in the first cache beside the rows
/// of the left factor that it is multiplied with.
const DEPTH: usize = 256;
/// The most rows of the left factor that are read again for each panel, so that they stay in the second cache.
const ROWS: usize = 22 * HEIGHT;

/// Part of a row of a tile or a panel.
type Wide = [f32x16; 2];

/// Columns of the right factor, as wide as a tile.
#[repr(align(64))]
struct Panel([Wide; DEPTH]);

/// `(a: m x k, b: k x n) => out: m x n`, which is overwritten.
///
/// # Panics
/// When the shapes do not fit one another.
pub(crate) fn product<E: Epilogue>(simd: V4, out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>, epilogue: E) {
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
        let mut panel = Panel([[zero(); 2]; DEPTH]);
        for depth in (0..self.b.rows).step_by(DEPTH) {
            let panel = &mut panel.0[..DEPTH.min(self.b.rows - depth)];
            let depths = depth..depth + panel.len();
            touch(self.b.part(depths.clone(), 0..self.b.cols));
            for first in (0..self.a.rows).step_by(ROWS) {
                let rows = first..self.a.rows.min(first + ROWS);
                touch(self.a.part(rows.clone(), depths.clone()));
                let out = Matrix::new(self.out, self.a.rows, self.b.cols);
                touch(out.part(rows.clone(), 0..self.b.cols));
                for column in (0..self.b.cols).step_by(WIDTH) {
                    self.copy(panel, depth, column);
                    self.multiply(panel, rows.clone(), depth, column);
                }
            }
        }
    }
}

impl<E: Epilogue> Product<'_, E> {
    /// Copies the part of the right factor that begins at row `depth` and `column`.
    #[inline(always)]
    fn copy(&self, panel: &mut [Wide], depth: usize, column: usize) {
        let Self { simd, b, .. } = *self;
        let width = WIDTH.min(b.cols - column);
        if b.col_stride == 1 {
            for (p, to) in panel.iter_mut().enumerate() {
                let from = &b.data[(depth + p) * b.row_stride + column..][..width];
                *to = load_wide(simd, from);
            }
            return;
        }
        for half in 0..2 {
            for first in (0..panel.len()).step_by(LANES) {
                let rows = &mut panel[first..];
                let n = rows.len().min(LANES);
                let mut columns = [zero(); LANES];
                for (c, values) in (half * LANES..width).zip(&mut columns) {
                    let from = &b.data[(column + c) * b.col_stride + depth + first..][..n];
                    *values = load(simd, from);
                }
                for (to, row) in rows.iter_mut().zip(transposed(simd, columns)) {
                    to[half] = row;
                }
            }
        }
    }

    /// Multiplies rows of the left factor with the panel.
    #[inline(always)]
    fn multiply(&mut self, panel: &[Wide], rows: Range<usize>, depth: usize, column: usize) {
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
    fn tile<const R: usize>(&mut self, panel: &[Wide], row: usize, depth: usize, column: usize) -> usize {
        let Self { simd, a, b, .. } = *self;
        let mut sums = if a.col_stride == 1 {
            sums_by_rows::<R>(simd, &a.data[row * a.row_stride + depth..], a.row_stride, panel)
        } else {
            sums_by_columns::<R>(simd, &a.data[depth * a.col_stride + row..], a.col_stride, panel)
        };
        let is_last = depth + panel.len() == b.rows;
        let width = WIDTH.min(b.cols - column);
        for (r, sum) in sums.iter_mut().enumerate() {
            let out = &mut self.out[(row + r) * b.cols + column..][..width];
            if depth > 0 {
                let before = load_wide(simd, out);
                *sum = [simd.add_f32s(before[0], sum[0]), simd.add_f32s(before[1], sum[1])];
            }
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
    let by_rows = if matrix.col_stride == 1 { matrix } else { matrix.t() };
    let mut sums = [0.0f32; 4];
    for row in 0..by_rows.rows {
        let values = &by_rows.data[row * by_rows.row_stride..][..by_rows.cols];
        let (fours, rest) = values.as_chunks::<{ 4 * LANES }>();
        for lines in fours {
            for (i, sum) in sums.iter_mut().enumerate() {
                *sum += lines[i * LANES];
            }
        }
        for line in rest.chunks(LANES) {
            sums[0] += line[0];
        }
    }
    std::hint::black_box(sums);
}

#[inline(always)]
fn sums_by_rows<const R: usize>(simd: V4, values: &[f32], stride: usize, panel: &[Wide]) -> [Wide; R] {
    let mut sums = [[zero(); 2]; R];
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
fn sums_by_columns<const R: usize>(simd: V4, values: &[f32], stride: usize, panel: &[Wide]) -> [Wide; R] {
    let mut sums = [[zero(); 2]; R];
    for (p, b) in panel.iter().enumerate() {
        for (sum, x) in sums.iter_mut().zip(&values[p * stride..][..R]) {
            add_product(simd, sum, *x, b);
        }
    }
    sums
}

#[inline(always)]
fn add_product(simd: V4, sum: &mut Wide, x: f32, b: &Wide) {
    let x = simd.splat_f32s(x);
    for (s, b) in sum.iter_mut().zip(b) {
        *s = simd.mul_add_e_f32s(x, *b, *s);
    }
}

#[inline(always)]
fn zero() -> f32x16 {
    cast([0.0f32; LANES])
}

#[inline(always)]
fn load_wide(simd: V4, from: &[f32]) -> Wide {
    match from.first_chunk::<WIDTH>() {
        Some(whole) => cast(*whole),
        None => [load(simd, from), load(simd, &from[from.len().min(LANES)..])],
    }
}

/// Takes the vectors for the rows of a matrix and returns its columns.
#[inline(always)]
fn transposed(simd: V4, rows: [f32x16; LANES]) -> [f32x16; LANES] {
    let f = simd.avx512f;
    macro_rules! each {
        ($f:ident, $a:expr, $b:expr) => {
            cast::<_, f32x16>(f.$f(cast($a), cast($b)))
        };
    }
    macro_rules! quarters {
        ($choice:literal, $a:expr, $b:expr) => {
            cast::<_, f32x16>(f._mm512_shuffle_f32x4::<$choice>(cast($a), cast($b)))
        };
    }
    let mut pairs = rows;
    for i in 0..8 {
        pairs[2 * i] = each!(_mm512_unpacklo_ps, rows[2 * i], rows[2 * i + 1]);
        pairs[2 * i + 1] = each!(_mm512_unpackhi_ps, rows[2 * i], rows[2 * i + 1]);
    }
    let mut fours = pairs;
    for i in (0..LANES).step_by(4) {
        fours[i] = each!(_mm512_unpacklo_pd, pairs[i], pairs[i + 2]);
        fours[i + 1] = each!(_mm512_unpackhi_pd, pairs[i], pairs[i + 2]);
        fours[i + 2] = each!(_mm512_unpacklo_pd, pairs[i + 1], pairs[i + 3]);
        fours[i + 3] = each!(_mm512_unpackhi_pd, pairs[i + 1], pairs[i + 3]);
    }
    let mut eights = fours;
    for i in 0..4 {
        eights[i] = quarters!(0x88, fours[i], fours[4 + i]);
        eights[4 + i] = quarters!(0xdd, fours[i], fours[4 + i]);
        eights[8 + i] = quarters!(0x88, fours[8 + i], fours[12 + i]);
        eights[12 + i] = quarters!(0xdd, fours[8 + i], fours[12 + i]);
    }
    let mut all = eights;
    for i in 0..8 {
        all[i] = quarters!(0x88, eights[i], eights[8 + i]);
        all[8 + i] = quarters!(0xdd, eights[i], eights[8 + i]);
    }
    all
}
