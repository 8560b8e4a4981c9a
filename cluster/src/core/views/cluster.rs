//! A read-only view of the parts that views read.

use crate::core::config::Config;
use crate::core::samples::Samples;
use crate::core::workers::Workers;

/// The state by which plans and workers are chosen.
#[derive(Debug, Clone, Copy)]
pub(in crate::core) struct Cluster<'a> {
    pub(in crate::core) config: &'a Config,
    pub(in crate::core) workers: &'a Workers,
    pub(in crate::core) samples: &'a Samples,
    /// Whether views lacked time at the last tick, and the workers that do not sample carry them in some way.
    pub(in crate::core) others_carry: bool,
}
