//! Makes missing normals and repairs bad ones.

use glam::{DVec3, Vec3};

use crate::Mesh;

/// Moves element `order[i]` to `i`; an empty array stays empty.
pub(super) fn pick<T: Copy>(values: &mut Vec<T>, order: &[u32]) {
    if !values.is_empty() {
        *values = order.iter().map(|&i| values[i as usize]).collect();
    }
}

/// Normal of a triangle with twice its area as length, in f64, since squares of large coordinates overflow.
fn area_normal(mesh: &Mesh, triangle: [u32; 3]) -> DVec3 {
    let [a, b, c] = triangle.map(|i| mesh.positions[i as usize].as_dvec3());
    (b - a).cross(c - a)
}

/// The direction of `n`, or up if it has none.
fn unit(n: DVec3) -> Vec3 {
    n.try_normalize().unwrap_or(DVec3::Y).as_vec3()
}

fn triangles(mesh: &Mesh) -> impl Iterator<Item = [u32; 3]> {
    mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]])
}

/// Averages around each vertex, weighted by area.
fn averaged(mesh: &Mesh) -> Vec<Vec3> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    for triangle in triangles(mesh) {
        let normal = area_normal(mesh, triangle);
        triangle.into_iter().for_each(|i| sums[i as usize] += normal);
    }
    sums.into_iter().map(unit).collect()
}

/// Gives every vertex the average of its triangles' normals.
pub(super) fn make_smooth(mesh: &mut Mesh) {
    mesh.normals = averaged(mesh);
}

/// Gives every triangle vertices of its own, with its own normal.
pub(super) fn make_flat(mesh: &mut Mesh) {
    let normals = triangles(mesh).flat_map(|triangle| [unit(area_normal(mesh, triangle)); 3]).collect();
    let order = std::mem::take(&mut mesh.indices);
    pick(&mut mesh.positions, &order);
    pick(&mut mesh.tangents, &order);
    pick(&mut mesh.uvs, &order);
    pick(&mut mesh.uvs2, &order);
    pick(&mut mesh.colors, &order);
    mesh.normals = normals;
    mesh.indices = (0..order.len() as u32).collect();
}

/// Normalises all normals. Those without a direction are made from the triangles around them.
pub(super) fn repair(mesh: &mut Mesh) {
    let mut broken = Vec::new();
    for (i, normal) in mesh.normals.iter_mut().enumerate() {
        match normal.as_dvec3().try_normalize() {
            Some(unit) if normal.is_finite() => *normal = unit.as_vec3(),
            _ => broken.push(i),
        }
    }
    if !broken.is_empty() {
        let made = averaged(mesh);
        broken.into_iter().for_each(|i| mesh.normals[i] = made[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two faces of a roof that share their ridge.
    fn roof() -> Mesh {
        Mesh {
            positions: vec![Vec3::ZERO, Vec3::Z, Vec3::new(1.0, -1.0, 0.0), Vec3::new(-1.0, -1.0, 0.0)],
            indices: vec![0, 1, 2, 0, 3, 1],
            ..Mesh::default()
        }
    }

    #[test]
    fn smooth_normals_average_and_flat_ones_do_not() {
        let mut smooth = roof();
        make_smooth(&mut smooth);
        assert!((smooth.normals[0] - Vec3::Y).length() < 1e-6);
        let mut flat = roof();
        make_flat(&mut flat);
        assert_eq!(flat.positions.len(), 6);
        assert!((flat.normals[0] - Vec3::new(1.0, 1.0, 0.0).normalize()).length() < 1e-6);
    }

    #[test]
    fn normals_without_a_direction_are_replaced_and_the_rest_normalised() {
        let mut mesh = roof();
        mesh.normals =
            vec![Vec3::NAN, Vec3::new(0.0, 3.0, 0.0), Vec3::ZERO, Vec3::new(f32::INFINITY, 0.0, 0.0)];
        repair(&mut mesh);
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-6));
        assert_eq!(mesh.normals[1], Vec3::Y);
    }

    #[test]
    fn degenerate_and_huge_triangles_have_unit_normals() {
        let mut mesh = roof();
        mesh.positions = vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::splat(f32::MAX)];
        make_flat(&mut mesh);
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-6));
    }
}
