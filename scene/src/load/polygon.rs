//! Triangulates polygons.

use earcut::Earcut;
use glam::{DVec2, DVec3};

/// Concave polygons with more corners than this become fans: one that crosses itself may take quadratic time.
const MOST_CORNERS: usize = 1 << 14;

/// Cuts a polygon into triangles of positions in `points`; none if it has fewer than three corners. A convex polygon
/// becomes a fan; of others ears are clipped (Meisters 1975).
pub(super) fn triangulate(points: &[DVec3], mut triangle: impl FnMut([usize; 3])) {
    match concave(points).map(|flat| ears(&flat)).filter(|ears| !ears.is_empty()) {
        Some(ears) => ears.into_iter().for_each(triangle),
        None => (1..points.len().saturating_sub(1)).for_each(|i| triangle([0, i, i + 1])),
    }
}

/// The polygon in its plane, anticlockwise, if it is concave.
fn concave(points: &[DVec3]) -> Option<Vec<DVec2>> {
    let count = points.len();
    let flat = flatten(points).filter(|_| (4..=MOST_CORNERS).contains(&count))?;
    let turn = |a: usize, b: usize, c: usize| (flat[b] - flat[a]).perp_dot(flat[c] - flat[a]);
    let is_convex = (0..count).all(|i| turn(i, (i + 1) % count, (i + 2) % count) >= 0.0);
    (!is_convex).then_some(flat)
}

/// Triangles of an anticlockwise polygon, anticlockwise.
fn ears(flat: &[DVec2]) -> Vec<[usize; 3]> {
    let mut corners: Vec<u32> = Vec::new();
    Earcut::new().earcut(flat.iter().map(|corner| corner.to_array()), &[], &mut corners);
    let triangles = corners.as_chunks::<3>().0.iter().map(|triangle| triangle.map(|corner| corner as usize));
    let faces_us = |&[a, b, c]: &[usize; 3]| (flat[b] - flat[a]).perp_dot(flat[c] - flat[a]) >= 0.0;
    triangles.map(|one| if faces_us(&one) { one } else { [one[0], one[2], one[1]] }).collect()
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
    fn a_ring_with_a_cut_is_covered_exactly_once_however_many_corners_it_has() {
        for count in [8, 66, 1000] {
            let around = |radius: f64| {
                let angle = move |i: usize| i as f64 / count as f64 * std::f64::consts::TAU;
                (0..=count)
                    .map(move |i| DVec3::new(angle(i % count).sin(), 0.0, angle(i % count).cos()) * radius)
            };
            let ring: Vec<DVec3> =
                around(2.0).chain(around(1.5).collect::<Vec<_>>().into_iter().rev()).collect();
            let of_circle = 0.5 * count as f64 * (std::f64::consts::TAU / count as f64).sin();
            let truth = of_circle * (4.0 - 2.25);
            assert!((area_of(&ring) - truth).abs() < 1e-9, "{count}: {} of {truth}", area_of(&ring));
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
            assert!(triangles <= points.len().saturating_sub(2));
            assert_eq!(triangles == 0, points.len() < 3, "{points:?}");
        }
    }
}
