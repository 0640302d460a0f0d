//! `policy.onnx`: a policy, with the normalisation of its inputs, as a graph that ONNX runtimes compute.
//!
//! Inputs are `observation` (batch x n) and `goal` (batch x m), the output is `action` (batch x actuators), all float32.
//!
//! # Source
//! `onnx/onnx.proto3` and the operators of version 13 of the ONNX standard.

use eigenhand_rl::{NormalizerConfig, Policy, RlError, Tensor, TensorData, TensorMap};
use prost::Message;

/// Versions of the file format and of the operators: old enough for every runtime of the last years.
const IR_VERSION: i64 = 8;
const OPERATORS: i64 = 13;
/// `TensorProto.DataType.FLOAT`, and the kind of an attribute that is an integer.
const FLOAT: i32 = 1;
const INTEGER: i32 = 2;

/// `onnx.ModelProto`, as far as it is needed; so are the messages below.
#[derive(Clone, PartialEq, Message)]
struct Model {
    #[prost(int64, tag = "1")]
    ir_version: i64,
    #[prost(string, tag = "2")]
    producer_name: String,
    #[prost(string, tag = "3")]
    producer_version: String,
    #[prost(string, tag = "6")]
    doc_string: String,
    #[prost(message, optional, tag = "7")]
    graph: Option<Graph>,
    #[prost(message, repeated, tag = "8")]
    opset_import: Vec<OperatorSet>,
}

#[derive(Clone, PartialEq, Message)]
struct OperatorSet {
    #[prost(string, tag = "1")]
    domain: String,
    #[prost(int64, tag = "2")]
    version: i64,
}

#[derive(Clone, PartialEq, Message)]
struct Graph {
    #[prost(message, repeated, tag = "1")]
    node: Vec<Node>,
    #[prost(string, tag = "2")]
    name: String,
    #[prost(message, repeated, tag = "5")]
    initializer: Vec<Constant>,
    #[prost(message, repeated, tag = "11")]
    input: Vec<ValueInfo>,
    #[prost(message, repeated, tag = "12")]
    output: Vec<ValueInfo>,
}

#[derive(Clone, PartialEq, Message)]
struct Node {
    #[prost(string, repeated, tag = "1")]
    input: Vec<String>,
    #[prost(string, repeated, tag = "2")]
    output: Vec<String>,
    #[prost(string, tag = "4")]
    op_type: String,
    #[prost(message, repeated, tag = "5")]
    attribute: Vec<Attribute>,
}

#[derive(Clone, PartialEq, Message)]
struct Attribute {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(int64, tag = "3")]
    i: i64,
    #[prost(int32, tag = "20")]
    kind: i32,
}

/// `onnx.TensorProto`.
#[derive(Clone, PartialEq, Message)]
struct Constant {
    #[prost(int64, repeated, tag = "1")]
    dims: Vec<i64>,
    #[prost(int32, tag = "2")]
    data_type: i32,
    #[prost(string, tag = "8")]
    name: String,
    #[prost(bytes = "vec", tag = "9")]
    raw_data: Vec<u8>,
}

#[derive(Clone, PartialEq, Message)]
struct ValueInfo {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, optional, tag = "2")]
    kind: Option<ValueType>,
}

#[derive(Clone, PartialEq, Message)]
struct ValueType {
    #[prost(message, optional, tag = "1")]
    tensor: Option<TensorType>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorType {
    #[prost(int32, tag = "1")]
    elem_type: i32,
    #[prost(message, optional, tag = "2")]
    shape: Option<Shape>,
}

#[derive(Clone, PartialEq, Message)]
struct Shape {
    #[prost(message, repeated, tag = "1")]
    dim: Vec<Dimension>,
}

/// `onnx.TensorShapeProto.Dimension`: one of the two.
#[derive(Clone, PartialEq, Message)]
struct Dimension {
    #[prost(int64, optional, tag = "1")]
    value: Option<i64>,
    #[prost(string, optional, tag = "2")]
    parameter: Option<String>,
}

/// (policy, limits of its inputs, name of the hand, version of this program) => the bytes of the file
pub fn graph(policy: &Policy, clip: &NormalizerConfig, hand: &str, version: &str) -> Result<Vec<u8>, RlError> {
    let tensors = policy.export_tensors();
    let mut graph = Builder { tensors, nodes: Vec::new(), constants: Vec::new() };
    for (name, value) in [("raw_clip", clip.raw_clip), ("norm_clip", clip.norm_clip), ("one", 1.0)] {
        graph.constant(name, &[], &[value]);
        graph.constant(&format!("minus_{name}"), &[], &[-value]);
    }
    for name in ["observation", "goal"] {
        for part in ["mean", "std"] {
            graph.tensor(&format!("{name}.{part}"))?;
        }
        graph.clip(name, "raw_clip", &format!("{name}.raw"));
        graph.node("Sub", [format!("{name}.raw"), format!("{name}.mean")], &format!("{name}.centred"), None);
        graph.node("Div", [format!("{name}.centred"), format!("{name}.std")], &format!("{name}.scaled"), None);
        graph.clip(&format!("{name}.scaled"), "norm_clip", &format!("{name}.normalised"));
    }
    graph.node("Concat", ["observation.normalised", "goal.normalised"], "layer.0", Some(("axis", 1)));
    let n_layers =
        graph.tensors.iter().filter(|(name, _)| name.starts_with("actor.") && name.ends_with(".bias")).count();
    for i in 0..n_layers {
        let (weight, bias) = (format!("actor.{i}.weight"), format!("actor.{i}.bias"));
        graph.tensor(&weight)?;
        graph.tensor(&bias)?;
        graph.node("Gemm", [format!("layer.{i}"), weight, bias], &format!("sum.{i}"), Some(("transB", 1)));
        let activation = if i + 1 == n_layers { "Tanh" } else { "Relu" };
        graph.node(activation, [format!("sum.{i}")], &format!("layer.{}", i + 1), None);
    }
    let mut output = format!("layer.{n_layers}");
    if policy.map().is_some() {
        graph.tensor("action.matrix")?;
        graph.tensor("action.offset")?;
        let inputs = [output, "action.matrix".to_owned(), "action.offset".to_owned()];
        graph.node("Gemm", inputs, "mapped", Some(("transB", 1)));
        output = "mapped".to_owned();
    }
    graph.clip(&output, "one", "action");
    let value = |name: &str, width: usize| {
        let dim = vec![
            Dimension { value: None, parameter: Some("batch".to_owned()) },
            Dimension { value: Some(width as i64), parameter: None },
        ];
        let tensor = TensorType { elem_type: FLOAT, shape: Some(Shape { dim }) };
        ValueInfo { name: name.to_owned(), kind: Some(ValueType { tensor: Some(tensor) }) }
    };
    let model = Model {
        ir_version: IR_VERSION,
        producer_name: "eigenhand".to_owned(),
        producer_version: version.to_owned(),
        doc_string: format!(
            "Grasping policy of the hand {hand}: observation and goal in, action in [-1, 1] for each actuator out. \
             policy.toml names every number."
        ),
        graph: Some(Graph {
            node: graph.nodes,
            name: "policy".to_owned(),
            initializer: graph.constants,
            input: vec![value("observation", policy.obs_dim()), value("goal", policy.goal_dim())],
            output: vec![value("action", policy.act_dim())],
        }),
        opset_import: vec![OperatorSet { domain: String::new(), version: OPERATORS }],
    };
    Ok(model.encode_to_vec())
}

struct Builder {
    tensors: TensorMap,
    nodes: Vec<Node>,
    constants: Vec<Constant>,
}

impl Builder {
    fn constant(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        let dims = shape.iter().map(|&n| n as i64).collect();
        let raw_data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constants.push(Constant { dims, data_type: FLOAT, name: name.to_owned(), raw_data });
    }

    /// Adds one of the policy's tensors as a constant.
    fn tensor(&mut self, name: &str) -> Result<(), RlError> {
        let Tensor { shape, data } = self.tensors.get(name)?.clone();
        let values = match data {
            TensorData::F32(values) => values,
            TensorData::F64(values) => values.into_iter().map(|value| value as f32).collect(),
            TensorData::U64(values) => values.into_iter().map(|value| value as f32).collect(),
        };
        self.constant(name, &shape, &values);
        Ok(())
    }

    fn node<S: Into<String>>(
        &mut self,
        operator: &str,
        inputs: impl IntoIterator<Item = S>,
        output: &str,
        attribute: Option<(&str, i64)>,
    ) {
        let attribute = attribute.map(|(name, i)| Attribute { name: name.to_owned(), i, kind: INTEGER });
        self.nodes.push(Node {
            input: inputs.into_iter().map(Into::into).collect(),
            output: vec![output.to_owned()],
            op_type: operator.to_owned(),
            attribute: attribute.into_iter().collect(),
        });
    }

    /// Limits a value to a constant's number, up and down.
    fn clip(&mut self, input: &str, limit: &str, output: &str) {
        self.node("Clip", [input, &format!("minus_{limit}"), limit], output, None);
    }
}
