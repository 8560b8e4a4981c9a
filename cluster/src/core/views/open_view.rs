//! State of a view that leaves the way open.

use std::hash::{DefaultHasher, Hash, Hasher};

use argus_scene::frame::Decision;
use argus_scene::{FrameSource, Outputs, Plan, Preset, View};
use glam::DVec3;

use super::explicit_plan::samples_per_pixel;
use crate::core::event::{Fallback, LastView};
use crate::core::market::{Chosen, ViewGrid};

/// Greatest predicted excess of [`Preset::Exact`], mean FLIP.
///
/// Tuned: below it differences to the view from triangles are not seen (docs/results.md, "Bounds").
const EXACT_EXCESS: f64 = 0.005;

/// What the decision needs to know about one view.
#[derive(Debug, Clone)]
pub(super) struct OpenView {
    /// The direct frame that would answer it.
    pub(super) direct: FrameSource,
    /// Its rays.
    pub(super) grid: ViewGrid,
    /// What its time is worth.
    pub(super) preset: Option<Preset>,
    /// Milliseconds after which its frame is worthless, by its plan.
    pub(super) deadline_ms: Option<f64>,
    /// Whether it may be warped from sources: it is colour alone, sampled as usual.
    pub(super) may_warp: bool,
    /// The session's last frame, if the camera stands still: whether it was rendered in full.
    pub(super) rests: Option<bool>,
    /// The latest choice.
    pub(super) chosen: Option<Chosen>,
    /// The best warp beside it.
    pub(super) warped: Option<Chosen>,
    /// The latest decision, for people.
    pub(super) decision: Option<Decision>,
    /// What replaces a frame from sources that is not good enough, by that decision.
    pub(super) fallback: Option<Fallback>,
}

impl OpenView {
    /// Makes the state; `None` for a view that is pinned or whose request names the way.
    pub(super) fn of(view: &View, last: Option<&LastView>) -> Option<Box<Self>> {
        if !view.leaves_way_open() {
            return None;
        }
        let View { camera, width, height, ref plan, .. } = *view;
        let direct = FrameSource {
            camera,
            width,
            height,
            samples_per_pixel: samples_per_pixel(plan),
            band_rows: 0,
            light: None,
        };
        let stands = |last: &LastView| {
            let same = |a: &View| (a.camera, a.width, a.height, a.plan) == (camera, width, height, *plan);
            same(&last.view).then(|| {
                let plan = &last.provenance.plan;
                matches!(plan, Plan::Direct { .. }) && plan.is_whole()
            })
        };
        Some(Box::new(Self {
            direct,
            grid: ViewGrid::new(&camera, [width, height]),
            preset: plan.preset,
            deadline_ms: plan.deadline_ms,
            may_warp: view.outputs == Outputs::COLOR && plan.supersampling.is_none(),
            rests: last.and_then(stands),
            chosen: None,
            warped: None,
            decision: None,
            fallback: None,
        }))
    }

    /// Greatest predicted excess of its frame.
    pub(super) fn max_excess(&self) -> f64 {
        if self.preset == Some(Preset::Exact) { EXACT_EXCESS } else { f64::INFINITY }
    }

    /// Whether pixels may be guessed, or rendered in less detail.
    pub(super) fn may_guess(&self) -> bool {
        self.preset != Some(Preset::Exact)
    }

    /// A number of the place that it is at, for views that are near no source: the same within a sixteenth of `reach` metres and an
    /// octant of directions.
    pub(super) fn place(&self, reach: f64) -> u64 {
        let cell = (self.grid.eye / (reach / 16.0)).floor();
        let signs = self.grid.axis.to_array().map(|x| x >= 0.0);
        let mut hasher = DefaultHasher::new();
        (DVec3::to_array(&cell).map(f64::to_bits), signs).hash(&mut hasher);
        hasher.finish()
    }
}
