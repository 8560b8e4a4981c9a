//! The walk `roam`: four groups of people who walk through the scene, and do not come back the same way.

use std::f64::consts::TAU;
use std::time::Duration;

use argus_scene::path::uniform;
use argus_scene::{Bounds, Camera};
use futures::future::try_join_all;
use glam::{DQuat, DVec3};

use super::explore::{Region, explore, speed, unit};
use super::pose::{Walk, moved, up};
use super::surroundings::Probe;
use super::trail::Trail;
use crate::ClientError;

/// Groups of viewers.
const GROUPS: u32 = 4;
/// Seconds by which a viewer walks behind the one before.
const LAG_SECS: f64 = 0.6;
/// Viewers behind one another in a group; further ones walk beside them.
const ROWS: u32 = 8;
/// Steps from the viewpoint until the walk begins: groups with one viewpoint have parted by then.
const FIRST_STEPS: f64 = 4.0;
/// Seconds of a step.
const STEP_SECS: f64 = 2.0;
/// Seconds before and after a moment that make its heading.
const HEADING_SECS: f64 = 0.5;
/// Half the width of a group in a scene of metres.
const ASIDE: f64 = 0.5;

/// Four groups of walkers.
#[derive(Debug)]
pub(super) struct Roam(Vec<Group>);

#[derive(Debug)]
struct Group {
    region: Region,
    trail: Trail,
    /// Metres a second.
    speed: f64,
    /// Room on both sides of the trail.
    aside: f64,
    /// Turns a second and phases of the two swings of heads.
    swings: [[f64; 2]; 2],
}

impl Roam {
    /// Explores the scene from its viewpoints, one for each group in turn.
    pub(super) async fn new(
        viewpoints: &[Camera],
        bounds: Bounds,
        lasts: Duration,
        probe: &impl Probe,
    ) -> Result<Self, ClientError> {
        let groups = (0..GROUPS).map(async |number| {
            let start = viewpoints[number as usize % viewpoints.len()];
            Group::new(start, bounds, lasts, number, probe).await
        });
        try_join_all(groups).await.map(Self)
    }
}

impl Walk for Roam {
    fn camera(&self, viewer: u32, secs: f64) -> Camera {
        self.0[(viewer % GROUPS) as usize].camera(viewer / GROUPS, secs)
    }
}

impl Group {
    async fn new(
        start: Camera,
        bounds: Bounds,
        lasts: Duration,
        number: u32,
        probe: &impl Probe,
    ) -> Result<Self, ClientError> {
        let speed = speed(bounds);
        let stride = speed * STEP_SECS;
        let region = Region { start, bounds, stride, aside: ASIDE * unit(bounds) };
        let secs = lasts.as_secs_f64() + f64::from(ROWS) * LAG_SECS + HEADING_SECS;
        // Rounded corners are shorter than the steps.
        let length = 1.3 * speed * secs + (FIRST_STEPS + 2.0) * stride;
        let way = explore(region, length, u64::from(number) + 1, probe).await?;
        let mut chance = uniform(u64::from(number) + 101);
        let swings = std::array::from_fn(|_| [0.05 + 0.07 * chance(), TAU * chance()]);
        Ok(Self { region, trail: Trail::new(&way.corners), speed, aside: way.aside, swings })
    }

    /// The camera of a group's viewer; viewer 0 leads.
    fn camera(&self, viewer: u32, secs: f64) -> Camera {
        let (row, column) = (viewer % ROWS, viewer / ROWS);
        let secs = secs + f64::from(ROWS - row) * LAG_SECS;
        let at = |secs: f64| self.trail.at(FIRST_STEPS * self.region.stride + self.speed * secs);
        let up = up(&self.region.start);
        let ahead = (at(secs + HEADING_SECS) - at(secs - HEADING_SECS)).try_normalize();
        let axis = self.region.start.target - self.region.start.eye;
        let ahead = ahead.unwrap_or_else(|| axis.normalize_or(DVec3::X));
        let side = ahead.cross(up).normalize_or(DVec3::X);
        let eye = at(secs) + side * self.aside * place(viewer, row, column);
        let [slow, fast] = self.swings.map(|[turns, phase]| (TAU * turns * secs + phase).sin());
        let look = DQuat::from_axis_angle(up, 0.6 * slow + 0.5 * fast);
        if self.region.is_inside() {
            return moved(self.region.start, eye, look * (ahead - 0.05 * up));
        }
        // Those outside look at the scene, not where they go.
        let target = self.region.start.target;
        moved(self.region.start, eye, DQuat::from_axis_angle(up, 0.3 * slow) * (target - eye))
    }
}

/// A viewer's place across the trail: the leader in its middle, others on both sides in turn (−1 to 1).
fn place(viewer: u32, row: u32, column: u32) -> f64 {
    let side = if viewer.is_multiple_of(2) { 1.0 } else { -1.0 };
    match viewer {
        0 => 0.0,
        _ => side * [1.0, 0.8, 0.5, 0.9, 0.6][(row + 3 * column) as usize % 5],
    }
}
