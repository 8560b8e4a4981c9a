//! The point of a triangle that is closest to a given point.

use glam::DVec3;

/// The point of a triangle that is closest to `point` (Ericson, "Real-Time Collision Detection", 2005, section 5.1.5).
/// All in one space, metres. Uses only operations that IEEE 754 rounds alike everywhere. A triangle without area gives
/// one of its corners or a point of its edges; a corner that is not finite gives a point that is not finite.
pub fn closest_on_triangle(point: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = point - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = point - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    let (to_c, to_b) = (d4 - d3, d5 - d6);
    if va <= 0.0 && to_c >= 0.0 && to_b >= 0.0 && to_c + to_b > 0.0 {
        return b + (c - b) * (to_c / (to_c + to_b));
    }
    let sum = va + vb + vc;
    if sum == 0.0 {
        return a;
    }
    a + ab * (vb / sum) + ac * (vc / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The distance to the closest of many points of a triangle.
    fn by_sampling(point: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
        let steps = 200;
        let mut least = f64::INFINITY;
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (u, v) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
                least = least.min((a + (b - a) * u + (c - a) * v - point).length());
            }
        }
        least
    }

    #[test]
    fn the_closest_point_is_as_close_as_the_closest_of_many_samples() {
        let mut seed = 1u32;
        let mut unit = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24)
        };
        for _ in 0..60 {
            let mut place = || DVec3::new(unit(), unit(), unit()) * 2.0 - 1.0;
            let (corners, point) = ([place(), place(), place()], place() * 2.0);
            let closest = closest_on_triangle(point, corners);
            let (found, sampled) = ((closest - point).length(), by_sampling(point, corners));
            assert!(found <= sampled + 1e-12, "{found} {sampled}");
            assert!(found > sampled - 0.02, "the point lies on the triangle: {found} {sampled}");
        }
    }

    #[test]
    fn a_triangle_without_area_has_a_closest_point() {
        let (a, b) = (DVec3::ZERO, DVec3::X);
        assert_eq!(closest_on_triangle(DVec3::Y, [a; 3]), a);
        assert_eq!(closest_on_triangle(DVec3::new(2.0, 1.0, 0.0), [a, b, b]), b);
        let on_edge = closest_on_triangle(DVec3::new(0.5, 1.0, 0.0), [a, b, a]);
        assert!((on_edge - DVec3::new(0.5, 0.0, 0.0)).length() < 1e-12, "{on_edge}");
    }
}
