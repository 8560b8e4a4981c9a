//! What rendering costs here: sums since the start, means since the last report.

use std::time::Duration;

use parking_lot::Mutex;

use crate::core::Report;

/// Work of one kind.
#[derive(Debug, Clone, Copy, Default)]
struct Work {
    total: u64,
    recent: u64,
    recent_ms: f64,
    mean_ms: Option<f64>,
}

impl Work {
    fn add(&mut self, count: usize, ms: f64) {
        self.total += count as u64;
        self.recent += count as u64;
        self.recent_ms += ms;
    }

    fn mean_ms(&mut self) -> Option<f64> {
        if self.recent > 0 {
            self.mean_ms = Some(self.recent_ms / self.recent as f64);
            (self.recent, self.recent_ms) = (0, 0.0);
        }
        self.mean_ms
    }
}

#[derive(Debug, Default)]
struct Sums {
    samples: Work,
    direct: Work,
    views: Work,
    sampling_busy_ms: f64,
    compositing_busy_ms: f64,
}

/// Kinds of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Sample,
    Direct,
    View,
}

/// Filled by the render thread, read by the reports.
#[derive(Debug, Default)]
pub(super) struct Meter(Mutex<Sums>);

impl Meter {
    /// A batch of `count` results took `rendering`, of `busy` in all (with uploads).
    pub(super) fn add(&self, kind: Kind, count: usize, rendering: Duration, busy: Duration) {
        let mut sums = self.0.lock();
        let (ms, busy_ms) = (rendering.as_secs_f64() * 1e3, busy.as_secs_f64() * 1e3);
        match kind {
            Kind::Sample => sums.samples.add(count, ms),
            Kind::Direct => sums.direct.add(count, ms),
            Kind::View => sums.views.add(count, ms),
        }
        match kind {
            Kind::Sample | Kind::Direct => sums.sampling_busy_ms += busy_ms,
            Kind::View => sums.compositing_busy_ms += busy_ms,
        }
    }

    /// Fills in the measured part of a report.
    pub(super) fn fill(&self, report: &mut Report) {
        let mut sums = self.0.lock();
        report.sample_ms = sums.samples.mean_ms();
        report.direct_ms = sums.direct.mean_ms();
        report.view_ms = sums.views.mean_ms();
        report.samples_rendered = sums.samples.total;
        report.views_direct = sums.direct.total;
        report.views_composed = sums.views.total;
        report.sampling_busy_ms = sums.sampling_busy_ms;
        report.compositing_busy_ms = sums.compositing_busy_ms;
    }
}
