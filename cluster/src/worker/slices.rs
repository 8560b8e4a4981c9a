//! Durations of the slices of longer work. A view that arrives during a slice waits for its end.

use std::fmt;
use std::time::{Duration, Instant};

use super::policy::SLICE_MS;

/// Slices of one piece of work. The first begins with it.
#[derive(Debug)]
pub(super) struct Slices {
    began: Instant,
    count: usize,
    last: Duration,
    longest: Duration,
    /// Those that took longer than [`SLICE_MS`].
    too_long: usize,
}

impl Default for Slices {
    fn default() -> Self {
        Self { began: Instant::now(), count: 0, last: Duration::ZERO, longest: Duration::ZERO, too_long: 0 }
    }
}

impl Slices {
    /// A slice is over.
    pub(super) fn end(&mut self) {
        let took = self.began.elapsed();
        (self.count, self.last) = (self.count + 1, took);
        self.longest = self.longest.max(took);
        self.too_long += usize::from(took.as_secs_f64() * 1e3 > SLICE_MS);
    }

    /// The next one begins.
    pub(super) fn begin(&mut self) {
        self.began = Instant::now();
    }

    /// How long the last slice took.
    pub(super) fn last(&self) -> Duration {
        self.last
    }

    /// Slices that are over.
    pub(super) fn count(&self) -> usize {
        self.count
    }
}

impl fmt::Display for Slices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { count, longest, too_long, .. } = self;
        let longest = longest.as_secs_f64() * 1e3;
        write!(f, "{count} slices, the longest of {longest:.1} ms, {too_long} longer than {SLICE_MS} ms")
    }
}
