//! One ray against one triangle, in f64.

use glam::{DVec2, DVec3, Vec3};

/// A ray prepared for triangle tests: sheared so that it runs along one axis (Woop, Benthin, Wald:
/// "Watertight Ray/Triangle Intersection", JCGT 2013).
///
/// Edge functions of two triangles that share an edge come from the same products. Rounding can change their value, but
/// both triangles see the same sign, so a ray through the edge meets at least one of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct ShearedRay {
    origin: DVec3,
    /// The axis along which the direction is longest; the other two follow it cyclically.
    axis: usize,
    /// Shear of the two axes after `axis`, scale of `axis` itself.
    shear: DVec3,
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Crossing {
    /// Range in units of the ray's direction.
    pub(super) t: f64,
    /// Weights of the second and third corner.
    pub(super) barycentric: DVec2,
    /// Whether the corners appear counter-clockwise.
    pub(super) front: bool,
}

impl ShearedRay {
    /// Prepares a ray; `direction` must be finite and not zero.
    pub(super) fn new(origin: DVec3, direction: DVec3) -> Self {
        let axis = direction.abs().max_position();
        let [x, y, z] = [1, 2, 0].map(|next| direction[(axis + next) % 3]);
        Self { origin, axis, shear: DVec3::new(x, y, 1.0) / z }
    }

    /// The crossing with t > 0, if there is one; edges and corners belong to the triangle.
    #[inline]
    pub(super) fn crossing(&self, corners: &[Vec3; 3]) -> Option<Crossing> {
        // A fixed order of axes per case keeps the corners in registers.
        match self.axis {
            0 => self.crossing_along(corners, |p| DVec3::new(p.y, p.z, p.x)),
            1 => self.crossing_along(corners, |p| DVec3::new(p.z, p.x, p.y)),
            _ => self.crossing_along(corners, |p| p),
        }
    }

    #[inline(always)]
    fn crossing_along(&self, corners: &[Vec3; 3], order: impl Fn(DVec3) -> DVec3) -> Option<Crossing> {
        let sheared = |corner: Vec3| {
            let p = order(corner.as_dvec3() - self.origin);
            DVec3::new(p.x - self.shear.x * p.z, p.y - self.shear.y * p.z, self.shear.z * p.z)
        };
        let (a, b, c) = (sheared(corners[0]), sheared(corners[1]), sheared(corners[2]));
        let u = c.x * b.y - c.y * b.x;
        let v = a.x * c.y - a.y * c.x;
        let w = b.x * a.y - b.y * a.x;
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        let t = (u * a.z + v * b.z + w * c.z) / determinant;
        // Edge-on, the determinant is 0 and t is not finite; a NaN fails both comparisons.
        if !(t > 0.0 && t < f64::INFINITY) {
            return None;
        }
        let barycentric = DVec2::new(v, w) / determinant;
        // Looking along a negative axis, the other two appear mirrored.
        Some(Crossing { t, barycentric, front: (determinant > 0.0) == (self.shear.z > 0.0) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [Vec3; 3] =
        [Vec3::new(0.0, 0.0, -4.0), Vec3::new(1.0, 0.0, -4.0), Vec3::new(0.0, 1.0, -4.0)];

    fn cross(origin: DVec3, direction: DVec3, corners: &[Vec3; 3]) -> Option<Crossing> {
        ShearedRay::new(origin, direction).crossing(corners)
    }

    #[test]
    fn a_crossing_has_its_range_its_weights_and_its_side() {
        let hit = cross(DVec3::new(0.25, 0.5, 0.0), DVec3::NEG_Z, &CORNERS).unwrap();
        assert_eq!((hit.t, hit.barycentric, hit.front), (4.0, DVec2::new(0.25, 0.5), true));
        let behind = cross(DVec3::new(0.25, 0.5, -8.0), DVec3::Z * 2.0, &CORNERS).unwrap();
        assert_eq!((behind.t, behind.barycentric, behind.front), (2.0, DVec2::new(0.25, 0.5), false));
    }

    #[test]
    fn every_axis_and_sign_agrees_with_the_others() {
        // The same triangle and ray, permuted and mirrored, must be crossed at the same place.
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let turn = |v: DVec3| DVec3::from_array(std::array::from_fn(|i| v[(i + axis) % 3])) * sign;
                let corners = CORNERS.map(|corner| turn(corner.as_dvec3()).as_vec3());
                let direction = turn(DVec3::new(0.1, 0.125, -1.0));
                let hit = cross(DVec3::ZERO, direction, &corners).expect("crossed");
                assert!((hit.t - 4.0).abs() < 1e-14);
                assert!((hit.barycentric - DVec2::new(0.4, 0.5)).length() < 1e-7);
                assert_eq!(hit.front, sign > 0.0, "a point reflection turns the triangle around");
            }
        }
    }

    #[test]
    fn a_triangle_behind_beside_edge_on_or_without_area_is_not_crossed() {
        assert_eq!(cross(DVec3::new(0.25, 0.5, -5.0), DVec3::NEG_Z, &CORNERS), None);
        assert_eq!(cross(DVec3::new(0.25, 0.5, -4.0), DVec3::NEG_Z, &CORNERS), None, "at t = 0");
        assert_eq!(cross(DVec3::new(0.6, 0.5, 0.0), DVec3::NEG_Z, &CORNERS), None);
        assert_eq!(cross(DVec3::new(-1.0, 0.2, -4.0), DVec3::X, &CORNERS), None);
        let needle = [CORNERS[0], CORNERS[1], CORNERS[1]];
        assert_eq!(cross(DVec3::new(0.5, 0.0, 0.0), DVec3::NEG_Z, &needle), None);
        assert_eq!(cross(DVec3::ZERO, DVec3::NEG_Z, &[Vec3::NAN; 3]), None);
    }
}
