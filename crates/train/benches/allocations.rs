//! Counts the allocations in the loops of training.
//!
//! `cargo bench --package eigenhand-train --bench allocations [-- --hand NAME] [--plugins DIR]` prints a line of JSON;
//! `cargo xtask bench allocations` runs it. It is a program of its own because its allocator counts.

use std::process::ExitCode;
use std::time::Duration;

use eigenhand_train::TrainError;
use eigenhand_train::bench::{AllocationCounts, BenchSetting, allocations};

fn main() -> ExitCode {
    let found = count().map_err(|error| error.to_string());
    match found.and_then(|counts| serde_json::to_string(&counts).map_err(|error| error.to_string())) {
        Ok(text) => {
            println!("{text}");
            ExitCode::SUCCESS
        }
        Err(reason) => {
            eprintln!("error: {reason}");
            ExitCode::FAILURE
        }
    }
}

fn count() -> Result<AllocationCounts, TrainError> {
    let mut setting = BenchSetting { hand: None, plugins: Vec::new(), duration: Duration::ZERO };
    let mut arguments = std::env::args().skip(1);
    // What else there is comes from cargo.
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--hand" => setting.hand = arguments.next(),
            "--plugins" => setting.plugins.extend(arguments.next().map(Into::into)),
            _ => {}
        }
    }
    allocations(&setting, &|work| allocation_counter::measure(work).count_total)
}
