//! Readback, prefix sums and sorting on a device.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod device;
mod lists;
mod numbers;
mod readback;
mod sort;

use device::{gpu, read};
