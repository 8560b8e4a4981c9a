//! The experiments: accuracy against time, and the cluster under load.
//!
//! One file per experiment. Each returns a [`Report`], which the command prints as a table, as CSV or as JSON. Every
//! figure in the README comes from one of these, by the command beside it. Times are wall times of whole calls,
//! readback included. They are medians over rounds in which the alternatives alternate, so that noise affects all of
//! them alike.

mod arguments;
pub mod baseline;
mod bench;
pub mod bounds;
pub mod break_even;
pub mod burst;
pub mod calibration;
pub mod campaign;
pub mod capacity;
pub mod cluster;
pub mod detail;
pub mod device;
pub mod effects;
mod effort;
pub mod epr;
pub mod equal_error;
pub mod history;
pub mod light;
pub mod manylods;
mod median;
pub mod megaviews;
mod metered;
mod methods;
pub mod omni_maps;
pub mod overload;
pub mod particles;
mod processes;
mod radiance;
pub mod radiosity;
pub mod rays;
pub mod reflections;
mod report;
pub mod scenes;
pub mod service;
pub mod shadows;
pub mod simulate;
pub mod soak;
pub mod targets;
pub mod throughput;
pub mod visibility;
pub mod walk;
pub mod warp;

pub use arguments::set_quick;
pub use effort::Effort;
pub use report::{Machine, Report};
