//! Measured costs of rendering: sums since the start, and means since the last report.

use std::time::{Duration, Instant};

use parking_lot::Mutex;

use crate::core::Report;
use crate::core::quality::Cost;
use crate::worker::effect_meter::EffectMeter;
use crate::worker::view_costs::{ViewCosts, ViewKind};

/// Work of one kind.
#[derive(Debug, Clone, Copy, Default)]
struct Work {
    /// Results since the start.
    total: u64,
    /// Results since the last report, and their milliseconds.
    recent: u64,
    recent_ms: f64,
    mean_ms: Option<f64>,
}

impl Work {
    fn add(&mut self, count: usize, ms: f64) {
        self.total += count as u64;
        self.add_cost(count, ms);
    }

    /// Counts results, but leaves the first batch out of the cost. A driver compiles programs at their first use,
    /// which takes the software driver seconds. Later views must not be refused because of that.
    fn add_warm(&mut self, count: usize, ms: f64) {
        if self.total > 0 {
            self.add_cost(count, ms);
        }
        self.total += count as u64;
    }

    fn add_cost(&mut self, count: usize, ms: f64) {
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
    view_costs: ViewCosts,
    effects: EffectMeter,
    samples: Work,
    direct: Work,
    views: Work,
    rays: Work,
    /// Slices of samples.
    parts: Work,
    /// Rendered share of the samples in progress, 0 to 1.
    sample_progress: Option<f64>,
    sampling_busy_ms: f64,
    compositing_busy_ms: f64,
    holding_ms: f64,
    received: u64,
    unpacking_ms: f64,
}

/// Kinds of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Sample,
    Direct,
    View,
    /// Single rays.
    Ray,
}

/// Measurements of the render thread, for reports.
#[derive(Debug, Default)]
pub(super) struct Meter(Mutex<Sums>);

impl Meter {
    /// Forgets costs, which were those of another scene. Sums since the start stay.
    pub(super) fn forget_costs(&self) {
        let mut sums = self.0.lock();
        (sums.view_costs, sums.effects) = (ViewCosts::default(), EffectMeter::default());
        let Sums { samples, direct, views, rays, parts, .. } = &mut *sums;
        for work in [samples, direct, views, rays, parts] {
            *work = Work { total: work.total, ..Work::default() };
        }
    }

    /// Records a batch of `count` results. `rendering` is the time in the role, `busy` the whole time with uploads.
    pub(super) fn add(&self, kind: Kind, count: usize, rendering: Duration, busy: Duration) {
        let mut sums = self.0.lock();
        let (ms, busy_ms) = (rendering.as_secs_f64() * 1e3, busy.as_secs_f64() * 1e3);
        match kind {
            // In a static scene a sampler's first samples may be its only ones, so their cost counts.
            Kind::Sample => sums.samples.add(count, ms),
            Kind::Direct => sums.direct.add_warm(count, ms),
            Kind::View => sums.views.add_warm(count, ms),
            Kind::Ray => sums.rays.add_warm(count, ms),
        }
        match kind {
            Kind::Sample | Kind::Direct | Kind::Ray => sums.sampling_busy_ms += busy_ms,
            Kind::View => {
                sums.compositing_busy_ms += busy_ms;
                sums.holding_ms += (busy_ms - ms).max(0.0);
            }
        }
    }

    /// Sets the cost of views of one kind, measured before the first request. `None` changes nothing.
    pub(super) fn set_cost(&self, kind: ViewKind, cost: Option<Cost>) {
        if let Some(cost) = cost {
            self.0.lock().view_costs.set(kind, cost);
        }
    }

    /// Records the milliseconds of a view. `pixels` are those that were rendered, with sub-pixels.
    pub(super) fn observe_view(&self, kind: ViewKind, pixels: u64, ms: f64) {
        self.0.lock().view_costs.observe(kind, pixels, ms, Instant::now());
    }

    /// Changes what is known of the cost of effects.
    pub(super) fn effects(&self, change: impl FnOnce(&mut EffectMeter)) {
        change(&mut self.0.lock().effects);
    }

    /// Records samples that were rendered in `count` slices, and the time of all slices.
    pub(super) fn add_parts(&self, count: usize, rendering: Duration) {
        self.0.lock().parts.add_warm(count, rendering.as_secs_f64() * 1e3);
    }

    /// Sets the rendered share of the samples in progress; `None` if none is in progress.
    pub(super) fn set_sample_progress(&self, share: Option<f64>) {
        self.0.lock().sample_progress = share;
    }

    /// Records a sample received from another worker, and the time of unpacking it.
    pub(super) fn add_received(&self, unpacking: Duration) {
        let mut sums = self.0.lock();
        sums.received += 1;
        sums.unpacking_ms += unpacking.as_secs_f64() * 1e3;
    }

    /// Cost of a view from triangles; `None` until it is measured.
    pub(super) fn direct_cost(&self) -> Option<Cost> {
        self.0.lock().view_costs.cost(ViewKind::Direct, Instant::now())
    }

    /// Fills in the measurements of a report.
    pub(super) fn fill(&self, report: &mut Report) {
        let mut sums = self.0.lock();
        report.sample_ms = sums.samples.mean_ms();
        report.direct_ms = sums.direct.mean_ms();
        report.view_ms = sums.views.mean_ms();
        report.ray_ms = sums.rays.mean_ms();
        report.part_ms = sums.parts.mean_ms();
        report.sample_progress = sums.sample_progress;
        let cost = |kind| sums.view_costs.cost(kind, Instant::now());
        (report.direct_cost, report.few_rays_cost) = (cost(ViewKind::Direct), cost(ViewKind::FewRays));
        (report.warp_cost, report.frame_cost) = (cost(ViewKind::Warp), cost(ViewKind::FromFrames));
        report.effect_costs = sums.effects.costs();
        report.samples_rendered = sums.samples.total;
        report.views_direct = sums.direct.total;
        report.views_composed = sums.views.total;
        report.rays_traced = sums.rays.total;
        report.sampling_busy_ms = sums.sampling_busy_ms;
        report.compositing_busy_ms = sums.compositing_busy_ms;
        report.holding_ms = sums.holding_ms;
        report.samples_received = sums.received;
        report.unpacking_ms = sums.unpacking_ms;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_batch_of_views_is_counted_but_not_part_of_their_cost() {
        let ms = Duration::from_millis;
        let meter = Meter::default();
        let mut report = Report::default();
        meter.add(Kind::View, 4, ms(2000), ms(2100));
        meter.add(Kind::Sample, 2, ms(80), ms(80));
        meter.fill(&mut report);
        assert_eq!((report.views_composed, report.view_ms), (4, None));
        assert_eq!(report.compositing_busy_ms, 2100.0);
        assert_eq!(report.sample_ms, Some(40.0));
        meter.add(Kind::View, 4, ms(20), ms(24));
        meter.fill(&mut report);
        assert_eq!((report.views_composed, report.view_ms), (8, Some(5.0)));
        // Time of a batch outside of composing is upload time.
        assert_eq!(report.holding_ms, 104.0);
        meter.add_received(ms(5));
        meter.add_received(ms(7));
        meter.fill(&mut report);
        assert_eq!((report.samples_received, report.unpacking_ms), (2, 12.0));
    }

    #[test]
    fn costs_of_another_scene_are_forgotten_and_sums_stay() {
        let (meter, mut report) = (Meter::default(), Report::default());
        let ms = Duration::from_millis;
        meter.add(Kind::Sample, 2, ms(80), ms(80));
        meter.set_cost(ViewKind::Direct, Some(Cost { fixed_ms: 1.0, ms_per_megapixel: 2.0 }));
        meter.fill(&mut report);
        assert!(report.sample_ms.is_some() && report.direct_cost.is_some());
        meter.forget_costs();
        meter.fill(&mut report);
        assert_eq!((report.sample_ms, report.direct_cost), (None, None));
        assert_eq!((report.samples_rendered, report.sampling_busy_ms), (2, 80.0));
    }
}
