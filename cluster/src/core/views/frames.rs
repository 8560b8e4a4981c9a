//! Offers of views that are warped from recent direct frames.
//!
//! A direct frame with its range is a sample at no price. A worker that rendered one nearby offers to warp it, and to
//! trace the pixels that it did not see. Which share those are, and how fine its pixels are, comes from the estimate of
//! the view, as for samples of a set. Frames that were warped themselves are no sources, so that errors do not add up.

use argus_scene::rig::CoverageEstimate;
use argus_scene::{Camera, FaceMasks, FrameSource, Holes, Plan, Search, View, Warp};

use super::cluster::Cluster;
use super::open_view::{OpenView, direct_frame};
use super::pending::Pending;
use super::planner::{EXCESS_OF_COARSE, LEAST_FINE, Offer};
use crate::core::workers::Worker;

/// Frames of all workers that are examined for a view, nearest first. Each costs as many rays as the view's estimate.
const MOST_EXAMINED: usize = 4;

/// Workers whose frames are considered for an estimate.
const MOST_WORKERS: usize = 64;

/// Frames of a plan: a second one sees past the borders of the first.
const MOST_FRAMES: usize = 2;

/// Least share of the view that the frames see. The rest is traced pixel by pixel. Workers accept frames that miss half as
/// much again, since an estimate has few rays.
const LEAST_SEEN: f64 = 0.9;

/// Greatest share of a direct view's time that warping may take.
const MOST_SHARE: f64 = 0.6;

/// Price of a traced pixel in pixels of a direct view, until a worker has measured it. Single pixels share no light with
/// neighbours, so each casts more rays: in Sponza they cost 11 µs, and pixels of direct views 2 µs.
const PRICE_OF_RAY: f64 = 5.0;

/// Predicted excess near the frame's own viewpoint: its colours are filtered once more. It is an upper bound for what
/// probes of a few hundred pixels find: in Sponza 0.001 to 0.022, with a mean of 0.012.
const EXCESS_OF_FRAME: f64 = 0.013;

/// Predicted excess for each radian by which surfaces are seen from another side: highlights stay where the frame's
/// viewer saw them, and pixels at silhouettes are filled from either side. `study light equal-error` measured 0.005, 0.009 and
/// 0.043 in Sponza, from frames 0.05, 0.2 and 0.8 m aside of surfaces about 6 m away.
const EXCESS_OF_PARALLAX: f64 = 0.25;

/// Share of the extent's diagonal that counts as much as one radian, in the order in which frames are examined.
const SHARE_OF_A_RADIAN: f64 = 0.1;

impl Cluster<'_> {
    /// The recent frames to examine for a view that leaves the way open: those nearest to it, of any worker that can warp
    /// them.
    pub(super) fn frames_around(&self, view: &View) -> Vec<FrameSource> {
        let asked = direct_frame(view);
        let set = self.samples.set();
        let metres = (set.extent.max - set.extent.min).length() * SHARE_OF_A_RADIAN;
        let pixels = u64::from(asked.width) * u64::from(asked.height) * u64::from(asked.samples_per_pixel);
        let able = self.workers.iter().filter(|worker| warping_pays(worker, pixels)).take(MOST_WORKERS);
        let frames = able.flat_map(|worker| worker.frames().showing(set.version.state));
        let apart = |frame: &FrameSource| apart(&frame.camera, &view.camera, metres);
        let mut near: Vec<(f64, FrameSource)> = frames
            .filter(|frame| is_alike(frame, &asked))
            .map(|frame| (apart(frame), *frame))
            .filter(|(apart, _)| apart.is_finite())
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.dedup_by(|a, b| a.1 == b.1);
        near.into_iter().map(|(_, frame)| frame).take(MOST_EXAMINED).collect()
    }

    /// A worker's offer to warp recent frames of its own, like its offer `base` from triangles. `None` without a frame
    /// that shows any of the view.
    pub(super) fn offer_from_frames(
        &self,
        worker: &Worker,
        view: &Pending,
        open: &OpenView,
        base: &Offer,
    ) -> Option<Offer> {
        let work = view.pixels.saturating_mul(open.direct.samples_per_pixel.into());
        let cost = worker.report().frame_cost.filter(|_| warping_pays(worker, work))?;
        let estimate = open.estimate.as_deref()?;
        let held: Vec<FrameSource> = worker
            .frames()
            .showing(self.samples.set().version.state)
            .filter(|frame| is_alike(frame, &open.direct))
            .copied()
            .collect();
        let frames = best_of(&held, estimate);
        let (numbers, eyes): (Vec<u64>, Vec<_>) =
            frames.iter().map(|frame| (frame.number(), frame.camera.eye)).unzip();
        frames.first()?;
        let coverage = estimate.coverage(&numbers);
        let parallax = EXCESS_OF_FRAME + EXCESS_OF_PARALLAX * estimate.parallax(&eyes);
        let coarse = EXCESS_OF_COARSE * (coverage.covered - coverage.fine);
        let excess = (parallax + coarse) * self.samples.error_factor();
        let meets_coverage = coverage.covered >= LEAST_SEEN && coverage.fine >= LEAST_FINE * coverage.covered;
        let rays_ms = self.ray_ms(worker) * (1.0 - coverage.covered) * work as f64;
        let plan = self.warp_of(frames, open);
        Some(Offer {
            render_ms: Some(cost.ms(work) + rays_ms),
            excess,
            meets_coverage,
            repeats: self.repeats(worker, open, &plan),
            plan,
            ..base.clone()
        })
    }

    /// The plan of a view from these frames.
    fn warp_of(&self, frames: Vec<FrameSource>, open: &OpenView) -> Plan {
        let search = Search::default();
        Plan::Warp(Warp {
            search,
            steps: self.config.steps_of(search),
            supersampling: open.direct.samples_per_pixel.isqrt(),
            samples: Vec::new(),
            frames,
            faces: FaceMasks::default(),
            holes: Holes::Trace,
        })
    }

    /// Milliseconds of a worker for a traced ray, measured or by the price of its direct views.
    fn ray_ms(&self, worker: &Worker) -> f64 {
        let by_direct = || Some(PRICE_OF_RAY * worker.report().direct_cost?.ms_per_megapixel * 1e-6);
        worker.report().ray_ms.or_else(by_direct).unwrap_or(0.0)
    }
}

/// Whether a worker warps frames so much faster than it renders a view of this many pixels, with sub-pixels, that keeping
/// and examining them pays. A small plain scene is simply rendered.
pub(super) fn warping_pays(worker: &Worker, pixels: u64) -> bool {
    let costs = worker.report().frame_cost.zip(worker.report().direct_cost);
    costs.is_some_and(|(frame, direct)| frame.ms(pixels) <= MOST_SHARE * direct.ms(pixels))
}

/// Whether a frame has the size and the sampling of the direct view that it replaces: its pixels are as fine, and its
/// edges as smooth.
fn is_alike(frame: &FrameSource, direct: &FrameSource) -> bool {
    let kind = |frame: &FrameSource| (frame.width, frame.height, frame.samples_per_pixel);
    kind(frame) == kind(direct)
}

/// Distance of two cameras, where `metres` count as one radian. Infinite if they look in directions that share nothing.
fn apart(a: &Camera, b: &Camera, metres: f64) -> f64 {
    let ahead = |camera: &Camera| (camera.target - camera.eye).normalize();
    let cosine = ahead(a).dot(ahead(b));
    // Written so that NaN shares nothing.
    if !(cosine > 0.0) {
        return f64::INFINITY;
    }
    cosine.min(1.0).acos() + a.eye.distance(b.eye) / metres.max(f64::MIN_POSITIVE)
}

/// The frames, among those examined, that together show most of the view: one if it shows as much as two.
fn best_of(held: &[FrameSource], estimate: &CoverageEstimate) -> Vec<FrameSource> {
    let is_held = |number| held.iter().any(|frame| frame.number() == number);
    let mut numbers = estimate.choose(is_held, MOST_FRAMES);
    let seen = |numbers: &[u64]| estimate.coverage(numbers).covered;
    if numbers.len() > 1 && seen(&numbers[..1]) >= seen(&numbers) {
        numbers.truncate(1);
    }
    let frame = |number: u64| held.iter().find(|frame| frame.number() == number).copied();
    numbers.into_iter().filter_map(frame).collect()
}
