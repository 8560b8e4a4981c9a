//! The octree and maps of many views against the same on the CPU, in f64.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod common;
mod culling;
#[path = "../../../../gpu/tests/gpu/device.rs"]
mod device;
mod hard_cases;
mod maps_oracle;
#[path = "../../../../gpu/tests/gpu/numbers.rs"]
mod numbers;
mod octree;
mod octree_oracle;
mod sharing;
mod texels;
