//! Reflections on the GPU: lookups, requests, the list of what is shaded, and the mean of taps ([`crate::device`]).
//!
//! What crosses over is what shading needs of the listed points, and their radiance. Of the CPU's definition (`requests.rs`), f32
//! differs where rounding decides which texel a ray meets.

use argus_sampler::plug::{MappedReflector, SurfacePoint};
use argus_scene::Sky;
use argus_scene::shading::sky_radiance;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::cells::Point;
use crate::compute::PointDevice;
use crate::device::{DeviceRays, PointsError, Requested};
use crate::layout::PointPixel;
use crate::on_device::DevicePoints;
use crate::requests::ReflectivePixel;
use crate::{PointScene, Reflected, Stages};

/// What the taps of an eye look up on a device.
#[derive(Debug, Clone, Copy)]
pub struct DeviceLookups<'a> {
    /// The reflectors of the maps.
    pub reflectors: &'a [MappedReflector],
    /// The eye, metres, world space.
    pub eye: DVec3,
    /// The reflective pixels.
    pub pixels: &'a [ReflectivePixel],
    /// Offsets of taps, in pixels.
    pub taps: &'a [DVec2],
    /// Impostor steps of a lookup, 16 at most.
    pub steps: u32,
}

impl DeviceLookups<'_> {
    pub(crate) fn upload(&self, device: &PointDevice) -> Result<DeviceRays, PointsError> {
        let f32s = |v: DVec3| v.as_vec3().to_array();
        let pixel = |pixel: &ReflectivePixel| PointPixel {
            about: f32s(pixel.position - self.reflectors[pixel.reflector as usize].center),
            map: pixel.reflector,
            from_eye: f32s(pixel.position - self.eye),
            normal: f32s(pixel.normal),
            right: f32s(pixel.position_steps[0]),
            down: f32s(pixel.position_steps[1]),
            normal_right: f32s(pixel.normal_steps[0]),
            normal_down: f32s(pixel.normal_steps[1]),
            ..bytemuck::Zeroable::zeroed()
        };
        let pixels: Vec<PointPixel> = self.pixels.par_iter().with_min_len(1024).map(pixel).collect();
        let taps: Vec<[f32; 2]> = self.taps.iter().map(|tap| tap.as_vec2().to_array()).collect();
        device.passes.pixels(&pixels, &taps)
    }

    /// The mean of taps under a sky that only the CPU knows: an environment map.
    fn mean(&self, slots: &[u32], shaded: &[Vec3], sky: &Sky) -> Vec<Vec3> {
        let taps = self.taps.len().max(1);
        let of_pixel = |(pixel, slots): (&ReflectivePixel, &[u32])| {
            let of_tap = |(&slot, &tap): (&u32, &DVec2)| match slot.checked_sub(1) {
                Some(slot) => shaded[slot as usize],
                None => sky_radiance(sky, pixel.ray(self.eye, tap).1.as_vec3()),
            };
            slots.iter().zip(self.taps).map(of_tap).sum::<Vec3>() / taps as f32
        };
        self.pixels.par_iter().zip(slots.par_chunks(taps)).with_min_len(64).map(of_pixel).collect()
    }
}

impl PointScene {
    /// Requests, shades and looks up what pixels reflect, on a device with filled maps. `shade` gives the radiance of a point on
    /// the CPU. Times of passes are those of a clock, with uploads and readback.
    ///
    /// # Errors
    /// The radiance of requested points exceeds an array, or the device failed.
    pub fn reflect_on(
        &self,
        device: &PointDevice,
        found: &DevicePoints,
        lookups: &DeviceLookups<'_>,
        sky: &Sky,
        shade: impl Fn(&SurfacePoint) -> Vec3 + Sync,
    ) -> Result<Reflected, PointsError> {
        let mut stages = Stages::new();
        let rays = lookups.upload(device)?;
        let requested = device.passes.request(&found.turns, &rays, lookups.steps, found.count())?;
        let points = self.requested_points(device, found, &requested)?;
        stages.end("request");
        let shaded: Vec<Vec3> = points.par_iter().with_min_len(64).map(&shade).collect();
        stages.end("shade");
        let radiance = if sky.map.is_some() {
            lookups.mean(&device.passes.slots(&rays, &requested)?, &shaded, sky)
        } else {
            let shaded: Vec<[f32; 4]> =
                shaded.iter().map(|radiance| radiance.extend(0.0).to_array()).collect();
            let sky = [sky.zenith, sky.horizon, sky.ground].map(|radiance| radiance.to_array());
            let arriving = device.passes.mirror(&rays, &requested, &shaded, sky)?;
            arriving.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect()
        };
        stages.end("mirror");
        let bytes = requested.bytes() as usize + size_of_val(&shaded[..]);
        Ok(Reflected { radiance, shades: shaded.len(), bytes, stages: stages.all() })
    }

    /// What shading needs of the requested points, in the order of their ids.
    pub(crate) fn requested_points(
        &self,
        device: &PointDevice,
        found: &DevicePoints,
        requested: &Requested,
    ) -> Result<Vec<SurfacePoint>, PointsError> {
        if let Some(completed) = &found.completed {
            let ids = device.passes.requested_ids(requested)?;
            return Ok(ids.par_iter().map(|&id| self.shading_of_point(completed, id)).collect());
        }
        let listed = device.passes.listed(requested, &found.list_parts(device))?;
        let point = |listed: &[u32; 4]| {
            // The point's own piece is `piece_of(listed)`; only its cell counts here.
            let point = Point(u64::from(listed[3]));
            self.shading_of_cell(&self.piece_of(listed), point)
        };
        Ok(listed.par_iter().with_min_len(256).map(point).collect())
    }
}
