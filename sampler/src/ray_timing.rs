//! Measures the tracers of the CPU and of the device on the rays that light needs, for studies.

mod device;

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::Gpu;
use argus_scene::light_sampling::{cosine_direction, disc_point};
use argus_scene::{Camera, Light, RenderError, SampleCamera, Scene};
use argus_shaders::layout::sampler::Rays;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::draws;
use crate::light_rays::{CullMode, LightRays, LightRaysAbout, RayHit};
use crate::mixed::mixed;
use crate::packets::{PacketTracer, Ray};
use crate::resident::placed;
use crate::tile::tiles;
pub use device::{DeviceRayBatch, DeviceRayTimes, DeviceRays};

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

/// A tracer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RayTracer {
    /// One ray at a time against eight boxes, f32.
    Wide,
    /// Packets of rays with a common origin, f32: primary rays, and point lights from the light.
    Packets,
    /// One ray at a time through the binary tree, f64.
    Single,
    /// One ray an invocation of the device, f32.
    Device,
}

impl RayTracer {
    /// The tracers of the CPU.
    pub const OF_CPU: [Self; 3] = [Self::Wide, Self::Packets, Self::Single];

    /// Its name in a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wide => "wide",
            Self::Packets => "packets",
            Self::Single => "single",
            Self::Device => "device",
        }
    }

    fn traces(self, kind: RayKind) -> bool {
        self != Self::Packets || matches!(kind, RayKind::Primary | RayKind::Point)
    }
}

/// What is measured.
#[derive(Debug, Clone)]
pub struct RayWork {
    /// Viewpoints whose pixels give the rays.
    pub cameras: Vec<Camera>,
    /// Pixels of a view.
    pub size: [u32; 2],
    /// Measured rounds, after one that is not counted. Tracers alternate within a round.
    pub rounds: usize,
}

/// What tracing one kind of rays costs.
#[derive(Debug, Clone)]
pub struct RayCost {
    /// The kind of rays.
    pub kind: RayKind,
    /// The tracer.
    pub tracer: RayTracer,
    /// Threads of the CPU; 0 for the device.
    pub threads: usize,
    /// Rays of a round.
    pub rays: usize,
    /// Share of the rays that hit something.
    pub hit_fraction: f64,
    /// Seconds of each round.
    pub secs: Vec<f64>,
}

/// Traces all kinds of rays with each tracer that supports them, on one thread and on all. Also returns the milliseconds
/// in which the trees of [`RayTracer::Wide`] were built, and their bytes.
///
/// # Errors
/// [`RenderError::OutOfMemory`] if the scene is too large for [`RayTracer::Wide`].
pub fn ray_costs(scene: &Arc<Scene>, work: &RayWork) -> Result<(Vec<RayCost>, f64, usize), RenderError> {
    let placements = placed(scene, &scene.instances);
    let tracer = PacketTracer::new(scene, &placements, draws::near(&scene.bounds()));
    let begin = Instant::now();
    let rays = LightRays::new(&tracer, CullMode::None)
        .ok_or_else(|| RenderError::OutOfMemory("too many triangles for rays of light".to_owned()))?;
    let build_ms = begin.elapsed().as_secs_f64() * 1e3;
    let views: Vec<View> =
        work.cameras.iter().map(|camera| View::new(scene, &rays, camera, work.size)).collect();
    let all = rayon::current_num_threads();
    let mut pools = Vec::new();
    for threads in if all > 1 { vec![1, all] } else { vec![1] } {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        pools.push(pool.map_err(|error| RenderError::Internal(error.to_string()))?);
    }
    let mut costs = Vec::new();
    for round in 0..=work.rounds {
        let mut at = 0;
        for pool in &pools {
            for kind in RayKind::ALL {
                for tracer_kind in RayTracer::OF_CPU.into_iter().filter(|tracer| tracer.traces(kind)) {
                    let cost = measure(pool, &rays, &tracer, &views, kind, tracer_kind);
                    if round == 0 {
                        costs.push(RayCost { secs: Vec::new(), ..cost });
                    } else {
                        costs[at].secs.extend(cost.secs);
                    }
                    at += 1;
                }
            }
        }
    }
    Ok((costs, build_ms, rays.bytes()))
}

/// Traces all kinds of rays on a device.
///
/// # Errors
/// [`RenderError::OutOfMemory`] if the scene is too large for the device; a fault of the device.
pub fn device_ray_costs(
    gpu: &Arc<Gpu>,
    scene: &Arc<Scene>,
    work: &RayWork,
) -> Result<Vec<RayCost>, RenderError> {
    let mut device = DeviceRays::new(gpu, scene)?;
    let mut costs = Vec::new();
    for kind in RayKind::ALL {
        let (mut rays, mut hits, mut secs) = (0, 0.0, vec![0.0; work.rounds]);
        for camera in &work.cameras {
            let batch = device.seen(camera, work.size, kind)?;
            let times = device.trace(&batch, kind.ends_at_any_hit(), work.rounds)?;
            rays += times.rays;
            hits += times.hit_fraction * times.rays as f64;
            let measured = if times.device_secs.is_empty() { &times.secs } else { &times.device_secs };
            secs.iter_mut().zip(measured).for_each(|(sum, secs)| *sum += secs);
        }
        let hit_fraction = hits / rays.max(1) as f64;
        costs.push(RayCost { kind, tracer: RayTracer::Device, threads: 0, rays, hit_fraction, secs });
    }
    Ok(costs)
}

fn measure(
    pool: &ThreadPool,
    rays: &LightRays,
    tracer: &PacketTracer,
    views: &[View],
    kind: RayKind,
    by: RayTracer,
) -> RayCost {
    let (mut count, mut hit, mut secs) = (0, 0, 0.0);
    for view in views {
        let batch = view.batch(kind);
        let begin = Instant::now();
        hit += pool.install(|| match by {
            RayTracer::Wide => batch.wide(&rays.about(view.eye), kind),
            RayTracer::Packets => view.packets(tracer, kind),
            RayTracer::Single => batch.single(tracer, view.eye),
            // Measured by `DeviceRays`.
            RayTracer::Device => 0,
        });
        secs += begin.elapsed().as_secs_f64();
        count += batch.directions.len();
    }
    let hit_fraction = hit as f64 / count.max(1) as f64;
    RayCost {
        kind,
        tracer: by,
        threads: pool.current_num_threads(),
        rays: count,
        hit_fraction,
        secs: vec![secs],
    }
}

/// Rays about an eye.
#[derive(Default)]
struct Batch {
    origins: Vec<Vec3>,
    directions: Vec<Vec3>,
    /// Length of each, in units of its direction.
    most: f32,
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

    fn wide(&self, about: &LightRaysAbout<'_>, kind: RayKind) -> usize {
        if !kind.ends_at_any_hit() {
            return self.count(|origin, direction| about.nearest(origin, direction, self.most).is_some());
        }
        self.count(|origin, direction| about.is_blocked(origin, direction, self.most))
    }

    fn single(&self, tracer: &PacketTracer, eye: DVec3) -> usize {
        let most = f64::from(self.most);
        self.count(|origin, direction| {
            tracer.nearest(eye + origin.as_dvec3(), direction.as_dvec3(), most).is_some()
        })
    }
}

/// A view's rays.
struct View {
    eye: DVec3,
    /// Of the whole image, as packets take them.
    image: Option<Rays>,
    /// Relative to the eye.
    light: Vec3,
    /// One entry a kind.
    batches: [Batch; RayKind::ALL.len()],
}

impl View {
    fn new(scene: &Scene, rays: &LightRays, camera: &Camera, [width, height]: [u32; 2]) -> Self {
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

    fn batch(&self, kind: RayKind) -> &Batch {
        &self.batches[kind as usize]
    }

    fn packets(&self, tracer: &PacketTracer, kind: RayKind) -> usize {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_tracers_are_measured_on_the_terrain_and_hit_about_as_much() {
        let scene = Arc::new(argus_scene::open("terrain:20000").unwrap());
        let cameras: Vec<Camera> = scene.cameras.iter().take(2).map(|named| named.camera).collect();
        let work = RayWork { cameras, size: [64, 48], rounds: 2 };
        let (costs, build_ms, bytes) = ray_costs(&scene, &work).unwrap();
        assert!(build_ms > 0.0 && bytes > 20_000 * 36);
        for kind in RayKind::ALL {
            let of = |tracer| costs.iter().find(|c| c.kind == kind && c.tracer == tracer);
            let wide = of(RayTracer::Wide).unwrap();
            assert!(wide.rays > 1000 && wide.secs.len() == 2 && wide.hit_fraction > 0.0, "{wide:?}");
            for other in [RayTracer::Packets, RayTracer::Single].into_iter().filter_map(of) {
                assert_eq!(other.rays, wide.rays);
                // The others pass through backs of single-sided triangles.
                assert!(other.hit_fraction <= wide.hit_fraction + 0.01, "{other:?} {wide:?}");
                assert!(other.hit_fraction >= wide.hit_fraction - 0.2, "{other:?} {wide:?}");
            }
        }
    }
}
