//! What things cost, as workers measured it.

use super::balance::Costs;
use super::worker::QueuedView;
use crate::core::event::Report;
use crate::core::smooth::Smoothed;

/// What things cost, seconds of one process, over all workers.
#[derive(Debug, Clone)]
pub(in crate::core) struct MeasuredCosts {
    sample: Smoothed,
    direct: Smoothed,
    view: Smoothed,
    ray: Smoothed,
    /// What is rendered for a direct view, pixels with their sub-pixels.
    direct_pixels: Smoothed,
    /// What is rendered for a view from samples, pixels with their sub-pixels.
    view_pixels: Smoothed,
    /// Busy seconds of the busiest worker in a tick.
    tick_secs: f64,
}

impl MeasuredCosts {
    /// Nothing measured yet; `weight` of the newest observation in (0, 1].
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

    /// A worker reported, and what it had reported before: costs of what it did in between.
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

    /// A view was answered for which so many pixels were rendered, sub-pixels counted.
    pub(super) fn learn_pixels(&mut self, direct: bool, work: u64) {
        let pixels = if direct { &mut self.direct_pixels } else { &mut self.view_pixels };
        pixels.observe(work as f64);
    }

    /// The busiest worker was busy for so many seconds in a tick.
    pub(super) fn learn_tick(&mut self, busy_secs: f64, weight: f64) {
        self.tick_secs += weight * (busy_secs - self.tick_secs);
    }

    /// What is believed of costs by the formula. A direct view and a sample are alike (both render the triangles), so either
    /// stands in for the other while that is unmeasured. The planner goes by what each worker measured, and never by another
    /// kind's cost.
    pub(super) fn believed(&self) -> Costs {
        let (sample, direct) = (self.sample_secs(), self.direct_secs());
        Costs {
            sample_secs: sample.or(direct).unwrap_or(0.0),
            direct_secs: direct.or(sample).unwrap_or(0.0),
            ray_secs: self.ray_secs().unwrap_or(0.0),
            view_secs: self.view_secs().unwrap_or(0.0),
        }
    }

    /// Seconds that a view in a queue is expected to take, by its kind and its size.
    pub(super) fn expected_secs(&self, view: &QueuedView) -> f64 {
        let (cost, usual) = match view.direct {
            true => (self.direct_secs().or(self.sample_secs()), self.direct_pixels.value()),
            false => (self.view_secs(), self.view_pixels.value()),
        };
        cost.unwrap_or(0.0) * usual.map_or(1.0, |usual| (view.work as f64 / usual).max(1.0))
    }

    /// Of a sample, if any was measured.
    pub(in crate::core) fn sample_secs(&self) -> Option<f64> {
        self.sample.value()
    }

    /// Of a direct view, if any was measured.
    pub(in crate::core) fn direct_secs(&self) -> Option<f64> {
        self.direct.value()
    }

    /// Of a view from samples, if any was measured.
    pub(in crate::core) fn view_secs(&self) -> Option<f64> {
        self.view.value()
    }

    /// Of a single ray, if any was measured.
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
    fn a_cost_is_learnt_from_work_that_was_done_and_stands_in_for_a_sample_alone() {
        let costs = after(3);
        assert_eq!((costs.direct_secs(), costs.view_secs(), costs.sample_secs()), (Some(0.02), None, None));
        let believed = costs.believed();
        assert_eq!((believed.sample_secs, believed.view_secs), (0.02, 0.0));
        assert_eq!(after(0).believed(), Costs::default());
    }

    #[test]
    fn a_view_larger_than_usual_is_expected_to_take_longer_and_a_smaller_one_no_less() {
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
