//! The walk `jumps`: a viewer stands for some seconds, then stands at another place.

use argus_scene::path::uniform;
use argus_scene::{Bounds, Camera};
use futures::future::try_join_all;
use glam::DVec3;

use super::explore::{Region, explore, speed};
use super::pose::{Walk, moved, up};
use super::surroundings::Probe;
use crate::ClientError;
use crate::load::path::GOLDEN;

/// Seconds for which a viewer stands.
const STAND_SECS: f64 = 3.0;
/// Places about each viewpoint.
const PLACES: f64 = 12.0;
/// Most viewpoints whose neighbourhood is explored.
const VIEWPOINTS: usize = 4;
/// Walking seconds between neighbouring places.
const APART_SECS: f64 = 3.0;

/// Viewers who jump between places in free space.
#[derive(Debug)]
pub(super) struct Jumps(Vec<Place>);

#[derive(Debug)]
struct Place {
    eye: DVec3,
    /// Directions to look in.
    looks: Vec<DVec3>,
    /// The viewpoint from which the place was found.
    base: Camera,
}

impl Jumps {
    /// Explores the scene from its first viewpoints.
    pub(super) async fn new(
        viewpoints: &[Camera],
        bounds: Bounds,
        probe: &impl Probe,
    ) -> Result<Self, ClientError> {
        let places = viewpoints.iter().take(VIEWPOINTS).zip(1..).map(async |(start, number)| {
            let stride = APART_SECS * speed(bounds);
            let region = Region { start: *start, bounds, stride, aside: 0.0 };
            let way = explore(region, PLACES * stride, number, probe).await?;
            let outside = !region.is_inside();
            let places = way.corners.into_iter().zip(way.open).map(move |(eye, open)| {
                let looks = if outside { vec![start.target - eye] } else { open };
                Place { eye, looks, base: *start }
            });
            Ok::<_, ClientError>(places.collect::<Vec<_>>())
        });
        Ok(Self(try_join_all(places).await?.into_iter().flatten().collect()))
    }
}

impl Walk for Jumps {
    fn camera(&self, viewer: u32, secs: f64) -> Camera {
        let stay = (secs / STAND_SECS + f64::from(viewer) * GOLDEN % 1.0).floor().max(0.0) as u64;
        let mut chance = uniform(u64::from(viewer) << 32 ^ stay);
        let mut pick = |count: usize| ((chance() * count as f64) as usize).min(count - 1);
        let place = &self.0[pick(self.0.len())];
        let look = place.looks[pick(place.looks.len())];
        let level = if place.looks.len() > 1 { look - 0.05 * up(&place.base) } else { look };
        moved(place.base, place.eye, level)
    }
}
