//! What rays meet: triangles of meshes in trees, and the instances that place them.

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};

use super::boxes::BoxTree;
use super::corners::triangle_indices;
use crate::{Bounds, Instance, Mesh, Pose, Scene};

/// Triangles of one mesh in the order of their tree, so that a leaf's triangles are adjacent.
pub(super) struct MeshTree {
    pub(super) tree: BoxTree,
    pub(super) corners: Vec<[Vec3; 3]>,
    pub(super) triangles: Vec<u32>,
}

/// An instance whose transform can be inverted.
pub(super) struct Placed {
    pub(super) instance: u32,
    pub(super) mesh: u32,
    /// Directions, and positions relative to `translation`, to mesh space.
    pub(super) mesh_from_world: DMat3,
    pub(super) translation: DVec3,
    pub(super) origin: DVec3,
    pub(super) culled: bool,
    pub(super) passes_light: bool,
    pub(super) passes_light_in_parts: bool,
    pub(super) cutoff: Option<f32>,
}

/// The instances that can be seen, in the order of their hierarchy.
pub(super) fn place(scene: &Scene, pose: &Pose, boxes: &[Bounds]) -> (Vec<Placed>, BoxTree) {
    let (boxes, unordered): (Vec<Bounds>, Vec<Placed>) = (0u32..)
        .zip(&pose.instances)
        .filter_map(|(index, instance)| {
            let placed = Placed::new(scene, index, instance)?;
            let bounds = placed_bounds(scene, instance, boxes[instance.mesh as usize])?;
            Some((bounds, placed))
        })
        .unzip();
    let top = BoxTree::new(&boxes, 1);
    let mut unordered: Vec<_> = unordered.into_iter().map(Some).collect();
    let placed = top.order().iter().filter_map(|&i| unordered[i as usize].take()).collect();
    (placed, top)
}

/// A triangle costs about as much as a box: obvhs' own choice for its "medium" build.
const TRIANGLES_A_LEAF: u32 = 8;

impl MeshTree {
    /// The triangles that can be seen, and their box; none if not `used`.
    pub(super) fn new(mesh: &Mesh, used: bool) -> (Arc<Self>, Bounds) {
        let count = if used { mesh.triangles() as u32 } else { 0 };
        let mut all = Bounds::EMPTY;
        let (mut boxes, mut corners, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for triangle in 0..count {
            let indices = triangle_indices(mesh, triangle);
            let [Some(a), Some(b), Some(c)] = indices.map(|i| mesh.positions.get(i as usize).copied()) else {
                continue;
            };
            let area = (b - a).as_dvec3().cross((c - a).as_dvec3());
            if !(a.is_finite() && b.is_finite() && c.is_finite() && area != DVec3::ZERO) {
                continue;
            }
            let bounds = Bounds { min: a.min(b).min(c).as_dvec3(), max: a.max(b).max(c).as_dvec3() };
            all.extend(bounds.min);
            all.extend(bounds.max);
            boxes.push(bounds);
            corners.push([a, b, c]);
            triangles.push(triangle);
        }
        let tree = BoxTree::new(&boxes, TRIANGLES_A_LEAF);
        let corners = tree.order().iter().map(|&i| corners[i as usize]).collect();
        let triangles = tree.order().iter().map(|&i| triangles[i as usize]).collect();
        (Arc::new(Self { tree, corners, triangles }), all)
    }
}

impl Placed {
    fn new(scene: &Scene, index: u32, instance: &Instance) -> Option<Self> {
        let mesh = &scene.meshes[instance.mesh as usize];
        let material = &scene.materials[mesh.material as usize];
        let mesh_from_world = instance.world_from_mesh.matrix3.inverse();
        let translation = instance.world_from_mesh.translation;
        let usable = mesh_from_world.is_finite() && translation.is_finite() && mesh.origin.is_finite();
        usable.then_some(Self {
            instance: index,
            mesh: instance.mesh,
            mesh_from_world,
            translation,
            origin: mesh.origin,
            culled: !material.double_sided,
            passes_light: material.passes_light(),
            passes_light_in_parts: material.passes_light_in_parts(),
            cutoff: material.alpha_cutoff(),
        })
    }
}

/// Coordinates beyond this, metres, are not seen: their squares would overflow.
const FARTHEST: f64 = 1e150;

/// The world's box of a placed mesh's box; `None` if it is empty or reaches beyond [`FARTHEST`].
fn placed_bounds(scene: &Scene, instance: &Instance, in_mesh: Bounds) -> Option<Bounds> {
    if in_mesh.is_empty() {
        return None;
    }
    let origin = scene.meshes[instance.mesh as usize].origin;
    let mut bounds = Bounds::EMPTY;
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { in_mesh.min[axis] } else { in_mesh.max[axis] };
        let point = DVec3::new(pick(0), pick(1), pick(2));
        let placed = instance.world_from_mesh.transform_point3(origin + point);
        // A NaN is not within the limit either.
        if !placed.abs().cmple(DVec3::splat(FARTHEST)).all() {
            return None;
        }
        bounds.extend(placed);
    }
    Some(bounds)
}
