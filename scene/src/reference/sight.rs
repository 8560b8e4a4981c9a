//! Which cameras see what a view shows, by rays.

use std::fmt;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::Tracer;
use crate::rig::Sight;
use crate::{Camera, Scene};

/// Rays of a view by which cameras are told apart: columns and rows, of an image of [`SIZE`]. 8×6 of them tell no more.
const GRID: [u32; 2] = [5, 4];

/// Of what form a view is taken to be.
const SIZE: [u32; 2] = [4, 3];

/// A ray meets a point if it ends within this share of the way to it.
const SLACK: f64 = 1e-3;

/// What a camera is worth for what others see already: near the edges of things, between rays, it sees what they do not.
const BESIDES: f64 = 0.3;

/// Rays through the triangles of a scene that stands still, cut-outs left out.
///
/// What a camera is worth to a view is judged by what it shows of the surfaces that the view's own rays meet, with single-sided
/// ones seen from their front alone, as samples have them: one that stands inside of a column shows what is around it and
/// nothing of the column.
pub struct SceneSight {
    /// What a viewer sees.
    seen: Tracer,
    /// The same triangles, seen from behind as well: nobody walks out of a wall.
    solid: Tracer,
}

impl fmt::Debug for SceneSight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SceneSight").finish_non_exhaustive()
    }
}

/// What a ray of a view meets.
enum Target {
    At(DVec3),
    Sky(DVec3),
}

impl SceneSight {
    /// Builds the hierarchy of the scene's triangles; `None` for one in which something moves, where what is between two points
    /// now says nothing of later.
    pub fn new(scene: &Arc<Scene>) -> Option<Self> {
        if scene.is_animated() {
            return None;
        }
        let seen = Tracer::of_shapes(scene.clone());
        let solid = seen.without_backs();
        Some(Self { seen, solid })
    }

    fn targets(&self, camera: &Camera) -> Vec<Target> {
        let [width, height] = SIZE;
        let cell = DVec2::new(f64::from(width), f64::from(height)) / DVec2::from(GRID.map(f64::from));
        let places =
            (0..GRID[0] * GRID[1]).map(|i| DVec2::new(f64::from(i % GRID[0]), f64::from(i / GRID[0])));
        let target = |place: DVec2| {
            let direction = camera.direction((place + 0.5) * cell, width, height);
            match self.seen.trace(camera.eye, direction) {
                Some(hit) => Target::At(hit.position),
                None => Target::Sky(direction),
            }
        };
        places.map(target).collect()
    }

    /// How well a camera shows what a viewer sees in a direction, 0 to 1: not at all where it does not see it, less from
    /// aside and from afar.
    fn worth(&self, camera: DVec3, eye: DVec3, target: &Target) -> f64 {
        match *target {
            Target::Sky(direction) => f64::from(u8::from(self.seen.trace(camera, direction).is_none())),
            Target::At(point) => {
                let (from_camera, from_eye) = (point - camera, point - eye);
                let (distance, near) = (from_camera.length(), from_eye.length());
                if !(distance > 0.0 && near > 0.0) {
                    return 0.0;
                }
                let aside = (from_camera.dot(from_eye) / (distance * near)).max(0.0);
                let worth = aside * (near / distance).min(1.0).sqrt();
                let hit = if worth > 0.0 { self.seen.trace(camera, from_camera) } else { None };
                let shown = hit.is_some_and(|hit| (hit.range - distance).abs() <= SLACK * distance);
                if shown { worth } else { 0.0 }
            }
        }
    }
}

impl Sight for SceneSight {
    fn best(&self, camera: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        let targets = self.targets(camera);
        let worths = |at: DVec3| targets.iter().map(|t| self.worth(at, camera.eye, t)).collect::<Vec<f64>>();
        let mut open: Vec<(u64, Vec<f64>)> =
            candidates.iter().map(|&(index, at)| (index, worths(at))).collect();
        let mut shown = vec![0.0; targets.len()];
        let mut best = Vec::new();
        while best.len() < count {
            let gain = |worths: &[f64]| {
                let gains = worths
                    .iter()
                    .zip(&shown)
                    .map(|(worth, shown)| (worth - shown).max(0.0) + BESIDES * worth);
                gains.sum::<f64>()
            };
            // Of equals the first, which is nearest.
            let gains = open.iter().map(|(_, worths)| gain(worths)).enumerate();
            let Some((next, _)) = gains.rev().max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            let (index, worths) = open.remove(next);
            shown.iter_mut().zip(&worths).for_each(|(shown, worth)| *shown = worth.max(*shown));
            best.push(index);
        }
        best
    }

    fn sees(&self, from: DVec3, to: DVec3) -> bool {
        let hit = self.solid.trace(from, to - from);
        hit.is_none_or(|hit| hit.range >= (1.0 - SLACK) * from.distance(to))
    }
}
