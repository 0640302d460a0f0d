//! A synergy as people look at it: in words, and as a page in which sliders move the hand.
//!
//! [`Words`] says what a component does to a hand. [`page`] writes one HTML page without other files: the hand in 3D, a
//! slider for each number, and the joint angles and commands to which the numbers lead.
#![forbid(unsafe_code)]

mod error;
mod page;
mod recording;
mod surfaces;
mod words;

pub use error::ExploreError;
pub use page::{Shown, check, page};
pub use recording::Recording;
pub use words::Words;
