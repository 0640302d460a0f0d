//! MuJoCo 2.2.2: finds the library, checks its version, and owns models and simulation states.
//!
//! The library is loaded at run time, so that everything builds on a machine without it. All `unsafe` code of the
//! workspace that calls the simulator is in this crate. A [`Model`] that threads share is immutable. A [`Data`] is one
//! simulation: it belongs to one thread at a time and keeps its model alive. It can change a model that it has to itself.
//! Ids are typed; a name is resolved to its id once.
//!
//! ```no_run
//! use std::sync::Arc;
//!
//! use eigenhand_mujoco::{Data, Model, MuJoCo};
//!
//! let library = MuJoCo::load()?;
//! let xml = "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>";
//! let model = Arc::new(Model::from_xml(&library, xml, &[])?);
//! let mut data = Data::new(&model)?;
//! data.step();
//! # Ok::<(), eigenhand_mujoco::MuJoCoError>(())
//! ```

#[rustfmt::skip]
mod assets;
mod bindings;
mod changes;
mod data;
mod error;
mod geometry;
mod geoms;
mod ids;
mod library;
mod model;

pub use changes::ModelChanges;
pub use data::{Contact, Data, WarningCounts};
pub use error::MuJoCoError;
pub use geoms::{GeomShape, MeshView};
pub use ids::{ActuatorId, BodyId, GeomId, JointId, SiteId};
pub use library::{LIBRARY_FILE, LIBRARY_VARIABLE, MuJoCo, REQUIRED_VERSION, fetched_library};
pub use model::Model;
