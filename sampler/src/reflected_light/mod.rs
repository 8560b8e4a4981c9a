//! Light along reflected rays: what they meet, what that reflects in turn, and so on (Gavane and Watson 2022, section 4.1.4).
//!
//! What a ray meets is shaded without what depends on the viewer. If it is reflective, it sends one ray on: glass a refracted
//! one, anything else a reflected one. So as many points are shaded as rays are cast, and a ray's points are where the ray is in
//! an image, whose neighbours share light.
//!
//! Direct views and reflection probes share it.

mod mirror;
mod rays;
mod reflectors;
mod scene;

use argus_scene::reflection::BOUNCES;
use argus_scene::shading::{Surface, reflected_around, sky_radiance};
use argus_scene::{RenderError, Sky, Stage, rgb9e5};
use argus_shaders::layout::sampler::{LEAF_BLOCK, ProbePoint};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

pub use self::mirror::Ray;
pub(crate) use self::mirror::{Mirror, reflected};
pub use self::rays::{MetByRay, ReflectionRays};
pub(crate) use self::reflectors::Reflectors;
pub(crate) use self::scene::{ReflectedScene, ReflectionSource};
use crate::plug::ViewMaps;
use crate::point_shading::{PointGuides, PointShading, Points, ShadedPoints, index_in_blocks, probe_point};
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

/// What rays met, to be shaded.
pub struct Met {
    /// Each point once.
    pub points: Points,
    /// For each ray the index of its point; `None` for the sky.
    pub of_ray: Vec<Option<u32>>,
}

/// A ray on its way.
struct Path {
    ray: Ray,
    /// The first ray, of whose light this is a share.
    first: u32,
    share: Vec3,
}

impl Path {
    fn of_rays(rays: &[Ray]) -> Vec<Self> {
        (0..).zip(rays).map(|(first, ray)| Self { ray: *ray, first, share: Vec3::ONE }).collect()
    }
}

impl Bounces<'_> {
    /// Radiance that arrives along each ray.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn arriving(
        &self,
        rays: &[Ray],
        shading: &mut PointShading<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<Vec<Vec3>, RenderError> {
        let paths = Path::of_rays(rays);
        let met = self.meet(&paths);
        self.arriving_from(paths, met, shading, stages)
    }

    /// Radiance of points that are seen along rays, which see one each.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn radiance_of(
        &self,
        points: Vec<ProbePoint>,
        rays: &[Ray],
        shading: &mut PointShading<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<Vec<Vec3>, RenderError> {
        let of_ray = (0..points.len() as u32).map(Some).collect();
        let met = Met { points: Points { all: points, image: None }, of_ray };
        self.arriving_from(Path::of_rays(rays), met, shading, stages)
    }

    /// Radiance that arrives along first rays, of which is known what they met.
    fn arriving_from(
        &self,
        mut paths: Vec<Path>,
        mut met: Met,
        shading: &mut PointShading<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<Vec<Vec3>, RenderError> {
        let mut arriving = vec![Vec3::ZERO; paths.len()];
        for bounce in 1..=BOUNCES {
            let reflects = |point: &ProbePoint| self.reflectors.of(point.instance).is_some();
            let goes_on = bounce < BOUNCES && met.points.all.par_iter().any(reflects);
            let shaded = shading.shade(&met.points, goes_on, stages)?;
            let offset = offset_about(self.by, self.eye);
            let follow = |(path, index): (&Path, &Option<u32>)| match index {
                Some(index) => self.follow(path, *index as usize, (&met.points, &shaded), &offset),
                None => (path.share * sky_radiance(self.sky, path.ray.direction), None),
            };
            let along: Vec<(Vec3, Option<Path>)> =
                paths.par_iter().zip(&met.of_ray).with_min_len(1024).map(follow).collect();
            for (path, (light, _)) in paths.iter().zip(&along) {
                arriving[path.first as usize] += light;
            }
            paths = along.into_iter().filter_map(|(_, next)| next).collect();
            if paths.is_empty() {
                break;
            }
            met = self.meet(&paths);
        }
        Ok(arriving)
    }

    /// The light of a point that a path met, and how the path goes on.
    fn follow(
        &self,
        path: &Path,
        index: usize,
        (points, shaded): (&Points, &ShadedPoints),
        offset: impl Fn(Vec3) -> f32,
    ) -> (Vec3, Option<Path>) {
        let light = path.share * shaded.radiance[index];
        let Some(&guides) = shaded.guides.get(index) else { return (light, None) };
        match self.onward(path, points.all[index].instance, guides, offset) {
            Some((next, kept)) => (light * kept, Some(next)),
            None => (light, None),
        }
    }

    /// The path on from a surface that it met, and the share of the surface's own light that is seen.
    fn onward(
        &self,
        path: &Path,
        instance: u32,
        guides: PointGuides,
        offset: impl Fn(Vec3) -> f32,
    ) -> Option<(Path, f32)> {
        let (reflector, transmission) = self.reflectors.of(instance)?;
        let mirror = Mirror::of_guides(guides, offset, (reflector, transmission > 0.0))?;
        let Ray { direction, at, .. } = path.ray;
        let surface = Surface {
            position: DVec3::ZERO,
            normal: mirror.texel.normal,
            albedo: Vec3::ZERO,
            emissive: Vec3::ZERO,
            f0: mirror.f0,
            roughness: mirror.roughness,
            transmission: 0.0,
        };
        let reflectance = reflected_around(&surface, -direction, Vec3::ONE);
        let (share, start, onward, past) = match mirror.through(direction) {
            Some((start, inward)) => {
                let passes = rgb9e5::decode(guides[1][0]) * transmission * (Vec3::ONE - reflectance);
                (passes, start, inward, Some(instance))
            }
            None => {
                let [width, _] = self.tile.sub_samples();
                let stratum = at % width % SQUARE + SQUARE * (at / width % SQUARE);
                let onward = reflected(direction, mirror.half_vector(stratum, SQUARE * SQUARE));
                let past = Some(instance).filter(|_| onward.dot(mirror.texel.side) <= 0.0);
                (reflectance, mirror.texel.start, onward, past)
            }
        };
        let share = path.share * share;
        let leaves = past.is_some() || onward.dot(mirror.texel.normal) > 0.0;
        // NaN fails.
        if !(leaves && share.max_element() >= LEAST_SHARE && onward.is_finite()) {
            return None;
        }
        let range = (mirror.texel.position - path.ray.start).length();
        let width = path.ray.width + path.ray.spread * range;
        let spread = path.ray.spread + mirror.alpha();
        let ray = Ray { start, direction: onward, reflector, past, width, spread, ..path.ray };
        Some((Path { ray, share, ..*path }, 1.0 - transmission))
    }

    fn meet(&self, paths: &[Path]) -> Met {
        match (self.by, self.maps) {
            (ReflectionSource::Points(_), Some(maps)) => {
                let rays: Vec<Ray> = paths.iter().map(|path| path.ray).collect();
                maps.meet(self.eye, &rays)
            }
            (ReflectionSource::Points(_), None) => {
                Met { points: Points::default(), of_ray: vec![None; paths.len()] }
            }
            (ReflectionSource::Rays(tracer), _) => self.meet_by_rays(tracer, paths),
        }
    }

    /// Traces rays. What they meet has the places of their sub-samples in an image; refracted rays have the rows below it.
    fn meet_by_rays(&self, tracer: &ReflectionRays, paths: &[Path]) -> Met {
        let rays = paths.par_iter().map(|path| (path.ray.start, path.ray.direction, path.ray.past));
        let met = tracer.follow(self.eye, rays);
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
            let point = probe_point(&tracer.shading_of(met, f64::from(width_there)), self.eye);
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
