//! The C interface between Eigenhand and a compiled hand plugin.
//!
//! A hand is a directory of data wherever that is enough. A compiled plugin is for hands that are *generated*: it is
//! given options and yields the manifest and the files that such a directory would hold. The program copies them out
//! and closes the conversation, so that no code of a plugin runs while a hand is simulated.
//!
//! A plugin is a dynamic library that exports one symbol, a [`HandPlugin`]. Whoever writes one in Rust writes a
//! function from options to [`HandFiles`] and names it in [`export_hand!`]; whoever writes one in C includes
//! `include/eigenhand_hand.h`, which says the same as this crate.

mod export;
mod table;

pub use export::{Generate, HandFiles};
pub use table::{
    ABI_MAJOR, ABI_MINOR, Bytes, Generated, HandPlugin, Header, MAGIC, STATUS_ERROR, STATUS_OK, STATUS_PANIC, SYMBOL,
    Status,
};
