//! Generates a hand of any number of fingers that stand in a circle under a palm and point down.
//!
//! This is the example of a compiled plugin: it turns [`Options`] into a manifest and a model.
//! `README.md` derives the numbers.
#![deny(unsafe_code)]

mod files;
mod options;

use eigenhand_hand_abi::{HandFiles, export_hand};

pub use options::Options;

/// Generates the hand that `options`, a TOML document, describe.
///
/// # Errors
/// Names the option that is unknown or out of its bounds.
pub fn generate(options: &str) -> Result<HandFiles, String> {
    let options = Options::parse(options)?;
    Ok(HandFiles::new().with("hand.toml", files::manifest(&options)).with(files::MODEL, files::model(&options)))
}

export_hand!(generate);
