//! Directions that surfaces reflect and refract light in.

use std::f64::consts::TAU;

use glam::DVec3;

/// The refracted direction of a unit direction in a medium, `eta` times as fast there as before; along the surface at
/// total reflection.
pub fn refracted(direction: DVec3, normal: DVec3, eta: f64) -> DVec3 {
    let cosine = -direction.dot(normal);
    let squared = 1.0 - eta * eta * (1.0 - cosine * cosine);
    direction * eta + normal * (eta * cosine - squared.max(0.0).sqrt())
}

/// Half vector `index` of `count` about a unit normal, which fill the lobe of α (GGX; Karis 2013) evenly. One alone is the
/// normal.
pub fn half_vector(normal: DVec3, alpha: f64, index: u32, count: u32) -> DVec3 {
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
    fn light_bends_towards_the_normal_and_stays_straight_without_a_change_of_medium() {
        let (direction, normal) = (DVec3::new(0.6, -0.8, 0.0), DVec3::Y);
        assert!((refracted(direction, normal, 1.0) - direction).length() < 1e-12);
        let bent = refracted(direction, normal, 1.0 / 1.5);
        assert!((bent.length() - 1.0).abs() < 1e-12 && (bent.x - 0.4).abs() < 1e-12, "Snell: {bent}");
        assert!(refracted(DVec3::X, normal, 1.0 / 1.5).is_finite(), "grazing");
    }

    #[test]
    fn half_vectors_are_unit_and_close_to_the_normal_on_a_smooth_surface() {
        for index in 0..64 {
            let wide = half_vector(DVec3::Z, 0.8, index, 64);
            assert!((wide.length() - 1.0).abs() < 1e-12);
            assert!(half_vector(DVec3::Z, 1e-4, index, 64).z > 0.999);
        }
    }
}
