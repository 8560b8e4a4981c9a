//! Time as the core sees it: handed in, never read.

use std::time::Duration;

use serde::Serialize;

/// Time since the coordinator started, on its monotonic clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize)]
pub struct Uptime(pub Duration);

impl Uptime {
    /// Time that passed since `earlier`; zero if that lies ahead.
    pub fn since(self, earlier: Uptime) -> Duration {
        self.0.saturating_sub(earlier.0)
    }

    /// The moment that lies `duration` ahead.
    pub fn after(self, duration: Duration) -> Uptime {
        Uptime(self.0.saturating_add(duration))
    }
}
