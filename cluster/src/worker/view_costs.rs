//! Costs of views by their kind: measured once, alone, and corrected by the times of real views.
//!
//! A cost has a fixed part and a part per pixel. The time of a view corrects each part by its share of the predicted time (the
//! normalised least-mean-squares rule, on logarithms), so that views of several sizes correct both. What slows one kind from triangles
//! slows the other, so each corrects the other, too, by half. A kind of which no view was rendered for a while is slowed as they are:
//! else one that was slow once would look expensive, be rendered no more, and look so for ever.

use std::time::{Duration, Instant};

use argus_scene::Plan;

use crate::core::quality::Cost;

/// Time for which the last correction of a kind is worth more than a newer one of another kind.
const FRESH: Duration = Duration::from_secs(3);

/// Part of a view's difference to its predicted time by which it corrects the cost.
const STEP: f64 = 0.15;

/// Most ratio of a view's time to the predicted one that counts, and its inverse: one that is delayed is no measurement.
const MOST_RATIO: f64 = 2.0;

/// Pixels of a typical view, by which kinds are compared.
const TYPICAL: u64 = 320 * 240;

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

/// The cost of one kind.
#[derive(Debug, Clone, Copy)]
struct KindCost {
    measured: Cost,
    corrected: Cost,
    /// When a view corrected it.
    at: Option<Instant>,
}

impl KindCost {
    /// Ratio of a view's time to the predicted one, as far as it counts.
    fn ratio(&self, pixels: u64, ms: f64) -> Option<f64> {
        let ratio = ms / self.corrected.ms(pixels);
        (ratio > 0.0 && ratio.is_finite()).then(|| ratio.clamp(1.0 / MOST_RATIO, MOST_RATIO))
    }

    /// Corrects each part by its share of the time of a view of so many pixels.
    fn correct(&mut self, pixels: u64, ratio: f64, step: f64) {
        let Cost { fixed_ms, ms_per_megapixel } = self.corrected;
        let all = self.corrected.ms(pixels);
        let shares = [fixed_ms / all, 1.0 - fixed_ms / all];
        let squares = shares[0] * shares[0] + shares[1] * shares[1];
        let factor = |share: f64| (step * ratio.ln() * share / squares).exp();
        self.corrected = Cost {
            fixed_ms: fixed_ms * factor(shares[0]),
            ms_per_megapixel: ms_per_megapixel * factor(shares[1]),
        };
    }

    /// The corrected cost of a typical view over the measured one.
    fn slowdown(&self) -> f64 {
        self.corrected.ms(TYPICAL) / self.measured.ms(TYPICAL)
    }

    fn is_fresh(&self, now: Instant) -> bool {
        self.at.is_some_and(|at| now.duration_since(at) < FRESH)
    }
}

/// The costs of all kinds.
#[derive(Debug, Default)]
pub(super) struct ViewCosts {
    direct: Option<KindCost>,
    few_rays: Option<KindCost>,
    warp: Option<KindCost>,
    from_frames: Option<KindCost>,
}

impl ViewCosts {
    /// Sets the measured cost of a kind, which nothing corrects so far.
    pub(super) fn set(&mut self, kind: ViewKind, cost: Cost) {
        *self.of(kind) = Some(KindCost { measured: cost, corrected: cost, at: None });
    }

    /// Learns from the milliseconds of a view. `pixels` are those that were rendered, with sub-pixels.
    pub(super) fn observe(&mut self, kind: ViewKind, pixels: u64, ms: f64, now: Instant) {
        let Some(cost) = self.of(kind) else { return };
        let Some(ratio) = cost.ratio(pixels, ms) else { return };
        cost.correct(pixels, ratio, STEP);
        cost.at = Some(now);
        let alike = match kind {
            ViewKind::Direct => &mut self.few_rays,
            ViewKind::FewRays => &mut self.direct,
            ViewKind::Warp | ViewKind::FromFrames => return,
        };
        if let Some(alike) = alike {
            alike.correct(pixels, ratio, 0.5 * STEP);
        }
    }

    /// The corrected cost of a kind; `None` until it is measured.
    pub(super) fn cost(&self, kind: ViewKind, now: Instant) -> Option<Cost> {
        match kind {
            ViewKind::Direct => self.direct.map(|cost| cost.corrected),
            // It does the same with fewer rays.
            ViewKind::FewRays => self.few_rays.map(|KindCost { corrected, .. }| match self.direct {
                None => corrected,
                Some(direct) => Cost {
                    fixed_ms: corrected.fixed_ms.min(direct.corrected.fixed_ms),
                    ms_per_megapixel: corrected.ms_per_megapixel.min(direct.corrected.ms_per_megapixel),
                },
            }),
            ViewKind::Warp => self.or_slowed(self.warp?, now),
            ViewKind::FromFrames => self.or_slowed(self.from_frames?, now),
        }
    }

    /// The corrected cost of a kind, or if that is old and views from triangles were rendered, the measured cost, slowed as they are.
    fn or_slowed(&self, cost: KindCost, now: Instant) -> Option<Cost> {
        let triangles = [self.direct, self.few_rays].into_iter().flatten().find(|cost| cost.is_fresh(now));
        Some(match triangles.filter(|_| !cost.is_fresh(now)) {
            None => cost.corrected,
            Some(triangles) => Cost {
                fixed_ms: cost.measured.fixed_ms * triangles.slowdown(),
                ms_per_megapixel: cost.measured.ms_per_megapixel * triangles.slowdown(),
            },
        })
    }

    fn of(&mut self, kind: ViewKind) -> &mut Option<KindCost> {
        match kind {
            ViewKind::Direct => &mut self.direct,
            ViewKind::FewRays => &mut self.few_rays,
            ViewKind::Warp => &mut self.warp,
            ViewKind::FromFrames => &mut self.from_frames,
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
        (0..60).for_each(|_| costs.observe(ViewKind::Direct, PIXELS, 40.0, now));
        assert!((ms(&costs, ViewKind::Direct) - 40.0).abs() < 0.1);
        assert!(ms(&costs, ViewKind::FewRays) > 11.0, "the machine is slow for it, too");
        assert!((2.2..4.1).contains(&ms(&costs, ViewKind::Warp)));
        for ms in [f64::NAN, 0.0, -1.0, f64::INFINITY] {
            costs.observe(ViewKind::Direct, 0, ms, now);
        }
        assert!(costs.cost(ViewKind::Direct, now).unwrap().ms(0).is_finite());
        costs.observe(ViewKind::FromFrames, PIXELS, 3.0, now);
        assert_eq!(costs.cost(ViewKind::FromFrames, now), None);
    }

    #[test]
    fn views_of_several_sizes_correct_both_parts() {
        let (mut costs, now) = (ViewCosts::default(), Instant::now());
        // Measured while the machine started: all of it looked fixed.
        costs.set(ViewKind::Direct, Cost { fixed_ms: 60.0, ms_per_megapixel: 500.0 });
        let real = Cost { fixed_ms: 8.0, ms_per_megapixel: 2400.0 };
        for i in 0..300 {
            let pixels = [2_000, 8_000, 30_000][i % 3];
            costs.observe(ViewKind::Direct, pixels, real.ms(pixels), now);
        }
        let cost = costs.cost(ViewKind::Direct, now).unwrap();
        for pixels in [2_000, 8_000, 30_000] {
            assert!((cost.ms(pixels) / real.ms(pixels) - 1.0).abs() < 0.1, "{pixels}: {cost:?}");
        }
    }

    #[test]
    fn one_delayed_view_changes_little() {
        let (mut costs, now) = (costs(), Instant::now());
        costs.observe(ViewKind::Direct, PIXELS, 5000.0, now);
        assert!(costs.cost(ViewKind::Direct, now).unwrap().ms(PIXELS) < 23.0);
    }

    #[test]
    fn few_rays_never_look_dearer_than_all() {
        let mut costs = costs();
        costs.set(ViewKind::FewRays, Cost { fixed_ms: 50.0, ms_per_megapixel: 90.0 });
        let [few, all] = [ViewKind::FewRays, ViewKind::Direct].map(|kind| costs.cost(kind, Instant::now()));
        assert_eq!(few, all);
    }

    #[test]
    fn a_kind_that_was_slow_once_does_not_look_so_for_ever() {
        let (mut costs, begin) = (costs(), Instant::now());
        let later = begin + 2 * FRESH;
        (0..60).for_each(|_| costs.observe(ViewKind::Warp, PIXELS, 200.0, begin));
        (0..60).for_each(|_| costs.observe(ViewKind::Direct, PIXELS, 30.0, later));
        assert!(costs.cost(ViewKind::Warp, begin).unwrap().ms(PIXELS) > 100.0);
        assert!((2.2..3.1).contains(&costs.cost(ViewKind::Warp, later).unwrap().ms(PIXELS)));
        // While nothing is rendered, the last that was known stays.
        let much_later = later + 2 * FRESH;
        assert!(costs.cost(ViewKind::Warp, much_later).unwrap().ms(PIXELS) > 100.0);
    }
}
