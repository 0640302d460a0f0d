//! The survey of a hand without a description: finds its palm, its fingers and fingertips, how it closes, and how to
//! mount it above a plane.
//!
//! Names tell the survey nothing. The hand's own actuators move it without gravity and contacts, and the motion of its
//! parts is measured, so couplings, tendons and closed loops are taken into account.

use std::sync::Arc;

use eigenhand_hands::xmltree::Element;
use eigenhand_mujoco::{Model, MuJoCo};

use crate::error::OnboardError;

mod arm;
mod findings;
mod fingers;
mod lab;
mod several;
mod stand;

pub use arm::{Arm, OtherHands, arm, other_hands};
pub use findings::{Closing, Finger, Hints, Survey};
use fingers::{chains, palm};
use lab::Lab;
use stand::stand;

/// Surveys the hand whose model is `root`, with the files that it names: one survey for each direction in which the hand
/// may approach an object, the likeliest first.
///
/// # Errors
/// [`OnboardError::MuJoCo`] with MuJoCo's reason, [`OnboardError::Survey`] if no palm or finger is identified.
pub fn survey(
    library: &Arc<MuJoCo>,
    root: &Element,
    assets: &[(String, Vec<u8>)],
    hints: &Hints,
) -> Result<Vec<Survey>, OnboardError> {
    let model = Arc::new(Model::from_xml(library, &stand(root, "disable"), assets)?);
    let touching = Arc::new(Model::from_xml(library, &stand(root, "enable"), assets)?);
    let palm = palm(&model, hints)?;
    let chains = chains(&model, palm)?;
    let mut lab = Lab::new(&model, palm)?;
    let mut poses = lab.postures(chains)?;
    lab.leave_out_guides(&mut poses);
    lab.add_fixed_jaw(&mut poses)?;
    let mut found = Vec::new();
    for approach in lab.approaches(&poses, hints.approach)? {
        lab.set_approach(approach);
        lab.straighten(&poses);
        lab.check_fingers(&poses)?;
        let closing = lab.closing(&poses)?;
        let open = lab.open(&poses, &closing)?;
        found.push(lab.report(&poses, &closing, &open, &touching)?);
    }
    Ok(found)
}
