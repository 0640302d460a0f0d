//! Columns of the right factor, copied so that they follow one another in memory.

use pulp::x86::V4;
use pulp::{Simd, cast, f32x16};

use super::{LANES, zero};
use crate::epilogue::load;
use crate::gemm::Matrix;

/// Part of a row of a panel or of the product.
pub(super) type Wide<const VECTORS: usize> = [f32x16; VECTORS];

/// Up to `DEPTH` rows of as many columns as `VECTORS` registers hold.
#[repr(align(64))]
pub(super) struct Panel<const VECTORS: usize, const DEPTH: usize>(pub [Wide<VECTORS>; DEPTH]);

impl<const VECTORS: usize, const DEPTH: usize> Panel<VECTORS, DEPTH> {
    /// Columns of a panel.
    const WIDTH: usize = VECTORS * LANES;

    #[inline(always)]
    pub fn new() -> Self {
        Self([[zero(); VECTORS]; DEPTH])
    }

    /// Copies `n_rows` rows of a matrix from row `depth` on, from `column` on; zeros stand for columns behind its last.
    #[inline(always)]
    pub fn copy(&mut self, simd: V4, from: Matrix<'_>, depth: usize, n_rows: usize, column: usize) {
        let width = Self::WIDTH.min(from.cols - column);
        let panel = &mut self.0[..n_rows];
        if from.col_stride == 1 {
            for (p, to) in panel.iter_mut().enumerate() {
                *to = load_wide(simd, &from.data[(depth + p) * from.row_stride + column..][..width]);
            }
            return;
        }
        for part in 0..VECTORS {
            for first in (0..panel.len()).step_by(LANES) {
                let rows = &mut panel[first..];
                let n = rows.len().min(LANES);
                let mut columns = [zero(); LANES];
                for (c, values) in (part * LANES..width).zip(&mut columns) {
                    *values = load(simd, &from.data[(column + c) * from.col_stride + depth + first..][..n]);
                }
                for (to, row) in rows.iter_mut().zip(transposed(simd, columns)) {
                    to[part] = row;
                }
            }
        }
    }
}

/// Reads registers full of values; zeros follow the last.
// Every loop is over all registers, so that they stay registers.
#[inline(always)]
pub(super) fn load_wide<const VECTORS: usize>(simd: V4, from: &[f32]) -> Wide<VECTORS> {
    let mut wide = [zero(); VECTORS];
    match from.as_chunks().0.first_chunk::<VECTORS>() {
        Some(whole) => {
            for (to, from) in wide.iter_mut().zip(whole) {
                *to = cast::<[f32; LANES], _>(*from);
            }
        }
        None => {
            for (j, to) in wide.iter_mut().enumerate() {
                *to = load(simd, &from[(j * LANES).min(from.len())..]);
            }
        }
    }
    wide
}

/// `(x, b: a row of a panel) => sums + x b`
#[inline(always)]
pub(super) fn add_product<const VECTORS: usize>(simd: V4, sums: &mut Wide<VECTORS>, x: f32, b: &Wide<VECTORS>) {
    let x = simd.splat_f32s(x);
    for (sum, b) in sums.iter_mut().zip(b) {
        *sum = simd.mul_add_e_f32s(x, *b, *sum);
    }
}

/// Takes the vectors for the rows of a matrix and returns its columns.
#[inline(always)]
pub(super) fn transposed(simd: V4, rows: [f32x16; LANES]) -> [f32x16; LANES] {
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
