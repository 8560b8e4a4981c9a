//! What planning takes: how views whose request leaves the way open are to be answered, and by whom.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use argus_scene::View;

/// The views that were planned so far.
#[derive(Debug, Default)]
pub(super) struct PlanningTime {
    views: AtomicU64,
    nanos: AtomicU64,
}

/// A view that is being planned; nothing is counted of one whose request or pin names the way.
pub(super) struct PlanningTimer<'a>(Option<(&'a PlanningTime, Instant)>);

impl PlanningTime {
    /// A view is about to be planned.
    pub(super) fn begin(&self, view: &View) -> PlanningTimer<'_> {
        let is_open = view.pin.is_none() && view.plan.leaves_way_open();
        PlanningTimer(is_open.then(|| (self, Instant::now())))
    }

    /// How many views were planned, and the microseconds that it took in all.
    pub(super) fn so_far(&self) -> (u64, f64) {
        let nanos = self.nanos.load(Ordering::Relaxed);
        (self.views.load(Ordering::Relaxed), nanos as f64 * 1e-3)
    }
}

impl PlanningTimer<'_> {
    /// It was given to a worker, or waits for one.
    pub(super) fn end(self) {
        if let Some((planning, began)) = self.0 {
            planning.views.fetch_add(1, Ordering::Relaxed);
            planning.nanos.fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, Outputs, PlanRequest};
    use glam::DVec3;

    use super::*;

    #[test]
    fn views_whose_way_is_named_are_not_counted() {
        let planning = PlanningTime::default();
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X);
        let view = |plan| View { camera, width: 8, height: 8, outputs: Outputs::COLOR, plan, pin: None };
        planning.begin(&view(PlanRequest { direct: true, ..PlanRequest::default() })).end();
        assert_eq!(planning.so_far(), (0, 0.0));
        planning.begin(&view(PlanRequest::default())).end();
        assert_eq!(planning.so_far().0, 1);
    }
}
