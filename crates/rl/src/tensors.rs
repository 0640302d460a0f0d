//! Named tensors in memory, and their safetensors bytes.

use std::borrow::Cow;
use std::collections::BTreeMap;

use safetensors::tensor::{Dtype, SafeTensors, View};

use crate::{LayerShape, Mlp, RlError};

/// The values of a tensor.
#[derive(Clone, Debug, PartialEq)]
pub enum TensorData {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 64-bit floats.
    F64(Vec<f64>),
    /// Unsigned 64-bit integers.
    U64(Vec<u64>),
}

/// A dense tensor, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Size along each axis.
    pub shape: Vec<usize>,
    /// Values, as many as the product of the shape.
    pub data: TensorData,
}

impl Tensor {
    /// Makes a tensor of 32-bit floats.
    pub fn f32(shape: Vec<usize>, values: Vec<f32>) -> Self {
        Self { shape, data: TensorData::F32(values) }
    }

    /// Makes a vector of 64-bit floats.
    pub fn f64(values: Vec<f64>) -> Self {
        Self { shape: vec![values.len()], data: TensorData::F64(values) }
    }

    /// Makes a tensor of one unsigned integer.
    pub fn u64(value: u64) -> Self {
        Self { shape: vec![1], data: TensorData::U64(vec![value]) }
    }

    fn n_values(&self) -> usize {
        match &self.data {
            TensorData::F32(values) => values.len(),
            TensorData::F64(values) => values.len(),
            TensorData::U64(values) => values.len(),
        }
    }

    fn type_name(&self) -> &'static str {
        match self.data {
            TensorData::F32(_) => "F32",
            TensorData::F64(_) => "F64",
            TensorData::U64(_) => "U64",
        }
    }
}

impl View for &Tensor {
    fn dtype(&self) -> Dtype {
        match self.data {
            TensorData::F32(_) => Dtype::F32,
            TensorData::F64(_) => Dtype::F64,
            TensorData::U64(_) => Dtype::U64,
        }
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Owned(match &self.data {
            TensorData::F32(values) => values.iter().flat_map(|x| x.to_le_bytes()).collect(),
            TensorData::F64(values) => values.iter().flat_map(|x| x.to_le_bytes()).collect(),
            TensorData::U64(values) => values.iter().flat_map(|x| x.to_le_bytes()).collect(),
        })
    }

    fn data_len(&self) -> usize {
        match &self.data {
            TensorData::F32(values) => size_of_val(values.as_slice()),
            TensorData::F64(values) => size_of_val(values.as_slice()),
            TensorData::U64(values) => size_of_val(values.as_slice()),
        }
    }
}

/// Tensors by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TensorMap {
    tensors: BTreeMap<String, Tensor>,
}

impl TensorMap {
    /// Adds a tensor. It replaces one of the same name.
    pub fn insert(&mut self, name: impl Into<String>, tensor: Tensor) {
        self.tensors.insert(name.into(), tensor);
    }

    /// Returns a tensor.
    ///
    /// # Errors
    /// [`RlError::TensorMissing`].
    pub fn get(&self, name: &str) -> Result<&Tensor, RlError> {
        self.tensors.get(name).ok_or_else(|| RlError::TensorMissing { name: name.to_owned() })
    }

    /// Returns names and tensors, sorted by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.tensors.iter().map(|(name, tensor)| (name.as_str(), tensor))
    }

    /// Returns the 32-bit floats of a tensor of a given shape.
    ///
    /// # Errors
    /// [`RlError::TensorMissing`], [`RlError::TensorShape`] or [`RlError::TensorType`].
    pub fn f32s(&self, name: &str, shape: &[usize]) -> Result<&[f32], RlError> {
        match self.shaped(name, shape)? {
            Tensor { data: TensorData::F32(values), .. } => Ok(values),
            other => Err(wrong_type(name, "F32", other)),
        }
    }

    /// Returns the 64-bit floats of a tensor of a given shape.
    ///
    /// # Errors
    /// As [`f32s`](Self::f32s).
    pub fn f64s(&self, name: &str, shape: &[usize]) -> Result<&[f64], RlError> {
        match self.shaped(name, shape)? {
            Tensor { data: TensorData::F64(values), .. } => Ok(values),
            other => Err(wrong_type(name, "F64", other)),
        }
    }

    /// Returns the integer of a tensor that holds one.
    ///
    /// # Errors
    /// As [`f32s`](Self::f32s).
    pub fn u64(&self, name: &str) -> Result<u64, RlError> {
        match self.shaped(name, &[1])? {
            Tensor { data: TensorData::U64(values), .. } => Ok(values[0]),
            other => Err(wrong_type(name, "U64", other)),
        }
    }

    /// Writes the safetensors format.
    ///
    /// # Errors
    /// [`RlError::Format`] if a tensor has more or fewer values than its shape.
    pub fn save_bytes(&self) -> Result<Vec<u8>, RlError> {
        safetensors::serialize(self.iter(), None).map_err(RlError::Format)
    }

    /// Reads the safetensors format.
    ///
    /// # Errors
    /// [`RlError::Format`] if the bytes are in another format or incomplete. [`RlError::TensorType`] for an element type that
    /// this crate does not write.
    pub fn load_bytes(bytes: &[u8]) -> Result<Self, RlError> {
        let file = SafeTensors::deserialize(bytes).map_err(RlError::Format)?;
        let mut tensors = BTreeMap::new();
        for (name, view) in file.iter() {
            let bytes = view.data();
            let data = match view.dtype() {
                Dtype::F32 => TensorData::F32(numbers(bytes, f32::from_le_bytes)),
                Dtype::F64 => TensorData::F64(numbers(bytes, f64::from_le_bytes)),
                Dtype::U64 => TensorData::U64(numbers(bytes, u64::from_le_bytes)),
                other => {
                    let (name, got) = (name.to_owned(), format!("{other:?}"));
                    return Err(RlError::TensorType { name, expected: "F32, F64 or U64", got });
                }
            };
            tensors.insert(name.to_owned(), Tensor { shape: view.shape().to_vec(), data });
        }
        Ok(Self { tensors })
    }

    /// Adds a network as `{prefix}.{i}.weight` (outputs x inputs, row-major) and `{prefix}.{i}.bias`.
    pub(crate) fn insert_network(&mut self, prefix: &str, net: &Mlp) {
        self.insert_layers(prefix, net, net.parameters());
    }

    /// As [`insert_network`](Self::insert_network), for a vector in the order of the network's parameters.
    pub(crate) fn insert_layers(&mut self, prefix: &str, net: &Mlp, flat: &[f32]) {
        for (i, layer) in net.layers().iter().enumerate() {
            let weight = Tensor::f32(vec![layer.outputs, layer.inputs], flat[layer.weight()].to_vec());
            self.insert(format!("{prefix}.{i}.weight"), weight);
            self.insert(format!("{prefix}.{i}.bias"), Tensor::f32(vec![layer.outputs], flat[layer.bias()].to_vec()));
        }
    }

    /// Reads the tensors that [`insert_network`](Self::insert_network) added.
    pub(crate) fn read_network(&self, prefix: &str, net: &mut Mlp) -> Result<(), RlError> {
        let layers = net.layers().to_vec();
        self.read_layers(prefix, &layers, net.parameters_mut())
    }

    /// Reads the tensors that [`insert_layers`](Self::insert_layers) added.
    pub(crate) fn read_layers(&self, prefix: &str, layers: &[LayerShape], flat: &mut [f32]) -> Result<(), RlError> {
        for (i, layer) in layers.iter().enumerate() {
            let weight = self.finite(&format!("{prefix}.{i}.weight"), &[layer.outputs, layer.inputs])?;
            flat[layer.weight()].copy_from_slice(weight);
            flat[layer.bias()].copy_from_slice(self.finite(&format!("{prefix}.{i}.bias"), &[layer.outputs])?);
        }
        Ok(())
    }

    fn finite(&self, name: &str, shape: &[usize]) -> Result<&[f32], RlError> {
        let values = self.f32s(name, shape)?;
        match values.iter().find(|x| !x.is_finite()) {
            Some(got) => {
                let (name, got) = (name.to_owned(), got.to_string());
                Err(RlError::TensorValue { name, expected: "finite numbers", got })
            }
            None => Ok(values),
        }
    }

    fn shaped(&self, name: &str, shape: &[usize]) -> Result<&Tensor, RlError> {
        let tensor = self.get(name)?;
        let fault = |got| RlError::TensorShape { name: name.to_owned(), expected: shape.to_vec(), got };
        if tensor.shape != shape {
            return Err(fault(tensor.shape.clone()));
        }
        if tensor.n_values() != shape.iter().product::<usize>() {
            return Err(fault(vec![tensor.n_values()]));
        }
        Ok(tensor)
    }
}

fn wrong_type(name: &str, expected: &'static str, got: &Tensor) -> RlError {
    RlError::TensorType { name: name.to_owned(), expected, got: got.type_name().to_owned() }
}

fn numbers<T, const N: usize>(bytes: &[u8], read: impl Fn([u8; N]) -> T) -> Vec<T> {
    let (words, _) = bytes.as_chunks::<N>();
    words.iter().map(|word| read(*word)).collect()
}
