//! The kept files of `fuzz/corpus`, as they are and damaged, in the readers that the fuzzer feeds.

use std::collections::BTreeSet;
use std::path::PathBuf;

use rand::{RngExt, SeedableRng};

use crate::inputs::INPUTS;
use crate::support::workspace;

/// Damaged copies of each file.
const DAMAGED: u64 = 40;

fn files_of(name: &str) -> Vec<PathBuf> {
    let directory = workspace().join("fuzz/corpus").join(name);
    let entries = std::fs::read_dir(&directory).unwrap_or_else(|error| panic!("{}: {error}", directory.display()));
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Changes, removes or repeats a few bytes.
fn damage(bytes: &[u8], seed: u64) -> Vec<u8> {
    let mut random = rand::rngs::SmallRng::seed_from_u64(seed);
    let mut bytes = bytes.to_vec();
    for _ in 0..random.random_range(1..6) {
        let start = random.random_range(0..=bytes.len());
        let end = (start + random.random_range(0..9)).min(bytes.len());
        match random.random_range(0..3) {
            0 => bytes[start..end].iter_mut().for_each(|byte| *byte = random.random()),
            1 => _ = bytes.drain(start..end),
            _ => bytes.extend_from_within(start..end),
        }
    }
    bytes
}

#[test]
fn the_kept_files_of_the_fuzzer_are_read() {
    for (name, input) in INPUTS {
        let files = files_of(name);
        assert!(!files.is_empty(), "fuzz/corpus/{name} has files");
        let mut n_read = 0;
        for file in files {
            let bytes = std::fs::read(&file).unwrap();
            n_read += u32::from(input(&bytes));
            for seed in 0..DAMAGED {
                let damaged = damage(&bytes, seed);
                let read = std::panic::catch_unwind(|| input(&damaged));
                assert!(read.is_ok(), "{}, damaged with seed {seed}", file.display());
            }
        }
        assert!(
            n_read > 0,
            "a good file is among those of fuzz/corpus/{name}, so that the fuzzer gets beyond the beginning"
        );
    }
}

#[test]
fn each_reader_has_its_fuzz_target() {
    let manifest = std::fs::read_to_string(workspace().join("fuzz/Cargo.toml")).unwrap();
    let manifest: toml::Table = toml::from_str(&manifest).unwrap();
    let bins = manifest["bin"].as_array().unwrap().iter();
    let targets: BTreeSet<&str> = bins.map(|bin| bin["name"].as_str().unwrap()).collect();
    assert_eq!(targets, INPUTS.iter().map(|(name, _)| *name).collect());
    for name in targets {
        let text = std::fs::read_to_string(workspace().join(format!("fuzz/fuzz_targets/{name}.rs"))).unwrap();
        assert!(text.contains(&format!("inputs::{name}(")), "{name}");
    }
}
