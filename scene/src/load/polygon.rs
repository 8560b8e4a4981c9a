//! Triangulates polygons.

use glam::{DVec2, DVec3};

/// Polygons with more corners than this become fans, since ear clipping takes cubic time.
const MOST_EARS: usize = 64;

/// Cuts a polygon into triangles of positions in `points`; none if it has fewer than three corners. A convex polygon
/// becomes a fan; of others ears are clipped (Meisters 1975).
pub(super) fn triangulate(points: &[DVec3], mut triangle: impl FnMut([usize; 3])) {
    let count = points.len();
    let fan = 1..count.saturating_sub(1);
    if count <= 3 || count > MOST_EARS {
        fan.for_each(|i| triangle([0, i, i + 1]));
        return;
    }
    let Some(flat) = flatten(points) else {
        fan.for_each(|i| triangle([0, i, i + 1]));
        return;
    };
    let turn = |a: usize, b: usize, c: usize| (flat[b] - flat[a]).perp_dot(flat[c] - flat[a]);
    if (0..count).all(|i| turn(i, (i + 1) % count, (i + 2) % count) >= 0.0) {
        fan.for_each(|i| triangle([0, i, i + 1]));
        return;
    }
    let mut left: Vec<usize> = (0..count).collect();
    while left.len() > 3 {
        let n = left.len();
        let is_ear = |i: usize| {
            let (a, b, c) = (left[(i + n - 1) % n], left[i], left[(i + 1) % n]);
            let inside = |p: usize| turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
            turn(a, b, c) > 0.0 && !left.iter().any(|&p| p != a && p != b && p != c && inside(p))
        };
        // A self-intersecting polygon may have no ear: any corner will do.
        let i = (0..n).find(|&i| is_ear(i)).unwrap_or(0);
        triangle([left[(i + n - 1) % n], left[i], left[(i + 1) % n]]);
        left.remove(i);
    }
    triangle([left[0], left[1], left[2]]);
}

/// Projects the polygon onto its best plane, anticlockwise; `None` if it has no area.
fn flatten(points: &[DVec3]) -> Option<Vec<DVec2>> {
    // Newell's normal, about the first corner so that distant coordinates do not cancel.
    let at = |i: usize| points[i % points.len()] - points[0];
    let normal = (0..points.len()).map(|i| at(i).cross(at(i + 1))).sum::<DVec3>().try_normalize()?;
    let x = normal.any_orthonormal_vector();
    let y = normal.cross(x);
    Some((0..points.len()).map(|i| DVec2::new(at(i).dot(x), at(i).dot(y))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_of(points: &[DVec3]) -> f64 {
        let mut area = 0.0;
        triangulate(points, |[a, b, c]| {
            let normal = (points[b] - points[a]).cross(points[c] - points[a]);
            assert!(normal.y >= -1e-12, "every triangle faces the way the polygon does");
            area += normal.length() * 0.5;
        });
        area
    }

    #[test]
    fn a_concave_polygon_is_covered_exactly_once() {
        let l = [(0.0, 0.0), (0.0, 2.0), (1.0, 2.0), (1.0, 1.0), (2.0, 1.0), (2.0, 0.0)];
        let far = DVec3::new(1e6, 0.0, -1e6);
        for start in 0..6 {
            let points: Vec<DVec3> =
                (0..6).map(|i| l[(start + i) % 6]).map(|(x, z)| DVec3::new(x, 0.0, z) + far).collect();
            assert!((area_of(&points) - 3.0).abs() < 1e-9, "from corner {start}");
        }
    }

    #[test]
    fn degenerate_polygons_give_a_triangle_less_than_two_corners_and_no_panic() {
        for points in [
            vec![],
            vec![DVec3::ZERO],
            vec![DVec3::ZERO; 2],
            vec![DVec3::ZERO; 5],
            vec![DVec3::NAN; 5],
            vec![DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::X * 3.0],
            vec![DVec3::ZERO, DVec3::X + DVec3::Z, DVec3::X, DVec3::Z],
            vec![DVec3::splat(f64::MAX); 4],
        ] {
            let mut triangles = 0;
            triangulate(&points, |t| {
                assert!(t.iter().all(|&i| i < points.len()));
                triangles += 1;
            });
            assert_eq!(triangles, points.len().saturating_sub(2));
        }
    }
}
