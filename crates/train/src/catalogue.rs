//! Hands by name, and the contract that every one of them keeps.

use std::path::PathBuf;
use std::sync::Arc;

use eigenhand_hands::{Hand, Registry, SearchPath};
use eigenhand_sim::contract::{self, ContractReport};
use eigenhand_sim::ffi::MuJoCo;

use crate::TrainError;
use crate::config::{Layers, Preset};

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

/// Runs the hand contract with the objects and the simulation of the default configuration.
///
/// # Errors
/// [`TrainError::Config`] when the default configuration is broken, which no release is.
pub fn check_hand(hand: &Hand, library: &Arc<MuJoCo>) -> Result<ContractReport, TrainError> {
    let config = Layers::new(Preset::Default)?.resolve()?;
    let setting = contract::Setting {
        objects: config.objects,
        task: config.task,
        physics: config.physics,
        reward: config.reward,
    };
    Ok(contract::check(hand, library, &setting))
}
