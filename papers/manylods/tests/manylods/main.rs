//! Sphere trees and cuts on a device.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

#[path = "../../../megaviews/tests/megaviews/common.rs"]
mod common;
mod cuts;
#[path = "../../../../gpu/tests/gpu/device.rs"]
mod device;
#[path = "../../../../gpu/tests/gpu/numbers.rs"]
mod numbers;
mod spheres;
