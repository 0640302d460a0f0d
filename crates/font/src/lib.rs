//! The font of pictures and figures, so that they have the same text on every machine.
#![forbid(unsafe_code)]

/// A part of DejaVu Sans as a TrueType file, see `assets/README.md`.
pub const FONT: &[u8] = include_bytes!("../assets/DejaVuSans-subset.ttf");
