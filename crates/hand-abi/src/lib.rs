//! The C interface between Eigenhand and a compiled hand plugin.
//!
//! Most hands are a directory of data. A compiled plugin is for hands that are *generated*: from options it generates
//! the files of such a directory, the manifest among them. The program copies the files when it loads the hand, so no
//! code of a plugin runs in a simulation. Plugins work on Linux and macOS.
//!
//! A plugin is a dynamic library that exports one symbol, a [`HandPlugin`]. In Rust, write a function from options to
//! [`HandFiles`] and pass it to [`export_hand!`]. In C, include `include/eigenhand_hand.h`, which declares the same
//! types.

mod export;
mod table;

pub use export::{Generate, HandFiles};
pub use table::{
    ABI_MAJOR, ABI_MINOR, Bytes, Generated, HandPlugin, Header, MAGIC, STATUS_ERROR, STATUS_OK, STATUS_PANIC, SYMBOL,
    Status,
};
