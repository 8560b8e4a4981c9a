//! What stands around a point, as a range view sees it.

use std::future::Future;

use argus_proto::WireError;
use argus_scene::{Camera, Lens, Output, Outputs, PlanRequest, View};
use glam::{DVec2, DVec3};

use crate::load::patient;
use crate::{Client, ClientError};

/// Width and height of a range view in all directions, pixels.
const SIZE: [u32; 2] = [128, 64];
/// Half of a pixel's angle: a surface may stand out so much, as a share of its distance, between two pixels.
const HALF_PIXEL: f64 = std::f64::consts::PI / SIZE[0] as f64;
/// Distance kept from surfaces, as a share of what is typically seen.
const MARGIN: f64 = 0.05;

/// Says what stands around a point.
pub(super) trait Probe: AsyncFn(DVec3) -> Result<Surroundings, ClientError> {}
impl<F: AsyncFn(DVec3) -> Result<Surroundings, ClientError>> Probe for F {}

/// The nearest surface in each direction from a point.
#[derive(Debug)]
pub(super) struct Surroundings {
    /// The point, metres.
    pub(super) at: DVec3,
    /// Surfaces as offsets from the point, and their distances; sky has none.
    seen: Vec<(DVec3, f64)>,
}

/// Renders the range of all directions from a point.
pub(super) fn probe(
    client: &Client,
    at: DVec3,
) -> impl Future<Output = Result<Surroundings, ClientError>> + Send + use<> {
    let client = client.clone();
    async move {
        let camera = Camera { lens: Some(Lens::Equirectangular), ..Camera::look_at(at, at + DVec3::X * 1e3) };
        let plan = PlanRequest { direct: true, ..PlanRequest::default() };
        let view = View { outputs: Outputs::only(Output::Range), ..View::new(camera, SIZE, plan) };
        let frame = client.render(&view, &patient()).await?.frame;
        let range = frame.images[Output::Range].as_ref();
        let range =
            range.ok_or(WireError::Corrupt { what: "range", reason: "the frame has none".to_owned() })?;
        let range = range.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
        Ok(Surroundings::new(at, &camera, range))
    }
}

impl Surroundings {
    /// Of the ranges of the camera's image, row by row.
    pub(super) fn new(at: DVec3, camera: &Camera, range: impl Iterator<Item = f32>) -> Self {
        let rays = camera.rays(SIZE[0], SIZE[1]);
        let seen = (0..SIZE[0] * SIZE[1]).zip(range).filter_map(|(i, range)| {
            let pixel = DVec2::new((i % SIZE[0]).into(), (i / SIZE[0]).into()) + 0.5;
            let range = f64::from(range);
            (range.is_finite() && range > 0.0).then_some((rays.direction(pixel)? * range, range))
        });
        Self { at, seen: seen.collect() }
    }

    /// The median distance of what is seen; `otherwise` where there is nothing but sky.
    fn typical(&self, otherwise: f64) -> f64 {
        let mut ranges: Vec<f64> = self.seen.iter().map(|(_, range)| *range).collect();
        ranges.sort_by(f64::total_cmp);
        ranges.get(ranges.len() / 2).copied().unwrap_or(otherwise)
    }

    /// The distance to keep from surfaces: a small share of what is typically seen, and at most half of the distance kept here.
    pub(super) fn margin(&self, otherwise: f64) -> f64 {
        (MARGIN * self.typical(otherwise)).min(0.5 * self.nearest())
    }

    /// The distance of the nearest surface; infinite without any.
    pub(super) fn nearest(&self) -> f64 {
        self.seen.iter().fold(f64::INFINITY, |least, (_, range)| least.min(*range))
    }

    /// How far a ball of this radius can go from here in a unit direction without touching a surface; infinite without any.
    pub(super) fn free(&self, direction: DVec3, radius: f64) -> f64 {
        self.seen.iter().fold(f64::INFINITY, |free, (offset, range)| {
            let ahead = offset.dot(direction);
            let keep = radius + range * HALF_PIXEL;
            // Behind, or further than what is known to stand in the way.
            if ahead <= 0.0 || ahead - keep > free {
                return free;
            }
            let inside = keep * keep - (range * range - ahead * ahead);
            if inside <= 0.0 { free } else { free.min((ahead - inside.sqrt()).max(0.0)) }
        })
    }

    /// Whether a ball of this radius can go straight to a point.
    pub(super) fn reaches(&self, to: DVec3, radius: f64) -> bool {
        let way = to - self.at;
        let length = way.length();
        length <= 0.0 || self.free(way / length, radius) >= length
    }
}
