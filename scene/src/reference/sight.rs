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

    /// How well a camera shows what a viewer sees in a direction where it sees it, 0 to 1: less from aside and from afar,
    /// and less the farther it is from the viewer, beside what is seen: more between the rays is hidden from it.
    fn worth(camera: DVec3, eye: DVec3, target: &Target) -> f64 {
        let Target::At(point) = *target else { return 1.0 };
        let (from_camera, from_eye) = (point - camera, point - eye);
        let (distance, near) = (from_camera.length(), from_eye.length());
        if !(distance > 0.0 && near > 0.0) {
            return 0.0;
        }
        let aside = (from_camera.dot(from_eye) / (distance * near)).max(0.0);
        let baseline = camera.distance(eye);
        aside * (near / distance).min(1.0).sqrt() * near / (near + baseline)
    }

    /// Whether a camera sees what a viewer sees in a direction.
    fn shows(&self, camera: DVec3, target: &Target) -> bool {
        match *target {
            Target::Sky(direction) => self.seen.is_clear(camera, direction),
            Target::At(point) => {
                let distance = point.distance(camera);
                let range = self.seen.range_towards(camera, point, SLACK);
                range.is_some_and(|range| (range - distance).abs() <= SLACK * distance)
            }
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
        let worths: Vec<f64> = targets.iter().map(|target| SceneSight::worth(at, eye, target)).collect();
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
        if !sight.shows(self.at, &targets[target]) {
            self.worths[target] = 0.0;
        }
        true
    }
}

/// What a camera that shows a target so well adds to others.
fn added(worth: f64, shown: f64) -> f64 {
    (worth - shown).max(0.0) + BESIDES * worth
}

impl Sight for SceneSight {
    /// The greedy choice. Rays are sent only for who may be the next to be chosen: from above, what somebody is worth is known
    /// without any.
    fn best(&self, camera: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        let targets = self.targets(camera);
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::procedural::terrain;

    /// The greedy choice, with a ray from every camera to every target.
    fn greedy(sight: &SceneSight, camera: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        let targets = sight.targets(camera);
        let worth = |at, target| match sight.shows(at, target) {
            true => SceneSight::worth(at, camera.eye, target),
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
        let sight = SceneSight::new(&scene).unwrap();
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
