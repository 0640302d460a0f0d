//! From a maker's file to a hand that trains: import, survey, scripted grasps, check.
//!
//! [`new_hand`] reads MJCF or URDF, finds palm, fingers, approach and place by moving the hand ([`survey`]) and by
//! scripted grasps ([`trial`]), and writes a plugin directory. [`check_hand`] runs the contract, looks for [`symptoms`] of a
//! faulty model, and draws the hand.
//! Nothing is learned here.
#![forbid(unsafe_code)]

mod check;
mod error;
mod new_hand;
pub mod survey;
mod symptoms;
pub mod trial;

pub use check::{HandCheck, check_hand, default_picture};
pub use error::OnboardError;
pub use new_hand::{NewHand, NewHandReport, OnStep, Step, describe_new_hand, new_hand};
pub use survey::Hints;
pub use symptoms::{Symptom, symptoms};
