//! Light sources of paths: the scene's lights and emissive triangles.

use argus_scene::light_sampling::{cosine_direction, disc_point};
use argus_scene::shading::falloff;
use argus_scene::{Bounds, Light, Lighting, Material};
use glam::{DVec2, DVec3, Vec3};

use super::sequence::Path;
use argus_sampler::plug::{Placement, Surfaces};

/// Light that leaves a source.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Emission {
    pub(crate) origin: DVec3,
    /// Unit.
    pub(crate) direction: DVec3,
    /// Watts, for a single path.
    pub(crate) flux: Vec3,
    /// Normal of an emissive surface, which is a VPL itself; `None` for a light.
    pub(crate) surface: Option<DVec3>,
    /// Radius and range of the point or spot light that it leaves.
    lamp: Option<(f64, Option<f64>)>,
}

impl Emission {
    /// Share of the flux at a distance: the factors of [`argus_scene::shading::incident`] beside 1/d².
    pub(crate) fn left_at(&self, distance: f64) -> f32 {
        let Some((radius, range)) = self.lamp else { return 1.0 };
        (f64::from(falloff(distance, radius, range)) * distance * distance) as f32
    }
}

/// A source and its cumulative probability.
struct Emitter {
    source: Source,
    /// Cumulative probability, this source included.
    up_to: f64,
    probability: f64,
}

enum Source {
    Light(Light),
    Triangle(Emissive),
}

struct Emissive {
    placement: Placement,
    primitive: u32,
    a: DVec3,
    edges: [DVec3; 2],
    normal: DVec3,
    area: f64,
    both_sides: bool,
}

/// All sources, sampled by power.
pub(crate) struct Emitters {
    all: Vec<Emitter>,
    bounds: Bounds,
}

impl Emitters {
    /// The sources of a scene with these bounds.
    pub(crate) fn new(lighting: &Lighting, surfaces: &Surfaces, bounds: Bounds) -> Self {
        let lights = lighting.lights.iter().map(|&light| (Source::Light(light), power(&light, bounds)));
        let triangles = emissive(surfaces).map(|(triangle, power)| (Source::Triangle(triangle), power));
        let usable = |(_, power): &(Source, f64)| *power > 0.0 && power.is_finite();
        let sources: Vec<(Source, f64)> = lights.chain(triangles).filter(usable).collect();
        let whole: f64 = sources.iter().map(|(_, power)| power).sum();
        let mut up_to = 0.0;
        let emitter = |(source, power)| {
            let probability = power / whole;
            up_to += probability;
            Emitter { source, up_to, probability }
        };
        Self { all: sources.into_iter().map(emitter).collect(), bounds }
    }

    /// Number of sources.
    pub(crate) fn len(&self) -> usize {
        self.all.len()
    }

    /// Samples the light of one path. `None` if it carries no flux.
    pub(crate) fn sample(&self, surfaces: &Surfaces, path: &mut Path) -> Option<Emission> {
        let u = path.next();
        let index = self.all.partition_point(|e| e.up_to <= u).min(self.all.len().checked_sub(1)?);
        let emitter = &self.all[index];
        let numbers = [path.next(), path.next(), path.next(), path.next()];
        let mut emission = match &emitter.source {
            Source::Light(light) => from_light(light, self.bounds, numbers)?,
            Source::Triangle(triangle) => triangle.emission(surfaces, numbers, path.next())?,
        };
        emission.flux /= emitter.probability as f32;
        emission.flux.is_finite().then_some(emission)
    }
}

/// Mean of the channels, by which sources are sampled.
fn brightness(color: Vec3) -> f64 {
    f64::from(color.element_sum()) / 3.0
}

/// Approximate power of a light towards the scene's bounds.
fn power(light: &Light, bounds: Bounds) -> f64 {
    match *light {
        Light::Directional { direction, irradiance, .. } => {
            let (.., area) = window(direction, bounds);
            brightness(irradiance) * area
        }
        Light::Point { intensity, .. } => brightness(intensity) * 4.0 * std::f64::consts::PI,
        Light::Spot { intensity, outer_cone, .. } => brightness(intensity) * cap(outer_cone),
    }
}

/// Solid angle of a cone with this half angle.
fn cap(half_angle: f64) -> f64 {
    std::f64::consts::TAU * (1.0 - half_angle.cos())
}

/// The rectangle through which parallel light reaches all of a box: a corner, two edges, and its area.
fn window(direction: DVec3, bounds: Bounds) -> (DVec3, DVec3, DVec3, f64) {
    let (x, y) = direction.any_orthonormal_pair();
    let (center, half) = (bounds.center(), bounds.size() * 0.5);
    let reach = |axis: DVec3| axis.abs().dot(half);
    let (x, y, back) = (x * reach(x), y * reach(y), direction * (reach(direction) * 1.01));
    (center - back - x - y, x * 2.0, y * 2.0, 4.0 * x.length() * y.length())
}

fn from_light(light: &Light, bounds: Bounds, [u, v, s, t]: [f64; 4]) -> Option<Emission> {
    match *light {
        Light::Directional { direction, irradiance, .. } => {
            let (corner, x, y, area) = window(direction, bounds);
            let flux = irradiance * area as f32;
            let origin = corner + x * u + y * v;
            Some(Emission { origin, direction, flux, surface: None, lamp: None })
        }
        Light::Point { position, intensity, range, radius: bulb } => {
            let (z, turn) = (1.0 - 2.0 * s, std::f64::consts::TAU * t);
            let radius = (1.0 - z * z).max(0.0).sqrt();
            let direction = DVec3::new(radius * turn.cos(), radius * turn.sin(), z);
            let flux = intensity * (4.0 * std::f32::consts::PI);
            Some(Emission { origin: position, direction, flux, surface: None, lamp: Some((bulb, range)) })
        }
        Light::Spot { position, direction, intensity, range, inner_cone, outer_cone, radius: bulb } => {
            let (inner, outer) = (inner_cone.cos(), outer_cone.cos());
            let (z, turn) = (1.0 - s * (1.0 - outer), std::f64::consts::TAU * t);
            let radius = (1.0 - z * z).max(0.0).sqrt();
            let (x, y) = direction.any_orthonormal_pair();
            let along = x * (radius * turn.cos()) + y * (radius * turn.sin()) + direction * z;
            // The squared ramp between the cones of KHR_lights_punctual, as in shading.
            let ramp = ((z - outer) / (inner - outer).max(1e-4)).clamp(0.0, 1.0);
            let flux = intensity * (cap(outer_cone) * ramp * ramp) as f32;
            let lamp = Some((bulb, range));
            Some(Emission { origin: position, direction: along, flux, surface: None, lamp })
        }
    }
}

/// Emissive triangles, and their power by the mean of their texture.
fn emissive(surfaces: &Surfaces) -> impl Iterator<Item = (Emissive, f64)> + '_ {
    let scene = surfaces.scene();
    let emits = |m: &Material| m.emissive.max_element() > 0.0;
    let placements = surfaces
        .placements()
        .filter(move |p| emits(&scene.materials[scene.meshes[p.mesh as usize].material as usize]));
    placements.flat_map(move |placement| {
        let mesh = &scene.meshes[placement.mesh as usize];
        (0..mesh.triangles() as u32).filter_map(move |primitive| {
            let normal = surfaces.normal(placement, primitive)?;
            let at = |i: usize| {
                let p = mesh.positions[mesh.indices[3 * primitive as usize + i] as usize];
                placement.origin + placement.world_from_mesh * p.as_dvec3()
            };
            let (a, b, c) = (at(0), at(1), at(2));
            let edges = [b - a, c - a];
            let area = edges[0].cross(edges[1]).length() * 0.5;
            let both_sides = scene.materials[mesh.material as usize].double_sided;
            // A few points of the texture, because the sampling weights need not be exact.
            let places = [[0.33, 0.33], [0.15, 0.15], [0.7, 0.15], [0.15, 0.7]];
            let seen = places.iter().filter_map(|&w| surfaces.point(placement, primitive, w, normal));
            let mean = seen.map(|p| brightness(p.emissive)).sum::<f64>() / places.len() as f64;
            // A minimum, so that dark points of a bright texture are sampled too.
            let floor = brightness(scene.materials[mesh.material as usize].emissive) * 0.02;
            let sides = if both_sides { 2.0 } else { 1.0 };
            let power = mean.max(floor) * area * sides * std::f64::consts::PI;
            Some((Emissive { placement: *placement, primitive, a, edges, normal, area, both_sides }, power))
        })
    })
}

impl Emissive {
    fn emission(&self, surfaces: &Surfaces, [u, v, s, t]: [f64; 4], side: f64) -> Option<Emission> {
        // Uniform in a triangle (Turk, "Generating Random Points in Triangles", 1990).
        let root = u.sqrt();
        let (beta, gamma) = (root * (1.0 - v), root * v);
        let normal = if self.both_sides && side < 0.5 { -self.normal } else { self.normal };
        let point = surfaces.point(&self.placement, self.primitive, [beta, gamma], normal)?;
        let sides = if self.both_sides { 2.0 } else { 1.0 };
        let flux = point.emissive * (std::f64::consts::PI * self.area * sides) as f32;
        let origin = self.a + self.edges[0] * beta + self.edges[1] * gamma;
        let direction = cosine_direction(normal, disc_point(DVec2::new(s, t)));
        (flux.max_element() > 0.0).then_some(Emission {
            origin,
            direction,
            flux,
            surface: Some(normal),
            lamp: None,
        })
    }
}
