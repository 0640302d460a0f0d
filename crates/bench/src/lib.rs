//! Speed of the simulation, of the learner and of both together.
//!
//! Compared alternatives run by turns, in short pieces, and a ratio is the median over the pieces. So ratios are
//! reliable also on a machine with other work; rates are not.

#![forbid(unsafe_code)]

mod allocations;
mod error;
mod learner;
mod peak;
mod peers;
mod setting;
mod sim;
mod training;

pub use allocations::{AllocationCounts, Counter, Work, allocations};
pub use error::BenchError;
pub use learner::{LearnerSpeed, learner_speed};
pub use peers::{PYTHON_VARIABLE, Peer, PeerKind, PeerSpeed, find_peers};
pub use setting::BenchSetting;
pub use sim::{SimSpeed, sim_speed};
pub use training::{TrainingMemory, TrainingSpeed, WorkersSpeed, training_memory, training_speed};
