//! What glossy and transparent things show of the scene around them, by rays: what maps of surroundings
//! ([`crate::reflection`]) stand for.
//!
//! A surface reflects the mean of what arrives over its lobe (GGX about its normal, Karis 2013), by the environment BRDF
//! that the sky's reflection has, and lets through what arrives from the refracted direction, as if the thing ended where
//! it begins: refracted once. What is met shows what does not depend on the viewer.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use super::{Hit, Tracer};
use crate::shading::{Surface, dielectric_f0, diffuse_radiance, reflected_around, sky_radiance};

/// Which things show what is around them, and how hard it is looked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reflecting {
    /// Rays over a lobe.
    pub rays: u32,
    /// Instances that do, ascending; others reflect the sky.
    pub instances: Vec<u32>,
}

/// A ray leaves its surface by this share of the distance from the eye.
const OFF_SURFACE: f64 = 1e-7;
/// Surfaces of the same thing that a refracted ray passes at most.
const MOST_PASSED: u32 = 64;

impl Tracer {
    /// The same scene, with things that show what is around them.
    pub fn reflecting(mut self, reflecting: Reflecting) -> Self {
        self.reflecting = Some(reflecting);
        self
    }

    /// A visible surface without what passes through it, and that share; nothing passes where nobody looks behind.
    pub(super) fn without_transmitted(&self, hit: &Hit, surface: &Surface) -> (Surface, Vec3) {
        let transmission = self.material_of(hit).transmission;
        if surface.f0 == Vec3::ZERO || self.reflects(hit).is_none() {
            return (*surface, Vec3::ZERO);
        }
        let transmitted = surface.albedo * transmission;
        (Surface { albedo: surface.albedo - transmitted, ..*surface }, transmitted)
    }

    /// What a thing sends of its surroundings along the reverse of a ray's unit direction; `None` for what reflects the sky
    /// alone.
    pub(super) fn sent_of_around(
        &self,
        hit: &Hit,
        surface: &Surface,
        transmitted: Vec3,
        direction: DVec3,
    ) -> Option<Vec3> {
        let reflecting = self.reflects(hit)?;
        let normal = surface.normal.as_dvec3();
        let off = normal * (OFF_SURFACE * hit.range);
        let alpha = f64::from(surface.roughness).powi(2);
        let rays = if alpha > 0.0 { reflecting.rays.max(1) } else { 1 };
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for ray in 0..rays {
            let half = half_vector(normal, alpha, ray, rays);
            let reflected = direction - 2.0 * direction.dot(half) * half;
            let weight = reflected.dot(normal);
            if weight > 0.0 {
                sum += self.met(hit.position + off, reflected, None) * weight as f32;
                weights += weight as f32;
            }
        }
        let to_eye = -direction.as_vec3();
        let mut sent = reflected_around(surface, to_eye, sum / weights.max(1e-6));
        if transmitted != Vec3::ZERO {
            let ior = f64::from(self.material_of(hit).ior);
            // As maps know it, from reflectance.
            let root = f64::from(dielectric_f0(ior as f32)).clamp(0.0, 0.5).sqrt();
            let inward = refracted(direction, normal, (1.0 - root) / (1.0 + root));
            let through = self.met(hit.position - off, inward, Some(hit.instance));
            sent += transmitted * through * (Vec3::ONE - reflected_around(surface, to_eye, Vec3::ONE));
        }
        Some(sent)
    }

    fn reflects(&self, hit: &Hit) -> Option<&Reflecting> {
        let found = |r: &&Reflecting| r.instances.binary_search(&hit.instance).is_ok();
        self.reflecting.as_ref().filter(found)
    }

    /// Radiance that arrives from a unit direction, past what belongs to one instance.
    fn met(&self, from: DVec3, direction: DVec3, past: Option<u32>) -> Vec3 {
        let lighting = &self.pose.lighting;
        let mut origin = from;
        for _ in 0..MOST_PASSED {
            let Some(hit) = self.trace(origin, direction) else { break };
            if past == Some(hit.instance) {
                origin = hit.position + direction * (OFF_SURFACE * hit.range.max(1e-6));
                continue;
            }
            let surface = self.surface(&hit, direction, DVec3::ZERO, DVec3::ZERO);
            return diffuse_radiance(&surface, lighting);
        }
        sky_radiance(&lighting.sky, direction.as_vec3())
    }
}

/// The direction in which a unit direction goes on in a medium, `eta` times as fast there as before; along the surface
/// where it would not get in.
fn refracted(direction: DVec3, normal: DVec3, eta: f64) -> DVec3 {
    let cosine = -direction.dot(normal);
    let squared = 1.0 - eta * eta * (1.0 - cosine * cosine);
    direction * eta + normal * (eta * cosine - squared.max(0.0).sqrt())
}

/// One of `count` half vectors about a normal that fill the lobe of that α evenly.
fn half_vector(normal: DVec3, alpha: f64, index: u32, count: u32) -> DVec3 {
    if count == 1 {
        return normal;
    }
    let x = (f64::from(index) + 0.5) / f64::from(count);
    let y = f64::from(index.reverse_bits()) / 2f64.powi(32);
    let cosine = ((1.0 - x) / (1.0 + (alpha * alpha - 1.0) * x)).sqrt();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let tangent = normal.any_orthonormal_vector();
    let bitangent = normal.cross(tangent);
    tangent * (sine * (TAU * y).cos()) + bitangent * (sine * (TAU * y).sin()) + normal * cosine
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_bends_towards_the_normal_and_goes_straight_where_nothing_changes() {
        let (direction, normal) = (DVec3::new(0.6, -0.8, 0.0), DVec3::Y);
        assert!((refracted(direction, normal, 1.0) - direction).length() < 1e-12);
        let bent = refracted(direction, normal, 1.0 / 1.5);
        assert!((bent.length() - 1.0).abs() < 1e-12 && (bent.x - 0.4).abs() < 1e-12, "Snell: {bent}");
        assert!(refracted(DVec3::X, normal, 1.0 / 1.5).is_finite(), "grazing");
    }

    #[test]
    fn half_vectors_are_unit_and_narrow_where_a_surface_is_smooth() {
        for index in 0..64 {
            let wide = half_vector(DVec3::Z, 0.8, index, 64);
            assert!((wide.length() - 1.0).abs() < 1e-12);
            assert!(half_vector(DVec3::Z, 1e-4, index, 64).z > 0.999);
        }
    }
}
