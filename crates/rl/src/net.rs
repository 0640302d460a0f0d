//! Fully connected networks: their values and gradients for a whole batch.

use rand::{Rng, RngExt};

use crate::elementwise;
use crate::gemm::gemm;
use crate::matrix::{Aligned, Matrix, MatrixMut, zeros};

/// The activation of the last layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputActivation {
    /// None.
    Linear,
    /// Hyperbolic tangent: outputs in (-1, 1).
    Tanh,
}

/// The place of one layer in the flat parameter vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerShape {
    /// Inputs of the layer.
    pub inputs: usize,
    /// Outputs of the layer.
    pub outputs: usize,
    /// Index of the first weight. The weights are `outputs x inputs`, row-major. The `outputs` biases follow them.
    pub offset: usize,
}

impl LayerShape {
    /// Returns the index range of the weights.
    pub fn weight(&self) -> std::ops::Range<usize> {
        self.offset..self.offset + self.outputs * self.inputs
    }

    /// Returns the index range of the biases.
    pub fn bias(&self) -> std::ops::Range<usize> {
        let start = self.weight().end;
        start..start + self.outputs
    }
}

/// Rows of a batch inside a larger row-major array.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// The array from the first value of the first row on.
    pub data: &'a [f32],
    /// Number of values from the start of a row to that of the next.
    pub stride: usize,
}

/// A request for the gradient with respect to `n` of the inputs.
#[derive(Debug)]
pub struct InputGradient<'a> {
    /// Index of the first of these inputs.
    pub first: usize,
    /// Receives `batch x n` values. Its length determines `n`.
    pub out: &'a mut [f32],
}

/// A multi-layer perceptron with rectified hidden layers. One flat vector holds all parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Mlp {
    layers: Vec<LayerShape>,
    output: OutputActivation,
    layer_norm: bool,
    parameters: Aligned,
}

/// Activations and gradients of a batch, allocated once for a network and a batch size.
#[derive(Clone, Debug)]
pub struct MlpScratch {
    batch: usize,
    activations: Vec<Aligned>,
    /// Results of layer normalisation for each hidden layer. Empty without it.
    normalized: Vec<Normalized>,
    delta: Aligned,
    next_delta: Aligned,
}

/// Rows of mean 0 and variance 1, as they are before rectification.
#[derive(Clone, Debug)]
struct Normalized {
    values: Aligned,
    /// The inverse of each row's standard deviation before it was normalised.
    inverse_std: Vec<f32>,
}

impl MlpScratch {
    /// Returns the outputs of the last forward pass: `batch x outputs`.
    pub fn output(&self) -> &[f32] {
        // A network has at least one layer, see `Mlp::zeros`.
        &self.activations[self.activations.len() - 1]
    }
}

impl Mlp {
    /// Makes a network with random weights from the uniform distribution of Glorot and Bengio. Its biases are zero.
    ///
    /// # Shapes
    /// `sizes`: inputs, hidden widths, outputs.
    ///
    /// # Source
    /// Glorot and Bengio 2010, equation 16; OpenAI baselines HER, `util.nn`.
    ///
    /// # Panics
    /// If `sizes` has fewer than two entries, or one of them is 0.
    pub fn new(sizes: &[usize], output: OutputActivation, rng: &mut impl Rng) -> Self {
        let mut net = Self::zeros(sizes, output);
        for layer in &net.layers {
            let limit = (6.0 / (layer.inputs + layer.outputs) as f32).sqrt();
            for w in &mut net.parameters[layer.weight()] {
                *w = rng.random_range(-limit..limit);
            }
        }
        net
    }

    /// Splits the last input off: returns a network without it, which gives the outputs for 0 at that input, and the weights
    /// with which the units of the first layer read it.
    ///
    /// # Panics
    /// If there is only one input.
    pub(crate) fn without_last_input(&self) -> (Mlp, Vec<f32>) {
        let first = self.layers[0];
        let sizes: Vec<usize> =
            std::iter::once(first.inputs - 1).chain(self.layers.iter().map(|layer| layer.outputs)).collect();
        let mut net = Mlp { layer_norm: self.layer_norm, ..Self::zeros(&sizes, self.output) };
        let weights = &self.parameters[first.weight()];
        let last = weights.chunks_exact(first.inputs).map(|row| row[first.inputs - 1]).collect();
        let kept = net.layers[0].weight();
        let rows = net.parameters[kept].chunks_exact_mut(first.inputs - 1);
        rows.zip(weights.chunks_exact(first.inputs)).for_each(|(to, from)| to.copy_from_slice(&from[..to.len()]));
        let (to, from) = (net.layers[0].bias().start, first.bias().start);
        net.parameters[to..].copy_from_slice(&self.parameters[from..]);
        (net, last)
    }

    /// Makes a network whose parameters are all zero.
    ///
    /// # Panics
    /// If `sizes` has fewer than two entries, or one of them is 0.
    pub fn zeros(sizes: &[usize], output: OutputActivation) -> Self {
        assert!(sizes.len() >= 2 && sizes.iter().all(|&n| n > 0), "a network needs inputs and outputs, got {sizes:?}");
        let mut layers = Vec::with_capacity(sizes.len() - 1);
        let mut offset = 0;
        for pair in sizes.windows(2) {
            let layer = LayerShape { inputs: pair[0], outputs: pair[1], offset };
            offset = layer.bias().end;
            layers.push(layer);
        }
        Self { layers, output, layer_norm: false, parameters: zeros(offset) }
    }

    /// Adds layer normalisation before the rectification of each hidden layer. It has no gain and no bias of its own.
    ///
    /// # Source
    /// Ba, Kiros and Hinton 2016; in critics: Hiraoka et al. 2022 (DroQ) and Ball et al. 2023 (RLPD).
    pub fn with_layer_norm(mut self) -> Self {
        self.layer_norm = true;
        self
    }

    /// Allocates scratch for `batch` rows.
    pub fn scratch(&self, batch: usize) -> MlpScratch {
        let widest = self.layers.iter().map(|l| l.outputs).max().unwrap_or(0);
        MlpScratch {
            batch,
            activations: self.layers.iter().map(|l| zeros(batch * l.outputs)).collect(),
            normalized: self.layers[..if self.layer_norm { self.layers.len() - 1 } else { 0 }]
                .iter()
                .map(|l| Normalized { values: zeros(batch * l.outputs), inverse_std: vec![0.0; batch] })
                .collect(),
            delta: zeros(batch * widest),
            next_delta: zeros(batch * widest),
        }
    }

    /// Returns the layers, first to last.
    pub fn layers(&self) -> &[LayerShape] {
        &self.layers
    }

    /// Returns the number of inputs.
    pub(crate) fn inputs(&self) -> usize {
        self.layers[0].inputs
    }

    /// Returns the number of outputs.
    pub(crate) fn outputs(&self) -> usize {
        self.layers[self.layers.len() - 1].outputs
    }

    /// Returns all parameters. [`LayerShape`] tells their order.
    pub fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    /// Returns all parameters, to be changed.
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }

    /// Computes the outputs of a batch: `(x: batch x inputs) => output: batch x outputs`. The scratch keeps them and the
    /// activations, for [`backward`](Self::backward).
    ///
    /// # Panics
    /// If `x` holds fewer rows than the scratch, or the scratch was made by another network.
    pub fn forward<'s>(&self, x: Rows<'_>, scratch: &'s mut MlpScratch) -> &'s [f32] {
        let batch = scratch.batch;
        let last = self.layers.len() - 1;
        for (i, layer) in self.layers.iter().enumerate() {
            let (before, from) = scratch.activations.split_at_mut(i);
            let input = match before.last() {
                Some(hidden) => Matrix::new(hidden, batch, layer.inputs),
                None => Matrix::strided(x.data, batch, layer.inputs, x.stride),
            };
            let out = &mut from[0];
            let weight = Matrix::new(&self.parameters[layer.weight()], layer.outputs, layer.inputs);
            let bias = &self.parameters[layer.bias()];
            gemm(MatrixMut::new(out, batch, layer.outputs), input, weight.t());
            if i < last && self.layer_norm {
                let Normalized { values, inverse_std } = &mut scratch.normalized[i];
                elementwise::bias_norm_relu(out, bias, values, inverse_std);
            } else {
                self.activate(i, bias, out);
            }
        }
        scratch.output()
    }

    /// Computes the gradients with respect to the parameters, the inputs, or both, from that with respect to the outputs of
    /// the last [`forward`](Self::forward).
    ///
    /// # Shapes
    /// `x`: the rows that `forward` was given. `output_gradient`: batch x outputs. `parameter_gradient`: as long as
    /// [`parameters`](Self::parameters), overwritten. `input_gradient`: see [`InputGradient`].
    ///
    /// # Panics
    /// If a length does not fit.
    pub fn backward(
        &self,
        x: Rows<'_>,
        output_gradient: &[f32],
        scratch: &mut MlpScratch,
        mut parameter_gradient: Option<&mut [f32]>,
        input_gradient: Option<InputGradient<'_>>,
    ) {
        let MlpScratch { batch, activations, normalized, delta, next_delta } = scratch;
        let batch = *batch;
        let last = self.layers.len() - 1;
        let n_out = batch * self.outputs();
        assert_eq!(output_gradient.len(), n_out, "output gradient and batch differ in length");
        match self.output {
            OutputActivation::Linear => delta[..n_out].copy_from_slice(output_gradient),
            OutputActivation::Tanh => {
                elementwise::tanh_gradient(&mut delta[..n_out], output_gradient, &activations[last])
            }
        }
        if let Some(gradient) = parameter_gradient.as_deref_mut() {
            elementwise::row_sum(&delta[..n_out], &mut gradient[self.layers[last].bias()]);
        }
        for (i, layer) in self.layers.iter().enumerate().rev() {
            let d = Matrix::new(&delta[..batch * layer.outputs], batch, layer.outputs);
            if let Some(gradient) = parameter_gradient.as_deref_mut() {
                let input = match i.checked_sub(1) {
                    Some(below) => Matrix::new(&activations[below], batch, layer.inputs),
                    None => Matrix::strided(x.data, batch, layer.inputs, x.stride),
                };
                let out = MatrixMut::new(&mut gradient[layer.weight()], layer.outputs, layer.inputs);
                gemm(out, d.t(), input);
            }
            let Some(below) = i.checked_sub(1) else { break };
            let weight = Matrix::new(&self.parameters[layer.weight()], layer.outputs, layer.inputs);
            let next = &mut next_delta[..batch * layer.inputs];
            gemm(MatrixMut::new(next, batch, layer.inputs), d, weight);
            if self.layer_norm {
                let Normalized { values, inverse_std } = &normalized[below];
                elementwise::norm_relu_gradient(next, values, inverse_std);
            } else {
                elementwise::relu_gradient(next, &activations[below]);
            }
            if let Some(gradient) = parameter_gradient.as_deref_mut() {
                elementwise::row_sum(next, &mut gradient[self.layers[below].bias()]);
            }
            std::mem::swap(delta, next_delta);
        }
        if let Some(InputGradient { first, out }) = input_gradient {
            let layer = self.layers[0];
            let n = out.len() / batch;
            let d = Matrix::new(&delta[..batch * layer.outputs], batch, layer.outputs);
            let weight = &self.parameters[layer.weight()][first..];
            let columns = Matrix::strided(weight, layer.outputs, n, layer.inputs);
            gemm(MatrixMut::new(out, batch, n), d, columns);
        }
    }

    /// Computes the outputs of one row: `(x: inputs) => out: outputs`. The network must not have layer normalisation.
    ///
    /// # Shapes
    /// `buffers`: two slices, each at least as long as the widest hidden layer.
    ///
    /// # Panics
    /// If a slice is too short, or the network has layer normalisation.
    pub(crate) fn forward_row(&self, x: &[f32], buffers: [&mut [f32]; 2], out: &mut [f32]) {
        assert!(!self.layer_norm, "a single row is for networks without layer normalisation");
        let last = self.layers.len() - 1;
        let [mut from, mut to] = buffers;
        for (i, layer) in self.layers.iter().enumerate() {
            let weight = &self.parameters[layer.weight()];
            let bias = &self.parameters[layer.bias()];
            let input = if i == 0 { &x[..layer.inputs] } else { &from[..layer.inputs] };
            let result = if i == last { &mut out[..layer.outputs] } else { &mut to[..layer.outputs] };
            elementwise::gemv(weight, input, result);
            self.activate(i, bias, result);
            std::mem::swap(&mut from, &mut to);
        }
    }

    /// Adds the bias to rows of a layer without normalisation and applies its activation.
    fn activate(&self, layer: usize, bias: &[f32], rows: &mut [f32]) {
        match self.output {
            _ if layer + 1 < self.layers.len() => elementwise::bias_relu(rows, bias),
            OutputActivation::Linear => elementwise::bias(rows, bias),
            OutputActivation::Tanh => elementwise::bias_tanh(rows, bias),
        }
    }
}
