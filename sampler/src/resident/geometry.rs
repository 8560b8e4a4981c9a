//! Triangles of all meshes in a few buffers.

use argus_scene::{Mesh, Scene};
use argus_shaders::layout::sampler::{MeshLayout, has};
use glam::{DVec3, Vec2, Vec3, Vec4};

/// Triangles of a chunk, the unit of culling. Smaller chunks cull more and cost more draws. Triangles keep the file's
/// order: sorted along a space-filling curve, the 500k terrain drew no faster and fetched vertices more slowly.
const CHUNK_TRIANGLES: usize = 4096;

/// Marks a missing normal. No fraction is stored as -32768.
const NO_NORMAL: u32 = 0x8000_8000;

/// Contents of the buffers.
#[derive(Default)]
pub(super) struct Arena {
    /// Position and normal.
    pub(super) vertices: Vec<[u32; 4]>,
    /// Texture coordinates and colour. The tangent has its own record.
    pub(super) attributes: Vec<[u32; 4]>,
    pub(super) indices: Vec<u32>,
    /// One a mesh.
    pub(super) layouts: Vec<MeshLayout>,
}

/// How a mesh is drawn.
pub(crate) struct MeshRun {
    pub(crate) first_index: u32,
    pub(crate) first_vertex: u32,
    /// First record of its vertices' attributes.
    pub(super) first_attribute: u32,
    /// Consecutive triangles. Empty for a mesh without instances.
    pub(crate) chunks: Vec<Chunk>,
    /// Box around all chunks.
    pub(crate) whole: Chunk,
}

/// Consecutive triangles of a mesh, and their box relative to the mesh's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Chunk {
    pub(crate) first_triangle: u32,
    pub(crate) triangles: u32,
    pub(crate) middle: DVec3,
    pub(crate) half: DVec3,
}

impl Arena {
    /// The buffers of all meshes with instances.
    pub(super) fn new(scene: &Scene) -> (Self, Vec<MeshRun>) {
        let mut used = vec![false; scene.meshes.len()];
        scene.instances.iter().for_each(|i| used[i.mesh as usize] = true);
        let mut arena = Self::default();
        let tests_second = |mesh: &Mesh| {
            let material = scene.materials.get(mesh.material as usize);
            material.and_then(|m| m.base_color_texture).is_some_and(|texture| texture.uv_set == 1)
        };
        let runs = scene.meshes.iter().zip(used);
        let runs = runs.map(|(mesh, used)| arena.push(mesh, used, tests_second(mesh))).collect();
        (arena, runs)
    }

    /// `tests_second`: the alpha test reads the second set of texture coordinates.
    pub(super) fn push(&mut self, mesh: &Mesh, used: bool, tests_second: bool) -> MeshRun {
        let held = |attribute: usize| used && attribute > 0 && attribute >= mesh.positions.len();
        let held = Held {
            uv: held(mesh.uvs.len()),
            second: held(mesh.uvs2.len()),
            color: held(mesh.colors.len()),
            tangent: held(mesh.tangents.len()),
        };
        let records = held.records();
        let bit = |is_set: bool, bit: u32| if is_set { bit } else { 0 };
        let uvs = bit(held.uv, has::UVS)
            | bit(held.second, has::SECOND_UVS)
            | bit(held.second && tests_second, has::TESTS_SECOND_UVS);
        let (first_index, first_vertex) = (self.indices.len() as u32, self.vertices.len() as u32);
        let layout = MeshLayout {
            first: [first_index, first_vertex, self.attributes.len() as u32, records],
            has: [uvs, u32::from(held.color), u32::from(held.tangent), mesh.material],
        };
        self.layouts.push(layout);
        let mut run = MeshRun {
            first_index,
            first_vertex,
            first_attribute: self.attributes.len() as u32,
            chunks: Vec::new(),
            whole: Chunk { first_triangle: 0, triangles: 0, middle: DVec3::ZERO, half: DVec3::ZERO },
        };
        if !used || mesh.triangles() == 0 || mesh.positions.is_empty() {
            return run;
        }
        for vertex in 0..mesh.positions.len() {
            self.push_vertex(mesh, vertex);
            self.push_attributes(mesh, vertex, held);
        }
        let drawn = |corners: &[u32]| {
            corners.iter().all(|&i| mesh.positions.get(i as usize).is_some_and(|p| p.is_finite()))
        };
        let triangles = mesh.indices[..3 * mesh.triangles()].as_chunks::<3>().0;
        for (i, chunk) in triangles.chunks(CHUNK_TRIANGLES).enumerate() {
            let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            for corners in chunk {
                if drawn(corners) {
                    self.indices.extend(corners);
                    for &corner in corners {
                        let p = mesh.positions[corner as usize].as_dvec3();
                        (min, max) = (min.min(p), max.max(p));
                    }
                } else {
                    self.indices.extend([0; 3]);
                }
            }
            if min.cmple(max).all() {
                let first_triangle = (i * CHUNK_TRIANGLES) as u32;
                let (middle, half) = ((min + max) * 0.5, (max - min) * 0.5);
                run.chunks.push(Chunk { first_triangle, triangles: chunk.len() as u32, middle, half });
            }
        }
        run.whole = around(&run.chunks, mesh.triangles() as u32);
        run
    }

    fn push_vertex(&mut self, mesh: &Mesh, vertex: usize) {
        // Triangles of a corner that is not finite become degenerate and are never drawn.
        let position = if mesh.positions[vertex].is_finite() { mesh.positions[vertex] } else { Vec3::ZERO };
        let normal = mesh.normals.get(vertex).copied().unwrap_or(Vec3::ZERO);
        let [x, y, z] = position.to_array().map(f32::to_bits);
        self.vertices.push([x, y, z, octahedral(normal)]);
    }

    fn push_attributes(&mut self, mesh: &Mesh, vertex: usize, held: Held) {
        let records = held.records();
        if records > 0 {
            let uv = if held.uv { mesh.uvs[vertex] } else { Vec2::ZERO };
            let [r, g, b, a] = if held.color { mesh.colors[vertex] } else { Vec4::ONE }.to_array();
            self.attributes.push([uv.x.to_bits(), uv.y.to_bits(), halves(r, g), halves(b, a)]);
        }
        if records > 1 {
            let tangent = if held.tangent { tangent(mesh.tangents[vertex]) } else { NO_NORMAL };
            let uv = if held.second { mesh.uvs2[vertex] } else { Vec2::ZERO };
            self.attributes.push([tangent, uv.x.to_bits(), uv.y.to_bits(), 0]);
        }
    }
}

/// Attributes of a mesh's vertices.
#[derive(Clone, Copy)]
struct Held {
    uv: bool,
    second: bool,
    color: bool,
    tangent: bool,
}

impl Held {
    /// Records of attributes a vertex.
    fn records(self) -> u32 {
        let second = self.tangent || self.second;
        u32::from(self.uv || self.color || second) + u32::from(second)
    }
}

/// The union of chunks: their box and all triangles.
fn around(chunks: &[Chunk], triangles: u32) -> Chunk {
    let min = chunks.iter().map(|c| c.middle - c.half).fold(DVec3::INFINITY, DVec3::min);
    let max = chunks.iter().map(|c| c.middle + c.half).fold(DVec3::NEG_INFINITY, DVec3::max);
    Chunk { first_triangle: 0, triangles, middle: (min + max) * 0.5, half: (max - min) * 0.5 }
}

/// A unit vector as two snorm16, accurate to about 4·10⁻⁵ radians.
pub(crate) fn octahedral(n: Vec3) -> u32 {
    let sum = n.x.abs() + n.y.abs() + n.z.abs();
    if !(sum > 0.0 && sum < f32::INFINITY) {
        return NO_NORMAL;
    }
    let p = Vec2::new(n.x, n.y) / sum;
    let folded = (Vec2::ONE - Vec2::new(p.y, p.x).abs())
        * Vec2::new(if p.x >= 0.0 { 1.0 } else { -1.0 }, if p.y >= 0.0 { 1.0 } else { -1.0 });
    let e = if n.z >= 0.0 { p } else { folded };
    let snorm = |x: f32| u32::from((x.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
    snorm(e.x) | snorm(e.y) << 16
}

/// A tangent, stored like a normal, with the bitangent's sign in the lowest bit.
fn tangent(t: Vec4) -> u32 {
    let word = octahedral(t.truncate());
    if word == NO_NORMAL {
        return word;
    }
    (word & !1) | u32::from(t.w >= 0.0)
}

fn halves(low: f32, high: f32) -> u32 {
    let bits = |x: f32| u32::from(half::f16::from_f32(x).to_bits());
    bits(low) | bits(high) << 16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh(triangles: usize) -> Mesh {
        Mesh {
            positions: (0..triangles + 2).map(|i| Vec3::new(i as f32, (i % 2) as f32, 0.0)).collect(),
            indices: (0..triangles as u32).flat_map(|i| [i, i + 1, i + 2]).collect(),
            ..Mesh::default()
        }
    }

    #[test]
    fn chunks_cover_all_triangles_and_hold_their_corners() {
        let mesh = mesh(3 * CHUNK_TRIANGLES + 7);
        let mut arena = Arena::default();
        let run = arena.push(&mesh, true, false);
        assert_eq!(run.chunks.iter().map(|c| c.triangles as usize).sum::<usize>(), mesh.triangles());
        for chunk in &run.chunks {
            let first = 3 * chunk.first_triangle as usize;
            for &i in &mesh.indices[first..first + 3 * chunk.triangles as usize] {
                let from_middle = (mesh.positions[i as usize].as_dvec3() - chunk.middle).abs();
                assert!(from_middle.cmple(chunk.half).all());
            }
        }
    }

    #[test]
    fn a_corner_that_is_not_finite_takes_its_triangles_away_and_no_others() {
        let mut mesh = mesh(4);
        mesh.positions[0].y = f32::NAN;
        let mut arena = Arena::default();
        let run = arena.push(&mesh, true, false);
        assert_eq!(arena.indices[..3], [0, 0, 0]);
        assert_eq!(arena.indices[3..], mesh.indices[3..]);
        let finite = |v: &[u32; 4]| v[..3].iter().all(|&x| f32::from_bits(x).is_finite());
        assert!(arena.vertices.iter().all(finite));
        assert_eq!(run.whole.triangles, 4, "numbers of triangles do not move");
    }

    #[test]
    fn unit_vectors_survive_their_encoding() {
        let decode = |word: u32| {
            let e = [word as u16, (word >> 16) as u16].map(|x| f32::from(x as i16) / 32767.0);
            let z = 1.0 - e[0].abs() - e[1].abs();
            let fold = |a: f32, b: f32| if z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
            Vec3::new(fold(e[0], e[1]), fold(e[1], e[0]), z).normalize()
        };
        for v in [Vec3::X, Vec3::NEG_Z, Vec3::new(0.3, -0.8, -0.2), Vec3::new(-1.0, 1.0, 1.0)] {
            let v = v.normalize();
            assert!((decode(octahedral(v)) - v).length() < 6e-5, "{v}");
            for sign in [1.0, -1.0] {
                let word = tangent(v.extend(sign));
                assert_eq!(word & 1 == 1, sign > 0.0);
                assert!((decode(word) - v).length() < 1.2e-4, "{v}");
            }
        }
        assert_eq!(octahedral(Vec3::ZERO), NO_NORMAL);
        assert_eq!(octahedral(Vec3::NAN), NO_NORMAL);
    }
}
