//! Elementwise passes of the learner, written without branches so that the compiler vectorises them.

/// Per-step constants of Adam with the bias corrections folded in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AdamCoefficients {
    pub beta1: f32,
    pub beta2: f32,
    pub step: f32,
    pub epsilon: f32,
}

impl AdamCoefficients {
    #[inline(always)]
    fn apply(self, p: &mut f32, g: f32, m: &mut f32, v: &mut f32) {
        *m = self.beta1 * *m + (1.0 - self.beta1) * g;
        *v = self.beta2 * *v + (1.0 - self.beta2) * g * g;
        *p -= self.step * *m / (v.sqrt() + self.epsilon);
    }
}

/// One Adam step.
pub(crate) fn adam(c: AdamCoefficients, p: &mut [f32], g: &[f32], m: &mut [f32], v: &mut [f32]) {
    for (((p, g), m), v) in p.iter_mut().zip(g).zip(m).zip(v) {
        c.apply(p, *g, m, v);
    }
}

/// One Adam step, after which `target` moves by `tau` towards the new parameters.
pub(crate) fn adam_polyak(
    c: AdamCoefficients,
    tau: f32,
    p: &mut [f32],
    g: &[f32],
    m: &mut [f32],
    v: &mut [f32],
    target: &mut [f32],
) {
    for ((((p, g), m), v), t) in p.iter_mut().zip(g).zip(m).zip(v).zip(target) {
        c.apply(p, *g, m, v);
        *t += tau * (*p - *t);
    }
}

/// `target += tau (online - target)`
pub(crate) fn polyak(tau: f32, online: &[f32], target: &mut [f32]) {
    for (t, p) in target.iter_mut().zip(online) {
        *t += tau * (*p - *t);
    }
}

/// Adds the bias to each row and rectifies. A value that is not a number stays one, so that divergence shows.
pub(crate) fn bias_relu(values: &mut [f32], bias: &[f32]) {
    for row in values.chunks_exact_mut(bias.len()) {
        for (v, b) in row.iter_mut().zip(bias) {
            let x = *v + *b;
            *v = if x < 0.0 { 0.0 } else { x };
        }
    }
}

/// Adds the bias to each row.
pub(crate) fn bias(values: &mut [f32], bias: &[f32]) {
    for row in values.chunks_exact_mut(bias.len()) {
        for (v, b) in row.iter_mut().zip(bias) {
            *v += *b;
        }
    }
}

/// Clears the gradient where the rectified activation is zero.
pub(crate) fn relu_mask(gradient: &mut [f32], activation: &[f32]) {
    for (g, a) in gradient.iter_mut().zip(activation) {
        *g = if *a == 0.0 { 0.0 } else { *g };
    }
}

/// As [`relu_mask`], and sums the masked rows into `bias_gradient` in the same pass.
pub(crate) fn relu_mask_sum(gradient: &mut [f32], activation: &[f32], bias_gradient: &mut [f32]) {
    bias_gradient.fill(0.0);
    let width = bias_gradient.len();
    for (row, act) in gradient.chunks_exact_mut(width).zip(activation.chunks_exact(width)) {
        for ((g, a), sum) in row.iter_mut().zip(act).zip(bias_gradient.iter_mut()) {
            *g = if *a == 0.0 { 0.0 } else { *g };
            *sum += *g;
        }
    }
}

/// Sums the rows into `bias_gradient`.
pub(crate) fn row_sum(gradient: &[f32], bias_gradient: &mut [f32]) {
    bias_gradient.fill(0.0);
    for row in gradient.chunks_exact(bias_gradient.len()) {
        for (g, sum) in row.iter().zip(bias_gradient.iter_mut()) {
            *sum += *g;
        }
    }
}

const LANES: usize = 16;

/// Inner product, summed in a fixed number of lanes.
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0f32; LANES];
    let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let tail: f32 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a_chunks.zip(b_chunks) {
        for ((lane, x), y) in lanes.iter_mut().zip(x).zip(y) {
            *lane += x * y;
        }
    }
    lanes.iter().sum::<f32>() + tail
}

/// `(weight: outputs x inputs, x: inputs) => out: outputs`
pub(crate) fn gemv(weight: &[f32], x: &[f32], out: &mut [f32]) {
    for (row, out) in weight.chunks_exact(x.len()).zip(out) {
        *out = dot(row, x);
    }
}

/// Adds the bias to each row and takes the hyperbolic tangent.
pub(crate) fn bias_tanh(values: &mut [f32], bias: &[f32]) {
    for row in values.chunks_exact_mut(bias.len()) {
        for (v, b) in row.iter_mut().zip(bias) {
            *v = (*v + *b).tanh();
        }
    }
}

/// `delta = gradient (1 - output^2)`
pub(crate) fn tanh_gradient(delta: &mut [f32], gradient: &[f32], output: &[f32]) {
    for ((d, g), y) in delta.iter_mut().zip(gradient).zip(output) {
        *d = g * (1.0 - y * y);
    }
}
