//! The peak speed of a core's arithmetic.

use std::time::Instant;

/// Number of independent chains of multiply-adds: enough to fill the pipelines of the arithmetic units, and fewer than
/// the registers of any processor.
const CHAINS: usize = 10;
/// Operations of each chain in one measurement; about a millisecond.
const LENGTH: usize = 1 << 18;

/// Measures the 32-bit floating-point operations per second of a core that only multiplies and adds in registers.
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
