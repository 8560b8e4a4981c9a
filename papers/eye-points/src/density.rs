//! How densely a triangle needs points, so that the eye misses nothing in its reflections (section 4.1.1).

use argus_scene::closest_on_triangle;
use glam::DVec3;

use super::Eye;
use super::shadows::shadow_density;
use argus_sampler::plug::MappedReflector;

/// The rule by which density follows reflectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DensityRule {
    /// A pixel of the eye by way of the reflector, with its curvature.
    Eye,
    /// A pixel of the eye by way of the reflector, as if that were planar: equations 2 and 3 as they stand.
    Planar,
    /// A texel of the map (improved view-independent rendering).
    Map,
    /// A pixel of the eye where a triangle's shadow may fall, for maps around points of a light (section 5.1).
    Shadow,
}

/// Density of points, and its rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Density {
    /// The rule.
    pub rule: DensityRule,
    /// Points for each pixel of the eye, by area: the paper's ρ_scale. 1/2 is one point for two pixels.
    pub scale: f64,
    /// Factor on the density, linear, by which a budget lowers it; 1 without.
    pub reduction: f64,
}

impl Default for Density {
    /// One point for two pixels, the paper's choice (section 4.2.1).
    fn default() -> Self {
        Self { rule: DensityRule::Eye, scale: 0.5, reduction: 1.0 }
    }
}

/// Most texels that a cell is wide: a splat's loop has a bound.
const WIDEST_CELL: f64 = 16.0;

/// Cells for each metre that a triangle needs for one reflector.
///
/// A pixel of angle α sees α·d_er on a surface of curvature κ, whose normal turns by κ·α·d_er and the reflected ray by
/// twice that; at a distance d_rt beyond it covers α·(d_er + d_rt·(1 + 2·d_er·κ)). The density is the inverse. No more than
/// one cell for each texel of the map is needed, and a cell is at most 16 texels wide. Distances are those of nearest
/// points, so a density is never too low.
pub fn density_for(eye: &Eye, reflector: &MappedReflector, corners: [DVec3; 3], density: &Density) -> f64 {
    density_at(eye, reflector, corners, distance(reflector, corners), density)
}

/// Distance of a triangle from a reflector's middle, metres.
pub(super) fn distance(reflector: &MappedReflector, corners: [DVec3; 3]) -> f64 {
    (closest_on_triangle(reflector.center, corners) - reflector.center).length()
}

/// [`density_for`] a triangle whose distance from the reflector's middle is known.
pub(super) fn density_at(
    eye: &Eye,
    reflector: &MappedReflector,
    corners: [DVec3; 3],
    distance: f64,
    density: &Density,
) -> f64 {
    let from_center = distance.max(eye.near);
    let eye_to_reflector = (eye.distance(reflector.center) - reflector.radius).max(eye.near);
    let reflector_to_triangle = (from_center - reflector.radius).max(eye.near);
    let of_map = f64::from(reflector.side) / (2.0 * from_center);
    let by_eye = |curvature: f64| {
        if reflector.front.is_some() {
            // The map is seen from the eye's mirror image: the way from there is that from the eye by the mirror.
            return eye.pixels / from_center;
        }
        eye.pixels / (eye_to_reflector + reflector_to_triangle * (1.0 + 2.0 * eye_to_reflector * curvature))
    };
    let wanted = match density.rule {
        DensityRule::Eye => by_eye(reflector.curvature).min(of_map) * density.scale.sqrt(),
        DensityRule::Planar => by_eye(0.0).min(of_map) * density.scale.sqrt(),
        DensityRule::Map => of_map,
        DensityRule::Shadow => {
            let by_eye = shadow_density(eye, reflector.center, corners, from_center);
            by_eye.min(of_map) * density.scale.sqrt()
        }
    };
    wanted.max(of_map / WIDEST_CELL) * density.reduction
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [DVec3; 3] =
        [DVec3::new(0.0, 0.0, -5.0), DVec3::new(1.0, 0.0, -5.0), DVec3::new(0.0, 1.0, -5.0)];

    fn eye() -> Eye {
        let position = DVec3::new(0.0, 0.0, 8.0);
        Eye { position, half_size: DVec3::ZERO, pixels: 900.0, height: 1080, near: 1e-3 }
    }

    #[test]
    fn a_box_of_viewpoints_needs_the_density_of_its_nearest_one() {
        let ball = reflector(0.5, 512);
        let rule = full(DensityRule::Eye);
        let half_size = DVec3::new(2.0, 1.0, 3.0);
        let of_box = density_for(&Eye { half_size, ..eye() }, &ball, CORNERS, &rule);
        let of_nearest = density_for(&Eye { position: DVec3::Z * 5.0, ..eye() }, &ball, CORNERS, &rule);
        assert_eq!(of_box, of_nearest);
        for corner in [DVec3::ONE, DVec3::NEG_ONE, DVec3::new(1.0, -1.0, 1.0)] {
            let corner = Eye { position: eye().position + half_size * corner, ..eye() };
            assert!(density_for(&corner, &ball, CORNERS, &rule) < of_box);
        }
        let around = Eye { position: DVec3::ONE, half_size: DVec3::splat(2.0), ..eye() };
        let at_near = density_for(&around, &ball, CORNERS, &rule);
        assert!(at_near.is_finite() && at_near > of_box, "the reflector is among the viewers: {at_near}");
    }

    fn reflector(radius: f64, side: u32) -> MappedReflector {
        MappedReflector {
            instance: 0,
            center: DVec3::ZERO,
            radius,
            curvature: radius.recip(),
            side,
            front: None,
        }
    }

    fn full(rule: DensityRule) -> Density {
        Density { rule, scale: 1.0, reduction: 1.0 }
    }

    #[test]
    fn density_is_one_over_the_footprint_of_a_reflected_pixel() {
        // Two rays of neighbouring pixels, traced to a small ball in their middle and on to a plane behind the eye.
        let (radius, plane) = (0.01, 20.0);
        let ball = reflector(radius, 8);
        let hit = |angle: f64| {
            let direction = DVec3::new(angle.sin(), 0.0, -angle.cos());
            let along = -eye().position.dot(direction);
            let squared = along * along - eye().position.length_squared() + radius * radius;
            let place = eye().position + direction * (along - squared.sqrt());
            let normal = place / radius;
            let reflected = direction - 2.0 * direction.dot(normal) * normal;
            place + reflected * ((plane - place.z) / reflected.z)
        };
        let alpha = 1e-9;
        let footprint = (hit(alpha) - hit(0.0)).length() / alpha / eye().pixels;
        let behind = [DVec3::new(0.0, 0.0, plane), DVec3::new(1.0, 0.0, plane), DVec3::new(0.0, 1.0, plane)];
        let found = density_for(&eye(), &ball, behind, &full(DensityRule::Eye));
        assert!((found * footprint - 1.0).abs() < 0.01, "{found} {}", footprint.recip());
    }

    #[test]
    fn planar_density_is_that_of_the_way_from_triangle_to_eye() {
        let found = density_for(&eye(), &reflector(0.5, 2000), CORNERS, &full(DensityRule::Planar));
        assert!((found - 900.0 / (7.5 + 4.5)).abs() < 1e-9, "{found}");
    }

    #[test]
    fn density_stays_between_one_cell_a_texel_and_one_for_sixteen() {
        for side in [32, 128, 512] {
            let of_map = f64::from(side) / 10.0;
            for radius in [0.01, 0.1, 1.0] {
                let found = density_for(&eye(), &reflector(radius, side), CORNERS, &full(DensityRule::Eye));
                assert!((of_map / 16.0..=of_map).contains(&found), "{side} {radius}: {found}");
            }
            assert_eq!(density_for(&eye(), &reflector(0.1, side), CORNERS, &full(DensityRule::Map)), of_map);
        }
    }

    #[test]
    fn the_scale_counts_points_by_area_and_the_reduction_cells_by_length() {
        let ball = reflector(0.5, 512);
        let of = |scale, reduction| {
            let density = Density { scale, reduction, ..full(DensityRule::Planar) };
            density_for(&eye(), &ball, CORNERS, &density)
        };
        assert!((of(0.25, 1.0) / of(1.0, 1.0) - 0.5).abs() < 1e-12);
        assert!((of(1.0, 0.5) / of(1.0, 1.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn density_is_finite_where_eye_reflector_and_triangle_touch_and_far_from_the_origin() {
        let touching = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for far in [DVec3::ZERO, DVec3::splat(1e6)] {
            let eye = Eye { position: far, ..eye() };
            let ball = MappedReflector { center: far, ..reflector(0.5, 512) };
            let near = touching.map(|corner| corner + far);
            for rule in [DensityRule::Eye, DensityRule::Planar, DensityRule::Map] {
                let found = density_for(&eye, &ball, near, &full(rule));
                assert!(found.is_finite() && found > 0.0, "{rule:?} {found}");
            }
        }
        let moved = CORNERS.map(|corner| corner + 1e6);
        let far_eye = Eye { position: eye().position + 1e6, ..eye() };
        let ball = MappedReflector { center: DVec3::splat(1e6), ..reflector(0.5, 512) };
        let [there, here] = [
            density_for(&far_eye, &ball, moved, &full(DensityRule::Eye)),
            density_for(&eye(), &reflector(0.5, 512), CORNERS, &full(DensityRule::Eye)),
        ];
        assert!((there / here - 1.0).abs() < 1e-8);
    }
}
