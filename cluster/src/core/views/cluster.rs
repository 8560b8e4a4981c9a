//! The cluster as views see it: workers and samples, read and never changed.

use crate::core::config::Config;
use crate::core::samples::Samples;
use crate::core::workers::Workers;

/// What is decided on when a view is given to a worker.
#[derive(Debug, Clone, Copy)]
pub(in crate::core) struct Cluster<'a> {
    pub(in crate::core) config: &'a Config,
    pub(in crate::core) workers: &'a Workers,
    pub(in crate::core) samples: &'a Samples,
}
