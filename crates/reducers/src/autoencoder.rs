//! A nonlinear reducer.

use eigenhand_rl::{Adam, InputGradient, Mlp, MlpScratch, OutputActivation, Rows, rng};
use eigenhand_synergy::{Synergy, SynergyError};
use rand::{Rng, RngExt};

use crate::linear::principal_space;
use crate::{Reducer, Reduction};

/// An autoencoder: a network computes the numbers of a sample, and another the sample of the numbers. Each has one rectified
/// hidden layer, and adds to the linear map of [`Pca`](crate::Pca), from which the training starts.
///
/// The training descends on the squared error of the reconstruction for a fixed number of steps. It leaves out every eighth
/// sample, and keeps the networks with which the error of these is least.
///
/// # Source
/// Kramer, *Nonlinear principal component analysis using autoassociative neural networks*, AIChE J. 37 (1991).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Autoencoder {
    /// Units of each hidden layer.
    pub hidden: usize,
    /// Steps of the optimiser.
    pub steps: usize,
    /// Samples of a step.
    pub batch: usize,
    /// Step size of the optimiser.
    pub learning_rate: f32,
    /// Seed of the weights and the batches.
    pub seed: u64,
}

impl Default for Autoencoder {
    fn default() -> Self {
        Autoencoder { hidden: 64, steps: 3000, batch: 128, learning_rate: 1e-3, seed: 1 }
    }
}

/// One sample of so many judges the networks.
const JUDGING: usize = 8;
/// Steps between two judgements.
const JUDGE_EVERY: usize = 100;

impl Reducer for Autoencoder {
    fn name(&self) -> &'static str {
        "autoencoder"
    }

    fn fit(&self, samples: &[&[f64]], k: usize) -> Result<Box<dyn Reduction>, SynergyError> {
        let start = principal_space(samples, k)?;
        let size = (start.total_variance() / start.n_joints() as f64).sqrt();
        let mut rng = rng::stream(self.seed, "autoencoder", 0);
        let mut bent = Bent::new(start, if size > 0.0 { size } else { 1.0 }, self.hidden, &mut rng);
        let scaled = |(_, sample): &(usize, &&[f64])| bent.scaled(sample);
        let (judging, learning): (Vec<_>, Vec<_>) =
            samples.iter().enumerate().partition(|(i, _)| i % JUDGING == JUDGING - 1);
        let learning: Vec<f32> = learning.iter().flat_map(scaled).collect();
        let judging: Vec<f32> = judging.iter().flat_map(scaled).collect();
        bent.train(self, &learning, if judging.is_empty() { &learning } else { &judging }, &mut rng);
        Ok(Box::new(bent))
    }
}

/// The space of an autoencoder. Samples are scaled to `x = (sample - mean) / size`, so that a coordinate is about 1. Then
/// `z = C x + encoder(x)`, and the reconstruction is `C^T z + decoder(z)`, with the principal components `C`.
struct Bent {
    start: Synergy,
    size: f64,
    encoder: Mlp,
    decoder: Mlp,
}

/// What a step of the training writes into.
struct Workspace {
    encoder: MlpScratch,
    decoder: MlpScratch,
    numbers: Vec<f32>,
    error: Vec<f32>,
}

impl Bent {
    fn new(start: Synergy, size: f64, hidden: usize, rng: &mut impl Rng) -> Bent {
        let (k, n) = (start.n_components(), start.n_joints());
        let mut network = |inputs, outputs| {
            let mut network = Mlp::new(&[inputs, hidden, outputs], OutputActivation::Linear, rng);
            // The last layer begins at 0, so that the training starts from the principal components.
            let last = network.layers()[1].weight();
            network.parameters_mut()[last].fill(0.0);
            network
        };
        Bent { encoder: network(n, k), decoder: network(k, n), start, size }
    }

    fn scaled(&self, sample: &[f64]) -> Vec<f32> {
        sample.iter().zip(self.start.mean()).map(|(x, mean)| ((x - mean) / self.size) as f32).collect()
    }

    fn workspace(&self, batch: usize) -> Workspace {
        let (k, n) = (self.start.n_components(), self.start.n_joints());
        Workspace {
            encoder: self.encoder.scratch(batch),
            decoder: self.decoder.scratch(batch),
            numbers: vec![0.0; batch * k],
            error: vec![0.0; batch * n],
        }
    }

    /// (components: k x n) => the same in single precision
    fn components(&self) -> Vec<f32> {
        self.start.components().iter().map(|c| *c as f32).collect()
    }

    /// Reconstructs a batch of scaled samples; the workspace keeps their numbers and the error of each coordinate.
    fn reconstruct(&self, x: &[f32], components: &[f32], space: &mut Workspace) {
        let (k, n) = (self.start.n_components(), self.start.n_joints());
        let added = self.encoder.forward(Rows { data: x, stride: n }, &mut space.encoder);
        for ((z, x), added) in space.numbers.chunks_exact_mut(k).zip(x.chunks_exact(n)).zip(added.chunks_exact(k)) {
            for ((z, component), added) in z.iter_mut().zip(components.chunks_exact(n)).zip(added) {
                *z = added + dot(component, x);
            }
        }
        let bent = self.decoder.forward(Rows { data: &space.numbers, stride: k }, &mut space.decoder);
        let rows = space.error.chunks_exact_mut(n).zip(x.chunks_exact(n)).zip(bent.chunks_exact(n));
        for (((error, x), bent), z) in rows.zip(space.numbers.chunks_exact(k)) {
            error.iter_mut().zip(bent).zip(x).for_each(|((error, bent), x)| *error = bent - x);
            for (component, z) in components.chunks_exact(n).zip(z) {
                error.iter_mut().zip(component).for_each(|(error, c)| *error += z * c);
            }
        }
    }

    /// `learning` and `judging` are scaled samples, row by row.
    fn train(&mut self, settings: &Autoencoder, learning: &[f32], judging: &[f32], rng: &mut impl Rng) {
        let (k, n) = (self.start.n_components(), self.start.n_joints());
        let components = self.components();
        let batch = settings.batch.clamp(1, learning.len() / n);
        let mut space = self.workspace(batch);
        let mut judge = self.workspace(judging.len() / n);
        let mut optimisers =
            [&self.encoder, &self.decoder].map(|net| Adam::new(settings.learning_rate, net.parameters().len()));
        let mut gradients = [&self.encoder, &self.decoder].map(|net| vec![0.0; net.parameters().len()]);
        let mut of_numbers = vec![0.0; batch * k];
        let mut x = vec![0.0; batch * n];
        let mut best = (f32::INFINITY, self.encoder.clone(), self.decoder.clone());
        for step in 0..=settings.steps {
            if step % JUDGE_EVERY == 0 {
                self.reconstruct(judging, &components, &mut judge);
                let error = dot(&judge.error, &judge.error);
                if error < best.0 {
                    best = (error, self.encoder.clone(), self.decoder.clone());
                }
            }
            for row in x.chunks_exact_mut(n) {
                let chosen = rng.random_range(0..learning.len() / n);
                row.copy_from_slice(&learning[chosen * n..(chosen + 1) * n]);
            }
            self.reconstruct(&x, &components, &mut space);
            let Workspace { encoder, decoder, numbers, error } = &mut space;
            error.iter_mut().for_each(|error| *error /= batch as f32);
            let [of_encoder, of_decoder] = &mut gradients;
            let input = InputGradient { first: 0, out: &mut of_numbers };
            self.decoder.backward(Rows { data: numbers, stride: k }, error, decoder, Some(of_decoder), Some(input));
            for (gradient, error) in of_numbers.chunks_exact_mut(k).zip(error.chunks_exact(n)) {
                gradient.iter_mut().zip(components.chunks_exact(n)).for_each(|(g, c)| *g += dot(c, error));
            }
            self.encoder.backward(Rows { data: &x, stride: n }, &of_numbers, encoder, Some(of_encoder), None);
            let networks = [&mut self.encoder, &mut self.decoder];
            for ((network, optimiser), gradient) in networks.into_iter().zip(&mut optimisers).zip(&gradients) {
                optimiser.step(network.parameters_mut(), gradient, None);
            }
        }
        (_, self.encoder, self.decoder) = best;
    }
}

impl Reduction for Bent {
    fn encode(&self, sample: &[f64]) -> Vec<f64> {
        let mut space = self.workspace(1);
        self.reconstruct(&self.scaled(sample), &self.components(), &mut space);
        space.numbers.into_iter().map(f64::from).collect()
    }

    fn decode(&self, numbers: &[f64]) -> Vec<f64> {
        let z: Vec<f32> = numbers.iter().map(|z| *z as f32).collect();
        let mut scratch = self.decoder.scratch(1);
        let bent = self.decoder.forward(Rows { data: &z, stride: z.len() }, &mut scratch);
        let along: Vec<f64> = numbers.iter().map(|z| z * self.size).collect();
        let line = self.start.decode_unclamped(&along);
        line.iter().zip(bent).map(|(line, bent)| line + self.size * f64::from(*bent)).collect()
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pca;

    /// Samples on an arc in a plane, which one number tells apart, but no line does.
    fn arc(n: usize) -> Vec<Vec<f64>> {
        (0..n)
            .map(|i| {
                let angle = (i as f64 * 0.618).fract() * 3.0 - 1.5;
                vec![0.2 + angle.sin(), angle.cos(), 0.5]
            })
            .collect()
    }

    fn error(reduction: &dyn Reduction, samples: &[Vec<f64>]) -> f64 {
        let squared = |sample: &Vec<f64>| -> f64 {
            reduction.decode(&reduction.encode(sample)).iter().zip(sample).map(|(a, b)| (a - b).powi(2)).sum()
        };
        samples.iter().map(squared).sum::<f64>() / samples.len() as f64
    }

    #[test]
    fn one_number_follows_an_arc_that_no_line_follows() -> Result<(), SynergyError> {
        let samples = arc(400);
        let (learned, new) = samples.split_at(300);
        let rows: Vec<&[f64]> = learned.iter().map(Vec::as_slice).collect();
        let line = error(Pca.fit(&rows, 1)?.as_ref(), new);
        let bent = error(Autoencoder::default().fit(&rows, 1)?.as_ref(), new);
        assert!(line > 0.05 && bent < 0.1 * line, "line {line}, autoencoder {bent}");
        Ok(())
    }

    #[test]
    fn untrained_it_is_the_principal_space() -> Result<(), SynergyError> {
        let samples = arc(40);
        let rows: Vec<&[f64]> = samples.iter().map(Vec::as_slice).collect();
        let untrained = Autoencoder { steps: 0, ..Autoencoder::default() }.fit(&rows, 1)?;
        let line = Pca.fit(&rows, 1)?;
        let (a, b) = (untrained.decode(&untrained.encode(rows[3])), line.decode(&line.encode(rows[3])));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6), "{a:?} and {b:?}");
        Ok(())
    }

    #[test]
    fn two_samples_without_variation_are_no_fault() -> Result<(), SynergyError> {
        let same = [[0.3, 0.4].as_slice(), &[0.3, 0.4]];
        let flat = Autoencoder { steps: 10, ..Autoencoder::default() }.fit(&same, 1)?;
        assert!(flat.decode(&flat.encode(same[0])).iter().zip(same[0]).all(|(a, b)| (a - b).abs() < 1e-3));
        Ok(())
    }
}
