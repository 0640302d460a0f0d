//! The most that the arithmetic of a core can do.

use std::time::Instant;

/// Chains of multiplications and additions side by side: more than the units that add them have stages, fewer than any
/// processor has registers.
const CHAINS: usize = 10;
/// Operations of each chain in one measurement; about a millisecond.
const LENGTH: usize = 1 << 18;

/// Measures how many 32-bit floating-point operations a core does that multiplies and adds in registers and does nothing
/// else, per second.
pub(super) fn peak() -> f64 {
    pulp::Arch::new().dispatch(Peak)
}

struct Peak;

impl pulp::WithSimd for Peak {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> f64 {
        let (factor, term) = (simd.splat_f32s(std::hint::black_box(0.5)), simd.splat_f32s(std::hint::black_box(1.0)));
        let mut chains = [term; CHAINS];
        let start = Instant::now();
        for _ in 0..LENGTH {
            // No closure: it would be compiled without the vector instructions.
            for chain in &mut chains {
                *chain = simd.mul_add_e_f32s(*chain, factor, term);
            }
        }
        let seconds = start.elapsed().as_secs_f64();
        let mut sum = term;
        for chain in chains {
            sum = simd.add_f32s(sum, chain);
        }
        std::hint::black_box(simd.reduce_sum_f32s(sum));
        (2 * CHAINS * LENGTH * S::F32_LANES) as f64 / seconds
    }
}
