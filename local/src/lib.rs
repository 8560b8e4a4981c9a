//! What a user and a study need of this one machine: a cluster of processes on it, and the calibrated models kept on it.

mod cluster;
pub mod models;
mod ready;

pub use cluster::LocalCluster;
pub use ready::{connect, light_is_final, settle};
