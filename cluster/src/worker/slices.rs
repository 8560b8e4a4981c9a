//! Durations of the slices of longer work. A view that arrives during a slice waits for the slice's end.

use std::fmt;
use std::time::{Duration, Instant};

use super::policy::SLICE_MS;

/// Slices of one piece of work. The first slice begins at creation.
#[derive(Debug)]
pub(super) struct Slices {
    /// Start of the present slice.
    began: Instant,
    count: usize,
    last: Duration,
    longest: Duration,
    /// Number of slices longer than [`SLICE_MS`].
    too_long: usize,
}

impl Default for Slices {
    fn default() -> Self {
        Self { began: Instant::now(), count: 0, last: Duration::ZERO, longest: Duration::ZERO, too_long: 0 }
    }
}

impl Slices {
    /// Ends the present slice.
    pub(super) fn end(&mut self) {
        let took = self.began.elapsed();
        (self.count, self.last) = (self.count + 1, took);
        self.longest = self.longest.max(took);
        self.too_long += usize::from(took.as_secs_f64() * 1e3 > SLICE_MS);
    }

    /// Begins the next slice.
    pub(super) fn begin(&mut self) {
        self.began = Instant::now();
    }

    /// Duration of the last slice.
    pub(super) fn last(&self) -> Duration {
        self.last
    }

    /// Number of finished slices.
    pub(super) fn count(&self) -> usize {
        self.count
    }
}

impl fmt::Display for Slices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { count, longest, too_long, .. } = self;
        let longest = longest.as_secs_f64() * 1e3;
        write!(f, "{count} slices, longest {longest:.1} ms, {too_long} above {SLICE_MS} ms")
    }
}
