//! The bytes of an event file: protocol buffers in the record format of TensorFlow.
//!
//! # Source
//! `tensorflow/core/util/event.proto`, `summary.proto`, and `record_writer.h` for the frame around each message;
//! `tensorboard/plugins/hparams/plugin_data.proto` and `google/protobuf/struct.proto` for the settings.

use std::collections::BTreeMap;

use crc::{CRC_32_ISCSI, Crc};
use prost::{Message, Oneof};

/// The cyclic redundancy check that the frames use, CRC-32C.
const CRC32C: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);
/// Added to a rotated checksum, because a checksum over data with checksums in it is weak otherwise.
const MASK: u32 = 0xa282_ead8;
const MASK_ROTATION: u32 = 15;

/// `tensorflow.Event`, without the fields that no run needs.
#[derive(Clone, PartialEq, Message)]
pub struct Event {
    /// Seconds since 1970-01-01 UTC.
    #[prost(double, tag = "1")]
    pub wall_time: f64,
    /// Position on the horizontal axis.
    #[prost(int64, tag = "2")]
    pub step: i64,
    /// Version of the format; only in the first event of a file.
    #[prost(string, optional, tag = "3")]
    pub file_version: Option<String>,
    /// Values of this step.
    #[prost(message, optional, tag = "5")]
    pub summary: Option<Summary>,
}

/// `tensorflow.Summary`.
#[derive(Clone, PartialEq, Message)]
pub struct Summary {
    /// The values.
    #[prost(message, repeated, tag = "1")]
    pub value: Vec<Value>,
}

/// `tensorflow.Summary.Value` of a scalar, a picture, or a plugin's data.
#[derive(Clone, PartialEq, Message)]
pub struct Value {
    /// Name of the curve; the part before a `/` is the name of its group.
    #[prost(string, tag = "1")]
    pub tag: String,
    /// The value.
    #[prost(float, optional, tag = "2")]
    pub simple_value: Option<f32>,
    /// The picture.
    #[prost(message, optional, tag = "4")]
    pub image: Option<Image>,
    /// What a plugin reads.
    #[prost(message, optional, tag = "9")]
    pub metadata: Option<Metadata>,
}

/// `tensorflow.Summary.Image`.
#[derive(Clone, PartialEq, Message)]
pub struct Image {
    /// Height in pixels.
    #[prost(int32, tag = "1")]
    pub height: i32,
    /// Width in pixels.
    #[prost(int32, tag = "2")]
    pub width: i32,
    /// Number of channels: 3 for colours, 4 with transparency.
    #[prost(int32, tag = "3")]
    pub colorspace: i32,
    /// The bytes of a PNG file.
    #[prost(bytes = "vec", tag = "4")]
    pub encoded: Vec<u8>,
}

/// `tensorflow.SummaryMetadata`.
#[derive(Clone, PartialEq, Message)]
pub struct Metadata {
    /// The plugin and its data.
    #[prost(message, optional, tag = "1")]
    pub plugin_data: Option<PluginData>,
}

/// `tensorflow.SummaryMetadata.PluginData`.
#[derive(Clone, PartialEq, Message)]
pub struct PluginData {
    /// Name of the plugin.
    #[prost(string, tag = "1")]
    pub plugin_name: String,
    /// A message of the plugin's own, encoded.
    #[prost(bytes = "vec", tag = "2")]
    pub content: Vec<u8>,
}

/// `tensorboard.hparams.HParamsPluginData` at the start of a run.
#[derive(Clone, PartialEq, Message)]
pub struct Hparams {
    /// Its settings.
    #[prost(message, optional, tag = "3")]
    pub session_start_info: Option<SessionStart>,
}

/// `tensorboard.hparams.SessionStartInfo`.
#[derive(Clone, PartialEq, Message)]
pub struct SessionStart {
    /// Settings by their names.
    #[prost(btree_map = "string, message", tag = "1")]
    pub hparams: BTreeMap<String, Setting>,
    /// Seconds since 1970-01-01 UTC.
    #[prost(double, tag = "5")]
    pub start_time_secs: f64,
}

/// `google.protobuf.Value`.
#[derive(Clone, PartialEq, Message)]
pub struct Setting {
    /// The value.
    #[prost(oneof = "SettingValue", tags = "2, 3, 4")]
    pub value: Option<SettingValue>,
}

/// The kinds of `google.protobuf.Value` that a setting can have.
#[derive(Clone, PartialEq, Oneof)]
pub enum SettingValue {
    /// A number.
    #[prost(double, tag = "2")]
    Number(f64),
    /// A text.
    #[prost(string, tag = "3")]
    Text(String),
    /// A truth value.
    #[prost(bool, tag = "4")]
    Bool(bool),
}

/// Appends an event in its frame: length, checksum of the length, message, checksum of the message.
pub fn write_event(out: &mut Vec<u8>, event: &Event) {
    let message = event.encode_to_vec();
    let length = (message.len() as u64).to_le_bytes();
    out.extend(length);
    out.extend(masked_crc(&length).to_le_bytes());
    out.extend(&message);
    out.extend(masked_crc(&message).to_le_bytes());
}

fn masked_crc(bytes: &[u8]) -> u32 {
    CRC32C.checksum(bytes).rotate_right(MASK_ROTATION).wrapping_add(MASK)
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Reads every event of a file; checksums and messages have to be sound up to its last byte.
    pub fn read_events(mut bytes: &[u8]) -> Vec<Event> {
        let mut events = Vec::new();
        while !bytes.is_empty() {
            let (length, rest) = bytes.split_first_chunk::<8>().expect("a length");
            let (crc, rest) = rest.split_first_chunk::<4>().expect("a checksum");
            assert_eq!(u32::from_le_bytes(*crc), masked_crc(length));
            let (message, rest) = rest.split_at(u64::from_le_bytes(*length) as usize);
            let (crc, rest) = rest.split_first_chunk::<4>().expect("a checksum");
            assert_eq!(u32::from_le_bytes(*crc), masked_crc(message));
            events.push(Event::decode(message).expect("a message"));
            bytes = rest;
        }
        events
    }

    #[test]
    fn events_have_the_bytes_that_the_python_package_writes() {
        let version = Event { wall_time: 1.5e9, file_version: Some("brain.Event:2".to_owned()), ..Event::default() };
        let value = Value { tag: "a/b".to_owned(), simple_value: Some(0.25), ..Value::default() };
        let scalar =
            Event { wall_time: 1.5e9, step: 200, summary: Some(Summary { value: vec![value] }), ..Event::default() };
        let mut bytes = Vec::new();
        write_event(&mut bytes, &version);
        write_event(&mut bytes, &scalar);
        // Written by tensorboard 2.21.0: RecordWriter.write(Event(...).SerializeToString()).
        let expected = "1800000000000000a37f4b2209000000c00b5ad6411a0d627261696e2e4576656e743a324ca9a464\
                        1a00000000000000129bd82d09000000c00b5ad64110c8012a0c0a0a0a03612f62150000803ed235d391";
        let written: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(written, expected);
        assert_eq!(read_events(&bytes), [version, scalar]);
    }
}
