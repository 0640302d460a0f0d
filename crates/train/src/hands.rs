//! Finding a hand by name, and checking that it keeps the hand contract and has not changed.

use std::path::Path;
use std::sync::Arc;

use eigenhand_hands::{Hand, HandError, Registry, SearchPath};
use eigenhand_mujoco::MuJoCo;
use eigenhand_sim::contract;

use crate::config::RunConfig;
use crate::error::TrainError;
use crate::provenance::Provenance;

/// Finds a hand by name or directory.
///
/// # Errors
/// [`HandError`] when no hand has this name, or its files are wrong.
pub fn hand_named(name: &str, hands: &SearchPath) -> Result<Hand, HandError> {
    Registry::discover(hands)?.get(name)
}

/// Checks that a hand keeps the contract in the default setting, as `hands check` does: it is one on the hand alone.
///
/// # Errors
/// [`TrainError::HandContract`], which names the hand as `name`.
pub(crate) fn check_contract(name: &str, hand: &Hand, library: &Arc<MuJoCo>) -> Result<(), TrainError> {
    let report = contract::check(hand, library, &RunConfig::default_preset()?.setting());
    let faults: Vec<String> = report.faults().map(|check| format!("  {check}")).collect();
    if faults.is_empty() {
        return Ok(());
    }
    Err(TrainError::HandContract { hand: name.to_owned(), faults: faults.join("\n") })
}

/// Checks that a hand's files have not changed since a run began.
///
/// # Errors
/// [`TrainError::HandChanged`].
pub(crate) fn check_digest(run: &Path, hand: &Hand, provenance: &Provenance) -> Result<(), TrainError> {
    if hand.digest == provenance.hand_digest {
        return Ok(());
    }
    Err(TrainError::HandChanged {
        hand: hand.manifest.name.clone(),
        run: run.to_owned(),
        expected: provenance.hand_digest.clone(),
        found: hand.digest.clone(),
    })
}
