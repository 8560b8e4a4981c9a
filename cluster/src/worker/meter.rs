//! Measured costs of rendering: sums since the start, and means since the last report.

use std::time::Duration;

use argus_scene::Plan;
use parking_lot::Mutex;

use crate::core::Report;
use crate::core::quality::Cost;
use crate::core::smooth::Smoothed;
use crate::worker::effect_meter::EffectMeter;

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

/// Cost of views of one kind: measured before the first request, and corrected by the times of real views.
#[derive(Debug)]
struct ViewCost {
    measured: Option<Cost>,
    /// Ratio of real times to the measured cost.
    correction: Smoothed,
}

/// Weight of the newest view in the correction.
const CORRECTION_WEIGHT: f64 = 0.2;

impl Default for ViewCost {
    fn default() -> Self {
        Self { measured: None, correction: Smoothed::new(CORRECTION_WEIGHT) }
    }
}

impl ViewCost {
    fn observe(&mut self, pixels: u64, ms: f64) {
        if let Some(measured) = self.measured {
            self.correction.observe(ms / measured.ms(pixels));
        }
    }

    /// The corrected cost. Until a view of the kind corrects it, by the correction of a like kind.
    fn cost_like(&self, like: Option<&Self>) -> Option<Cost> {
        let correction = self.correction.value().or_else(|| like?.correction.value());
        let factor = correction.unwrap_or(1.0);
        self.measured.map(|cost| Cost {
            fixed_ms: cost.fixed_ms * factor,
            ms_per_megapixel: cost.ms_per_megapixel * factor,
        })
    }
}

/// Ways to answer a view that differ in their cost of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ViewKind {
    /// From triangles.
    Direct,
    /// From triangles, with few rays of light.
    FewRays,
    /// From samples.
    Warp,
    /// From recent direct frames.
    FromFrames,
}

impl ViewKind {
    /// The kind of a plan.
    pub(super) fn of(plan: &Plan) -> Self {
        match plan {
            Plan::Direct { detail, .. } if detail.ray_divisor() > 1 => Self::FewRays,
            Plan::Direct { .. } => Self::Direct,
            Plan::Warp(_) if plan.needs_samples() => Self::Warp,
            Plan::Warp(_) => Self::FromFrames,
        }
    }
}

#[derive(Debug, Default)]
struct Sums {
    direct_cost: ViewCost,
    few_rays_cost: ViewCost,
    warp_cost: ViewCost,
    frame_cost: ViewCost,
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

impl Sums {
    fn cost_of(&mut self, kind: ViewKind) -> &mut ViewCost {
        match kind {
            ViewKind::Direct => &mut self.direct_cost,
            ViewKind::FewRays => &mut self.few_rays_cost,
            ViewKind::Warp => &mut self.warp_cost,
            ViewKind::FromFrames => &mut self.frame_cost,
        }
    }
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
        if cost.is_some() {
            *self.0.lock().cost_of(kind) = ViewCost { measured: cost, ..ViewCost::default() };
        }
    }

    /// Records the milliseconds of a view. `pixels` are those that were rendered, with sub-pixels.
    pub(super) fn observe_view(&self, kind: ViewKind, pixels: u64, ms: f64) {
        self.0.lock().cost_of(kind).observe(pixels, ms);
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

    /// Fills in the measurements of a report.
    pub(super) fn fill(&self, report: &mut Report) {
        let mut sums = self.0.lock();
        report.sample_ms = sums.samples.mean_ms();
        report.direct_ms = sums.direct.mean_ms();
        report.view_ms = sums.views.mean_ms();
        report.ray_ms = sums.rays.mean_ms();
        report.part_ms = sums.parts.mean_ms();
        report.sample_progress = sums.sample_progress;
        (report.direct_cost, report.warp_cost) =
            (sums.direct_cost.cost_like(None), sums.warp_cost.cost_like(None));
        report.few_rays_cost = sums.few_rays_cost.cost_like(Some(&sums.direct_cost));
        report.frame_cost = sums.frame_cost.cost_like(None);
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
    fn views_correct_a_measured_cost_and_set_none_without_a_measurement() {
        let meter = Meter::default();
        let mut report = Report::default();
        meter.observe_view(ViewKind::Direct, 1_000_000, 40.0);
        meter.fill(&mut report);
        assert_eq!((report.direct_cost, report.warp_cost), (None, None));
        meter.set_cost(ViewKind::Direct, Some(Cost { fixed_ms: 2.0, ms_per_megapixel: 18.0 }));
        meter.fill(&mut report);
        assert_eq!(report.direct_cost.unwrap().ms(1_000_000), 20.0);
        (0..40).for_each(|_| meter.observe_view(ViewKind::Direct, 1_000_000, 40.0));
        meter.fill(&mut report);
        assert!((report.direct_cost.unwrap().ms(1_000_000) - 40.0).abs() < 0.1);
        assert!((report.direct_cost.unwrap().ms(0) - 4.0).abs() < 0.1);
        meter.set_cost(ViewKind::Direct, None);
        meter.observe_view(ViewKind::Direct, 0, f64::NAN);
        meter.fill(&mut report);
        assert!(report.direct_cost.unwrap().ms(0).is_finite());
    }

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
}
