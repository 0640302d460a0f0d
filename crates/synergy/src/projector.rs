//! The approximation error, arranged for millions of calls.

/// Number of components that one pass over the joints accumulates in parallel.
const LANES: usize = 8;

/// A synergy space laid out so that the inner loop runs across components, without reductions or allocation.
///
/// `e^2 = |d|^2 - |C d|^2` with `d = q - mean` and orthonormal rows of `C`. The difference loses digits when `e` is
/// small; in `f64`, the error of `e` is then about `1e-8 |d|`, below the resolution of the `f32` postures.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Projector {
    mean: Vec<f64>,
    /// For each block of `LANES` components, `n` rows of `LANES` loadings; the last block is padded with zeros.
    blocks: Vec<Vec<[f64; LANES]>>,
}

impl Projector {
    /// (mean: n, components: k x n) => the projector
    pub(crate) fn new(mean: &[f64], components: &[f64]) -> Self {
        let rows: Vec<&[f64]> = components.chunks_exact(mean.len()).collect();
        let blocks = rows
            .chunks(LANES)
            .map(|block| {
                (0..mean.len())
                    .map(|joint| {
                        let mut loadings = [0.0; LANES];
                        for (loading, row) in loadings.iter_mut().zip(block) {
                            *loading = row[joint];
                        }
                        loadings
                    })
                    .collect()
            })
            .collect();
        Projector { mean: mean.to_vec(), blocks }
    }

    /// (posture: n) => e
    pub(crate) fn error(&self, posture: &[f32]) -> f32 {
        let mut residual = 0.0;
        for (&q, &mean) in posture.iter().zip(&self.mean) {
            let deviation = f64::from(q) - mean;
            residual += deviation * deviation;
        }
        for block in &self.blocks {
            let mut coefficients = [0.0; LANES];
            for ((&q, &mean), loadings) in posture.iter().zip(&self.mean).zip(block) {
                let deviation = f64::from(q) - mean;
                for (coefficient, &loading) in coefficients.iter_mut().zip(loadings) {
                    *coefficient += deviation * loading;
                }
            }
            residual -= coefficients.iter().map(|z| z * z).sum::<f64>();
        }
        residual.max(0.0).sqrt() as f32
    }
}
