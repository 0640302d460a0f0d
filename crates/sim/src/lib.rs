//! Scenes of a hand with an object, the grasp task as an environment, and the contract that every hand must fulfil.
#![forbid(unsafe_code)]

pub mod contract;
mod env;
mod error;
mod fingertips;
mod inertia_box;
mod objects;
mod physics;
mod reward;
pub mod scene;
mod self_contacts;
mod setting;
mod task;

pub use env::{CLOSING_TIME, DROP, GraspEnv};
pub use error::SimError;
pub use fingertips::fingertip_positions;
pub use objects::{ConvexMesh, Object, ObjectSet, Shape};
pub use physics::{Cone, PhysicsConfig};
pub use reward::{FAILURE, RewardConfig, SUCCESS, StepFacts};
pub use self_contacts::{Overlap, SelfContacts};
pub use setting::{Factors, Orientation, Setting, TaskConfig};
pub use task::{GraspTask, ObjectScene, ObservationEntry};
