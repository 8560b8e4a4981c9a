//! Rays from surface to surface.

use argus_scene::reflection::BOUNCES;
use argus_scene::shading::{Surface, reflected_around, sky_radiance};
use argus_scene::{Sky, rgb9e5};
use argus_shaders::layout::sampler::{LEAF_BLOCK, ProbePoint, ScatteredRay, ray_flags};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::mirror::{Mirror, Ray, reflected};
use super::point_method::{Met, ViewMaps};
use super::rays::{MetByRay, ReflectionRays};
use super::reflectors::Reflectors;
use super::scene::ReflectionSource;
use crate::light_rays::RayHit;
use crate::point_shading::{GBufferTexel, Points, ShadedPoints, index_in_blocks, probe_point};
use crate::tile::Tile;

/// Rays are not sent on for a smaller share of what arrives: half a step of a display.
const LEAST_SHARE: f32 = 1.0 / 512.0;
/// Sub-samples along a side of the squares in which rays of blurred reflections differ.
const SQUARE: u32 = 5;
/// Images of points begin and end at multiples of so many sub-samples, so that few sizes are needed.
const GRAIN: u32 = 4 * LEAF_BLOCK;

/// What finds light along rays.
pub(crate) struct Bounces<'a> {
    pub(crate) by: &'a ReflectionSource,
    /// The view's maps, if points are looked up.
    pub(crate) maps: Option<&'a dyn ViewMaps>,
    pub(crate) reflectors: &'a Reflectors,
    pub(crate) sky: &'a Sky,
    /// Positions are about it, metres.
    pub(crate) eye: DVec3,
    /// The tile whose sub-samples rays are for.
    pub(crate) tile: &'a Tile,
}

/// A ray on its way.
struct Path {
    ray: Ray,
    /// The first ray, of whose light this is a share.
    first: u32,
    share: Vec3,
}

/// Rays on their way, and the radiance that has arrived along the first ones so far.
pub(crate) struct Paths {
    along: Vec<Path>,
    pub(crate) arriving: Vec<Vec3>,
}

impl Paths {
    /// First rays.
    pub(crate) fn of_rays(rays: &[Ray]) -> Self {
        let path = |(first, ray): (u32, &Ray)| Path { ray: *ray, first, share: Vec3::ONE };
        Self { along: (0..).zip(rays).map(path).collect(), arriving: vec![Vec3::ZERO; rays.len()] }
    }

    /// Number of rays on their way.
    pub(crate) fn len(&self) -> usize {
        self.along.len()
    }

    /// The rays on their way, for a device.
    pub(crate) fn of_sight(&self) -> Vec<ScatteredRay> {
        let ray = |path: &Path| ScatteredRay {
            origin: path.ray.start.to_array(),
            most: f32::MAX,
            direction: path.ray.direction.to_array(),
            flags: ray_flags::OF_SIGHT,
        };
        self.along.par_iter().with_min_len(1024).map(ray).collect()
    }

    /// Whether no ray goes on.
    pub(crate) fn have_ended(&self) -> bool {
        self.along.is_empty()
    }
}

impl Bounces<'_> {
    /// Whether rays go on from any of the points that they met, after so many bounces.
    pub(crate) fn go_on(&self, met: &Met, bounce: u32) -> bool {
        let reflects = |point: &ProbePoint| self.reflectors.of(point.instance).is_some();
        bounce < BOUNCES && met.points.all.par_iter().any(reflects)
    }

    /// Adds the light of what rays met, once it is shaded, and sends them on.
    pub(crate) fn follow(&self, paths: &mut Paths, met: &Met, shaded: &ShadedPoints) {
        let offset = offset_about(self.by, self.eye);
        let follow = |(path, index): (&Path, &Option<u32>)| match index {
            Some(index) => self.follow_path(path, *index as usize, &met.points, shaded, &offset),
            None => (path.share * sky_radiance(self.sky, path.ray.direction), None),
        };
        let along: Vec<(Vec3, Option<Path>)> =
            paths.along.par_iter().zip(&met.of_ray).with_min_len(1024).map(follow).collect();
        for (path, (light, _)) in paths.along.iter().zip(&along) {
            paths.arriving[path.first as usize] += light;
        }
        paths.along = along.into_iter().filter_map(|(_, next)| next).collect();
    }

    /// The light of a point that a path met, and how the path goes on.
    fn follow_path(
        &self,
        path: &Path,
        index: usize,
        points: &Points,
        shaded: &ShadedPoints,
        offset: impl Fn(Vec3) -> f32,
    ) -> (Vec3, Option<Path>) {
        let light = path.share * shaded.radiance[index];
        let Some(&g_buffer) = shaded.g_buffer.get(index) else { return (light, None) };
        match self.onward(path, points.all[index].instance, g_buffer, offset) {
            Some((next, kept)) => (light * kept, Some(next)),
            None => (light, None),
        }
    }

    /// The path on from a surface that it met, and the share of the surface's own light that is seen.
    fn onward(
        &self,
        path: &Path,
        instance: u32,
        g_buffer: GBufferTexel,
        offset: impl Fn(Vec3) -> f32,
    ) -> Option<(Path, f32)> {
        let (reflector, transmission) = self.reflectors.of(instance)?;
        let mirror = Mirror::of_g_buffer(g_buffer, offset, reflector, transmission > 0.0)?;
        let Ray { direction, at, .. } = path.ray;
        let surface = Surface {
            position: DVec3::ZERO,
            normal: mirror.point.normal,
            albedo: Vec3::ZERO,
            emissive: Vec3::ZERO,
            f0: mirror.f0,
            roughness: mirror.roughness,
            transmission: 0.0,
        };
        let reflectance = reflected_around(&surface, -direction, Vec3::ONE);
        let (share, start, onward, past) = match mirror.through(direction) {
            Some((start, inward)) => {
                let passes = rgb9e5::decode(g_buffer[1][0]) * transmission * (Vec3::ONE - reflectance);
                (passes, start, inward, Some(instance))
            }
            None => {
                let [width, _] = self.tile.sub_samples();
                let stratum = at % width % SQUARE + SQUARE * (at / width % SQUARE);
                let onward = reflected(direction, mirror.half_vector(stratum, SQUARE * SQUARE));
                let past = Some(instance).filter(|_| onward.dot(mirror.point.side) <= 0.0);
                (reflectance, mirror.point.start, onward, past)
            }
        };
        let share = path.share * share;
        let leaves = past.is_some() || onward.dot(mirror.point.normal) > 0.0;
        // NaN fails.
        if !(leaves && share.max_element() >= LEAST_SHARE && onward.is_finite()) {
            return None;
        }
        let range = (mirror.point.position - path.ray.start).length();
        let width = path.ray.width + path.ray.spread * range;
        let spread = path.ray.spread + mirror.alpha();
        let ray = Ray { start, direction: onward, reflector, past, width, spread, ..path.ray };
        Some((Path { ray, share, ..*path }, 1.0 - transmission))
    }

    /// What rays meet. `first`: the first surface along each, if a device found them.
    pub(crate) fn meet(&self, paths: &Paths, first: Option<&[Option<RayHit>]>) -> Met {
        let paths = &paths.along[..];
        match (self.by, self.maps) {
            (ReflectionSource::Points(_), Some(maps)) => {
                let rays: Vec<Ray> = paths.iter().map(|path| path.ray).collect();
                maps.meet(self.eye, &rays)
            }
            (ReflectionSource::Points(_), None) => {
                Met { points: Points::default(), of_ray: vec![None; paths.len()] }
            }
            (ReflectionSource::Rays(tracer), _) => self.meet_by_rays(tracer, paths, first),
        }
    }

    /// Traces rays. What they meet has the places of their sub-samples in an image; refracted rays have the rows below it.
    fn meet_by_rays(&self, tracer: &ReflectionRays, paths: &[Path], first: Option<&[Option<RayHit>]>) -> Met {
        let rays = paths.par_iter().map(|path| (path.ray.start, path.ray.direction, path.ray.past));
        let met = tracer.follow(self.eye, rays, first);
        let [columns, rows] = self.tile.sub_samples();
        let place = |ray: &Ray| [ray.at % columns, ray.at / columns];
        let (mut begin, mut end) = ([columns, rows], [0, 0]);
        for path in paths {
            for (axis, at) in place(&path.ray).into_iter().enumerate() {
                (begin[axis], end[axis]) = (begin[axis].min(at), end[axis].max(at + 1));
            }
        }
        let begin = [0, 1].map(|axis| begin[axis].min(end[axis]) / GRAIN * GRAIN);
        let [width, height] = [0, 1].map(|axis| (end[axis] - begin[axis]).next_multiple_of(GRAIN));
        let layers = 1 + u32::from(paths.iter().any(|path| path.ray.is_through));
        let of_path = |(path, met): (&Path, &Option<MetByRay>)| {
            let met = met.as_ref()?;
            let Path { ray, .. } = path;
            let width_there = ray.width + ray.spread * met.range as f32;
            let met = tracer.shading_of(met, ray.direction.as_dvec3(), f64::from(width_there));
            let point = probe_point(&met, self.eye);
            let [x, y] = place(ray);
            let row = y - begin[1] + height * u32::from(ray.is_through);
            Some((index_in_blocks([x - begin[0], row], width) as u32, point))
        };
        let found: Vec<Option<(u32, ProbePoint)>> =
            paths.par_iter().zip(&met).with_min_len(1024).map(of_path).collect();
        let mut all = vec![Points::NOTHING; (width * height * layers) as usize];
        for (index, point) in found.iter().flatten() {
            all[*index as usize] = *point;
        }
        let of_ray = found.iter().map(|found| found.map(|(index, _)| index)).collect();
        let in_image = [0, 1].map(|axis| self.tile.begin[axis] * self.tile.side + begin[axis]);
        Met { points: Points { all, image: Some([in_image, [width, height * layers]]) }, of_ray }
    }
}

/// How far off a surface rays begin, metres, by its place about an eye.
pub(crate) fn offset_about(by: &ReflectionSource, eye: DVec3) -> impl Fn(Vec3) -> f32 + Sync {
    let about = match by {
        ReflectionSource::Rays(tracer) => Some(tracer.about(eye)),
        // Lookups hit no surface.
        ReflectionSource::Points(_) => None,
    };
    move |position| about.as_ref().map_or(0.0, |about| about.offset(position, position.length()))
}
