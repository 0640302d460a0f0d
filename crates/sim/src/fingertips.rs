//! Where a hand's fingertips are.

use eigenhand_hands::{FrameKind, Hand};
use eigenhand_mujoco::Data;
use nalgebra::Vector3;

use crate::SimError;

/// Returns the places of the fingertips in the world's frame, in the order of the manifest.
///
/// # Units
/// m.
///
/// # Errors
/// [`SimError::MuJoCo`] for a fingertip that the model lacks.
pub fn fingertip_positions(hand: &Hand, data: &Data) -> Result<Vec<Vector3<f64>>, SimError> {
    let model = data.model();
    let place = |tip: &eigenhand_hands::Fingertip| {
        Ok(match tip.kind {
            FrameKind::Body => data.body_position(model.body(&tip.name)?),
            FrameKind::Site => data.site_position(model.site(&tip.name)?),
        })
    };
    hand.fingertips.iter().map(place).collect()
}
