//! Plans of a batch: from samples, where its views share so many of them that rendering these costs less than it saves.
//!
//! One decision is made for all cameras of a batch. It follows from the cameras, the scene and the first prices that this coordinator
//! learnt, not from the present load, from what workers hold or from the order in which frames are done. So while nothing moves
//! and all light is there, a batch gets the same bytes from one coordinator whenever it is asked for.

use std::collections::BTreeMap;

use argus_scene::rig::CoverageEstimate;
use argus_scene::{FaceMask, Holes, Plan, Provenance, SampleSetInfo, View, Warp};

use super::cluster::Cluster;
use super::explicit_plan::samples_per_pixel;
use super::planner::{Aim, predicted_excess};

/// Samples are rendered for a batch if this many times their price is saved: predictions are off by as much.
const LEAST_GAIN: f64 = 1.3;

/// Time of a sample over that of a view from triangles with as many pixels. A texel has several sub-samples, but is shaded and lit
/// once for most of them, which is what takes time.
const SAMPLE_OVER_VIEW: f64 = 1.25;

impl Cluster<'_> {
    /// The pins of a batch's views; `None` for those from triangles. Views are given with their estimates, if they have one.
    pub(in crate::core) fn batch_pins(
        &self,
        views: &[(View, Option<CoverageEstimate>)],
    ) -> Vec<Option<Provenance>> {
        let none = || vec![None; views.len()];
        let set = self.samples.set();
        let Some(prices) = self.workers.first_prices().filter(|_| stands_still(set)) else { return none() };
        let camera_sets: Vec<Option<Vec<(u64, FaceMask)>>> =
            views.iter().map(|(view, estimate)| self.camera_set_within(view, estimate.as_ref()?)).collect();
        let mut faces: BTreeMap<u64, FaceMask> = BTreeMap::new();
        for (camera, wanted) in camera_sets.iter().flatten().flatten() {
            let faces = faces.entry(*camera).or_insert(FaceMask::NONE);
            *faces = faces.union(*wanted);
        }
        let whole: f64 = faces.values().map(|faces| faces.share()).sum();
        let sample_ms = SAMPLE_OVER_VIEW * prices.direct.ms(set.rig.sample_texels());
        let saved_ms = |(view, _): &(View, Option<CoverageEstimate>)| {
            let per_pixel = u64::from(samples_per_pixel(&view.plan));
            let pixels = u64::from(view.width) * u64::from(view.height) * per_pixel;
            prices.direct.ms(pixels) - prices.warp.ms(pixels)
        };
        let saved: f64 =
            views.iter().zip(&camera_sets).filter(|(_, b)| b.is_some()).map(|(v, _)| saved_ms(v)).sum();
        // Written so that a batch without camera sets is rendered from triangles.
        if !(saved > LEAST_GAIN * whole * sample_ms) {
            return none();
        }
        let pin = |(view, camera_set): (&View, Vec<(u64, FaceMask)>)| {
            let cameras: Vec<u64> = camera_set.into_iter().map(|(camera, _)| camera).collect();
            let ids = cameras.iter().map(|camera| self.samples.served(*camera)).collect();
            let faces = cameras.iter().map(|camera| (*camera, faces[camera])).collect();
            let samples = set.with_reflection_probes(ids);
            let supersampling = samples_per_pixel(&view.plan).isqrt();
            let warp = Warp { samples, faces, supersampling, holes: Holes::Trace, ..Warp::default() };
            Provenance::of_plan(set.scene, set.version.state, Plan::Warp(warp))
        };
        let with_camera_sets = views.iter().map(|(view, _)| view).zip(camera_sets);
        with_camera_sets.map(|(view, camera_set)| Some(pin((view, camera_set?)))).collect()
    }

    /// The cameras that would bring a view within the bound of its request.
    fn camera_set_within(&self, view: &View, estimate: &CoverageEstimate) -> Option<Vec<(u64, FaceMask)>> {
        let camera_set = self.camera_set(estimate).filter(|camera_set| !camera_set.is_empty())?;
        let cameras: Vec<u64> = camera_set.iter().map(|(camera, _)| *camera).collect();
        let (excess, _) = predicted_excess(Some(estimate.coverage(&cameras)), 1.0);
        (excess <= Aim::of(&view.plan).max_excess).then_some(camera_set)
    }
}

/// Whether a set's version lasts: nothing moves, nothing was moved, and its light rises no more.
fn stands_still(set: &SampleSetInfo) -> bool {
    let state = set.version.state;
    set.epoch_secs == 0.0 && state.revision == 0 && state.light == set.last_light()
}
