//! Counts the allocations in the loops of training.
//!
//! `cargo bench --package eigenhand-bench --bench allocations [-- --hand NAME] [--plugins DIR]` prints a line of JSON;
//! `cargo xtask bench allocations` runs it. It is a separate program, because its allocator counts.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use eigenhand_bench::{AllocationCounts, BenchSetting, allocations};
use eigenhand_hands::SearchPath;

fn main() -> ExitCode {
    match count().and_then(|counts| serde_json::to_string(&counts).map_err(|error| error.to_string())) {
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

fn count() -> Result<AllocationCounts, String> {
    let (mut hand, mut plugins) = (None, Vec::new());
    let mut arguments = std::env::args().skip(1);
    // Cargo adds arguments of its own; they are ignored.
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--hand" => hand = arguments.next(),
            "--plugins" => plugins.extend(arguments.next().map(PathBuf::from)),
            _ => {}
        }
    }
    let setting = BenchSetting { hand, hands: SearchPath::from_environment(&plugins), duration: Duration::ZERO };
    allocations(&setting, &|work| allocation_counter::measure(work).count_total).map_err(|error| error.to_string())
}
