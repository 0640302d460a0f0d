//! Operations on each value of an array, and inner products.
//!
//! The bodies have no branches, so that the compiler can vectorise them. Each is compiled for every instruction set of
//! `pulp`, which chooses the best one of the machine at run time. The choice affects only the inner products: they are sums
//! of as many lanes as a vector register holds.

/// Defines functions whose bodies are compiled for several instruction sets.
///
/// The body is a function of its own: from its parameters the compiler knows that the slices do not overlap.
macro_rules! vectorized {
    ($($(#[$doc:meta])* fn $name:ident<$life:lifetime>($($arg:ident: $type:ty),* $(,)?) -> $ret:ty $body:block)*) => {$(
        $(#[$doc])*
        pub(crate) fn $name<$life>($($arg: $type),*) -> $ret {
            struct Op<$life> {
                $($arg: $type),*
            }
            impl<$life> pulp::NullaryFnOnce for Op<$life> {
                type Output = $ret;
                #[inline(always)]
                fn call(self) -> $ret {
                    #[inline(always)]
                    fn body<$life>($($arg: $type),*) -> $ret $body
                    body($(self.$arg),*)
                }
            }
            pulp::Arch::new().dispatch(Op { $($arg),* })
        }
    )*};
}

/// Adam replaces a number below these magnitudes by zero. A unit that no longer responds has gradients of zero. Its moments
/// would decay to subnormal numbers and stay there, and arithmetic with them takes a hundred times as long. The steps that
/// follow from such numbers, divided by Adam's epsilon, are lost in the rounding of the parameters.
const LEAST_GRADIENT: f32 = 1e-16;
const LEAST_FIRST_MOMENT: f32 = 1e-30;
const LEAST_SECOND_MOMENT: f32 = 1e-35;

#[inline(always)]
fn zero_below(least: f32, x: f32) -> f32 {
    if x.abs() < least { 0.0 } else { x }
}

/// Per-step constants of Adam with the bias corrections folded in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AdamCoefficients {
    pub keep1: f32,
    pub take1: f32,
    pub keep2: f32,
    pub take2: f32,
    pub step: f32,
    pub epsilon: f32,
}

impl AdamCoefficients {
    #[inline(always)]
    fn apply(self, p: &mut f32, g: f32, m: &mut f32, v: &mut f32) {
        let g = zero_below(LEAST_GRADIENT, g);
        *m = zero_below(LEAST_FIRST_MOMENT, self.keep1 * *m + self.take1 * g);
        *v = zero_below(LEAST_SECOND_MOMENT, self.keep2 * *v + self.take2 * g * g);
        *p -= self.step * *m / (v.sqrt() + self.epsilon);
    }
}

/// `(weight: outputs x inputs, x: inputs) => out: outputs`
pub(crate) fn gemv(weight: &[f32], x: &[f32], out: &mut [f32]) {
    pulp::Arch::new().dispatch(Gemv { weight, x, out });
}

/// Inner product.
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut out = [0.0];
    gemv(a, b, &mut out);
    out[0]
}

struct Gemv<'a> {
    weight: &'a [f32],
    x: &'a [f32],
    out: &'a mut [f32],
}

impl pulp::WithSimd for Gemv<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        const BLOCK: usize = 4;
        let Self { weight, x, out } = self;
        let n = x.len();
        assert_eq!(weight.len(), out.len() * n, "the weights are not outputs x inputs");
        let (outs, last_outs) = out.as_chunks_mut::<BLOCK>();
        for (i, out) in outs.iter_mut().enumerate() {
            let start = i * BLOCK * n;
            let mut rows = [x; BLOCK];
            for (r, row) in rows.iter_mut().enumerate() {
                *row = &weight[start + r * n..][..n];
            }
            *out = row_products(simd, rows, x);
        }
        let start = outs.len() * BLOCK * n;
        for (i, out) in last_outs.iter_mut().enumerate() {
            [*out] = row_products(simd, [&weight[start + i * n..][..n]], x);
        }
    }
}

/// Inner products of several rows with `x`, which is read once for all of them.
// No closures, because they would be compiled without the vector instructions.
#[inline(always)]
fn row_products<S: pulp::Simd, const N: usize>(simd: S, rows: [&[f32]; N], x: &[f32]) -> [f32; N] {
    let (x_head, x_tail) = S::as_simd_f32s(x);
    let x_tail = simd.partial_load_f32s(x_tail);
    let mut heads = [x_head; N];
    let mut sums = [simd.splat_f32s(0.0); N];
    for ((sum, head), row) in sums.iter_mut().zip(&mut heads).zip(rows) {
        let (row_head, row_tail) = S::as_simd_f32s(row);
        *head = &row_head[..x_head.len()];
        *sum = simd.mul_f32s(simd.partial_load_f32s(row_tail), x_tail);
    }
    for (i, x) in x_head.iter().enumerate() {
        for (sum, head) in sums.iter_mut().zip(&heads) {
            *sum = simd.mul_add_e_f32s(head[i], *x, *sum);
        }
    }
    let mut out = [0.0; N];
    for (out, sum) in out.iter_mut().zip(sums) {
        *out = simd.reduce_sum_f32s(sum);
    }
    out
}

/// Hyperbolic tangent as a rational function, which the compiler can vectorise. Its error is less than four times the spacing
/// of numbers at 1.
///
/// NaN stays NaN.
///
/// # Source
/// Eigen, `generic_fast_tanh_float`.
#[inline(always)]
fn tanh(x: f32) -> f32 {
    const NUMERATOR: [f32; 7] =
        [-2.760_768_5e-16, 2.000_188e-13, -8.604_672e-11, 5.122_297e-8, 1.485_722_4e-5, 6.372_619_3e-4, 4.893_524_6e-3];
    const DENOMINATOR: [f32; 4] = [1.198_258_4e-6, 1.185_347_1e-4, 2.268_434_6e-3, 4.893_525e-3];
    /// The result is 1 beyond this.
    const SATURATION: f32 = 7.905_311;
    let x = x.clamp(-SATURATION, SATURATION);
    let square = x * x;
    let mut p = NUMERATOR[0];
    for c in &NUMERATOR[1..] {
        p = p * square + c;
    }
    let mut q = DENOMINATOR[0];
    for c in &DENOMINATOR[1..] {
        q = q * square + c;
    }
    (x * p / q).clamp(-1.0, 1.0)
}

/// Added to a variance before its root is taken, as in PyTorch's `LayerNorm`.
const NORM_EPSILON: f32 = 1e-5;
/// Number of partial sums of a sum, so that it is not one chain of additions. It is the same on every machine, so that the
/// result is too.
const LANES: usize = 32;

#[inline(always)]
fn sum(values: &[f32]) -> f32 {
    let mut lanes = [0.0; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for (lane, v) in lanes.iter_mut().zip(chunk) {
            *lane += *v;
        }
    }
    lanes.iter().sum::<f32>() + rest.iter().sum::<f32>()
}

#[inline(always)]
fn sum_of_products(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0; LANES];
    let ((chunks, rest), (others, other_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (chunk, other) in chunks.iter().zip(others) {
        for ((lane, x), y) in lanes.iter_mut().zip(chunk).zip(other) {
            *lane += *x * *y;
        }
    }
    lanes.iter().sum::<f32>() + rest.iter().zip(other_rest).map(|(x, y)| x * y).sum::<f32>()
}

vectorized! {
    /// One Adam step.
    fn adam<'a>(c: AdamCoefficients, p: &'a mut [f32], g: &'a [f32], m: &'a mut [f32], v: &'a mut [f32]) -> () {
        for (((p, g), m), v) in p.iter_mut().zip(g).zip(m).zip(v) {
            c.apply(p, *g, m, v);
        }
    }

    /// One Adam step. Then `target` moves by `tau` towards the new parameters.
    fn adam_polyak<'a>(
        c: AdamCoefficients,
        tau: f32,
        p: &'a mut [f32],
        g: &'a [f32],
        m: &'a mut [f32],
        v: &'a mut [f32],
        target: &'a mut [f32],
    ) -> () {
        for ((((p, g), m), v), t) in p.iter_mut().zip(g).zip(m).zip(v).zip(target) {
            c.apply(p, *g, m, v);
            *t += tau * (*p - *t);
        }
    }

    /// `target += tau (online - target)`
    fn polyak<'a>(tau: f32, online: &'a [f32], target: &'a mut [f32]) -> () {
        for (t, p) in target.iter_mut().zip(online) {
            *t += tau * (*p - *t);
        }
    }

    /// Adds the bias to each row, normalises the row to mean 0 and variance 1, and rectifies it. `normalized` receives the
    /// rows before rectification and `inverse_std` the inverse of their standard deviations, for [`norm_relu_gradient`].
    fn bias_norm_relu<'a>(
        values: &'a mut [f32],
        bias: &'a [f32],
        normalized: &'a mut [f32],
        inverse_std: &'a mut [f32],
    ) -> () {
        let width = bias.len();
        let rows = values.chunks_exact_mut(width).zip(normalized.chunks_exact_mut(width));
        for ((row, normalized), inverse_std) in rows.zip(inverse_std) {
            for ((n, v), b) in normalized.iter_mut().zip(row.iter()).zip(bias) {
                *n = *v + *b;
            }
            let mean = sum(normalized) / width as f32;
            for n in normalized.iter_mut() {
                *n -= mean;
            }
            let variance = sum_of_products(normalized, normalized) / width as f32;
            *inverse_std = 1.0 / (variance + NORM_EPSILON).sqrt();
            for (n, v) in normalized.iter_mut().zip(row) {
                *n *= *inverse_std;
                *v = if *n < 0.0 { 0.0 } else { *n };
            }
        }
    }

    /// Turns the gradient with respect to the results of [`bias_norm_relu`] into that with respect to its arguments.
    fn norm_relu_gradient<'a>(gradient: &'a mut [f32], normalized: &'a [f32], inverse_std: &'a [f32]) -> () {
        let width = gradient.len() / inverse_std.len();
        let rows = gradient.chunks_exact_mut(width).zip(normalized.chunks_exact(width));
        for ((row, normalized), inverse_std) in rows.zip(inverse_std) {
            for (g, n) in row.iter_mut().zip(normalized) {
                *g = if *n > 0.0 { *g } else { 0.0 };
            }
            let mean = sum(row) / width as f32;
            let slope = sum_of_products(row, normalized) / width as f32;
            for (g, n) in row.iter_mut().zip(normalized) {
                *g = *inverse_std * (*g - mean - slope * *n);
            }
        }
    }

    /// Adds the bias to each row and rectifies it. NaN stays NaN, so that divergence shows.
    fn bias_relu<'a>(values: &'a mut [f32], bias: &'a [f32]) -> () {
        for row in values.chunks_exact_mut(bias.len()) {
            for (v, b) in row.iter_mut().zip(bias) {
                let sum = *v + *b;
                *v = if sum < 0.0 { 0.0 } else { sum };
            }
        }
    }

    /// Sets the gradient to zero where the rectified activation is zero.
    fn relu_gradient<'a>(gradient: &'a mut [f32], activation: &'a [f32]) -> () {
        for (g, a) in gradient.iter_mut().zip(activation) {
            *g = if *a == 0.0 { 0.0 } else { *g };
        }
    }

    /// Adds the bias to each row.
    fn bias<'a>(values: &'a mut [f32], bias: &'a [f32]) -> () {
        for row in values.chunks_exact_mut(bias.len()) {
            for (v, b) in row.iter_mut().zip(bias) {
                *v += *b;
            }
        }
    }

    /// Adds the bias to each row and takes the hyperbolic tangent.
    fn bias_tanh<'a>(values: &'a mut [f32], bias: &'a [f32]) -> () {
        for row in values.chunks_exact_mut(bias.len()) {
            for (v, b) in row.iter_mut().zip(bias) {
                *v += *b;
            }
        }
        for v in values {
            *v = tanh(*v);
        }
    }

    /// `delta = gradient (1 - output^2)`
    fn tanh_gradient<'a>(delta: &'a mut [f32], gradient: &'a [f32], output: &'a [f32]) -> () {
        for ((d, g), y) in delta.iter_mut().zip(gradient).zip(output) {
            *d = g * (1.0 - y * y);
        }
    }

    /// Sums the rows into `bias_gradient`.
    fn row_sum<'a>(gradient: &'a [f32], bias_gradient: &'a mut [f32]) -> () {
        bias_gradient.fill(0.0);
        for row in gradient.chunks_exact(bias_gradient.len()) {
            for (g, sum) in row.iter().zip(bias_gradient.iter_mut()) {
                *sum += *g;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tanh_follows_the_library_and_keeps_nan() {
        let mut worst = 0.0f64;
        for i in -200_000..=200_000 {
            let x = i as f32 * 1e-4;
            let y = tanh(x);
            assert!((-1.0..=1.0).contains(&y), "tanh({x}) = {y}");
            worst = worst.max((f64::from(y) - f64::from(x).tanh()).abs());
        }
        assert!(worst < 4.0 * f64::from(f32::EPSILON), "error {worst}");
        assert!(tanh(f32::NAN).is_nan());
    }

    #[test]
    fn rectification_keeps_nan() {
        let mut row = [f32::NAN, -2.0, 3.0];
        bias_relu(&mut row, &[0.0, 1.0, 1.0]);
        assert!(row[0].is_nan());
        assert_eq!(row[1..], [0.0, 4.0]);
        let mut gradient = [1.0, 2.0, f32::NAN];
        relu_gradient(&mut gradient, &row);
        assert_eq!(gradient[..2], [1.0, 0.0]);
        assert!(gradient[2].is_nan());
    }

    #[test]
    fn dot_counts_every_element() {
        for n in [0, 1, 15, 16, 17, 67, 256] {
            let a: Vec<f32> = (0..n).map(|i| i as f32).collect();
            let b = vec![2.0; n];
            assert_eq!(dot(&a, &b), (n * n.saturating_sub(1)) as f32, "length {n}");
        }
    }
}
