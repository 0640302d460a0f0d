//! Spaces with which a synergy is compared: random directions, and one number made by hand.

use std::collections::BTreeMap;
use std::path::Path;

use eigenhand_files::{create_directory, write_atomically};
use eigenhand_hands::Hand;
use eigenhand_mujoco::MuJoCo;
use eigenhand_rl::rng;
use eigenhand_synergy::{Space, Synergy, SynergyFile};

use crate::actuators::HandActuators;
use crate::config::RunConfig;
use crate::drive::random_rows;
use crate::error::TrainError;
use crate::products::SYNERGY;
use crate::task::task_of;

/// Directory of the spaces, beside the runs.
pub(super) const SPACES: &str = "spaces";

/// Writes a space of random directions about the mean of a run's synergy. Its samples have the same `k` numbers as those
/// of the synergy, so that they vary as much; only the directions differ.
///
/// # Errors
/// [`TrainError::NoMotions`] for a run without a control synergy, [`TrainError::Synergy`], [`TrainError::File`].
pub(super) fn write_random(run: &Path, k: usize, seed: u64, path: &Path) -> Result<(), TrainError> {
    if !run.join(SYNERGY).is_dir() {
        return Err(TrainError::NoMotions { run: run.to_owned() });
    }
    let found = eigenhand_synergy::import(run.join(SYNERGY))?;
    let own = &found.file.synergy;
    let n = own.n_joints();
    let k = k.min(own.n_components());
    let rows = random_rows(k, n, &mut rng::stream(seed, "random-space", 0));
    let sample = |command: &Vec<f64>| -> Vec<f64> {
        let z = own.encode(command);
        (0..n).map(|j| own.mean()[j] + (0..k).map(|i| z[i] * rows[i * n + j]).sum::<f64>()).collect()
    };
    let samples: Vec<Vec<f64>> = found.samples.iter().map(sample).collect();
    let synergy = Synergy::fit(own.joints(), &samples, k)?;
    write(&found.file.hand, synergy, format!("random directions, seed {seed}"), path)
}

/// Writes a space of one number, from the commands of the open hand to those with every closing actuator at its end.
///
/// # Errors
/// [`TrainError::Sim`], [`TrainError::Synergy`] for a hand that nothing closes, [`TrainError::File`].
pub(super) fn write_closing(hand: &Hand, config: &RunConfig, path: &Path) -> Result<(), TrainError> {
    let closing = &hand.manifest.closing;
    let task = task_of(config, hand, &MuJoCo::load()?)?;
    let actuators = HandActuators::of(hand, &task);
    let open = actuators.commands(&task.start_action());
    let closed: Vec<f64> = actuators
        .coordinates
        .iter()
        .zip(&open)
        .map(|(actuator, &open)| match closing.get(&actuator.name) {
            Some(&sign) if sign > 0.0 => actuator.upper,
            Some(_) => actuator.lower,
            None => open,
        })
        .collect();
    let synergy = Synergy::fit(&actuators.coordinates, &[open, closed], 1)?;
    write(&hand.manifest.name, synergy, "by hand: all closing actuators together".to_owned(), path)
}

fn write(hand: &str, synergy: Synergy, origin: String, path: &Path) -> Result<(), TrainError> {
    let file = SynergyFile {
        hand: hand.to_owned(),
        space: Space::Commands,
        synergy,
        joint_map: None,
        actuation: None,
        recommended: None,
        grasps: Vec::new(),
        provenance: BTreeMap::from([("directions".to_owned(), origin)]),
    };
    path.parent().map_or(Ok(()), create_directory)?;
    Ok(write_atomically(path, file.to_toml()?.as_bytes())?)
}
