//! Choice of the rig's cameras for a viewpoint.

use std::cell::RefCell;
use std::sync::Arc;

use argus_scene::rig::{CandidateCameras, VisibilityQuery};
use argus_scene::{Camera, Rig};

/// Most samples of a plan: those of an exact view.
pub(in crate::core) const MOST_SAMPLES: usize = 8;

/// The cameras chosen for one viewpoint, best first.
#[derive(Debug)]
struct Choice {
    camera: Camera,
    refined: Vec<u64>,
    /// The level of the rig's cameras that serve it.
    level: i32,
    best: Vec<u64>,
}

/// Chooses cameras by visibility, if ray queries exist, and else by distance.
#[derive(Debug, Default)]
pub(super) struct Cameras {
    /// Ray queries: which cameras see what a view shows.
    sight: Option<Arc<dyn VisibilityQuery>>,
    /// The last choice by rays. Planning one view asks for the same choice several times, for growing numbers of
    /// cameras, and rays take most of the coordinator's time.
    last: RefCell<Option<Choice>>,
}

impl Cameras {
    /// Chooses by ray queries, if there are any.
    pub(super) fn new(sight: Option<Arc<dyn VisibilityQuery>>) -> Self {
        Self { sight, last: RefCell::default() }
    }

    /// The ray queries, if there are any.
    pub(super) fn sight(&self) -> Option<&dyn VisibilityQuery> {
        self.sight.as_deref()
    }

    /// The level of the rig's cameras that serve a viewpoint.
    pub(super) fn own_level(&self, rig: &Rig, camera: &Camera) -> i32 {
        self.last_level(camera).unwrap_or_else(|| rig.own_level(camera, self.sight()))
    }

    /// The level of the last choice, if that was for this viewpoint.
    fn last_level(&self, camera: &Camera) -> Option<i32> {
        self.last.borrow().as_ref().filter(|last| last.camera == *camera).map(|last| last.level)
    }

    /// The best cameras for a viewpoint, of the rig and of these refinements, best first.
    pub(super) fn best(&self, rig: &Rig, camera: &Camera, count: usize, refined: &[u64]) -> Vec<u64> {
        let choose = |level, count| {
            rig.nearest_at(level, camera, count, CandidateCameras { refined, sight: self.sight() })
        };
        if self.sight.is_none() || count > MOST_SAMPLES {
            return choose(self.own_level(rig, camera), count);
        }
        let last_level = self.last_level(camera);
        let mut last = self.last.borrow_mut();
        let is_same = |last: &&mut Choice| last.camera == *camera && last.refined == refined;
        let best = match last.as_mut().filter(is_same) {
            Some(last) => &last.best,
            // The best few are the first of the best many.
            None => {
                let level = last_level.unwrap_or_else(|| rig.own_level(camera, self.sight()));
                let best = choose(level, MOST_SAMPLES);
                &last.insert(Choice { camera: *camera, refined: refined.to_vec(), level, best }).best
            }
        };
        best.iter().take(count).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use argus_scene::rig::Target;
    use argus_scene::{PlanRequest, SampleSetInfo, View};
    use glam::DVec3;

    use super::*;
    use crate::core::config::Config;
    use crate::core::event::{Action, Event, ViewId};
    use crate::core::machine::Core;
    use crate::core::samples::Samples;
    use crate::core::tests::set_info;
    use crate::core::time::Uptime;

    /// Chooses the first candidates, and counts the queries.
    #[derive(Debug, Default)]
    struct Counting(AtomicUsize);

    impl VisibilityQuery for Counting {
        fn best(&self, _: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
            self.0.fetch_add(1, Ordering::Relaxed);
            candidates.iter().map(|(index, _)| *index).take(count).collect()
        }

        fn sees(&self, _: DVec3, _: DVec3) -> bool {
            true
        }

        fn targets(&self, _: DVec3, directions: &[DVec3], _: f64) -> Vec<Target> {
            directions.iter().map(|direction| Target::Sky(*direction)).collect()
        }

        fn shows(&self, _: DVec3, targets: &[Target], _: f64) -> Vec<bool> {
            vec![true; targets.len()]
        }
    }

    #[test]
    fn rays_are_sent_once_for_a_viewpoint() {
        let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 2.0, face: 8 };
        let set = Arc::new(SampleSetInfo { rig, ..set_info() });
        let counting = Arc::new(Counting::default());
        let mut samples = Samples::new(&Arc::new(Config::default()), set);
        samples.plan_by(Some(counting.clone()));
        let asked = || counting.0.load(Ordering::Relaxed);
        let here = Camera::look_at(DVec3::new(0.3, 0.4, 0.5), DVec3::X);
        let there = Camera { eye: DVec3::splat(7.0), ..here };
        let four = samples.sample_ids(&here, 4, 0);
        let eight = samples.sample_ids(&here, MOST_SAMPLES, 0);
        assert_eq!((four.len(), &eight[..4], asked()), (4, &four[..], 1));
        assert_ne!(samples.sample_ids(&there, 4, 0), four);
        assert_eq!(samples.sample_ids(&here, 4, 0), four);
        assert_eq!(asked(), 3, "another viewpoint is another choice");
        samples.sample_ids_among(&here, 4, 0, &[rig.refinement(&here, 1, None).unwrap()]);
        assert_eq!(asked(), 4, "so are other refinements");
        assert_eq!(samples.sample_ids(&here, MOST_SAMPLES + 1, 0).len(), MOST_SAMPLES + 1);
    }

    #[test]
    fn a_refused_view_costs_no_rays() {
        let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 2.0, face: 8 };
        let set = Arc::new(SampleSetInfo { rig, ..set_info() });
        for max_views in [0, 1] {
            let counting = Arc::new(Counting::default());
            let config = Config { max_views, ..Config::default() };
            let mut core = Core::new(config, set.clone()).with_sight(Some(counting.clone()));
            let camera = Camera::look_at(DVec3::new(0.3, 0.4, 0.5), DVec3::X);
            let plan = PlanRequest::from_samples();
            let view = View::new(camera, [40, 30], plan);
            let (view_id, view) = (ViewId(1), Box::new(view));
            let client = "a client".into();
            let requested = Event::Requested { view_id, client, view, deadline: None, last: None };
            let actions = core.step(requested, Uptime::default());
            assert_eq!(matches!(actions[..], [Action::Refuse { .. }]), max_views == 0, "{actions:?}");
            assert_eq!(counting.0.load(Ordering::Relaxed) > 0, max_views > 0);
        }
    }
}
