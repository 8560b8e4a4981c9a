//! Points on lights: where a shadow ray goes. The reference and the samplers share this definition.
//!
//! The share of a light that a point sees is the share of a disc: the sun's in the sky, or the great circle of a shining
//! sphere that faces the point. A point of the unit disc chooses the place on it, uniformly by area.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use crate::Light;

/// A shadow ray: a direction, and its length in units of that direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadowRay {
    /// Not necessarily a unit vector.
    pub direction: DVec3,
    /// Infinite for a light in the sky.
    pub most: f64,
}

/// Largest share of its distance that a sphere's radius has: a point inside of a light still sees it in front of itself.
const LARGEST: f64 = 0.99;

/// The ray from a position to a point of a light, by a point of the unit disc; zero for the light's centre.
pub fn shadow_ray(light: &Light, from: DVec3, disc: DVec2) -> ShadowRay {
    let on_disc = |center: DVec3, radius: f64| {
        if radius == 0.0 || disc == DVec2::ZERO {
            return center;
        }
        let (x, y) = center.normalize_or(DVec3::Y).any_orthonormal_pair();
        center + (x * disc.x + y * disc.y) * radius
    };
    match *light {
        Light::Directional { direction, angular_radius, .. } => {
            ShadowRay { direction: on_disc(-direction, angular_radius.tan()), most: f64::INFINITY }
        }
        Light::Point { position, radius, .. } | Light::Spot { position, radius, .. } => {
            let center = position - from;
            ShadowRay { direction: on_disc(center, radius.min(center.length() * LARGEST)), most: 1.0 }
        }
    }
}

/// A point of the unit disc by numbers in the unit square, uniform by area.
pub fn disc_point(square: DVec2) -> DVec2 {
    let (sin, cos) = (TAU * square.y).sin_cos();
    DVec2::new(cos, sin) * square.x.max(0.0).sqrt()
}

/// A direction about a unit normal, with a probability proportional to its cosine (Malley's method): the point of the
/// hemisphere above a point of the unit disc.
pub fn cosine_direction(normal: DVec3, disc: DVec2) -> DVec3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let up = (1.0 - disc.length_squared()).max(0.0).sqrt();
    tangent * disc.x + bitangent * disc.y + normal * up
}

/// A point of the R2 sequence (Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
pub fn r2(index: u32) -> DVec2 {
    (DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_3) * f64::from(index)).fract()
}

/// Height above a triangle at which rays to lights begin, so that a smooth surface of flat triangles has no hard edge where
/// its light ends (Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021, chapter 4). `corners` and unit
/// `normals` are those of the triangle, normals on the lit side, `weights` barycentric, `side` the triangle's unit normal
/// on that side.
pub fn terminator_lift(corners: [DVec3; 3], normals: [DVec3; 3], weights: [f64; 3], side: DVec3) -> f64 {
    let at = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
    let mut lift = 0.0;
    for i in 0..3 {
        let above = normals[i].dot(corners[i] - at).max(0.0);
        lift += weights[i] * above * normals[i].dot(side).max(0.0);
    }
    if lift.is_finite() { lift } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn shadow_rays_end_on_the_light_and_within_its_disc() {
        let position = DVec3::new(1e6, 5.0, 0.0);
        let light = Light::Point { position, intensity: Vec3::ONE, range: None, radius: 0.5 };
        for i in 0..64 {
            let from = position + DVec3::new(3.0, -1.0, 2.0);
            let ray = shadow_ray(&light, from, disc_point(r2(i)));
            assert!((from + ray.direction * ray.most - position).length() <= 0.5 + 1e-9);
            assert_eq!(shadow_ray(&light, from, DVec2::ZERO).direction, position - from);
            // Inside of the light, a point looks at what is in front of it.
            let inside = shadow_ray(&light, position + DVec3::X * 0.1, disc_point(r2(i)));
            assert!(inside.direction.is_finite() && inside.direction.length() > 0.0);
            let at = shadow_ray(&light, position, disc_point(r2(i)));
            assert_eq!(at.direction, DVec3::ZERO);
        }
        let sun = Light::sun();
        let Light::Directional { direction, angular_radius, .. } = sun else { unreachable!() };
        for i in 0..64 {
            let ray = shadow_ray(&sun, DVec3::ZERO, disc_point(r2(i)));
            assert!(ray.direction.normalize().angle_between(-direction) <= angular_radius * 1.001);
        }
    }

    #[test]
    fn a_flat_triangle_is_not_lifted_and_a_bent_one_is_by_its_sagitta() {
        let corners = [DVec3::NEG_X, DVec3::X, DVec3::Y];
        let weights = [0.5, 0.5, 0.0];
        assert_eq!(terminator_lift(corners, [DVec3::Z; 3], weights, DVec3::Z), 0.0);
        let bent = [DVec3::new(-0.5, 0.0, 0.75f64.sqrt()), DVec3::new(0.5, 0.0, 0.75f64.sqrt()), DVec3::Z];
        let lift = terminator_lift(corners, bent, weights, DVec3::Z);
        assert!((lift - 0.5 * 0.75f64.sqrt()).abs() < 1e-12, "{lift}");
        assert_eq!(terminator_lift([DVec3::ZERO; 3], [DVec3::NAN; 3], weights, DVec3::Z), 0.0);
    }
}
