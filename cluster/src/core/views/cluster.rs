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
}

impl Cluster<'_> {
    /// A length of the scene, metres: half the diagonal of what viewers look at.
    pub(super) fn reach(&self) -> f64 {
        let extent = &self.samples.set().extent;
        (0.5 * (extent.max - extent.min).length()).max(f64::MIN_POSITIVE)
    }
}
