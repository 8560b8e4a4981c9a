//! Omnidirectional soft shadows from the same points (section 5).
//!
//! A light is a set of points, and each has a map around it, filled as a reflector's map is. A place is lit by a point of the
//! light if the map sees nothing nearer in its direction. Density follows the pixels of the eye at the places that a
//! triangle may shadow.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use super::Eye;
use argus_sampler::plug::{IndexMaps, MappedReflector};

/// Largest side of a light point's map, as in the paper (section 5.2).
pub const LARGEST_SHADOW_SIDE: u32 = 1024;
/// Sides are multiples of this.
const SIDE_STEP: u32 = 32;
/// A place farther than what a map sees by this share is in shadow.
const BIAS: f64 = 2e-3;
/// A place is looked up this many texels above its surface.
const ABOVE: f64 = 1.0;

/// Points of a spherical light: its middle alone, or evenly on its surface (a spiral with steps of the golden angle).
pub fn light_points(middle: DVec3, radius: f64, count: u32) -> Vec<DVec3> {
    if count <= 1 {
        return vec![middle];
    }
    let turn = PI * (3.0 - 5f64.sqrt());
    let point = |k: u32| {
        let y = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(count);
        let (sin, cos) = (turn * f64::from(k)).sin_cos();
        let ring = (1.0 - y * y).sqrt();
        middle + DVec3::new(ring * cos, y, ring * sin) * radius
    };
    (0..count).map(point).collect()
}

/// The map around a point of a light: a reflector that is no instance and has no extent.
pub fn light_map(point: DVec3, side: u32) -> MappedReflector {
    MappedReflector { instance: u32::MAX, center: point, radius: 0.0, curvature: 0.0, side, front: None }
}

/// Texels on an edge of the map of a light's point: so many that no texel is wider than a pixel on any of the places that
/// the eye sees, rounded up to a multiple of 32 and at most `largest` (equation 6). Places in metres, world space.
pub fn shadow_side(eye: &Eye, point: DVec3, places: &[DVec3], largest: u32) -> u32 {
    let ratio = |place: &DVec3| (*place - point).length() / (*place - eye.position).length().max(eye.near);
    let widest = places.iter().map(ratio).fold(0.0, f64::max);
    let most = (largest / SIDE_STEP).max(1);
    let steps = (2.0 * eye.pixels * widest / f64::from(SIDE_STEP)).ceil().clamp(1.0, f64::from(most));
    steps as u32 * SIDE_STEP
}

/// Cells for each metre that a triangle needs, so that the edge of its shadow is as fine as the eye's pixels.
///
/// A pixel covers d_e/f at a place in the shadow, and that times d_lt/d_l on the triangle, where d_e, d_l and d_lt are the
/// distances of eye and place, light and place, light and triangle, and f is the eye's pixels at unit distance. Since d_l is
/// at most d_e plus the distance of light and eye, the density f·d_l/(d_e·d_lt) is bounded by the least d_e in the shadow's
/// volume. `distance` is d_lt, metres. The paper has the eye's distance from the volume in place of d_l/d_e (equation 5).
pub(super) fn shadow_density(eye: &Eye, point: DVec3, corners: [DVec3; 3], distance: f64) -> f64 {
    let to_eye = eye.position - point;
    let between = to_eye.length();
    let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
    let radius = corners.iter().map(|corner| (*corner - middle).length()).fold(0.0, f64::max);
    let axis = middle - point;
    // The volume lies within the cone about the triangle's bounding sphere, and beyond the triangle's distance.
    let half = (radius / axis.length()).min(1.0).asin();
    let angle = if between > 0.0 { axis.angle_between(to_eye) } else { 0.0 };
    let beside = if angle > half { between * (angle - half).min(FRAC_PI_2).sin() } else { 0.0 };
    let from_volume = beside.max(distance - between).max(eye.near);
    eye.pixels / distance * (1.0 + between / from_volume)
}

/// Whether a place is lit by the point of a map; `normal` is a unit vector on the side that is seen.
pub fn is_lit(maps: &IndexMaps, map: usize, point: DVec3, place: DVec3, normal: DVec3) -> bool {
    let towards = place - point;
    if towards.dot(normal) >= 0.0 {
        return false;
    }
    let texel_width = 2.0 * towards.length() / f64::from(maps.side(map));
    let towards = towards + normal * (ABOVE * texel_width);
    let distance = towards.length();
    let direction = towards / distance;
    let texel = maps.texel_of(map, direction);
    let Some((_, range)) = maps.get(texel) else { return true };
    // What the texel sees goes on as a plane: a floor does not shadow itself within a texel.
    let on_plane = maps.plane(map, texel).map_or(range, |plane| plane.dot(direction).recip());
    let range = if on_plane > 0.0 && on_plane < 2.0 * range { range.max(on_plane) } else { range };
    distance <= range * (1.0 + BIAS)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use argus_scene::procedural::rooms;

    use super::*;
    use crate::tests::{by_brute_force, eye_of};
    use crate::{Density, DensityRule, EyePointSettings, PointScene};

    #[test]
    fn points_of_a_light_lie_evenly_on_its_sphere() {
        assert_eq!(light_points(DVec3::X, 2.0, 1), [DVec3::X]);
        for count in [5, 20] {
            let found = light_points(DVec3::X, 2.0, count);
            assert!(found.iter().all(|point| ((*point - DVec3::X).length() - 2.0).abs() < 1e-12));
            let mean = found.iter().sum::<DVec3>() / f64::from(count) - DVec3::X;
            assert!(mean.length() < 0.3, "{mean}");
        }
    }

    #[test]
    fn density_is_enough_for_every_place_in_a_triangles_shadow() {
        let mut seed = 3u32;
        let mut unit = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24)
        };
        for _ in 0..2000 {
            let mut place = || DVec3::new(unit(), unit(), unit()) * 10.0 - 5.0;
            let (point, corners) = (place(), [place(), place(), place()]);
            let eye =
                Eye { position: place(), half_size: DVec3::ZERO, pixels: 900.0, height: 1080, near: 1e-3 };
            let (distance, [u, v]) = (
                (argus_scene::closest_on_triangle(point, corners) - point).length(),
                [unit(), unit() * 0.99],
            );
            let density = shadow_density(&eye, point, corners, distance);
            let on = corners[0].lerp(corners[1], u).lerp(corners[2], v);
            let place = point + (on - point) * (1.0 + 20.0 * unit() * unit());
            let (d_e, d_l, d_lt) =
                ((place - eye.position).length(), (place - point).length(), (on - point).length());
            let needed = eye.pixels * d_l / (d_e * d_lt);
            assert!(density >= needed * (1.0 - 1e-9), "{density} {needed}");
            assert!(density.is_finite());
        }
    }

    #[test]
    fn a_maps_side_follows_the_farthest_ratio_within_limits() {
        let eye =
            Eye { position: DVec3::ZERO, half_size: DVec3::ZERO, pixels: 100.0, height: 1080, near: 1e-3 };
        let side = |places: &[DVec3]| shadow_side(&eye, DVec3::X * 4.0, places, 1024);
        assert_eq!(side(&[]), 32);
        assert_eq!(side(&[DVec3::X * 4.0]), 32, "at the light");
        // 2 · 100 · 4 / 4 is 200 texels.
        assert_eq!(side(&[DVec3::X * 4.0, DVec3::X * 8.0, DVec3::new(2.0, 3.0, 0.0)]), 224);
        assert_eq!(side(&[DVec3::ZERO]), 1024, "at the eye");
    }

    #[test]
    fn maps_shadow_what_rays_shadow_and_points_are_as_good_as_triangles() {
        let scene = Arc::new(rooms(20));
        let eye = eye_of(&scene, [320, 240]);
        let points = PointScene::new(&scene, 0.0);
        let lights: Vec<MappedReflector> = light_points(scene.bounds().center(), 0.1, 5)
            .into_iter()
            .map(|point| light_map(point, 256))
            .collect();
        let density = Density { rule: DensityRule::Shadow, ..Density::default() };
        let found =
            points.points(&eye, &lights, &EyePointSettings { density, ..EyePointSettings::default() });
        let whole = points.rasterise(&lights);
        let (mut wrong, mut shadowed, mut other, mut all) = (0, 0, 0, 0);
        for facet in points.facets().iter().step_by(points.facets().len() / 400 + 1) {
            let place = (facet.corners[0] + facet.corners[1] + facet.corners[2]) / 3.0;
            let normal = facet.area_vector().normalize();
            for (map, light) in lights.iter().enumerate() {
                let towards = place - light.center;
                let nearest = by_brute_force(points.facets(), light, towards.normalize());
                let truth = towards.dot(normal) < 0.0
                    && nearest.is_none_or(|(_, range)| towards.length() <= range * (1.0 + 1e-6));
                let lit = is_lit(&found.maps, map, light.center, place, normal);
                all += 1;
                shadowed += usize::from(!truth);
                wrong += usize::from(lit != truth);
                other += usize::from(lit != is_lit(&whole, map, light.center, place, normal));
            }
        }
        assert!(shadowed * 10 > all && shadowed < all, "{shadowed} of {all}");
        assert!(wrong * 25 < all, "{wrong} of {all}");
        assert_eq!(other, 0, "points fill maps as whole triangles do");
    }
}
