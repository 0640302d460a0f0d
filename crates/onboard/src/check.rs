//! Checks a hand against the contract, and draws it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eigenhand_files::{create_directory, write_atomically};
use eigenhand_hands::Hand;
use eigenhand_mujoco::MuJoCo;
use eigenhand_render::hand_with_objects;
use eigenhand_sim::Setting;
use eigenhand_sim::contract::{self, ContractReport};
use serde::Serialize;

use crate::error::OnboardError;

/// The result of the contract for a hand, and the path of its picture.
#[derive(Clone, Debug, Serialize)]
pub struct HandCheck {
    /// The conditions.
    #[serde(flatten)]
    pub report: ContractReport,
    /// Path of the picture, if one was requested and the hand's scenes compile.
    pub picture: Option<PathBuf>,
}

/// Returns the default path of a hand's picture.
pub fn default_picture(hand: &Hand) -> PathBuf {
    Path::new("runs/hands").join(format!("{}.png", hand.manifest.name))
}

/// Runs the hand contract in a setting. If `picture` names a PNG file, also draws the hand above the table with each
/// object, and replaces an older file there.
///
/// # Errors
/// [`OnboardError::File`] when the picture cannot be written.
pub fn check_hand(
    hand: &Hand,
    library: &Arc<MuJoCo>,
    setting: &Setting,
    picture: Option<&Path>,
) -> Result<HandCheck, OnboardError> {
    let report = contract::check(hand, library, setting);
    let picture = picture.filter(|_| report.compiles());
    if let Some(file) = picture {
        let drawn = hand_with_objects(hand, library, setting)?.png()?;
        if let Some(directory) = file.parent() {
            create_directory(directory)?;
        }
        write_atomically(file, &drawn)?;
    }
    Ok(HandCheck { report, picture: picture.map(Path::to_path_buf) })
}
