//! Traces which cameras see the surfaces of a view.
//!
//! The nearest camera may stand inside a wall or behind it. So some rays of the view find its surfaces, and rays from the
//! nearest cameras test which of them see these too. Single-sided surfaces count from their front, as in samples.
//!
//! Cameras are chosen greedily by their gain. A surface seen at a low angle, from afar, or far beside the viewer counts
//! less. The weight of nearness is a compromise, measured by `argus-lab study views warp` (rows of cameras that were chosen
//! without sight) and `argus-lab study views walk`. Without it, views from the scene's own cameras are worse than from the nearest
//! cameras. With four times as much, the first lap of `argus-lab study views walk` in Sponza has a FLIP of 0.051 instead of 0.043, since
//! cameras inside columns are near too.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;

use super::Tracer;
use crate::Scene;
use crate::rig::{Target, VisibilityQuery};

/// A ray meets a point if it ends within this share of the distance to it.
const SLACK: f64 = 1e-3;

/// Rays through the triangles of a scene, without cut-outs.
///
/// A camera's worth to a view is its visibility of the surfaces that the view's rays meet, with single-sided surfaces
/// seen from their front, as in samples. A camera inside a column shows what is around the column and nothing of
/// the column. [`VisibilityQuery::best`] uses time zero.
pub struct SceneSight {
    /// The visible triangles, at time zero.
    seen: Arc<Tracer>,
    /// The same triangles, visible from both sides: a path through a wall is blocked.
    solid: Tracer,
    /// The visible triangles at the last requested time; only of a scene that moves.
    posed: Mutex<Option<(f64, Arc<Tracer>)>>,
}

impl fmt::Debug for SceneSight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SceneSight").finish_non_exhaustive()
    }
}

impl SceneSight {
    /// Builds the hierarchy of the scene's triangles.
    pub fn new(scene: &Arc<Scene>) -> Self {
        let seen = Arc::new(Tracer::of_shapes(scene.clone()));
        let solid = seen.without_backs();
        Self { seen, solid, posed: Mutex::new(None) }
    }

    /// The triangles at a time in seconds.
    fn at(&self, time_secs: f64) -> Arc<Tracer> {
        if time_secs == 0.0 || !self.seen.scene().is_animated() {
            return self.seen.clone();
        }
        let mut posed = self.posed.lock().unwrap_or_else(PoisonError::into_inner);
        match posed.as_ref() {
            Some((at, tracer)) if *at == time_secs => tracer.clone(),
            _ => posed.insert((time_secs, Arc::new(self.seen.shapes_at(time_secs)))).1.clone(),
        }
    }
}

/// The target that a ray meets.
fn met(seen: &Tracer, eye: DVec3, direction: DVec3) -> Target {
    seen.trace(eye, direction).map_or(Target::Sky(direction), |hit| Target::Surface(hit.position))
}

/// Whether a camera shows a viewer's target.
fn shows(seen: &Tracer, camera: DVec3, target: &Target) -> bool {
    match *target {
        Target::Sky(direction) => seen.is_clear(camera, direction),
        Target::Surface(point) => {
            let distance = point.distance(camera);
            let range = seen.range_towards(camera, point, SLACK);
            range.is_some_and(|range| (range - distance).abs() <= SLACK * distance)
        }
    }
}

impl VisibilityQuery for SceneSight {
    fn sees(&self, from: DVec3, to: DVec3) -> bool {
        let range = self.solid.range_towards(from, to, SLACK);
        range.is_none_or(|range| range >= (1.0 - SLACK) * from.distance(to))
    }

    fn targets(&self, eye: DVec3, directions: &[DVec3], time_secs: f64) -> Vec<Target> {
        let seen = self.at(time_secs);
        directions.iter().map(|direction| met(&seen, eye, *direction)).collect()
    }

    fn shows(&self, camera: DVec3, targets: &[Target], time_secs: f64) -> Vec<bool> {
        let seen = self.at(time_secs);
        targets.iter().map(|target| shows(&seen, camera, target)).collect()
    }
}
