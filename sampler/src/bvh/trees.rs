//! Trees of triangles, and the binary trees that they are built by.

use argus_scene::Scene;
use glam::{DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use rayon::prelude::*;

use super::nodes::{Node, OF_OBJECT, Triangle, flags};
use crate::resident::{Cull, Placement};

/// Most triangles of a leaf.
const LEAF_TRIANGLES: u32 = 8;

/// The tree of one object, with indices from 0.
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) triangles: Vec<Triangle>,
    pub(super) depth: u32,
}

impl Tree {
    /// Builds a tree over triangles.
    pub(super) fn new(triangles: Vec<Triangle>) -> Self {
        let boxes: Vec<Aabb> = triangles
            .par_iter()
            .map(|t| {
                let [a, b, c] = [t.a, t.b, t.c].map(Vec3A::from_array);
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let bvh = build(&boxes, LEAF_TRIANGLES);
        let nodes = bvh.nodes.iter().map(|n| {
            let (min, max) = (n.min.to_array(), n.max.to_array());
            Node { min, count: n.prim_count, max, first: n.first_index }
        });
        Self {
            nodes: nodes.collect(),
            triangles: bvh.primitive_indices.iter().map(|&i| triangles[i as usize]).collect(),
            depth: bvh.max_depth as u32,
        }
    }
}

/// Builds a binary tree over boxes, at most `leaf_size` per leaf. These are the steps of obvhs' "medium" build. Its own
/// function would also validate the tree if debug assertions are on, which takes longer than the build. `max_depth` is
/// exact.
pub(super) fn build(boxes: &[Aabb], leaf_size: u32) -> Bvh2 {
    if boxes.is_empty() {
        return Bvh2::default();
    }
    let params = BvhBuildParams::medium_build();
    let mut bvh = PlocBuilder::with_capacity(boxes.len()).build(
        params.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        params.sort_precision,
        params.search_depth_threshold,
    );
    let mut optimizer = ReinsertionOptimizer::default();
    let ratio = params.reinsertion_batch_ratio;
    optimizer.run(&mut bvh, ratio, None);
    collapse(&mut bvh, leaf_size, params.collapse_traversal_cost);
    optimizer.run(&mut bvh, ratio * params.post_collapse_reinsertion_batch_ratio_multiplier, None);
    bvh.reorder_in_stack_traversal_order();
    // Reinsertion can deepen the tree beyond the builder's `max_depth`.
    let mut deepest = 0;
    let mut pending = vec![(0, 0)];
    while let Some((index, depth)) = pending.pop() {
        deepest = deepest.max(depth);
        if let Some(node) = bvh.nodes.get(index as usize).filter(|node| !node.is_leaf()) {
            pending.extend([(node.first_index, depth + 1), (node.first_index + 1, depth + 1)]);
        }
    }
    bvh.max_depth = deepest;
    bvh
}

/// The triangles of a mesh in mesh space.
pub(super) fn own_triangles(scene: &Scene, placement: &Placement) -> Vec<Triangle> {
    triangles(scene, placement, OF_OBJECT, false, |p| p)
}

/// The triangles of an instance in world axes, relative to `origin`.
pub(super) fn world_triangles(scene: &Scene, placement: &Placement, origin: DVec3) -> Vec<Triangle> {
    let offset = placement.origin - origin;
    let mirrored = placement.world_from_mesh.determinant() < 0.0;
    triangles(scene, placement, placement.instance, mirrored, |p| {
        (offset + placement.world_from_mesh * p.as_dvec3()).as_vec3()
    })
}

/// The triangles of a mesh with finite corners and an area. `place` transforms each corner.
fn triangles(
    scene: &Scene,
    placement: &Placement,
    instance: u32,
    mirrored: bool,
    place: impl Fn(Vec3) -> Vec3,
) -> Vec<Triangle> {
    let mesh = &scene.meshes[placement.mesh as usize];
    let mut flags = 0;
    flags |= if placement.class.cull == Cull::None { 0 } else { flags::ONE_SIDED };
    flags |= if placement.class.cutout { flags::CUTOUT } else { 0 };
    flags |= if mirrored { flags::MIRRORED } else { 0 };
    let material = &scene.materials[mesh.material as usize];
    flags |= if material.passes_light() { flags::GLASS } else { 0 };
    flags |= if material.passes_light_in_parts() { flags::GLASS_IN_PARTS } else { 0 };
    let corner = |index: u32| mesh.positions.get(index as usize).map(|&p| place(p)).filter(|p| p.is_finite());
    let place = |(primitive, corners): (u32, &[u32; 3])| {
        let [a, b, c] = [corner(corners[0])?, corner(corners[1])?, corner(corners[2])?];
        let normal = (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3());
        if normal == DVec3::ZERO {
            return None;
        }
        let (b, c) = if mirrored { (c, b) } else { (b, c) };
        let [a, b, c] = [a, b, c].map(|p| p.to_array());
        Some(Triangle { a, instance, b, primitive, c, flags })
    };
    (0u32..).zip(mesh.indices.as_chunks::<3>().0).filter_map(place).collect()
}
