//! Hands by name, and the contract that every one of them keeps.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eigenhand_hands::{Hand, Registry, SearchPath};
use eigenhand_sim::contract::{self, ContractReport};
use eigenhand_sim::ffi::MuJoCo;
use serde::Serialize;

use crate::TrainError;
use crate::config::{Layers, Preset};
use crate::files::{create_directory, write_atomically};

/// Finds all hands: those of the workspace, of the environment's directories and of `plugins`.
///
/// # Errors
/// [`TrainError::Hand`] when a directory that somebody named does not exist.
pub fn registry(plugins: &[PathBuf]) -> Result<Registry, TrainError> {
    Ok(Registry::discover(&SearchPath::from_environment(plugins))?)
}

/// Finds a hand by name or directory.
///
/// # Errors
/// [`TrainError::Hand`] when there is none, or it is broken.
pub fn hand_named(name: &str, plugins: &[PathBuf]) -> Result<Hand, TrainError> {
    Ok(registry(plugins)?.get(name)?)
}

/// What the contract says of a hand, and where its picture is.
#[derive(Clone, Debug, Serialize)]
pub struct HandCheck {
    /// The conditions.
    #[serde(flatten)]
    pub report: ContractReport,
    /// The picture, if one was asked for and the hand's scenes compile.
    pub picture: Option<PathBuf>,
}

/// Returns where the picture of a hand goes if nobody says otherwise.
pub fn default_picture(hand: &Hand) -> PathBuf {
    Path::new("runs/hands").join(format!("{}.png", hand.manifest.name))
}

/// Runs the hand contract with the objects and the simulation of the default configuration, and draws the hand above the
/// table with each object into a PNG file, which replaces an older one.
///
/// # Errors
/// [`TrainError::Config`] when the default configuration is broken, which no release is; [`TrainError::Io`] when the
/// picture cannot be written.
pub fn check_hand(hand: &Hand, library: &Arc<MuJoCo>, picture: Option<&Path>) -> Result<HandCheck, TrainError> {
    let config = Layers::new(Preset::Default)?.resolve()?;
    let setting = contract::Setting {
        objects: config.objects,
        task: config.task,
        physics: config.physics,
        reward: config.reward,
    };
    let report = contract::check(hand, library, &setting);
    let picture = picture.filter(|_| report.compiles());
    if let Some(file) = picture {
        let drawn = contract::pictures(hand, library, &setting)?.png()?;
        if let Some(directory) = file.parent() {
            create_directory(directory)?;
        }
        write_atomically(file, &drawn)?;
    }
    Ok(HandCheck { report, picture: picture.map(Path::to_path_buf) })
}
