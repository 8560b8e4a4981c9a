//! The rays that light needs in a view.

use argus_scene::light_sampling::{cosine_direction, disc_point};
use argus_scene::{Camera, Light, SampleCamera, Scene};
use argus_shaders::layout::sampler::Rays;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::light_rays::{LightRays, LightRaysAbout, RayHit};
use crate::mixed::mixed;
use crate::packets::{PacketTracer, Ray};
use crate::tile::tiles;

/// Rays that a thread takes at a time.
const SHARE: usize = 1024;
/// Share of a shadow ray's length at which it ends before the light.
const SHORT: f32 = 1e-3;
/// Direction towards the sun of a scene without a directional light.
const SUN: Vec3 = Vec3::new(0.3, 0.9, 0.2);

/// A kind of rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RayKind {
    /// From the eye through each pixel: nearest hit.
    Primary,
    /// From each visible point towards the first directional light: any hit.
    Sun,
    /// From each visible point to the first point or spot light, or to a point high in the scene: any hit.
    Point,
    /// From each visible point in a random direction by the cosine with its normal: any hit.
    Sky,
    /// The directions of [`Self::Sky`]: nearest hit.
    Bounce,
}

impl RayKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Primary, Self::Sun, Self::Point, Self::Sky, Self::Bounce];

    /// Whether any hit ends its rays.
    pub fn ends_at_any_hit(self) -> bool {
        !matches!(self, Self::Primary | Self::Bounce)
    }

    /// Its name in a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::Sun => "sun",
            Self::Point => "point",
            Self::Sky => "sky",
            Self::Bounce => "bounce",
        }
    }
}

/// Rays about an eye.
#[derive(Default)]
pub(super) struct Batch {
    pub(super) origins: Vec<Vec3>,
    pub(super) directions: Vec<Vec3>,
    /// Length of each, in units of its direction.
    pub(super) most: f32,
}

impl Batch {
    /// Traces the rays, and counts those that hit.
    fn count(&self, hits: impl Fn(Vec3, Vec3) -> bool + Sync) -> usize {
        let shares = self.origins.par_chunks(SHARE).zip(self.directions.par_chunks(SHARE));
        let count = |(origins, directions): (&[Vec3], &[Vec3])| {
            origins.iter().zip(directions).filter(|&(&origin, &direction)| hits(origin, direction)).count()
        };
        shares.map(count).sum()
    }

    pub(super) fn wide(&self, about: &LightRaysAbout<'_>, kind: RayKind) -> usize {
        if !kind.ends_at_any_hit() {
            return self.count(|origin, direction| about.nearest(origin, direction, self.most).is_some());
        }
        self.count(|origin, direction| about.is_blocked(origin, direction, self.most))
    }

    pub(super) fn single(&self, tracer: &PacketTracer, eye: DVec3) -> usize {
        let most = f64::from(self.most);
        self.count(|origin, direction| {
            tracer.nearest(eye + origin.as_dvec3(), direction.as_dvec3(), most).is_some()
        })
    }
}

/// A view's rays.
pub(super) struct View {
    pub(super) eye: DVec3,
    /// Of the whole image, as packets take them.
    image: Option<Rays>,
    /// Relative to the eye.
    light: Vec3,
    /// One entry a kind.
    batches: [Batch; RayKind::ALL.len()],
}

impl View {
    pub(super) fn new(scene: &Scene, rays: &LightRays, camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let faces = SampleCamera::Perspective { camera: *camera, width, height }.faces();
        let images: Vec<Rays> = tiles(&faces, 1).iter().map(|tile| tile.rays()).collect();
        let eye = camera.eye;
        let primary: Vec<Vec3> = images.iter().flat_map(directions).collect();
        let about = rays.about(eye);
        let seen = |(i, &direction): (usize, &Vec3)| {
            let hit = about.nearest(Vec3::ZERO, direction, f32::MAX)?;
            let normal = facing_normal(scene, &hit, direction);
            let point = direction * hit.t;
            Some((point + normal * about.offset(point, point.length()), by_cosine(normal, i as u64)))
        };
        let (points, scattered): (Vec<Vec3>, Vec<Vec3>) =
            primary.par_iter().enumerate().with_min_len(SHARE).filter_map(seen).unzip();
        let light = (light(scene) - eye).as_vec3();
        let ray = |directions: Vec<Vec3>, most| Batch { origins: points.clone(), directions, most };
        let sun = vec![sun(scene); points.len()];
        let to_light = points.iter().map(|&point| light - point).collect();
        let batches = [
            Batch { origins: vec![Vec3::ZERO; primary.len()], directions: primary, most: f32::MAX },
            ray(sun, f32::MAX),
            ray(to_light, 1.0 - SHORT),
            ray(scattered.clone(), f32::MAX),
            ray(scattered, f32::MAX),
        ];
        let image = <[Rays; 1]>::try_from(images).ok().map(|[image]| image);
        Self { eye, image, light, batches }
    }

    pub(super) fn batch(&self, kind: RayKind) -> &Batch {
        &self.batches[kind as usize]
    }

    pub(super) fn packets(&self, tracer: &PacketTracer, kind: RayKind) -> usize {
        if kind == RayKind::Primary {
            let Some(image) = &self.image else { return 0 };
            return tracer.trace(self.eye, image).iter().filter(|ids| ids[0] != 0).count();
        }
        let light = self.eye + self.light.as_dvec3();
        let count = |origins: &[Vec3]| {
            let ray = |&point: &Vec3| Ray { direction: (point - self.light).as_dvec3(), most: 1.0 - SHORT };
            let rays: Vec<Ray> = origins.iter().map(ray).collect();
            tracer.distances(light, &rays).iter().flatten().count()
        };
        self.batch(kind).origins.par_chunks(SHARE).map(count).sum()
    }
}

/// Directions of an image's rays, row by row.
fn directions(rays: &Rays) -> Vec<Vec3> {
    let [top_left, right, down] = [rays.top_left, rays.right, rays.down].map(Vec3::from_array);
    let through =
        |i: u32| top_left + ((i % rays.width) as f32 + 0.5) * right + ((i / rays.width) as f32 + 0.5) * down;
    (0..rays.width * rays.height).map(through).collect()
}

/// Unit normal of a hit triangle, on the side that a ray came from.
fn facing_normal(scene: &Scene, hit: &RayHit, direction: Vec3) -> Vec3 {
    let instance = &scene.instances[hit.instance as usize];
    let mesh = &scene.meshes[instance.mesh as usize];
    let corner = |i: usize| {
        let index = mesh.indices[3 * hit.primitive as usize + i] as usize;
        instance.world_from_mesh.matrix3 * mesh.positions[index].as_dvec3()
    };
    let (a, b, c) = (corner(0), corner(1), corner(2));
    let normal = (b - a).cross(c - a).normalize_or(DVec3::Y).as_vec3();
    if normal.dot(direction) > 0.0 { -normal } else { normal }
}

/// A random direction, distributed by the cosine with a normal.
fn by_cosine(normal: Vec3, index: u64) -> Vec3 {
    let disc = disc_point(DVec2::new(mixed(2 * index), mixed(2 * index + 1)));
    cosine_direction(normal.as_dvec3(), disc).as_vec3()
}

/// Direction towards the first directional light.
fn sun(scene: &Scene) -> Vec3 {
    let towards = |light: &Light| match light {
        Light::Directional { direction, .. } => Some(-direction.as_vec3()),
        _ => None,
    };
    scene.lighting.lights.iter().find_map(towards).unwrap_or(SUN)
}

/// The first point or spot light, or a point high in the middle of the scene.
fn light(scene: &Scene) -> DVec3 {
    let at = |light: &Light| match light {
        Light::Point { position, .. } | Light::Spot { position, .. } => Some(*position),
        Light::Directional { .. } => None,
    };
    let bounds = scene.bounds();
    let high = bounds.center() + DVec3::Y * 0.4 * bounds.size().y;
    scene.lighting.lights.iter().find_map(at).unwrap_or(high)
}
