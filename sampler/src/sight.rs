//! Visibility queries between cameras and points, by packets of rays.
//!
//! Gives the same answers as the reference's `SceneSight`, several times faster: all rays of a query share an origin, and
//! static triangles are in one tree. An animated scene is posed at the query's time, so queries of one time should be
//! grouped.

use std::fmt;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};

use argus_scene::rig::{Target, VisibilityQuery};
use argus_scene::{LightChoice, Scene};
use glam::DVec3;

use crate::packets::{PacketTracer, Ray};
use crate::resident::{Placement, placed};

/// A ray reaches a point if it ends within this share of the distance to it.
const SLACK: f64 = 1e-3;

/// Rays through the triangles of a scene, without cut-outs. Single-sided triangles are hit only from the front, as in
/// samples. [`VisibilityQuery::sees`] hits both sides, of the scene at time zero.
pub struct PacketSight {
    scene: Arc<Scene>,
    posed: RwLock<Posed>,
}

/// The triangles posed at a time.
struct Posed {
    time_secs: f64,
    tracer: PacketTracer,
}

impl fmt::Debug for PacketSight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PacketSight").finish_non_exhaustive()
    }
}

impl PacketSight {
    /// Builds the hierarchy of the scene's triangles: about a second for a few million.
    pub fn new(scene: &Arc<Scene>) -> Self {
        let tracer = PacketTracer::new(scene, &solid(scene, 0.0), f32::MIN_POSITIVE);
        Self { scene: scene.clone(), posed: RwLock::new(Posed { time_secs: 0.0, tracer }) }
    }

    /// The triangles of the scene in another light, for a scene as it was opened. They are not built again. The scene is
    /// copied only if others hold it.
    #[must_use]
    pub fn in_light(self, choice: LightChoice) -> Self {
        if choice == self.scene.opened_light() {
            return self;
        }
        let Self { scene, posed } = self;
        let mut posed = posed.into_inner().unwrap_or_else(PoisonError::into_inner);
        posed.tracer.set_scene(&Arc::default());
        let scene = Arc::new(Arc::unwrap_or_clone(scene).in_light(choice));
        posed.tracer.set_scene(&scene);
        Self { scene, posed: RwLock::new(posed) }
    }

    /// The scene whose triangles these are.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Calls a function with the triangles posed at a time, seconds.
    pub(crate) fn at<T>(&self, time_secs: f64, ask: impl FnOnce(&PacketTracer) -> T) -> T {
        let time_secs = if self.scene.is_animated() { time_secs } else { 0.0 };
        let read =
            || -> RwLockReadGuard<'_, Posed> { self.posed.read().unwrap_or_else(PoisonError::into_inner) };
        let posed = read();
        if posed.time_secs == time_secs {
            return ask(&posed.tracer);
        }
        drop(posed);
        let mut posed = self.posed.write().unwrap_or_else(PoisonError::into_inner);
        if posed.time_secs != time_secs {
            let scene = self.scene.posed(time_secs);
            posed.tracer.pose(&scene, &solid(&scene, time_secs));
            posed.time_secs = time_secs;
        }
        ask(&posed.tracer)
    }
}

/// Visible triangles at a time, without cut-outs.
fn solid(scene: &Scene, time_secs: f64) -> Vec<Placement> {
    let mut placements = placed(scene, &scene.at(time_secs).instances);
    placements.retain(|placement| !placement.class.cutout);
    placements
}

impl VisibilityQuery for PacketSight {
    fn sees(&self, from: DVec3, to: DVec3) -> bool {
        let way = to - from;
        self.at(0.0, |tracer| {
            // Traced from both ends, because a single-sided triangle is hit only from its front.
            let short = way * (1.0 - SLACK);
            let is_clear = |from, way| tracer.nearest(from, way, 1.0).is_none();
            is_clear(from, short) && is_clear(from + short, -short)
        })
    }

    fn targets(&self, eye: DVec3, directions: &[DVec3], time_secs: f64) -> Vec<Target> {
        let rays: Vec<Ray> = directions.iter().map(|&direction| Ray { direction, most: f32::MAX }).collect();
        let found = self.at(time_secs, |tracer| tracer.distances(eye, &rays));
        let target = |(&direction, found): (&DVec3, Option<f32>)| match found {
            Some(t) => Target::Surface(eye + direction * f64::from(t)),
            None => Target::Sky(direction),
        };
        directions.iter().zip(found).map(target).collect()
    }

    fn shows(&self, camera: DVec3, targets: &[Target], time_secs: f64) -> Vec<bool> {
        let ray = |target: &Target| match *target {
            Target::Surface(point) => Ray { direction: point - camera, most: (1.0 + SLACK) as f32 },
            Target::Sky(direction) => Ray { direction, most: f32::MAX },
        };
        let rays: Vec<Ray> = targets.iter().map(ray).collect();
        let found = self.at(time_secs, |tracer| tracer.distances(camera, &rays));
        let shows = |((target, ray), found): ((&Target, &Ray), Option<f32>)| match (target, found) {
            (Target::Surface(_), Some(t)) => f64::from(t) >= 1.0 - SLACK,
            (Target::Surface(_), None) => false,
            (Target::Sky(_), found) => found.is_none() && camera.is_finite() && ray.direction.is_finite(),
        };
        targets.iter().zip(&rays).zip(found).map(shows).collect()
    }
}
