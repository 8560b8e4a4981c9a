//! Reflection and refraction of the scene in glossy and transparent objects, by rays. Reflection probes
//! ([`crate::reflection`]) approximate it.
//!
//! A surface reflects the mean radiance over its lobe (GGX about its normal, Karis 2013), weighted by the environment
//! BRDF of the sky's reflection. It transmits the radiance of the refracted direction, as if the object had no far
//! side: light is refracted once. Reflecting surfaces seen in it reflect and refract in turn, with an eighth of the rays, up to
//! a number of bounces; all else shows its colour that does not depend on the viewer.

use glam::{DVec3, Vec3};

use super::Hit;
use super::tracer::{Reflecting, Tracer};
use crate::reflection::{half_vector, refracted};
use crate::shading::{Surface, dielectric_f0, reflected_around, sky_radiance};

/// Distance of a ray's start from its surface, as a share of the distance from the eye.
const OFF_SURFACE: f64 = 1e-7;
/// Most surfaces of the same object that a refracted ray passes through.
const MOST_PASSED: u32 = 64;

impl Tracer {
    /// The same scene, with instances that reflect and refract it.
    pub fn reflecting(mut self, reflecting: Reflecting) -> Self {
        self.reflecting = Some(reflecting);
        self
    }

    /// A visible surface without its transmitted light, and the transmitted share: zero for an instance
    /// outside [`Reflecting::instances`].
    pub(super) fn without_transmitted(&self, hit: &Hit, surface: &Surface) -> (Surface, Vec3) {
        if surface.f0 == Vec3::ZERO || self.reflects(hit).is_none() {
            return (*surface, Vec3::ZERO);
        }
        let transmitted = surface.albedo * surface.transmission;
        (Surface { albedo: surface.albedo - transmitted, ..*surface }, transmitted)
    }

    /// Radiance of the scene that an object reflects or transmits against a ray's unit direction; `None` if it reflects only
    /// the sky.
    pub(super) fn sent_of_around(
        &self,
        hit: &Hit,
        surface: &Surface,
        transmitted: Vec3,
        direction: DVec3,
    ) -> Option<Vec3> {
        let &Reflecting { rays, bounces, .. } = self.reflects(hit)?;
        Some(self.sent(hit, surface, transmitted, direction, (rays, bounces)))
    }

    fn sent(
        &self,
        hit: &Hit,
        surface: &Surface,
        transmitted: Vec3,
        direction: DVec3,
        (rays, bounces): (u32, u32),
    ) -> Vec3 {
        let normal = surface.normal.as_dvec3();
        let off = normal * (OFF_SURFACE * hit.range);
        let alpha = f64::from(surface.roughness).powi(2);
        let rays = if alpha > 0.0 { rays.max(1) } else { 1 };
        let next = (rays.div_ceil(8), bounces.saturating_sub(1));
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for ray in 0..rays {
            let half = half_vector(normal, alpha, ray, rays);
            let reflected = direction - 2.0 * direction.dot(half) * half;
            let weight = reflected.dot(normal);
            if weight > 0.0 {
                sum += self.met(hit.position + off, reflected, None, next) * weight as f32;
                weights += weight as f32;
            }
        }
        let to_eye = -direction.as_vec3();
        let mut sent = reflected_around(surface, to_eye, sum / weights.max(1e-6));
        if transmitted != Vec3::ZERO {
            let ior = f64::from(self.material_of(hit).ior);
            // From the reflectance, as in the maps.
            let root = f64::from(dielectric_f0(ior as f32)).clamp(0.0, 0.5).sqrt();
            let inward = refracted(direction, normal, (1.0 - root) / (1.0 + root));
            let through = self.met(hit.position - off, inward, Some(hit.instance), next);
            sent += transmitted * through * (Vec3::ONE - reflected_around(surface, to_eye, Vec3::ONE));
        }
        sent
    }

    fn reflects(&self, hit: &Hit) -> Option<&Reflecting> {
        let found = |r: &&Reflecting| r.instances.binary_search(&hit.instance).is_ok();
        self.reflecting.as_ref().filter(found)
    }

    /// Radiance from a unit direction, past the surfaces of one instance, with rays per lobe and so many more reflections.
    fn met(&self, from: DVec3, direction: DVec3, past: Option<u32>, (rays, bounces): (u32, u32)) -> Vec3 {
        let lighting = &self.pose.lighting;
        let mut origin = from;
        for _ in 0..MOST_PASSED {
            let Some(hit) = self.trace_one(origin, direction) else { break };
            if past == Some(hit.instance) {
                origin = hit.position + direction * (OFF_SURFACE * hit.range.max(1e-6));
                continue;
            }
            let surface = self.surface(&hit, direction, DVec3::ZERO, DVec3::ZERO);
            if bounces == 0 || surface.f0 == Vec3::ZERO || self.reflects(&hit).is_none() {
                return self.diffuse(&hit, &surface, direction);
            }
            let (surface, transmitted) = self.without_transmitted(&hit, &surface);
            let sent = self.sent(&hit, &surface, transmitted, direction, (rays, bounces));
            return self.diffuse(&hit, &surface, direction) + sent;
        }
        sky_radiance(&lighting.sky, direction.as_vec3())
    }
}
