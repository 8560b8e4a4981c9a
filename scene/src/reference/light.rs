//! Direct light with what blocks it: the definition that samplers approximate.
//!
//! Irradiance of a surface is the sum of
//! - each directional, point and spot light, as [`incident`] says, times the share of its disc that the surface sees
//!   ([`crate::light_sampling`]);
//! - the sky's radiance over all directions that no surface within its reach blocks, weighted by their cosine;
//! - the radiance of each emitting triangle that no surface blocks ([`crate::emitters`]).
//!
//! Rays begin a little above the surface ([`terminator_lift`]). Every triangle blocks both ways, but those of
//! glass ([`crate::Material::passes_light`]); cut-outs let light through where they let rays of sight through,
//! and transparent surfaces let a part of it through ([`crate::transparency`]).

use glam::{DVec2, DVec3, Vec3};

use super::Hit;
use super::corners::Corners;
use super::tracer::{DirectLight, Lit, Tracer};
use crate::Pose;
use crate::light_sampling::{cosine_direction, disc_point, r2, shadow_ray, terminator_lift};
use crate::shading::{Surface, diffuse_radiance, incident, reflected_light, sky_ambient, sky_radiance};

/// Light that reaches a surface.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Arriving {
    /// Irradiance / π.
    pub(super) by_pi: Vec3,
    /// Share of each light that is seen.
    pub(super) lights: Vec<f32>,
    /// Unblocked share of the sky's light.
    pub(super) sky: f32,
}

impl Tracer {
    /// The same scene under direct light with some effects.
    pub fn with_direct_light(mut self, light: DirectLight) -> Self {
        self.lit = light.effects.any().then(|| Lit::new(light, &self));
        self
    }

    /// Takes over how another tracer is lit, for this tracer's pose.
    pub(super) fn lit_as(self, other: &Self) -> Self {
        match &other.lit {
            Some(lit) => {
                let light = lit.light.clone();
                self.with_direct_light(light)
            }
            None => self,
        }
    }

    /// How direct light is traced; `None` without effects of light.
    pub(super) fn direct_light(&self) -> Option<&DirectLight> {
        self.lit.as_ref().map(|lit| &lit.light)
    }

    /// Whether emitting triangles light other surfaces directly.
    pub(super) fn lights_by_emitters(&self) -> bool {
        self.lit.as_ref().is_some_and(|lit| lit.light.effects.emitters)
    }

    /// Whether surfaces block the sky.
    pub(super) fn blocks_sky(&self) -> bool {
        self.lit.as_ref().is_some_and(|lit| lit.light.effects.sky_visibility)
    }

    /// Radiance of a surface that does not depend on the viewer, seen along the unit `direction`.
    pub(super) fn diffuse(&self, hit: &Hit, surface: &Surface, direction: DVec3) -> Vec3 {
        match self.arriving(hit, surface, direction) {
            Some(arriving) => surface.emissive + surface.albedo * arriving.by_pi,
            None => diffuse_radiance(surface, &self.pose.lighting),
        }
    }

    /// Reflection of lights by a surface towards the unit `to_eye`, each as far as it is seen.
    pub(super) fn reflected_lights_seen(&self, surface: &Surface, to_eye: Vec3, arriving: &Arriving) -> Vec3 {
        let lights = self.pose.lighting.lights.iter().zip(&arriving.lights);
        lights.map(|(light, seen)| reflected_light(surface, to_eye, light) * *seen).sum()
    }

    /// Direct light at a hit of a ray along the unit `direction`; `None` if this tracer has no effects of light.
    pub(super) fn arriving(&self, hit: &Hit, surface: &Surface, direction: DVec3) -> Option<Arriving> {
        let lit = self.lit.as_ref()?;
        let Pose { lighting, .. } = &self.pose;
        let mut arriving = Arriving { by_pi: Vec3::ZERO, lights: vec![1.0; lighting.lights.len()], sky: 1.0 };
        let start = self.start(hit, surface, direction);
        let effects = lit.light.effects;
        let shift = shift_of(surface.position);
        for (light, share) in lighting.lights.iter().zip(&mut arriving.lights) {
            let (to_light, irradiance) = incident(light, surface.position);
            let cosine = surface.normal.dot(to_light);
            if !(cosine > 0.0 && irradiance.max_element() > 0.0) {
                continue;
            }
            if effects.shadows {
                let rays = if effects.soft_shadows { lit.light.rays.max(1) } else { 1 };
                let seen = (0..rays).map(|ray| {
                    let disc = disc_point((r2(ray) + shift).fract());
                    let disc = if effects.soft_shadows { disc } else { DVec2::ZERO };
                    let ray = shadow_ray(light, start.position, disc);
                    start.sees(self, ray.direction, ray.most)
                });
                *share = seen.sum::<f32>() / rays as f32;
            }
            arriving.by_pi += irradiance * (cosine * *share * std::f32::consts::FRAC_1_PI);
        }
        let open = sky_ambient(&lighting.sky, surface.normal);
        if effects.sky_visibility && open != Vec3::ZERO {
            let seen = self.sky_by_pi(&start, surface, lit.light.rays.max(1) * 10, shift);
            arriving.sky = (seen.element_sum() / open.element_sum().max(1e-12)).clamp(0.0, 1.0);
            arriving.by_pi += seen;
        } else {
            arriving.by_pi += open;
        }
        if effects.emitters {
            arriving.by_pi += self.emitters_by_pi(lit, &start, surface, shift);
        }
        Some(arriving)
    }

    /// Irradiance / π of the sky, past what blocks it.
    fn sky_by_pi(&self, start: &LightStart, surface: &Surface, rays: u32, shift: DVec2) -> Vec3 {
        let sky = &self.pose.lighting.sky;
        let reach = sky.reach.unwrap_or(f64::INFINITY);
        let mut sum = DVec3::ZERO;
        for ray in 0..rays {
            let direction =
                cosine_direction(surface.normal.as_dvec3(), disc_point((r2(ray) + shift).fract()));
            let seen = start.sees(self, direction, reach);
            sum += (sky_radiance(sky, direction.as_vec3()) * seen).as_dvec3();
        }
        (sum / f64::from(rays)).as_vec3()
    }

    /// Irradiance / π of emitting triangles, past what blocks them: points on triangles by power, uniform by area.
    fn emitters_by_pi(&self, lit: &Lit, start: &LightStart, surface: &Surface, shift: DVec2) -> Vec3 {
        let rays = lit.light.rays.max(1) * 10;
        let normal = surface.normal.as_dvec3();
        let mut sum = DVec3::ZERO;
        for ray in 0..rays {
            let place = (f64::from(ray) + shift.x) / f64::from(rays);
            let Some(index) = lit.emitters.pick(place) else { return Vec3::ZERO };
            let emitter = &lit.emitters.all()[index];
            let square = (r2(ray) + DVec2::new(shift.y, shift.x)).fract();
            let to_light = emitter.point(square.x, square.y) - start.position;
            let (squared, area) = (to_light.length_squared(), emitter.area_vector());
            let cosine = normal.dot(to_light);
            let facing = -area.dot(to_light);
            let facing = if emitter.both_sides { facing.abs() } else { facing };
            // Twice the area is in `facing`.
            let weight = cosine * facing * 0.5 / (squared * squared) / lit.emitters.probability(emitter);
            if cosine > 0.0 && facing > 0.0 && weight.is_finite() {
                let seen = start.sees(self, to_light, 1.0 - NEAR_END);
                sum += emitter.radiance.as_dvec3() * weight * f64::from(seen);
            }
        }
        (sum / f64::from(rays) * std::f64::consts::FRAC_1_PI).as_vec3()
    }

    fn start(&self, hit: &Hit, surface: &Surface, direction: DVec3) -> LightStart {
        let instance = &self.pose.instances[hit.instance as usize];
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let corners = Corners::new(mesh, hit.triangle, hit.barycentric);
        let m = instance.world_from_mesh.matrix3;
        let positions = corners.each(&mesh.positions).unwrap_or_default().map(|p| m * p.as_dvec3());
        let edges = [positions[1] - positions[0], positions[2] - positions[0]];
        let side = edges[0].normalize_or_zero().cross(edges[1].normalize_or_zero()).normalize_or_zero();
        let side = if side.dot(direction) > 0.0 { -side } else { side };
        let weights = [1.0 - hit.barycentric.x - hit.barycentric.y, hit.barycentric.x, hit.barycentric.y];
        let inverse_transpose = m.inverse().transpose();
        let normals = corners.each(&mesh.normals).map(|normals| {
            normals.map(|n| {
                let normal = (inverse_transpose * n.as_dvec3()).normalize_or_zero();
                if normal.dot(side) < 0.0 { -normal } else { normal }
            })
        });
        let lift = normals.map_or(0.0, |normals| terminator_lift(positions, normals, weights, side));
        let off = OFF_SURFACE * surface.position.abs().max_element().max(hit.range);
        LightStart { position: surface.position + side * off.max(lift), side, is_lifted: lift > off }
    }
}

/// Distance of a ray's start from its surface, as a share of coordinates.
const OFF_SURFACE: f64 = 1e-10;
/// Share of the way to an emitter that is not looked at, so that it does not block itself.
const NEAR_END: f64 = 1e-6;

/// Where rays to lights begin.
struct LightStart {
    position: DVec3,
    /// Unit normal of the triangle on the lit side; zero for a degenerate triangle.
    side: DVec3,
    /// Whether the start is above the triangle, so that a ray may go below its plane.
    is_lifted: bool,
}

impl LightStart {
    /// The share of a ray that nothing blocks before its end.
    fn sees(&self, tracer: &Tracer, direction: DVec3, most: f64) -> f32 {
        if !self.is_lifted && direction.dot(self.side) <= 0.0 {
            return 0.0;
        }
        tracer.passed(self.position, direction, most * direction.length())
    }
}

/// A shift of the sequences, by a position's bits: the same at every rendering.
fn shift_of(position: DVec3) -> DVec2 {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    for x in position.to_array() {
        state = (state ^ x.to_bits()).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        state ^= state >> 29;
    }
    let unit = |bits: u64| (bits >> 40) as f64 / (1u64 << 24) as f64;
    DVec2::new(unit(state), unit(state.wrapping_mul(0x94d0_49bb_1331_11eb)))
}
