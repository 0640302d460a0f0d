//! The joints of a posture, and the map from a posture to the actuator commands that hold it.
//!
//! A posture is a row of numbers, one for each named joint. The readers of hands and the analysis of postures share
//! these types, and nothing else.
#![forbid(unsafe_code)]

mod actuation;
mod joint;

pub use actuation::ActuationMap;
pub use joint::{JointInfo, Unit};
