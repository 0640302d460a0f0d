//! Fuzz targets of Eigenhand; [docs/reliability.md](../../docs/reliability.md) says how to run them.
pub mod inputs;
