//! Traced reflections: reflected rays, and maps whose texels are traced.

use std::sync::Arc;

use argus_scene::{RenderError, Scene};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::index_maps::{IndexMaps, MappedReflector};
use crate::light_rays::{CullMode, LightRays, LightRaysAbout, RayHit};
use crate::packets::PacketTracer;
use crate::point_shading::{Side, SurfacePoint};
use crate::resident::placed;

/// Rays through a scene that pass through one instance, that which reflects them.
pub struct ReflectionRays {
    scene: Arc<Scene>,
    instances: Vec<argus_scene::Instance>,
    rays: LightRays,
}

/// Least cosine between a ray and the normal of what it met: at a smaller one, what the ray stands for grows no longer.
const LEAST_COSINE: f64 = 0.05;
/// Most surfaces of its own reflector that a ray passes.
const MOST_PASSED: u32 = 64;

/// Where a ray ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MetByRay {
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index of the triangle in its mesh.
    pub primitive: u32,
    /// Weights of the mesh's second and third corner.
    pub weights: [f64; 2],
    /// Distance from the ray's origin, metres.
    pub range: f64,
    /// The side that is seen.
    pub side: Side,
}

impl ReflectionRays {
    /// Builds the trees of a scene at a time in seconds.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for a scene of more than 2²⁸ triangles.
    pub fn new(scene: &Arc<Scene>, time_secs: f64) -> Result<Self, RenderError> {
        let instances = scene.at(time_secs).instances;
        let tracer = PacketTracer::new(scene, &placed(scene, &instances), f32::MIN_POSITIVE);
        Self::of_tracer(scene, time_secs, &tracer)
    }

    /// Takes the triangles of a packet tracer that is posed at a time in seconds.
    ///
    /// # Errors
    /// The errors of [`Self::new`].
    pub(crate) fn of_tracer(
        scene: &Arc<Scene>,
        time_secs: f64,
        tracer: &PacketTracer,
    ) -> Result<Self, RenderError> {
        let instances = scene.at(time_secs).instances;
        let rays = LightRays::new(tracer, CullMode::Back).ok_or_else(too_large)?;
        Ok(Self { scene: Arc::clone(scene), instances, rays })
    }

    /// The nearest surface along a ray of a unit direction, past those of `own`. Positions are relative to `eye`.
    fn nearest(
        &self,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        origin: DVec3,
        direction: DVec3,
        own: u32,
    ) -> Option<MetByRay> {
        let first = about.nearest((origin - eye).as_vec3(), direction.as_vec3(), f32::MAX);
        past_own(first, about, (origin - eye, direction), own)
    }

    /// Takes over the pose of a packet tracer, which has been posed before: a time in seconds. Trees of meshes are kept.
    ///
    /// # Errors
    /// The errors of [`Self::new`].
    pub(crate) fn pose(
        &mut self,
        scene: &Scene,
        tracer: &PacketTracer,
        time_secs: f64,
    ) -> Result<(), RenderError> {
        self.instances = scene.at(time_secs).instances;
        self.rays.pose(tracer).ok_or_else(too_large)
    }

    /// The trees about an eye.
    pub(crate) fn about(&self, eye: DVec3) -> LightRaysAbout<'_> {
        self.rays.about(eye)
    }

    /// Where rays end that begin off a surface: origin, metres about `eye`, and unit direction of each, and the instance that
    /// it passes through. `first`: the first surface along each, if a device found them.
    pub(crate) fn follow(
        &self,
        eye: DVec3,
        rays: impl IndexedParallelIterator<Item = (Vec3, Vec3, Option<u32>)>,
        first: Option<&[Option<RayHit>]>,
    ) -> Vec<Option<MetByRay>> {
        let about = self.rays.about(eye);
        let follow = |(index, (start, direction, past)): (usize, (Vec3, Vec3, Option<u32>))| {
            let first = match first {
                Some(first) => first.get(index).copied().flatten(),
                None => about.nearest(start, direction, f32::MAX),
            };
            let ray = (start.as_dvec3(), direction.as_dvec3());
            past_own(first, &about, ray, past.unwrap_or(u32::MAX))
        };
        rays.enumerate().with_min_len(256).map(follow).collect()
    }

    /// Where rays end: origin and unit direction of each, world space, and the instance that it passes through.
    pub fn trace(&self, eye: DVec3, rays: &[(DVec3, DVec3, u32)]) -> Vec<Option<MetByRay>> {
        let about = self.rays.about(eye);
        let trace = |&(origin, direction, own): &(DVec3, DVec3, u32)| {
            let from = (origin - eye).as_vec3();
            // Off the surface that the ray leaves.
            let start = origin + direction * f64::from(about.offset(from, from.length()));
            self.nearest(&about, eye, start, direction, own)
        };
        rays.par_iter().with_min_len(256).map(trace).collect()
    }

    /// Fills maps by a ray through the middle of each texel. Ids are indices of texels; what each has met comes with them.
    pub fn maps(&self, reflectors: &[MappedReflector]) -> (IndexMaps, Vec<Option<MetByRay>>) {
        let maps = IndexMaps::new(reflectors);
        let abouts: Vec<LightRaysAbout<'_>> = reflectors.iter().map(|r| self.rays.about(r.center)).collect();
        let met: Vec<Option<MetByRay>> = (0..maps.texels())
            .into_par_iter()
            .with_min_len(256)
            .map(|texel| {
                let (map, direction) = maps.direction_of(texel);
                let reflector = &reflectors[map];
                let direction = direction.normalize();
                let begin = reflector.begin(direction)?;
                let start = reflector.center + direction * begin;
                let mut found =
                    self.nearest(&abouts[map], reflector.center, start, direction, reflector.instance);
                if let Some(met) = &mut found {
                    met.range += begin;
                }
                if let Some(met) = found {
                    maps.write(texel, met.range, texel as u32);
                }
                found
            })
            .collect();
        (maps, met)
    }

    /// What a ray of a unit direction met, for shading; `width` is that of the ray there, metres.
    pub fn shading_of(&self, met: &MetByRay, direction: DVec3, width: f64) -> SurfacePoint {
        let instance = &self.instances[met.instance as usize];
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let first = 3 * met.primitive as usize;
        let corners = [0, 1, 2].map(|corner| {
            let vertex = mesh.indices.get(first + corner).copied().unwrap_or_default();
            let position = mesh.positions.get(vertex as usize).copied().unwrap_or(Vec3::ZERO);
            instance.world_from_mesh.transform_point3(mesh.origin + position.as_dvec3())
        });
        let [a, b, c] = corners;
        let [second, third] = met.weights;
        let normal = (b - a).cross(c - a).normalize_or(DVec3::Y);
        let right = normal.any_orthonormal_vector();
        let cosine = normal.dot(direction).abs().max(LEAST_COSINE);
        SurfacePoint {
            instance: met.instance,
            primitive: met.primitive,
            weights: met.weights,
            position: a + (b - a) * second + (c - a) * third,
            side: met.side,
            footprint: [right * width, normal.cross(right) * (width / cosine)],
        }
    }
}

/// The nearest surface along a ray past those of `own`, by the first along it. The ray: origin, metres about the trees' eye, and unit
/// direction.
fn past_own(
    first: Option<RayHit>,
    about: &LightRaysAbout<'_>,
    (origin, direction): (DVec3, DVec3),
    own: u32,
) -> Option<MetByRay> {
    let along = direction.as_vec3();
    let (mut hit, mut passed) = (first?, 0.0f64);
    for _ in 0..MOST_PASSED {
        let range = passed + f64::from(hit.t);
        if hit.instance != own {
            let side = if hit.front { Side::Front } else { Side::Back };
            let weights = hit.weights.map(f64::from);
            let RayHit { instance, primitive, .. } = hit;
            return Some(MetByRay { instance, primitive, weights, range, side });
        }
        let place = (origin + direction * passed).as_vec3() + along * hit.t;
        passed = range + f64::from(about.offset(place, hit.t).max(f32::MIN_POSITIVE));
        hit = about.nearest((origin + direction * passed).as_vec3(), along, f32::MAX)?;
    }
    None
}

fn too_large() -> RenderError {
    RenderError::OutOfMemory("the scene has too many triangles to trace".to_owned())
}
