//! Time in the core: an argument, never read from a clock.

use std::time::Duration;

use serde::Serialize;

/// Time since the coordinator started, on its monotonic clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize)]
pub struct Uptime(pub Duration);

impl Uptime {
    /// Time since `earlier`; zero if that is later.
    pub fn since(self, earlier: Uptime) -> Duration {
        self.0.saturating_sub(earlier.0)
    }

    /// The time `duration` later.
    pub fn after(self, duration: Duration) -> Uptime {
        Uptime(self.0.saturating_add(duration))
    }
}
