//! Postural synergies: the principal component analysis of postures or of commands, the comparison of two such spaces, what a set of postures holds, and the exported files for a controller.
//!
//! A posture is a row of numbers, one for each named joint. The crate knows nothing of learning, simulation or any
//! particular hand. Two features are on by default: `files` adds the exported files ([`export`], [`import`], [`SynergyFile`],
//! [`MotorMap`]), `database` adds [`PostureDatabase`], which keeps postures in SQLite. Without both, the crate needs neither TOML
//! nor SQLite.
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
#![cfg_attr(not(feature = "files"), expect(dead_code, reason = "checks of what is read from files"))]

mod actuation;
#[cfg(feature = "files")]
mod atomic;
mod common;
mod compare;
mod content;
#[cfg(feature = "database")]
mod database;
mod error;
#[cfg(feature = "files")]
mod export;
#[cfg(feature = "files")]
mod file;
mod joint;
mod joint_map;
#[cfg(feature = "files")]
mod motors;
#[cfg(feature = "files")]
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
#[cfg(feature = "files")]
pub use export::{Import, export, export_beside_others, import, read_matrix};
#[cfg(feature = "files")]
pub use file::{Moment, NamedGrasp, Recommended, SCHEMA, Space, SynergyFile};
pub use joint_map::JointMap;
#[cfg(feature = "files")]
pub use motors::{Motor, MotorMap};
pub use pca::{Synergy, newest};
