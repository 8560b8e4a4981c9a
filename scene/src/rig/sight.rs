//! Visibility in the scene around a rig's cameras, and the greedy choice of cameras by it, with few rays.

use std::fmt::Debug;

use glam::{DVec2, DVec3};

use super::target::{Target, added};
use crate::Camera;

/// Visibility between viewers and cameras.
///
/// A rig knows only the bounds of its scene, so some of its cameras stand inside walls or behind them. Their samples show
/// few of a viewer's surfaces. Where surfaces are single-sided, a camera in a wall sees through everything solid.
pub trait VisibilityQuery: Debug + Send + Sync {
    /// The `count` of the candidate cameras with their positions that together see most of a view, best first; fewer
    /// if there are fewer. The result depends only on the arguments. A moving scene counts at time zero.
    fn best(&self, camera: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        best(self, camera, candidates, count)
    }

    /// Whether no surface is between two points.
    fn sees(&self, from: DVec3, to: DVec3) -> bool;

    /// The targets of rays from a viewer, one per direction, at a time of the scene in seconds.
    fn targets(&self, eye: DVec3, directions: &[DVec3], time_secs: f64) -> Vec<Target>;

    /// Whether a sample camera at a position shows each of a view's targets, at a time of the scene in seconds.
    fn shows(&self, camera: DVec3, targets: &[Target], time_secs: f64) -> Vec<bool>;
}

/// The input for a choice of a view's cameras.
#[derive(Debug, Clone, Copy, Default)]
pub struct CandidateCameras<'a> {
    /// Refinements with samples, beside the rig's own cameras.
    pub refined: &'a [u64],
    /// Without it the nearest cameras count as best.
    pub sight: Option<&'a dyn VisibilityQuery>,
}

/// Columns and rows of the view's rays, over an image of [`SIZE`]. A grid of 8×6 distinguishes cameras no better.
const GRID: [u32; 2] = [5, 4];

/// Assumed proportions of a view.
const SIZE: [u32; 2] = [4, 3];

/// A camera that may be chosen.
struct Candidate {
    index: u64,
    at: DVec3,
    /// Its worth for each target: an upper bound until its rays are sent.
    worths: Vec<f64>,
    is_known: bool,
}

impl Candidate {
    /// Upper bound of its gain over the cameras chosen so far.
    fn gain(&self, shown: &[f64]) -> f64 {
        self.worths.iter().zip(shown).map(|(worth, shown)| added(*worth, *shown)).sum()
    }

    /// Sends rays to the targets for which it has a worth; `false` if that is done already.
    fn ask(&mut self, sight: &(impl VisibilityQuery + ?Sized), targets: &[Target]) -> bool {
        if std::mem::replace(&mut self.is_known, true) {
            return false;
        }
        let open: Vec<usize> = (0..targets.len()).filter(|&target| self.worths[target] > 0.0).collect();
        let asked: Vec<Target> = open.iter().map(|&target| targets[target]).collect();
        let shows = sight.shows(self.at, &asked, 0.0);
        for (i, &target) in open.iter().enumerate() {
            if shows.get(i) != Some(&true) {
                self.worths[target] = 0.0;
            }
        }
        true
    }
}

/// The cameras, among candidates with positions, that together show most of a view at time zero. Each adds most to those
/// before it. Rays are sent only for a camera that may be next: the upper bound of its gain needs none.
fn best(
    sight: &(impl VisibilityQuery + ?Sized),
    camera: &Camera,
    candidates: &[(u64, DVec3)],
    count: usize,
) -> Vec<u64> {
    let targets = sight.targets(camera.eye, &directions(camera), 0.0);
    let candidate = |&(index, at): &(u64, DVec3)| {
        let worths = targets.iter().map(|target| target.worth(at, camera.eye)).collect();
        Candidate { index, at, worths, is_known: false }
    };
    let mut left: Vec<Candidate> = candidates.iter().map(candidate).collect();
    let mut shown = vec![0.0; targets.len()];
    let mut best = Vec::new();
    while best.len() < count && !left.is_empty() {
        let mut gains: Vec<f64> = left.iter().map(|candidate| candidate.gain(&shown)).collect();
        let chosen = loop {
            // Of equals the first, which is nearest.
            let most = (0..gains.len()).rev().max_by(|&a, &b| gains[a].total_cmp(&gains[b]));
            let Some(most) = most else { return best };
            if !left[most].ask(sight, &targets) {
                break left.remove(most);
            }
            gains[most] = left[most].gain(&shown);
        };
        shown.iter_mut().zip(&chosen.worths).for_each(|(shown, worth)| *shown = worth.max(*shown));
        best.push(chosen.index);
    }
    best
}

/// Median distance of the surfaces that a viewer sees at time zero, metres; `None` if it sees none.
pub(super) fn median_range(sight: &(impl VisibilityQuery + ?Sized), camera: &Camera) -> Option<f64> {
    let range = |target: &Target| match target {
        Target::Surface(point) => Some(point.distance(camera.eye)),
        Target::Sky(_) => None,
    };
    let mut ranges: Vec<f64> =
        sight.targets(camera.eye, &directions(camera), 0.0).iter().filter_map(range).collect();
    ranges.sort_unstable_by(f64::total_cmp);
    ranges.get(ranges.len() / 2).copied()
}

/// Directions of the grid's rays.
fn directions(camera: &Camera) -> Vec<DVec3> {
    let [width, height] = SIZE;
    let cell = DVec2::new(f64::from(width), f64::from(height)) / DVec2::from(GRID.map(f64::from));
    let places = (0..GRID[0] * GRID[1]).map(|i| DVec2::new(f64::from(i % GRID[0]), f64::from(i / GRID[0])));
    places.map(|place| camera.direction((place + 0.5) * cell, width, height)).collect()
}

#[cfg(all(test, feature = "reference", feature = "procedural"))]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::procedural::terrain;
    use crate::reference::SceneSight;

    /// The greedy choice, with a ray from every camera to every target.
    fn greedy(sight: &SceneSight, camera: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        let targets = sight.targets(camera.eye, &directions(camera), 0.0);
        let worths = |&(index, at): &(u64, DVec3)| {
            let shows = sight.shows(at, &targets, 0.0);
            let worth = |(target, shows): (&Target, bool)| {
                if shows { target.worth(at, camera.eye) } else { 0.0 }
            };
            (index, targets.iter().zip(shows).map(worth).collect())
        };
        let mut left: Vec<(u64, Vec<f64>)> = candidates.iter().map(worths).collect();
        let mut shown = vec![0.0; targets.len()];
        let mut best = Vec::new();
        while best.len() < count && !left.is_empty() {
            let gain = |worths: &[f64]| worths.iter().zip(&shown).map(|(w, s)| added(*w, *s)).sum::<f64>();
            let gains: Vec<f64> = left.iter().map(|(_, worths)| gain(worths)).collect();
            let most = gains.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let (index, worths) = left.remove(
                gains.iter().position(|gain| *gain == most).expect("the greatest gain is one of them"),
            );
            shown.iter_mut().zip(&worths).for_each(|(shown, worth)| *shown = worth.max(*shown));
            best.push(index);
        }
        best
    }

    #[test]
    fn the_choice_is_the_same_as_with_every_ray() {
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
