//! Finds ways through the free space of a scene, step by step: what stands around a point says where the next one may be.

use std::f64::consts::TAU;

use argus_scene::path::uniform;
use argus_scene::{Bounds, Camera};
use glam::{DQuat, DVec3};

use super::pose::up;
use super::surroundings::{Probe, Surroundings};
use crate::ClientError;

/// Walking speed in a scene of metres, metres a second.
const SPEED: f64 = 1.2;
/// Largest sides of scenes that are taken to be in metres. The walk through others is as fast for their size.
const METRES: std::ops::RangeInclusive<f64> = 10.0..=100.0;
/// Directions that are considered at each point.
const DIRECTIONS: u32 = 16;
/// The longest step, as a share of the free way.
const STEP_SHARE: f64 = 0.6;
/// The most room that companions take on each side, as a share of the distance to the nearest surface at the start.
const ASIDE_SHARE: f64 = 0.4;
/// Halvings of the step before a walker turns back.
const HALVINGS: u32 = 3;
/// How far viewers outside of the scene may go from its middle, as a share of their viewpoint's distance.
const LEASH: f64 = 1.15;

/// Metres of this scene in a metre of a walker: 1 for scenes in metres.
pub(super) fn unit(bounds: Bounds) -> f64 {
    let extent = bounds.size().max_element();
    extent / extent.clamp(*METRES.start(), *METRES.end())
}

/// Walking speed in a scene, metres a second.
pub(super) fn speed(bounds: Bounds) -> f64 {
    SPEED * unit(bounds)
}

/// Where a walker starts and may go.
#[derive(Debug, Clone, Copy)]
pub(super) struct Region {
    /// The viewpoint at which the walk starts. Its height is kept.
    pub(super) start: Camera,
    /// The scene's bounds.
    pub(super) bounds: Bounds,
    /// Wanted length of a step, metres.
    pub(super) stride: f64,
    /// Room that companions take on both sides, metres, where there is as much.
    pub(super) aside: f64,
}

impl Region {
    /// Whether the walk is inside of the scene, not above or around it.
    pub(super) fn is_inside(&self) -> bool {
        self.bounds.contains(self.start.eye)
    }

    fn allows(&self, at: DVec3) -> bool {
        if self.is_inside() {
            return self.bounds.contains(at);
        }
        let away = |at: DVec3| (at - self.bounds.center()).length();
        away(at) <= LEASH * away(self.start.eye)
    }
}

/// A way through free space.
#[derive(Debug)]
pub(super) struct Way {
    /// Its corners, the first of which is the start.
    pub(super) corners: Vec<DVec3>,
    /// For each corner at which a step was looked for: unit directions with much free room, the freest first.
    pub(super) open: Vec<Vec<DVec3>>,
    /// Room on both sides of the way, metres.
    pub(super) aside: f64,
}

/// Walks from a viewpoint until the way has a length. The same seed finds the same way, and a longer way begins with a shorter one.
///
/// # Errors
/// A range view is not answered.
pub(super) async fn explore(
    region: Region,
    length: f64,
    seed: u64,
    probe: &impl Probe,
) -> Result<Way, ClientError> {
    let mut chance = uniform(seed);
    let start = probe(region.start.eye).await?;
    let axis = region.start.target - region.start.eye;
    let margin = start.margin(axis.length());
    let aside = region.aside.min(ASIDE_SHARE * start.nearest());
    let mut way = Way { corners: vec![region.start.eye], open: Vec::new(), aside };
    let (mut walked, mut around, mut heading) = (0.0, start, None);
    while walked < length {
        let step = Step { region: &region, around: &around, radius: margin + aside, heading };
        way.open.push(step.open());
        let at = around.at;
        let back = way.corners.len().checked_sub(2).map(|before| way.corners[before]);
        let Some(to) = step.next(&way.corners, &mut chance).or(back) else {
            // Without a way walkers stay where they are.
            break;
        };
        walked += (to - at).length().max(0.05 * region.stride);
        heading = (to - at).try_normalize();
        way.corners.push(to);
        around = probe(to).await?;
    }
    Ok(way)
}

/// The choice of the next corner.
struct Step<'a> {
    region: &'a Region,
    around: &'a Surroundings,
    /// Distance to keep from surfaces, metres.
    radius: f64,
    /// The direction of the last step.
    heading: Option<DVec3>,
}

impl Step<'_> {
    /// Level directions all around, `turn` (0 to 1) of the angle between two off the viewpoint's own.
    fn directions(&self, turn: f64) -> impl Iterator<Item = DVec3> {
        let camera = self.region.start;
        let up = up(&camera);
        let level = (camera.target - camera.eye).reject_from_normalized(up);
        let level = level.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
        (0..DIRECTIONS).map(move |i| {
            let angle = TAU * (f64::from(i) + turn) / f64::from(DIRECTIONS);
            DQuat::from_axis_angle(up, angle) * level
        })
    }

    /// The freer half of the directions, the freest first.
    fn open(&self) -> Vec<DVec3> {
        let mut open: Vec<(f64, DVec3)> = self
            .directions(0.0)
            .map(|direction| (self.around.free(direction, 0.25 * self.radius), direction))
            .collect();
        open.sort_by(|a, b| b.0.total_cmp(&a.0));
        open.into_iter().take(DIRECTIONS as usize / 2).map(|(_, direction)| direction).collect()
    }

    /// The best next corner: ahead, and away from where the walk has been. `None` without room for a step.
    fn next(&self, corners: &[DVec3], chance: &mut impl FnMut() -> f64) -> Option<DVec3> {
        let stride = self.region.stride;
        let at = self.around.at;
        let turn = chance();
        let free: Vec<(DVec3, f64, f64)> = self
            .directions(turn)
            .map(|direction| (direction, self.around.free(direction, self.radius), chance()))
            .collect();
        let before = corners.len().checked_sub(2).map(|last| corners[last]);
        (0..=HALVINGS).find_map(|halving| {
            let length = stride * 0.5_f64.powi(halving as i32);
            let steps = free.iter().filter_map(|&(direction, free, luck)| {
                let to = at + direction * length;
                let fits = length <= STEP_SHARE * free && self.region.allows(to);
                (fits && self.rounds(before, to)).then(|| {
                    let ahead = self.heading.map_or(0.0, |heading| heading.dot(direction));
                    let known = corners[..corners.len() - 1].iter().map(|corner| (*corner - to).length());
                    let novelty = (known.fold(f64::INFINITY, f64::min) / stride).min(2.0);
                    let room = (free / stride).min(4.0);
                    (ahead + novelty + 0.25 * room + 0.5 * luck, to)
                })
            });
            steps.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, to)| to)
        })
    }

    /// Whether the rounded corner between the middles of two steps is in free space.
    fn rounds(&self, before: Option<DVec3>, to: DVec3) -> bool {
        let at = self.around.at;
        let Some(before) = before else { return true };
        let [from, onto] = [before.midpoint(at), at.midpoint(to)];
        [0.25, 0.5, 0.75].iter().all(|share| self.around.reaches(corner(from, at, onto, *share), self.radius))
    }
}

/// A point of the curve that rounds a corner: the quadratic Bézier curve between the middles of its two steps.
pub(super) fn corner(from: DVec3, at: DVec3, onto: DVec3, share: f64) -> DVec3 {
    from.lerp(at, share).lerp(at.lerp(onto, share), share)
}
