//! Finding a hand by name, and checking that a run's hand has not changed.

use std::path::Path;

use eigenhand_hands::{Hand, HandError, Registry, SearchPath};

use crate::error::TrainError;
use crate::provenance::Provenance;

/// Finds a hand by name or directory.
///
/// # Errors
/// [`HandError`] when no hand has this name, or its files are wrong.
pub fn hand_named(name: &str, hands: &SearchPath) -> Result<Hand, HandError> {
    Registry::discover(hands)?.get(name)
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
