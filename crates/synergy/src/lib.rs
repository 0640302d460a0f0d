//! Postural synergies: the principal component analysis of postures or of commands, the comparison of two such spaces, what a set of postures holds, and the exported files for a controller.
//!
//! A posture is a row of numbers, one for each named joint. The crate knows nothing of learning, simulation or any
//! particular hand. The feature `database` (on by default) adds [`PostureDatabase`], which keeps postures in SQLite.
//!
//! ```
//! use eigenhand_synergy::{JointInfo, Synergy, Unit};
//!
//! let joints = ["bend", "curl"].map(|name| JointInfo {
//!     name: name.to_owned(),
//!     unit: Unit::Radian,
//!     lower: 0.0,
//!     upper: 1.6,
//! });
//! let postures = [[0.1, 0.2], [0.5, 0.6], [0.9, 1.0]];
//! let synergy = Synergy::fit(&joints, &postures, 1)?;
//!
//! let z = synergy.encode(&[0.7, 0.8]);
//! let q = synergy.decode(&z);
//! assert!((q[0] - 0.7).abs() < 1e-12 && (q[1] - 0.8).abs() < 1e-12);
//! assert!(synergy.error(&[0.7, 0.8]) < 1e-12);
//! # Ok::<(), eigenhand_synergy::SynergyError>(())
//! ```

#![forbid(unsafe_code)]

mod actuation;
mod atomic;
mod common;
mod compare;
mod content;
#[cfg(feature = "database")]
mod database;
mod error;
mod export;
mod file;
mod joint;
mod joint_map;
mod motors;
mod npy;
mod pca;
mod projector;

pub use common::{Compared, Comparison, Explained};
pub use compare::{cumulative_explained_variance, principal_angles};
pub use content::Content;
#[cfg(feature = "database")]
pub use database::{MotionRecord, PostureDatabase, PostureRecord, Source};
pub use eigenhand_posture::{ActuationMap, JointInfo, Unit};
pub use error::SynergyError;
pub use export::{Import, export, import, read_matrix};
pub use file::{Moment, NamedGrasp, Recommended, SCHEMA, Space, SynergyFile};
pub use joint_map::JointMap;
pub use motors::{Motor, MotorMap};
pub use pca::{Synergy, newest};
