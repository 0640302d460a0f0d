//! A short torture: trainings that are killed and lose their power end as if they had not been.
#![forbid(unsafe_code)]
// A helper function of a test fails the test, which is what a panic means here.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::process::Command;

use serde_json::Value;

#[test]
fn interrupted_trainings_lose_nothing() {
    let output = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["torture", "--kills", "4", "--cuts", "2", "--minutes", "5", "--json"])
        .current_dir(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .env("EIGENHAND_NO_INSTALL", "1")
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{told}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let blows = found["sigkill"].as_u64().unwrap() + found["sigterm"].as_u64().unwrap();
    assert!(blows >= 4 && found["differences"].as_array().unwrap().is_empty(), "{found}");
    assert!(found["power_cuts"].as_u64().unwrap() >= 2 || told.contains("no power is cut"), "{found} {told}");
}
