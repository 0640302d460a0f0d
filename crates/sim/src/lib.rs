//! MuJoCo, scenes of a hand with an object, and the grasp task as an environment.
#![deny(unsafe_code)]

pub mod contract;
mod env;
mod error;
pub mod ffi;
mod objects;
mod physics;
pub mod render;
mod reward;
pub mod scene;
pub mod survey;
mod task;
pub mod trial;

pub use env::{EpisodeSetup, GraspEnv};
pub use error::SimError;
pub use objects::{Object, Shape};
pub use physics::{Cone, PhysicsConfig};
pub use reward::{RewardConfig, StepFacts};
pub use task::{GraspTask, ObjectScene, ObservationEntry, Orientation, TaskConfig};
