//! Operations of vector registers that the product needs besides arithmetic.

use pulp::x86::{V3, V4};
use pulp::{NullaryFnOnce, Simd, cast, f32x8, f32x16};

/// Vector registers of a processor.
pub(super) trait Registers: Simd {
    /// As many registers as a register has values.
    type Square: AsMut<[Self::f32s]> + IntoIterator<Item = Self::f32s>;
    /// Zeros.
    const ZERO_SQUARE: Self::Square;

    /// Runs an operation that is compiled for these registers.
    fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output;

    /// Returns a mask with a bit for each value that is not zero. The lowest bit belongs to the first value.
    fn nonzero(self, values: Self::f32s) -> u64;

    /// Returns the columns of the square matrix with these rows.
    fn transposed(self, rows: Self::Square) -> Self::Square;
}

/// Reads a register full of values. Zeros follow the last.
#[inline(always)]
pub(super) fn load<S: Simd>(simd: S, values: &[f32]) -> S::f32s {
    match S::as_simd_f32s(values).0.first() {
        Some(whole) => *whole,
        None => simd.partial_load_f32s(values),
    }
}

/// Writes a register, as far as `to` is long.
#[inline(always)]
pub(super) fn store<S: Simd>(simd: S, to: &mut [f32], values: S::f32s) {
    match S::as_mut_simd_f32s(to).0.first_mut() {
        Some(whole) => *whole = values,
        None => simd.partial_store_f32s(to, values),
    }
}

impl Registers for V4 {
    type Square = [f32x16; 16];
    const ZERO_SQUARE: Self::Square =
        [f32x16(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0); 16];

    #[inline(always)]
    fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
        self.vectorize(op)
    }

    #[inline(always)]
    fn nonzero(self, values: f32x16) -> u64 {
        u64::from(self.avx512f._mm512_cmpneq_ps_mask(cast(values), cast(self.splat_f32s(0.0))))
    }

    #[inline(always)]
    fn transposed(self, rows: Self::Square) -> Self::Square {
        let f = self.avx512f;
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
        for i in (0..16).step_by(4) {
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
}

impl Registers for V3 {
    type Square = [f32x8; 8];
    const ZERO_SQUARE: Self::Square = [f32x8(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0); 8];

    #[inline(always)]
    fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
        self.vectorize(op)
    }

    #[inline(always)]
    fn nonzero(self, values: f32x8) -> u64 {
        /// Not equal, or not numbers.
        const UNEQUAL: i32 = 4;
        let unequal = self.avx._mm256_cmp_ps::<UNEQUAL>(cast(values), cast(self.splat_f32s(0.0)));
        // Eight bits.
        u64::from(self.avx._mm256_movemask_ps(unequal).cast_unsigned())
    }

    #[inline(always)]
    fn transposed(self, rows: Self::Square) -> Self::Square {
        let f = self.avx;
        macro_rules! each {
            ($f:ident, $a:expr, $b:expr) => {
                cast::<_, f32x8>(f.$f(cast($a), cast($b)))
            };
        }
        macro_rules! halves {
            ($choice:literal, $a:expr, $b:expr) => {
                cast::<_, f32x8>(f._mm256_permute2f128_ps::<$choice>(cast($a), cast($b)))
            };
        }
        let mut pairs = rows;
        for i in 0..4 {
            pairs[2 * i] = each!(_mm256_unpacklo_ps, rows[2 * i], rows[2 * i + 1]);
            pairs[2 * i + 1] = each!(_mm256_unpackhi_ps, rows[2 * i], rows[2 * i + 1]);
        }
        let mut fours = pairs;
        for i in [0, 4] {
            fours[i] = each!(_mm256_unpacklo_pd, pairs[i], pairs[i + 2]);
            fours[i + 1] = each!(_mm256_unpackhi_pd, pairs[i], pairs[i + 2]);
            fours[i + 2] = each!(_mm256_unpacklo_pd, pairs[i + 1], pairs[i + 3]);
            fours[i + 3] = each!(_mm256_unpackhi_pd, pairs[i + 1], pairs[i + 3]);
        }
        let mut all = fours;
        for i in 0..4 {
            all[i] = halves!(0x20, fours[i], fours[i + 4]);
            all[i + 4] = halves!(0x31, fours[i], fours[i + 4]);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check<S: Registers>(simd: S) {
        let mut rows = S::ZERO_SQUARE;
        let lanes = S::F32_LANES;
        let values: Vec<f32> = (0..lanes * lanes).map(|i| i as f32).collect();
        rows.as_mut().copy_from_slice(S::as_simd_f32s(&values).0);
        for (i, column) in simd.transposed(rows).into_iter().enumerate() {
            let mut got = vec![0.0; lanes];
            store(simd, &mut got, column);
            let expected: Vec<f32> = (0..lanes).map(|row| values[row * lanes + i]).collect();
            assert_eq!(got, expected);
        }
        for (i, odd) in [(0, 1.0), (2, f32::NAN), (lanes - 1, -f32::MIN_POSITIVE)] {
            let mut row = vec![0.0; lanes];
            row[1] = -0.0;
            row[i] = odd;
            assert_eq!(simd.nonzero(S::as_simd_f32s(&row).0[0]), 1 << i);
        }
    }

    #[test]
    fn registers_turn_and_tell_zeros() {
        match V3::try_new() {
            Some(simd) => check(simd),
            None => eprintln!("skipped: this processor has no AVX2"),
        }
        match V4::try_new() {
            Some(simd) => check(simd),
            None => eprintln!("skipped: this processor has no AVX-512"),
        }
    }
}
