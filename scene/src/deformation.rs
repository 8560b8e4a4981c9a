//! Meshes whose vertices move: by morph targets, by the joints of a skin, and by transforms that flatten them.
//!
//! A [`Deformation`] keeps the mesh's shape at rest, and [`crate::Scene::posed`] makes the scene whose meshes have their shapes
//! of a time. Targets are added first, then joints move the vertices (glTF 2.0, sections 3.7.2.2 and 3.7.3.3). The
//! vertices of a skinned mesh are in world space, so its node does not move it. A transform without an inverse would
//! leave an instance without rays and normals. So the vertices of a mesh under such a transform are in world space, too.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec3, Vec4};

use crate::Bounds;
#[cfg(feature = "loaders")]
use crate::animation::{Animation, Node, Rest, Track};

/// A transform is flat if its determinant is at most this share of the cube of its size (Frobenius norm).
const FLAT: f64 = 1e-6;

/// How the vertices of a mesh move. The mesh has one instance.
#[derive(Debug, Clone, PartialEq)]
pub struct Deformation {
    /// The vertices before anything moves them, mesh space.
    pub rest: Shape,
    /// Index into [`crate::Scene::nodes`] of the node whose channels drive the weights of targets.
    pub node: u32,
    /// Displacements of vertices.
    pub targets: Vec<MorphTarget>,
    /// Weight of each target without a channel.
    pub weights: Vec<f32>,
    /// Joints that move the vertices.
    pub skin: Option<Skin>,
    /// Whether the node's transform may be flat.
    pub flattens: bool,
    /// Whether the file has no normals, so that each triangle has the normal of its plane at all times.
    pub flat_normals: bool,
}

/// What moves of a mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Shape {
    /// As [`crate::Mesh::origin`].
    pub origin: DVec3,
    /// As [`crate::Mesh::positions`].
    pub positions: Vec<Vec3>,
    /// As [`crate::Mesh::normals`].
    pub normals: Vec<Vec3>,
    /// As [`crate::Mesh::tangents`].
    pub tangents: Vec<Vec4>,
}

/// Displacements of a mesh's vertices: one per vertex, or none of a kind.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MorphTarget {
    /// Metres.
    pub positions: Vec<Vec3>,
    /// Added to normals.
    pub normals: Vec<Vec3>,
    /// Added to the directions of tangents.
    pub tangents: Vec<Vec3>,
}

/// Joints, and their influence on vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct Skin {
    /// The joints.
    pub joints: Arc<Vec<Joint>>,
    /// For each vertex the index of its first influence, and at the end their number.
    pub first: Vec<u32>,
    /// Index into `joints`, and weight. The weights of a vertex sum to 1. A vertex without any stays at rest.
    pub influences: Vec<(u16, f32)>,
}

/// A node that moves vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joint {
    /// Index into [`crate::Scene::nodes`].
    pub node: u32,
    /// The inverse of its transform at which the mesh was bound to it.
    pub joint_from_mesh: DAffine3,
}

impl Skin {
    /// The joints of a vertex, each with its weight.
    pub(crate) fn influences_of(&self, vertex: usize) -> &[(u16, f32)] {
        let at = |i: usize| self.first.get(i).map_or(0, |&first| first as usize);
        self.influences.get(at(vertex)..at(vertex + 1)).unwrap_or_default()
    }
}

/// Whether a transform leaves too little thickness for an inverse in f32.
pub(crate) fn is_flat(linear: &DMat3) -> bool {
    let size = linear.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
    // Written so that NaN is flat.
    !(linear.determinant().abs() > FLAT * size * size * size)
}

/// For each node, whether it or a node above may be flattened, by its own transform or by a channel of any animation.
/// A scale of zero on all axes hides a thing, which needs no shape.
#[cfg(feature = "loaders")]
pub(crate) fn flattening(nodes: &[Node], animations: &[Animation]) -> Vec<bool> {
    let thin =
        |scale: DVec3| scale.abs().min_element() <= FLAT * scale.abs().max_element() && scale != DVec3::ZERO;
    let mut flat: Vec<bool> = nodes
        .iter()
        .map(|node| match &node.rest {
            Rest::Parts(parts) => thin(parts.scale),
            Rest::Matrix(matrix) => is_flat(&matrix.matrix3) && matrix.matrix3 != DMat3::ZERO,
        })
        .collect();
    for channel in animations.iter().flat_map(|animation| &animation.channels) {
        let (Track::Scale(scales), Some(flat)) = (&channel.track, flat.get_mut(channel.node as usize)) else {
            continue;
        };
        // One axis passes through zero between two keys; all three at once hide a thing for a moment.
        let passes = |pair: &[Vec3]| {
            let turned = (pair[0] * pair[1]).cmplt(Vec3::ZERO);
            turned.any() && !turned.all()
        };
        *flat |= scales.iter().any(|scale| thin(scale.as_dvec3())) || scales.windows(2).any(passes);
    }
    for (index, node) in nodes.iter().enumerate() {
        flat[index] |= node.parent.is_some_and(|parent| flat[parent as usize]);
    }
    flat
}

/// The transform of areas: of normals, up to their length. Unlike the inverse transpose, it exists for flat transforms.
fn cofactors(m: &DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

impl Deformation {
    /// Whether the vertices are in world space under this transform of the node.
    pub(crate) fn is_in_world(&self, world_from_node: &DAffine3) -> bool {
        self.skin.is_some() || (self.flattens && is_flat(&world_from_node.matrix3))
    }

    /// The shape of a mesh with these triangles, when its nodes are at `world` and its targets have `weights`.
    pub(crate) fn shape(&self, indices: &[u32], world: &[DAffine3], weights: &[f32]) -> Shape {
        let node = world.get(self.node as usize).copied().unwrap_or(DAffine3::IDENTITY);
        let mut shape = self.morphed(weights);
        match &self.skin {
            Some(skin) => {
                let place = |joint: &Joint| {
                    let world_from_joint = world.get(joint.node as usize).copied().unwrap_or_default();
                    world_from_joint * joint.joint_from_mesh
                };
                let joints: Vec<DAffine3> = skin.joints.iter().map(place).collect();
                move_vertices(&mut shape, |vertex| blended(&joints, skin.influences_of(vertex)));
            }
            None if self.is_in_world(&node) => move_vertices(&mut shape, |_| node),
            None => {}
        }
        if self.flat_normals {
            level(&mut shape, indices);
        }
        shape
    }

    /// The shape at rest with its targets added. A displacement that overflows is left out.
    fn morphed(&self, weights: &[f32]) -> Shape {
        let mut shape = self.rest.clone();
        for (target, &weight) in self.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            let add = |to: Vec3, by: Vec3| Some(to + by * weight).filter(|sum| sum.is_finite()).unwrap_or(to);
            for (to, &by) in shape.positions.iter_mut().zip(&target.positions) {
                *to = add(*to, by);
            }
            for (to, &by) in shape.normals.iter_mut().zip(&target.normals) {
                *to = add(*to, by);
            }
            for (to, &by) in shape.tangents.iter_mut().zip(&target.tangents) {
                *to = add(to.truncate(), by).extend(to.w);
            }
        }
        if !self.targets.is_empty() {
            for (normal, rest) in shape.normals.iter_mut().zip(&self.rest.normals) {
                *normal = normal.try_normalize().unwrap_or(*rest);
            }
            for (tangent, rest) in shape.tangents.iter_mut().zip(&self.rest.tangents) {
                *tangent = tangent.truncate().try_normalize().map_or(*rest, |unit| unit.extend(tangent.w));
            }
        }
        shape
    }

    /// The box of a vertex under all weights that lie between `least` and `most`, mesh space.
    pub(crate) fn reach(&self, vertex: usize, least: &[f32], most: &[f32]) -> Bounds {
        let at = self.rest.origin + self.rest.positions[vertex].as_dvec3();
        let mut reach = Bounds { min: at, max: at };
        for ((target, &least), &most) in self.targets.iter().zip(least).zip(most) {
            let by = target.positions.get(vertex).map_or(DVec3::ZERO, |by| by.as_dvec3());
            let (a, b) = (by * f64::from(least), by * f64::from(most));
            reach = Bounds { min: reach.min + a.min(b), max: reach.max + a.max(b) };
        }
        reach
    }
}

/// The weighted mean of joints' transforms (linear blend skinning); the identity without influences.
fn blended(joints: &[DAffine3], influences: &[(u16, f32)]) -> DAffine3 {
    if influences.is_empty() {
        return DAffine3::IDENTITY;
    }
    let mut sum = DAffine3::ZERO;
    for &(joint, weight) in influences {
        let (joint, weight) =
            (joints.get(usize::from(joint)).copied().unwrap_or_default(), f64::from(weight));
        sum.matrix3 += joint.matrix3 * weight;
        sum.translation += joint.translation * weight;
    }
    sum
}

/// Moves vertices to world space, about an origin in their middle. A vertex that overflows is at the origin.
fn move_vertices(shape: &mut Shape, world_from_mesh: impl Fn(usize) -> DAffine3) {
    let mut bounds = Bounds::EMPTY;
    let mut moved = Vec::with_capacity(shape.positions.len());
    for (vertex, position) in shape.positions.iter().enumerate() {
        let by = world_from_mesh(vertex);
        let position = by.transform_point3(shape.origin + position.as_dvec3());
        bounds.extend(position);
        moved.push(position);
        if let Some(normal) = shape.normals.get_mut(vertex) {
            // A mirrored surface keeps its front (glTF 2.0, section 3.7.2.1).
            let sign = if by.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 };
            let turned = (cofactors(&by.matrix3) * normal.as_dvec3()).try_normalize();
            *normal = turned.map_or(*normal, |turned| (turned * sign).as_vec3());
        }
        if let Some(tangent) = shape.tangents.get_mut(vertex) {
            let turned = (by.matrix3 * tangent.truncate().as_dvec3()).try_normalize();
            *tangent = turned.map_or(*tangent, |turned| turned.as_vec3().extend(tangent.w));
        }
    }
    let center = bounds.center();
    shape.origin = if center.is_finite() { center } else { DVec3::ZERO };
    for (to, position) in shape.positions.iter_mut().zip(moved) {
        *to = Some((position - shape.origin).as_vec3()).filter(|p| p.is_finite()).unwrap_or(Vec3::ZERO);
    }
}

/// Gives triangles that share no vertices the normals of their planes. Those without an area keep theirs.
fn level(shape: &mut Shape, indices: &[u32]) {
    for triangle in indices.as_chunks::<3>().0 {
        let [a, b, c] = triangle.map(|i| shape.positions[i as usize].as_dvec3());
        if let Some(normal) = (b - a).cross(c - a).try_normalize() {
            triangle.iter().for_each(|&i| shape.normals[i as usize] = normal.as_vec3());
        }
    }
}
