//! Robot hands as data: the manifest of a hand, its model file, and the registry that finds hands by name.
//!
//! A hand is a directory with a `hand.toml` ([`HandManifest`]) and a MuJoCo model that loads by itself. [`Hand::load`]
//! reads both, resolves every name and range, and computes a digest over the hand's files. [`import()`] reads MJCF and
//! URDF as makers publish them. [`Registry`] finds hands by name, including compiled plugins, whose libraries generate
//! a hand's files. This crate does not need MuJoCo and contains no particular hand.
#![deny(unsafe_code)]

mod actuation;
mod additions;
mod compiled;
mod error;
mod fingers;
mod hand;
mod import;
mod load;
mod manifest;
mod mjcf;
mod model;
mod notes;
mod parts;
mod registry;
mod resolve;
mod schema;
mod servo;
mod sources;
mod summary;
pub mod xml;

pub use compiled::{SIDECAR_FILE, SIDECAR_KEYS, serve_plugins};
pub use eigenhand_posture::{ActuationMap, JointInfo, Unit};
pub use error::HandError;
pub use hand::Hand;
pub use import::{ImportOptions, Imported, import};
pub use manifest::{
    AddedActuator, AddedCoupling, ContactBits, HandManifest, MANIFEST_FILE, ModelFormat, Mount, Objects, SCHEMA,
    ScriptedGrasps, Slide, is_hand_name,
};
pub use mjcf::{AngleUnit, Compiler};
pub use parts::{Fingertip, FrameKind, HandActuator, HandCoupling, HandJoint, Servo, Transmission};
pub use registry::{PLUGINS_VARIABLE, Registry, RegistryEntry, SearchPath};
pub use schema::{KeyInfo, keys};
pub use sources::LARGEST_FILE;
pub use summary::{HandSummary, SummaryJoint, SummaryValue, ValueOrigin};

/// The MJCF tree of [`Hand::model`].
pub use xmltree;
