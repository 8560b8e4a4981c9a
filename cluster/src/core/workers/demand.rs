//! Demand, counted per tick.

use super::balance::Demand;
use crate::core::smooth::Rate;

/// Kinds of work in the formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::core) enum WorkKind {
    /// S: samples to render.
    Samples,
    /// D: views from triangles by their request, or by its bound on the error.
    Direct,
    /// Views from triangles whose request left the way open.
    DirectAnywhere,
    /// Microseconds of these views, by the cheapest ways within their bounds.
    MicrosAnywhere,
    /// V: views from samples.
    Views,
    /// R: single rays.
    Rays,
}

/// Demand per tick of each kind.
#[derive(Debug, Clone)]
pub(super) struct Rates {
    samples: Rate,
    direct: Rate,
    direct_anywhere: Rate,
    micros_anywhere: Rate,
    views: Rate,
    rays: Rate,
}

impl Rates {
    /// Starts without counts; `weight` of the newest tick is in (0, 1].
    pub(super) fn new(weight: f64) -> Self {
        let rate = || Rate::new(weight);
        Self {
            samples: rate(),
            direct: rate(),
            direct_anywhere: rate(),
            micros_anywhere: rate(),
            views: rate(),
            rays: rate(),
        }
    }

    /// Counts in the current tick.
    pub(super) fn count(&mut self, kind: WorkKind, n: u64) {
        let rate = match kind {
            WorkKind::Samples => &mut self.samples,
            WorkKind::Direct => &mut self.direct,
            WorkKind::DirectAnywhere => &mut self.direct_anywhere,
            WorkKind::MicrosAnywhere => &mut self.micros_anywhere,
            WorkKind::Views => &mut self.views,
            WorkKind::Rays => &mut self.rays,
        };
        rate.count(n);
    }

    /// Closes the tick.
    pub(super) fn roll(&mut self) {
        let Self { samples, direct, direct_anywhere, micros_anywhere, views, rays } = self;
        let all = [samples, direct, direct_anywhere, micros_anywhere, views, rays];
        all.into_iter().for_each(Rate::roll);
    }

    /// The demand per closed tick.
    pub(super) fn demand(&self) -> Demand {
        Demand {
            samples: self.samples.per_tick(),
            direct: self.direct.per_tick(),
            direct_anywhere: self.direct_anywhere.per_tick(),
            anywhere_secs: self.micros_anywhere.per_tick() * 1e-6,
            rays: self.rays.per_tick(),
            views: self.views.per_tick(),
        }
    }
}
