//! Which cameras see what a view shows, by rays.
//!
//! The nearest camera may stand in a wall or behind it, and then shows what is behind. So some rays of the view find what it shows, and
//! rays from the nearest cameras find which of them see it too. Single-sided surfaces count from their front alone, as in samples.
//! Cameras are taken greedily by what they add; what is seen from aside, from afar or from far beside the viewer is worth less. How much
//! nearness counts is a compromise, measured by `argus study warp` (rows for cameras that were chosen blindly) and `study walk`: without it,
//! views from where the scene's own cameras stand are worse than from the nearest cameras; with four times as much, the first lap of
//! `study walk` in Sponza has a FLIP of 0.051 in place of 0.043, since cameras inside of columns are near, too.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec2, DVec3};

use super::Tracer;
use crate::rig::survey::added;
use crate::rig::{Sight, Target};
use crate::{Camera, Scene};

/// Rays of a view by which cameras are told apart: columns and rows, of an image of [`SIZE`]. 8×6 of them tell no more.
const GRID: [u32; 2] = [5, 4];

/// Of what form a view is taken to be.
const SIZE: [u32; 2] = [4, 3];

/// A ray meets a point if it ends within this share of the way to it.
const SLACK: f64 = 1e-3;

/// Rays through the triangles of a scene, cut-outs left out.
///
/// What a camera is worth to a view is judged by what it shows of the surfaces that the view's own rays meet, with single-sided
/// ones seen from their front alone, as samples have them: one that stands inside of a column shows what is around it and
/// nothing of the column. Choices of cameras are those of time zero: they are for scenes that stand still.
pub struct SceneSight {
    /// What a viewer sees, at time zero.
    seen: Arc<Tracer>,
    /// The same triangles, seen from behind as well: nobody walks out of a wall.
    solid: Tracer,
    /// What a viewer sees at the time that was asked for last; only of a scene that moves.
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

    /// The triangles where they are at a time, seconds.
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

    /// What the rays of the grid meet by which cameras are chosen.
    fn grid(&self, camera: &Camera) -> Vec<Target> {
        let [width, height] = SIZE;
        let cell = DVec2::new(f64::from(width), f64::from(height)) / DVec2::from(GRID.map(f64::from));
        let places =
            (0..GRID[0] * GRID[1]).map(|i| DVec2::new(f64::from(i % GRID[0]), f64::from(i / GRID[0])));
        let direction = |place: DVec2| camera.direction((place + 0.5) * cell, width, height);
        places.map(|place| met(&self.seen, camera.eye, direction(place))).collect()
    }
}

/// What a ray meets.
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

/// A camera that may be chosen.
struct Candidate {
    index: u64,
    at: DVec3,
    /// What it is worth to each target: at most, until a ray told whether it sees it.
    worths: Vec<f64>,
    /// Targets of some worth that no ray was sent to yet.
    open: Vec<usize>,
}

impl Candidate {
    fn new(index: u64, at: DVec3, eye: DVec3, targets: &[Target]) -> Self {
        let worths: Vec<f64> = targets.iter().map(|target| target.worth(at, eye)).collect();
        let open = (0..targets.len()).filter(|&target| worths[target] > 0.0).collect();
        Self { index, at, worths, open }
    }

    /// What it adds, at most, to what others show.
    fn gain(&self, shown: &[f64]) -> f64 {
        self.worths.iter().zip(shown).map(|(worth, shown)| added(*worth, *shown)).sum()
    }

    /// Has a ray tell of the target for which that may change most; `false` if there is none left.
    fn ask(&mut self, sight: &SceneSight, targets: &[Target], shown: &[f64]) -> bool {
        let adds = |target: usize| added(self.worths[target], shown[target]);
        let most = (0..self.open.len()).max_by(|&a, &b| adds(self.open[a]).total_cmp(&adds(self.open[b])));
        let Some(most) = most else { return false };
        let target = self.open.swap_remove(most);
        if !shows(&sight.seen, self.at, &targets[target]) {
            self.worths[target] = 0.0;
        }
        true
    }
}

impl Sight for SceneSight {
    /// The greedy choice. Rays are sent only for who may be the next to be chosen: from above, what somebody is worth is known
    /// without any.
    fn best(&self, camera: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        let targets = self.grid(camera);
        let candidate = |&(index, at): &(u64, DVec3)| Candidate::new(index, at, camera.eye, &targets);
        let mut left: Vec<Candidate> = candidates.iter().map(candidate).collect();
        let mut shown = vec![0.0; targets.len()];
        let mut best = Vec::new();
        while best.len() < count && !left.is_empty() {
            let mut gains: Vec<f64> = left.iter().map(|candidate| candidate.gain(&shown)).collect();
            let chosen = loop {
                // Of equals the first, which is nearest.
                let most = (0..gains.len()).rev().max_by(|&a, &b| gains[a].total_cmp(&gains[b]));
                let Some(most) = most else { return best };
                if !left[most].ask(self, &targets, &shown) {
                    break left.remove(most);
                }
                gains[most] = left[most].gain(&shown);
            };
            shown.iter_mut().zip(&chosen.worths).for_each(|(shown, worth)| *shown = worth.max(*shown));
            best.push(chosen.index);
        }
        best
    }

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::procedural::terrain;

    /// The greedy choice, with a ray from every camera to every target.
    fn greedy(sight: &SceneSight, camera: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        let targets = sight.grid(camera);
        let worth = |at, target: &Target| match shows(&sight.seen, at, target) {
            true => target.worth(at, camera.eye),
            false => 0.0,
        };
        let worths = |&(index, at): &(u64, DVec3)| (index, targets.iter().map(|t| worth(at, t)).collect());
        let mut left: Vec<(u64, Vec<f64>)> = candidates.iter().map(worths).collect();
        let mut shown = vec![0.0; targets.len()];
        let mut best = Vec::new();
        while best.len() < count && !left.is_empty() {
            let gain = |worths: &[f64]| worths.iter().zip(&shown).map(|(w, s)| added(*w, *s)).sum::<f64>();
            let gains: Vec<f64> = left.iter().map(|(_, worths)| gain(worths)).collect();
            let most = gains.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let (index, worths) = left.remove(gains.iter().position(|gain| *gain == most).unwrap());
            shown.iter_mut().zip(&worths).for_each(|(shown, worth)| *shown = worth.max(*shown));
            best.push(index);
        }
        best
    }

    #[test]
    fn rays_that_are_not_sent_change_no_choice() {
        let scene = Arc::new(terrain(3000));
        let sight = SceneSight::new(&scene);
        let bounds = scene.bounds();
        // Evenly spread, by the powers of the root of x⁴ = x + 1 (Roberts, 2018).
        let mut places = (1..)
            .map(|i| (f64::from(i) * DVec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5)).fract())
            .map(|share| bounds.min + bounds.size() * share);
        let mut place = || places.next().unwrap();
        for _ in 0..60 {
            let camera = Camera::look_at(place(), place());
            let candidates: Vec<(u64, DVec3)> = (0..24).map(|index| (index, place())).collect();
            for count in [1, 4, 30] {
                let best = sight.best(&camera, &candidates, count);
                assert_eq!(best, greedy(&sight, &camera, &candidates, count), "{camera:?}");
            }
        }
    }
}
