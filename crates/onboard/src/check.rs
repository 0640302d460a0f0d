//! Checks a hand against the contract, and draws it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eigenhand_files::{create_directory, write_atomically};
use eigenhand_hands::Hand;
use eigenhand_mujoco::MuJoCo;
use eigenhand_render::{COLUMNS, Picture, grasp, hand_with_objects};
use eigenhand_sim::contract::{self, ContractReport};
use eigenhand_sim::{GraspTask, Setting};
use serde::Serialize;

use crate::error::OnboardError;
use crate::symptoms::{Symptom, symptoms};
use crate::trial::lift;

/// The result of the contract for a hand, and the path of its picture.
#[derive(Clone, Debug, Serialize)]
pub struct HandCheck {
    /// The conditions.
    #[serde(flatten)]
    pub report: ContractReport,
    /// Signs of a fault in the hand's model.
    pub symptoms: Vec<Symptom>,
    /// Path of the picture, if one was requested and the hand's scenes compile.
    pub picture: Option<PathBuf>,
}

/// Returns the default path of a hand's picture.
pub fn default_picture(hand: &Hand) -> PathBuf {
    Path::new("runs/hands").join(format!("{}.png", hand.manifest.name))
}

/// Runs the hand contract in a setting, and looks for signs of a fault. If `picture` names a PNG file, also draws the hand
/// above the table with each object, open, closed, and with an object that a script has lifted, and replaces an older
/// file there.
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
    if !report.compiles() {
        return Ok(HandCheck { report, symptoms: Vec::new(), picture: None });
    }
    let task = Arc::new(GraspTask::new(library, hand, setting)?);
    if let Some(file) = picture {
        let drawn = picture_of(hand, &task)?.png()?;
        if let Some(directory) = file.parent() {
            create_directory(directory)?;
        }
        write_atomically(file, &drawn)?;
    }
    Ok(HandCheck { report, symptoms: symptoms(hand, &task)?, picture: picture.map(Path::to_path_buf) })
}

fn picture_of(hand: &Hand, task: &Arc<GraspTask>) -> Result<Picture, OnboardError> {
    let mut tiles = hand_with_objects(hand, task)?;
    if let Some(lifted) = lift(task, &hand.manifest.closing)? {
        let scene = &task.scenes[lifted.scene];
        let label = format!("{}, lifted by a script", scene.object.name);
        let [side, _] = grasp(hand, scene, lifted.env.simulation())?;
        tiles.push(side.labelled(&label));
    }
    Ok(Picture::grid(&tiles, COLUMNS))
}
