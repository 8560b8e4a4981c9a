//! Simple shapes that generated scenes consist of.

use glam::DVec3;

use crate::Mesh;

/// Two triangles about a middle, spanned by half edges; their front is towards the edges' cross product.
pub fn quad(mesh: &mut Mesh, middle: DVec3, right: DVec3, up: DVec3) {
    let first = mesh.positions.len() as u32;
    let corners = [middle - right - up, middle + right - up, middle + right + up, middle - right + up];
    mesh.positions.extend(corners.map(|corner| corner.as_vec3()));
    mesh.normals.extend([right.cross(up).normalize().as_vec3(); 4]);
    mesh.indices.extend([0, 1, 2, 0, 2, 3].map(|corner| first + corner));
}

/// A ball of radius 1: the faces of a cube of `face_cells` squares on an edge, projected onto the sphere.
pub fn ball(name: &str, material: u32, face_cells: u32) -> Mesh {
    let mut mesh = Mesh { name: name.to_owned(), material, ..Mesh::default() };
    for normal in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
        let right = if normal.x == 0.0 { DVec3::X } else { DVec3::Y };
        let up = normal.cross(right);
        let first = mesh.positions.len() as u32;
        let row = face_cells + 1;
        for i in 0..row * row {
            let [u, v] = [i % row, i / row].map(|k| f64::from(k) / f64::from(face_cells) * 2.0 - 1.0);
            let at = (normal + right * u + up * v).normalize().as_vec3();
            mesh.positions.push(at);
            mesh.normals.push(at);
        }
        for (i, j) in (0..face_cells * face_cells).map(|k| (k % face_cells, k / face_cells)) {
            let [a, b, c, d] =
                [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(di, dj)| first + (j + dj) * row + i + di);
            mesh.indices.extend([a, b, d, a, d, c]);
        }
    }
    mesh
}

/// The six faces of a box, seen from outside; with `min` and `max` exchanged, from inside. Metres.
pub fn cuboid(mesh: &mut Mesh, min: DVec3, max: DVec3) {
    let (middle, half) = ((min + max) * 0.5, (max - min) * 0.5);
    for [normal, right, up] in
        [[DVec3::X, DVec3::Y, DVec3::Z], [DVec3::Y, DVec3::Z, DVec3::X], [DVec3::Z, DVec3::X, DVec3::Y]]
    {
        quad(mesh, middle + normal * half, right * half, up * half);
        quad(mesh, middle - normal * half, up * half, right * half);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_faces_outwards_and_with_exchanged_corners_inwards() {
        let (min, max) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(2.0, 4.0, 6.0));
        for (from, to, sign) in [(min, max, 1.0), (max, min, -1.0)] {
            let mut mesh = Mesh::default();
            cuboid(&mut mesh, from, to);
            let middle = ((min + max) * 0.5).as_vec3();
            for corners in mesh.indices.as_chunks::<3>().0 {
                let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
                let front = (b - a).cross(c - a);
                assert!(front.dot(a - middle) * sign > 0.0);
                assert!(front.dot(mesh.normals[corners[0] as usize]) > 0.0);
            }
        }
    }
}
