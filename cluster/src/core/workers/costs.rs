//! Costs measured by workers.

use super::balance::Costs;
use super::worker::QueuedView;
use crate::core::event::Report;
use crate::core::smooth::Smoothed;

/// Smoothed costs over all workers, seconds of one process.
#[derive(Debug, Clone)]
pub(in crate::core) struct MeasuredCosts {
    sample: Smoothed,
    direct: Smoothed,
    view: Smoothed,
    ray: Smoothed,
    /// Pixels of a direct view, with sub-pixels.
    direct_pixels: Smoothed,
    /// Pixels of a view from samples, with sub-pixels.
    view_pixels: Smoothed,
    /// Busy seconds of the busiest worker in a tick.
    tick_secs: f64,
}

impl MeasuredCosts {
    /// Starts without measurements; `weight` of the newest observation is in (0, 1].
    pub(super) fn new(weight: f64) -> Self {
        let cost = || Smoothed::new(weight);
        Self {
            sample: cost(),
            direct: cost(),
            view: cost(),
            ray: cost(),
            direct_pixels: cost(),
            view_pixels: cost(),
            tick_secs: 0.0,
        }
    }

    /// Learns from a report, and the one before it, the costs of the work done in between.
    pub(super) fn learn(&mut self, report: &Report, before: &Report) {
        let observe = |cost: &mut Smoothed, done: u64, done_before: u64, ms: Option<f64>| {
            if let Some(ms) = ms.filter(|_| done > done_before) {
                cost.observe(ms * 1e-3);
            }
        };
        observe(&mut self.sample, report.samples_rendered, before.samples_rendered, report.sample_ms);
        observe(&mut self.direct, report.views_direct, before.views_direct, report.direct_ms);
        observe(&mut self.view, report.views_composed, before.views_composed, report.view_ms);
        observe(&mut self.ray, report.rays_traced, before.rays_traced, report.ray_ms);
    }

    /// Learns the pixels of an answered view, with sub-pixels.
    pub(super) fn learn_pixels(&mut self, direct: bool, work: u64) {
        let pixels = if direct { &mut self.direct_pixels } else { &mut self.view_pixels };
        pixels.observe(work as f64);
    }

    /// Learns the busy seconds of the busiest worker in a tick.
    pub(super) fn learn_tick(&mut self, busy_secs: f64, weight: f64) {
        self.tick_secs += weight * (busy_secs - self.tick_secs);
    }

    /// The formula's costs. A direct view and a sample are alike, since both render the triangles, so an unmeasured
    /// one has the other's cost. The planner uses each worker's own costs, and never another kind's.
    pub(super) fn believed(&self) -> Costs {
        let (sample, direct) = (self.sample_secs(), self.direct_secs());
        Costs {
            sample_secs: sample.or(direct).unwrap_or(0.0),
            direct_secs: direct.or(sample).unwrap_or(0.0),
            ray_secs: self.ray_secs().unwrap_or(0.0),
            view_secs: self.view_secs().unwrap_or(0.0),
        }
    }

    /// Expected seconds of a queued view, by its kind and size.
    pub(in crate::core) fn expected_secs(&self, view: &QueuedView) -> f64 {
        let (cost, usual) = match view.direct {
            true => (self.direct_secs().or(self.sample_secs()), self.direct_pixels.value()),
            false => (self.view_secs(), self.view_pixels.value()),
        };
        cost.unwrap_or(0.0) * usual.map_or(1.0, |usual| (view.work as f64 / usual).max(1.0))
    }

    /// Seconds of a sample, if measured.
    pub(in crate::core) fn sample_secs(&self) -> Option<f64> {
        self.sample.value()
    }

    /// Seconds of a direct view, if measured.
    pub(in crate::core) fn direct_secs(&self) -> Option<f64> {
        self.direct.value()
    }

    /// Seconds of a view from samples, if measured.
    pub(in crate::core) fn view_secs(&self) -> Option<f64> {
        self.view.value()
    }

    /// Seconds of a single ray, if measured.
    pub(in crate::core) fn ray_secs(&self) -> Option<f64> {
        self.ray.value()
    }

    /// Busy seconds of the busiest worker in a tick.
    pub(in crate::core) fn tick_secs(&self) -> f64 {
        self.tick_secs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(reports: u64) -> MeasuredCosts {
        let mut costs = MeasuredCosts::new(0.3);
        let mut before = Report::default();
        for done in 1..=reports {
            let report =
                Report { views_direct: done, direct_ms: Some(20.0), view_ms: Some(9e9), ..before.clone() };
            costs.learn(&report, &before);
            before = report;
        }
        costs
    }

    #[test]
    fn costs_are_learnt_only_from_work_that_was_done() {
        let costs = after(3);
        assert_eq!((costs.direct_secs(), costs.view_secs(), costs.sample_secs()), (Some(0.02), None, None));
        let believed = costs.believed();
        assert_eq!((believed.sample_secs, believed.view_secs), (0.02, 0.0));
        assert_eq!(after(0).believed(), Costs::default());
    }

    #[test]
    fn a_view_larger_than_usual_is_expected_to_take_longer() {
        let mut costs = after(3);
        let expected = |costs: &MeasuredCosts, direct, work| {
            costs.expected_secs(&QueuedView { predicted_ms: 0.0, direct, work })
        };
        assert_eq!(expected(&costs, true, 1 << 40), 0.02, "no size is known to be usual");
        costs.learn_pixels(true, 1000);
        assert_eq!(expected(&costs, true, 3000), 0.06);
        assert_eq!(expected(&costs, true, 10), 0.02);
        assert_eq!(expected(&costs, false, 3000), 0.0, "no such view was measured");
    }
}
