//! The experiments: accuracy against time, and the cluster under load.
//!
//! A folder for each kind, and a file for each experiment. Each returns a [`Report`], which the command prints as a table, as CSV or as JSON. Every
//! figure in the README comes from one of these, by the command beside it. Times are wall times of whole calls,
//! readback included. They are medians over rounds in which the alternatives alternate, so that noise affects all of
//! them alike.

mod arguments;
mod bench;
mod child;
pub mod device;
pub mod light;
pub mod load;
mod median;
mod metered;
mod methods;
pub mod papers;
mod processes;
mod report;
pub mod views;

pub use arguments::set_quick;
pub use report::{Machine, Report};
