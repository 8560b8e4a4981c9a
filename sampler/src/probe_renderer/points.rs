//! Probes from cube maps around reflectors, which are filled with what a ray through each texel meets, or by a method that finds
//! points ([`crate::plug::PointMethod`]). Each point that a map shows is shaded once.
//!
//! Within a cube map of as many texels a side as the probe, a texel of the probe is the mean of four rays.

use argus_gpu::Gpu;
use argus_scene::{ProbeEye, Scene};
use glam::DVec3;

use super::method::ProbePlaces;
use crate::index_maps::{MappedReflector, Requests};
use crate::passes::{BlurProbes, ResamplePoints, ShadePoints};
use crate::point_shading::probe_point;
use crate::reflected_light::{FilledMaps, Ray, ReflectionRays, ReflectionSource};
use crate::resident::{GBufferUse, Resident};

/// Most bytes of cube maps that are filled at once: 340 of 64 texels a side, or 21 of 256.
const MOST_BYTES: usize = 64 << 20;
/// Bytes of a texel of a cube map.
const TEXEL_BYTES: usize = 8;

/// The programs that fill probes with points, for one scene on one device.
pub(crate) struct PointProbes {
    pub(crate) source: Fill,
    /// Texels along a side of a probe.
    pub(crate) side: u32,
    pub(crate) shade: ShadePoints,
    pub(crate) resample: ResamplePoints,
    pub(crate) blur: BlurProbes,
}

/// What fills cube maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fill {
    /// Points on triangles, as dense as these viewers see them; at most so many at once.
    Points { viewers: ProbeEye, budget: u32 },
    /// A ray through each texel.
    Rays,
}

impl Fill {
    /// Texels on a side of the cube map for a probe of `side` texels. Rays shade every texel: with half the side, the cube has
    /// half again as many as the probe.
    fn cube_side(self, side: u32) -> u32 {
        match self {
            Self::Points { .. } => side,
            Self::Rays => side / 2,
        }
    }
}

impl PointProbes {
    pub(super) fn new(gpu: &Gpu, resident: &Resident, g_buffer: GBufferUse, source: Fill, side: u32) -> Self {
        let g_buffer = match source {
            Fill::Points { .. } => g_buffer,
            // Rays go on from what the G-buffer says.
            Fill::Rays => g_buffer.at_least_kept(),
        };
        Self {
            source,
            side,
            shade: ShadePoints::new(gpu, resident.features, g_buffer),
            resample: ResamplePoints::new(gpu, resident.features, source.cube_side(side)),
            blur: BlurProbes::new(gpu),
        }
    }

    /// The reflectors of all probes of a side in texels, in groups whose maps are filled at once.
    pub(crate) fn groups(
        source: Fill,
        by: &ReflectionSource,
        scene: &Scene,
        places: &ProbePlaces,
        side: u32,
        time_secs: f64,
    ) -> Vec<Vec<MappedReflector>> {
        let side = source.cube_side(side);
        let posed = scene.at(time_secs);
        let reflector = |(&instance, center): (&u32, DVec3)| {
            let found = match (source, by) {
                (Fill::Points { viewers, .. }, ReflectionSource::Points(points)) => {
                    let posed = &posed.instances[instance as usize];
                    points.reflector(scene, instance, posed, &viewers, side)
                }
                // Neither size nor curvature counts for rays.
                _ => None,
            };
            // The centre that lookups use, which is rounded. An object of zero size reflects nothing.
            let nothing =
                MappedReflector { instance, center, radius: 0.0, curvature: 0.0, side, front: None };
            found.map_or(nothing, |found| MappedReflector { center, side, ..found })
        };
        let all: Vec<MappedReflector> =
            places.instances.iter().zip(places.centers()).map(reflector).collect();
        let map_bytes = 6 * (side as usize).pow(2) * TEXEL_BYTES;
        all.chunks((MOST_BYTES / map_bytes).max(1)).map(<[MappedReflector]>::to_vec).collect()
    }

    /// Fills the maps of a group of reflectors, whose sides are equal.
    pub(crate) fn fill(
        source: Fill,
        by: &ReflectionSource,
        scene: &Scene,
        middle: DVec3,
        reflectors: &[MappedReflector],
    ) -> FilledMaps {
        match (source, by) {
            (Fill::Points { viewers, budget }, ReflectionSource::Points(points)) => {
                points.fill(scene, middle, reflectors, &viewers, budget)
            }
            (_, ReflectionSource::Rays(rays)) => Self::fill_by_rays(rays, middle, reflectors),
            (Fill::Rays, ReflectionSource::Points(_)) => unreachable!("the scene is prepared for the source"),
        }
    }

    fn fill_by_rays(rays: &ReflectionRays, middle: DVec3, reflectors: &[MappedReflector]) -> FilledMaps {
        let (maps, met) = rays.maps(reflectors);
        let shown = Requests::all(&maps, maps.texels(), |_, id| id);
        let side = f64::from(reflectors.first().map_or(1, |reflector| reflector.side));
        let spread = 2.0 / side;
        let point = |(at, texel): (u32, u32)| {
            let met = met[texel as usize]?;
            let (map, direction) = maps.direction_of(texel as usize);
            let ray = Ray {
                start: (reflectors[map].center - middle).as_vec3(),
                direction: direction.normalize().as_vec3(),
                reflector: map as u32,
                past: Some(reflectors[map].instance),
                width: 0.0,
                spread: spread as f32,
                at,
                is_through: false,
            };
            let point = rays.shading_of(&met, direction.normalize(), spread * met.range);
            Some((probe_point(&point, middle), ray))
        };
        let (points, found) = (0..).zip(shown.ids()).filter_map(point).unzip();
        FilledMaps { rays: found, ..FilledMaps::new(&maps, &shown, points) }
    }
}
