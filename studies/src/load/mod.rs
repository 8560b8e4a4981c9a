//! Load: services of several processes, real or simulated, under many clients.

pub mod break_even;
pub mod burst;
pub mod calibration;
pub mod capacity;
mod chaos;
pub mod cluster;
pub mod overload;
pub mod repeats;
pub mod service;
pub mod simulate;
pub mod soak;
