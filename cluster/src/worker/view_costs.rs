//! Costs of views by their kind: measured once, alone, and corrected by the times of real views.
//!
//! What corrects a kind is mostly what else the machine does, which slows all kinds. So both kinds from triangles share one
//! correction, and a kind of which no view was rendered for a while takes theirs: else one that was slow once would look
//! expensive, be rendered no more, and look so for ever.

use std::time::{Duration, Instant};

use argus_scene::Plan;

use crate::core::quality::Cost;
use crate::core::smooth::Smoothed;

/// Time for which a correction is worth more than a newer one of another kind.
const FRESH: Duration = Duration::from_secs(3);

/// Weight of the newest view in a correction.
const WEIGHT: f64 = 0.2;

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

/// Ratio of real times to measured costs.
#[derive(Debug)]
struct Correction {
    ratio: Smoothed,
    /// When a view was last observed.
    at: Option<Instant>,
}

impl Default for Correction {
    fn default() -> Self {
        Self { ratio: Smoothed::new(WEIGHT), at: None }
    }
}

impl Correction {
    fn observe(&mut self, ratio: f64, now: Instant) {
        self.ratio.observe(ratio);
        self.at = Some(now);
    }

    fn fresh(&self, now: Instant) -> Option<f64> {
        self.ratio.value().filter(|_| self.at.is_some_and(|at| now.duration_since(at) < FRESH))
    }
}

/// The costs of all kinds.
#[derive(Debug, Default)]
pub(super) struct ViewCosts {
    direct: Option<Cost>,
    few_rays: Option<Cost>,
    warp: Option<Cost>,
    from_frames: Option<Cost>,
    of_triangles: Correction,
    of_warps: Correction,
    of_frames: Correction,
}

impl ViewCosts {
    /// Sets the measured cost of a kind, which nothing corrects so far.
    pub(super) fn set(&mut self, kind: ViewKind, cost: Cost) {
        let (measured, correction) = match kind {
            ViewKind::Direct => (&mut self.direct, &mut self.of_triangles),
            ViewKind::FewRays => (&mut self.few_rays, &mut self.of_triangles),
            ViewKind::Warp => (&mut self.warp, &mut self.of_warps),
            ViewKind::FromFrames => (&mut self.from_frames, &mut self.of_frames),
        };
        (*measured, *correction) = (Some(cost), Correction::default());
    }

    /// Learns from the milliseconds of a view. `pixels` are those that were rendered, with sub-pixels.
    pub(super) fn observe(&mut self, kind: ViewKind, pixels: u64, ms: f64, now: Instant) {
        let Some(measured) = self.measured(kind) else { return };
        let correction = match kind {
            ViewKind::Direct | ViewKind::FewRays => &mut self.of_triangles,
            ViewKind::Warp => &mut self.of_warps,
            ViewKind::FromFrames => &mut self.of_frames,
        };
        correction.observe(ms / measured.ms(pixels), now);
    }

    /// The corrected cost of a kind; `None` until it is measured.
    pub(super) fn cost(&self, kind: ViewKind, now: Instant) -> Option<Cost> {
        let own = match kind {
            ViewKind::Direct | ViewKind::FewRays => &self.of_triangles,
            ViewKind::Warp => &self.of_warps,
            ViewKind::FromFrames => &self.of_frames,
        };
        let fresh = own.fresh(now).or_else(|| self.of_triangles.fresh(now));
        let factor = fresh.or_else(|| own.ratio.value()).unwrap_or(1.0);
        self.measured(kind).map(|cost| Cost {
            fixed_ms: cost.fixed_ms * factor,
            ms_per_megapixel: cost.ms_per_megapixel * factor,
        })
    }

    fn measured(&self, kind: ViewKind) -> Option<Cost> {
        match kind {
            ViewKind::Direct => self.direct,
            ViewKind::FewRays => self.few_rays,
            ViewKind::Warp => self.warp,
            ViewKind::FromFrames => self.from_frames,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXELS: u64 = 1_000_000;

    /// Views take 20 ms from triangles, 8 with few rays, and 2 from samples.
    fn costs() -> ViewCosts {
        let mut costs = ViewCosts::default();
        for (kind, ms) in [(ViewKind::Direct, 20.0), (ViewKind::FewRays, 8.0), (ViewKind::Warp, 2.0)] {
            costs.set(kind, Cost { fixed_ms: 0.1 * ms, ms_per_megapixel: 0.9 * ms });
        }
        costs
    }

    #[test]
    fn views_correct_a_measured_cost_and_set_none_without_a_measurement() {
        let (mut costs, now) = (costs(), Instant::now());
        let ms = |costs: &ViewCosts, kind| costs.cost(kind, now).unwrap().ms(PIXELS);
        assert!((ms(&costs, ViewKind::Direct) - 20.0).abs() < 1e-9);
        (0..40).for_each(|_| costs.observe(ViewKind::Direct, PIXELS, 40.0, now));
        assert!((ms(&costs, ViewKind::Direct) - 40.0).abs() < 0.1);
        assert!((ms(&costs, ViewKind::FewRays) - 16.0).abs() < 0.1, "the machine is slow for it, too");
        assert!((ms(&costs, ViewKind::Warp) - 4.0).abs() < 0.1);
        costs.observe(ViewKind::Direct, 0, f64::NAN, now);
        assert!(costs.cost(ViewKind::Direct, now).unwrap().ms(0).is_finite());
        costs.observe(ViewKind::FromFrames, PIXELS, 3.0, now);
        assert_eq!(costs.cost(ViewKind::FromFrames, now), None);
    }

    #[test]
    fn a_kind_that_was_slow_once_does_not_look_so_for_ever() {
        let (mut costs, begin) = (costs(), Instant::now());
        let later = begin + 2 * FRESH;
        (0..10).for_each(|_| costs.observe(ViewKind::Warp, PIXELS, 200.0, begin));
        (0..10).for_each(|_| costs.observe(ViewKind::Direct, PIXELS, 30.0, later));
        assert!(costs.cost(ViewKind::Warp, begin).unwrap().ms(PIXELS) > 100.0);
        assert!((costs.cost(ViewKind::Warp, later).unwrap().ms(PIXELS) - 3.0).abs() < 0.1);
        // While nothing is rendered, the last that was known stays.
        let much_later = later + 2 * FRESH;
        assert!(costs.cost(ViewKind::Warp, much_later).unwrap().ms(PIXELS) > 100.0);
    }
}
