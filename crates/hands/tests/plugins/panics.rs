//! A plugin in Rust that panics where its options say so.
#![deny(unsafe_code)]

use eigenhand_hand_abi::{HandFiles, export_hand};

fn generate(options: &str) -> Result<HandFiles, String> {
    match options.trim() {
        "" => panic!("out of {}", "ideas"),
        other => Err(format!("no hand of {other}")),
    }
}

export_hand!(generate);
