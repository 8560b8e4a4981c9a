//! The time that planning takes, for views whose request leaves the way open.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use argus_scene::View;

/// Number of planned views, and the total time.
#[derive(Debug, Default)]
pub(super) struct PlanningTime {
    views: AtomicU64,
    nanos: AtomicU64,
}

/// Times the planning of one view. Views whose request or pin names the way are not counted.
pub(super) struct PlanningTimer<'a>(Option<(&'a PlanningTime, Instant)>);

impl PlanningTime {
    /// Starts planning a view.
    pub(super) fn begin(&self, view: &View) -> PlanningTimer<'_> {
        let is_open = view.leaves_way_open();
        PlanningTimer(is_open.then(|| (self, Instant::now())))
    }

    /// Number of planned views, and the microseconds that they took in all.
    pub(super) fn so_far(&self) -> (u64, f64) {
        let nanos = self.nanos.load(Ordering::Relaxed);
        (self.views.load(Ordering::Relaxed), nanos as f64 * 1e-3)
    }
}

impl PlanningTimer<'_> {
    /// Ends planning: the view is dispatched or waits for a worker.
    pub(super) fn end(self) {
        if let Some((planning, began)) = self.0 {
            planning.views.fetch_add(1, Ordering::Relaxed);
            planning.nanos.fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, PlanRequest};
    use glam::DVec3;

    use super::*;

    #[test]
    fn only_views_that_leave_the_way_open_are_counted() {
        let planning = PlanningTime::default();
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X);
        let view = |plan| View::new(camera, [8, 8], plan);
        planning.begin(&view(PlanRequest { direct: true, ..PlanRequest::default() })).end();
        assert_eq!(planning.so_far(), (0, 0.0));
        planning.begin(&view(PlanRequest::default())).end();
        assert_eq!(planning.so_far().0, 1);
    }
}
