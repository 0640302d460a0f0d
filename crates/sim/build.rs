//! Compiles the crate anew when an object's file is added or changed.

fn main() {
    println!("cargo::rerun-if-changed=../../objects");
    println!("cargo::rerun-if-changed=build.rs");
}
