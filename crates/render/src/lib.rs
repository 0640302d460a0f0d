//! Pictures of a simulation, drawn by the processor: no display, no graphics card and no graphics library is needed.
//!
//! [`draw`] makes a [`Picture`] of a simulation as a [`Camera`] sees it, and [`hand_with_objects`] draws a hand above
//! the table with each object. Pictures can be labelled and put in rows.
#![forbid(unsafe_code)]

mod camera;
mod canvas;
mod error;
mod geoms;
mod hand;
mod label;
mod picture;
mod raster;
mod shapes;

pub use camera::Camera;
pub use canvas::draw;
pub use error::RenderError;
pub use geoms::{bounding_corners, drawn_geoms};
pub use hand::{COLUMNS, Film, View, grasp, hand_with_objects, postures};
pub use picture::Picture;
pub use shapes::{SurfacePoint, Triangle, surface};

#[cfg(test)]
mod tests;
