//! The fence around MuJoCo's C API: every `unsafe` of this crate lies in this folder.
#![allow(unsafe_code)]

#[rustfmt::skip]
mod bindings;
mod data;
mod geometry;
mod geoms;
mod ids;
mod library;
mod model;

pub use data::{Contact, Data, WarningCounts};
pub use geoms::{GeomShape, MeshView};
pub use ids::{ActuatorId, BodyId, GeomId, JointId, SiteId};
pub use library::{LIBRARY_VARIABLE, MuJoCo, REQUIRED_VERSION};
pub use model::Model;
