//! Samples that are rendered at once.

/// Samplers render at once for at most this many times the predicted time: it may be wrong, and views are not left to others
/// without end.
const PATIENCE: f64 = 3.0;

/// Samples that are rendered at once, since views lack time.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(in crate::core) struct Lot {
    /// Predicted seconds until they are there; 0 without any.
    pub(in crate::core) secs: f64,
    /// Seconds since they were decided.
    pub(in crate::core) passed_secs: f64,
}

impl Lot {
    /// Whether samplers still leave views to others.
    pub(super) fn lasts(self) -> bool {
        self.passed_secs < PATIENCE * self.secs
    }
}
