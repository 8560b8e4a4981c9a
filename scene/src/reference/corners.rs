//! A point of a triangle, at which a mesh's attributes are read.

use glam::DVec2;

use crate::Mesh;

/// Corners of a triangle, as indices into the mesh's attributes.
pub(super) fn triangle_indices(mesh: &Mesh, triangle: u32) -> [u32; 3] {
    let first = 3 * triangle as usize;
    [mesh.indices[first], mesh.indices[first + 1], mesh.indices[first + 2]]
}

/// A point on a triangle, at which attributes are read.
pub(super) struct Corners {
    pub(super) indices: [u32; 3],
    weights: [f32; 3],
}

impl Corners {
    pub(super) fn new(mesh: &Mesh, triangle: u32, barycentric: DVec2) -> Self {
        let weights = [1.0 - barycentric.x - barycentric.y, barycentric.x, barycentric.y];
        Self { indices: triangle_indices(mesh, triangle), weights: weights.map(|w| w as f32) }
    }

    /// The attribute at each corner; `None` if the mesh has no such attribute.
    pub(super) fn each<T: Copy>(&self, attribute: &[T]) -> Option<[T; 3]> {
        let [a, b, c] = self.indices.map(|i| attribute.get(i as usize).copied());
        Some([a?, b?, c?])
    }

    /// The attribute at the point; `None` if the mesh has no such attribute.
    pub(super) fn blend<T>(&self, attribute: &[T]) -> Option<T>
    where
        T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let [a, b, c] = self.each(attribute)?;
        Some(a * self.weights[0] + b * self.weights[1] + c * self.weights[2])
    }
}
