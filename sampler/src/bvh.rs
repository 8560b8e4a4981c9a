//! Two-level bounding volume hierarchies (BVHs) over the scene, for the tracers.
//!
//! An [`Object`] is a tree of triangles, a [`PlacedObject`] is an instance of one, and a top-level tree finds the placed
//! objects that a ray may hit. Static meshes with one instance, or with cheap copies, are merged into one object in world
//! axes relative to an origin of its own. The meshes of a building overlap, so a ray would otherwise enter most of them.
//! Meshes that move or deform, or have many instances, are objects of their own. Those that deform get new trees with
//! each pose.
//!
//! obvhs builds the trees (its "medium" build: PLOC, then reinsertion). Boxes of triangles contain the f32 corners exactly.
//! Boxes of placed objects are f64 in world space. [`Hierarchy::top_about`] rounds them outwards to f32 relative to an eye,
//! so positions far from the world's origin lose no precision.

use std::collections::BTreeMap;

use argus_scene::Scene;
use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use rayon::prelude::*;

use crate::resident::{Cull, Placement};

/// Most triangles that copies of one mesh may add to the merged object.
const MAX_COPIED_TRIANGLES: usize = 1 << 16;
/// Most triangles of a leaf.
const LEAF_TRIANGLES: u32 = 8;

/// Bits of [`Triangle::flags`].
pub(crate) mod flags {
    /// Not visible from behind. Seen from there, the stored corners are in clockwise order.
    pub(crate) const ONE_SIDED: u32 = 1;
    /// Alpha-tested: a hit counts only if alpha reaches the material's cutoff.
    pub(crate) const CUTOUT: u32 = 2;
    /// The second and third corner are exchanged, because the instance's transform mirrors.
    pub(crate) const MIRRORED: u32 = 4;
    /// Rays of light pass ([`argus_scene::Material::passes_light`]); rays of sight do not.
    pub(crate) const GLASS: u32 = 8;
    /// Rays of light pass where the transmission texture says so ([`argus_scene::Material::passes_light_in_parts`]).
    pub(crate) const GLASS_IN_PARTS: u32 = 16;
}

/// [`Triangle::instance`] of a triangle whose instance is [`PlacedObject::instance`].
pub(crate) const OF_OBJECT: u32 = u32::MAX;

/// A triangle in the tracers' layout.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Triangle {
    /// First corner, in the object's space.
    pub(crate) a: [f32; 3],
    /// Index into [`Scene::instances`], or [`OF_OBJECT`].
    pub(crate) instance: u32,
    /// Second corner.
    pub(crate) b: [f32; 3],
    /// Index of the triangle within its mesh.
    pub(crate) primitive: u32,
    /// Third corner.
    pub(crate) c: [f32; 3],
    /// Bits of [`flags`].
    pub(crate) flags: u32,
}

/// A node of a tree of triangles, or of the top-level tree relative to an eye. A leaf if `count` is not 0.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Node {
    /// Smallest coordinates.
    pub(crate) min: [f32; 3],
    /// Number of triangles of a leaf; 0 for an inner node.
    pub(crate) count: u32,
    /// Largest coordinates.
    pub(crate) max: [f32; 3],
    /// Inner node: index of the first of its two children in [`Hierarchy::nodes`], or in the list of the top-level tree.
    /// Leaf: index of its first triangle in [`Hierarchy::triangles`], or of its object in [`Hierarchy::placed`].
    pub(crate) first: u32,
}

/// A tree of triangles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Object {
    /// Index of its root in [`Hierarchy::nodes`].
    pub(crate) root: u32,
    /// Edges from the root to the deepest leaf. The stack of a traversal that pushes both children of a node and pops one
    /// has at most `depth + 1` entries.
    #[allow(dead_code, reason = "bounds the stack of the tracer on the device")]
    pub(crate) depth: u32,
    /// Number of its triangles.
    pub(crate) triangles: u32,
    /// Bounding box of its triangles: smallest coordinates.
    min: DVec3,
    /// Largest coordinates of the box.
    max: DVec3,
}

/// An object with its transform from world space.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlacedObject {
    /// Index into [`Hierarchy::objects`].
    pub(crate) object: u32,
    /// Index into [`Scene::instances`]; [`OF_OBJECT`] for the merged object, whose triangles have their own.
    pub(crate) instance: u32,
    /// Linear part of the transform from world space to the object's space.
    pub(crate) object_from_world: DMat3,
    /// Position of the object's origin in world space.
    pub(crate) origin: DVec3,
}

/// A node of the top-level tree, in world space. The fields are those of [`Node`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct TopNode {
    min: DVec3,
    max: DVec3,
    count: u32,
    first: u32,
}

impl TopNode {
    /// The node relative to an eye: see [`Hierarchy::top_about`].
    pub(crate) fn about(&self, eye: DVec3) -> Node {
        let (min, max) = box_about(eye, self.min, self.max);
        Node { min, max, count: self.count, first: self.first }
    }
}

/// The two-level hierarchy that tracers traverse.
pub(crate) struct Hierarchy {
    /// Nodes of all objects, one tree after another.
    pub(crate) nodes: Vec<Node>,
    /// Triangles of all objects, leaf by leaf.
    pub(crate) triangles: Vec<Triangle>,
    pub(crate) objects: Vec<Object>,
    /// Placed objects, in the order of the top-level tree's leaves. Each leaf has one.
    pub(crate) placed: Vec<PlacedObject>,
    /// Edges from the top-level tree's root to its deepest leaf.
    #[allow(dead_code, reason = "bounds the stack of the tracer on the device")]
    pub(crate) top_depth: u32,
    pub(crate) top: Vec<TopNode>,
    /// For each instance, whether it is part of the merged object.
    merged: Vec<bool>,
    merged_object: Option<PlacedObject>,
    /// Object of each mesh that is not merged; `None` for a mesh without triangles.
    object_of_mesh: BTreeMap<u32, Option<u32>>,
    /// Number of nodes, triangles and objects of meshes that keep their shapes. Those of others are behind them.
    lasting: [usize; 3],
    /// Counts changes of objects.
    pub(crate) version: u64,
}

impl Hierarchy {
    /// Builds the hierarchy over the visible instances, on all threads of rayon.
    pub(crate) fn new(scene: &Scene, placements: &[Placement]) -> Self {
        let moving = moving_nodes(scene);
        let deforming = scene.deforming_meshes();
        let mut copies = vec![0usize; scene.meshes.len()];
        placements.iter().for_each(|p| copies[p.mesh as usize] += 1);
        let merges = |p: &Placement| {
            let node = scene.instances[p.instance as usize].node;
            let moves = node.is_some_and(|node| moving.get(node as usize).copied().unwrap_or(false));
            let added = (copies[p.mesh as usize] - 1) * scene.meshes[p.mesh as usize].triangles();
            !moves && !deforming[p.mesh as usize] && added <= MAX_COPIED_TRIANGLES
        };
        let merged: Vec<Placement> = placements.iter().copied().filter(|p| merges(p)).collect();
        let origin = middle(scene, &merged);
        let all: Vec<Vec<Triangle>> = merged.par_iter().map(|p| world_triangles(scene, p, origin)).collect();
        let mut hierarchy = Self {
            nodes: Vec::new(),
            triangles: Vec::new(),
            objects: Vec::new(),
            placed: Vec::new(),
            top_depth: 0,
            top: Vec::new(),
            merged: vec![false; scene.instances.len()],
            merged_object: None,
            object_of_mesh: BTreeMap::new(),
            lasting: [0; 3],
            version: 0,
        };
        merged.iter().for_each(|p| hierarchy.merged[p.instance as usize] = true);
        hierarchy.merged_object = hierarchy.push(Tree::new(all.concat())).map(|object| PlacedObject {
            object,
            instance: OF_OBJECT,
            object_from_world: DMat3::IDENTITY,
            origin,
        });
        hierarchy.lasting = hierarchy.lengths();
        hierarchy.pose(scene, placements);
        hierarchy
    }

    /// The mesh of each object; `None` for the merged one.
    pub(crate) fn meshes(&self) -> Vec<Option<u32>> {
        let mut meshes = vec![None; self.objects.len()];
        for (&mesh, object) in &self.object_of_mesh {
            if let Some(object) = object {
                meshes[*object as usize] = Some(mesh);
            }
        }
        meshes
    }

    /// Numbers of nodes, triangles and objects.
    fn lengths(&self) -> [usize; 3] {
        [self.nodes.len(), self.triangles.len(), self.objects.len()]
    }

    /// Moves the instances of a posed scene that are not merged, and rebuilds the top-level tree and the trees of meshes that
    /// deform. `placements`: all visible instances.
    pub(crate) fn pose(&mut self, scene: &Scene, placements: &[Placement]) {
        let deforming = scene.deforming_meshes();
        let [nodes, triangles, objects] = self.lasting;
        self.nodes.truncate(nodes);
        self.triangles.truncate(triangles);
        self.objects.truncate(objects);
        self.object_of_mesh.retain(|&mesh, _| !deforming[mesh as usize]);
        let apart = || placements.iter().filter(|p| !self.merged[p.instance as usize]);
        // Meshes without a tree: all of them at first; later those that a scale of zero hid until now.
        let mut missing: BTreeMap<u32, &Placement> = apart().map(|p| (p.mesh, p)).collect();
        missing.retain(|mesh, _| !self.object_of_mesh.contains_key(mesh));
        let mut missing: Vec<(u32, &Placement)> = missing.into_iter().collect();
        missing.sort_by_key(|&(mesh, _)| deforming[mesh as usize]);
        self.version += u64::from(!missing.is_empty());
        let trees: Vec<(u32, Tree)> =
            missing.par_iter().map(|&(mesh, p)| (mesh, Tree::new(own_triangles(scene, p)))).collect();
        for (mesh, tree) in trees {
            // `None` for a mesh without triangles.
            let object = self.push(tree);
            self.object_of_mesh.insert(mesh, object);
            if !deforming[mesh as usize] {
                self.lasting = self.lengths();
            }
        }
        let mut placed: Vec<PlacedObject> = self.merged_object.into_iter().collect();
        for p in placements.iter().filter(|p| !self.merged[p.instance as usize]) {
            if let Some(&Some(object)) = self.object_of_mesh.get(&p.mesh) {
                let object_from_world = p.mesh_from_world;
                placed.push(PlacedObject {
                    object,
                    instance: p.instance,
                    object_from_world,
                    origin: p.origin,
                });
            }
        }
        self.place(placed);
    }

    /// Builds the top-level tree over placed objects.
    fn place(&mut self, placed: Vec<PlacedObject>) {
        let boxes: Vec<(DVec3, DVec3)> = placed.iter().map(|p| self.world_box(p)).collect();
        let (min, max) = around(boxes.iter().copied());
        let (center, scale) = ((min + max) * 0.5, (max - min).max_element().max(2.0_f64.powi(-500)).recip());
        let unit = |p: DVec3| Vec3A::from(((p - center) * scale).as_vec3());
        let rough: Vec<Aabb> = boxes.iter().map(|&(min, max)| Aabb::new(unit(min), unit(max))).collect();
        let bvh = build(&rough, 1);
        self.top_depth = bvh.max_depth as u32;
        let mut order = Vec::with_capacity(placed.len());
        let mut top: Vec<TopNode> = Vec::with_capacity(bvh.nodes.len());
        for node in &bvh.nodes {
            let (mut first, mut around_node) = (node.first_index, (DVec3::INFINITY, DVec3::NEG_INFINITY));
            if node.is_leaf() {
                let which = bvh.primitive_indices[node.first_index as usize] as usize;
                first = order.len() as u32;
                around_node = boxes[which];
                order.push(placed[which]);
            }
            let (min, max) = around_node;
            top.push(TopNode { min, max, count: node.prim_count, first });
        }
        refit(&mut top);
        self.top = top;
        self.placed = order;
    }

    /// The top-level tree relative to `eye`; empty without visible instances. Boxes are padded by more than the rounding
    /// error of objects seen from there.
    pub(crate) fn top_about(&self, eye: DVec3) -> Vec<Node> {
        self.top.iter().map(|node| node.about(eye)).collect()
    }

    /// Calls `visit` with each placed object whose box a ray hits. `visit` returns the largest distance that is still of
    /// interest, in units of the direction. `inverse`: inverse of the ray's direction, by component.
    pub(crate) fn visit_top(
        &self,
        origin: DVec3,
        inverse: DVec3,
        mut visit: impl FnMut(&PlacedObject) -> f64,
    ) {
        let mut limit = f64::INFINITY;
        let mut pending = vec![0u32];
        while let Some(node) = pending.pop().and_then(|index| self.top.get(index as usize)) {
            let (a, b) = ((node.min - origin) * inverse, (node.max - origin) * inverse);
            // The rounding error of world boxes, which are made of transformed corners, exceeds that of the test.
            let slack = (node.min.abs().max(node.max.abs()) * inverse.abs()).max_element() * 1e-12;
            let (from, to) = (a.min(b).max_element() - slack, a.max(b).min_element() + slack);
            if !(from <= to && to >= 0.0 && from <= limit) {
                continue;
            }
            if node.count == 0 {
                pending.extend([node.first, node.first + 1]);
                continue;
            }
            for placed in &self.placed[node.first as usize..(node.first + node.count) as usize] {
                limit = visit(placed);
            }
        }
    }

    /// The bounding box of a placed object in world space.
    pub(crate) fn world_box(&self, placed: &PlacedObject) -> (DVec3, DVec3) {
        let object = &self.objects[placed.object as usize];
        let world_from_object = placed.object_from_world.inverse();
        let corners = (0..8).map(|i| {
            let pick = |axis: usize| if i >> axis & 1 == 0 { object.min[axis] } else { object.max[axis] };
            placed.origin + world_from_object * DVec3::new(pick(0), pick(1), pick(2))
        });
        around(corners.map(|corner| (corner, corner)))
    }

    /// Appends a tree as an object. Returns its index, or `None` if the tree is empty.
    fn push(&mut self, tree: Tree) -> Option<u32> {
        let root = tree.nodes.first()?;
        let vector = |v: [f32; 3]| Vec3::from_array(v).as_dvec3();
        let (min, max) = (vector(root.min), vector(root.max));
        let (first_node, first_triangle) = (self.nodes.len() as u32, self.triangles.len() as u32);
        let triangles = tree.triangles.len() as u32;
        self.objects.push(Object { root: first_node, depth: tree.depth, triangles, min, max });
        self.nodes.extend(tree.nodes.into_iter().map(|node| {
            let first = node.first + if node.count == 0 { first_node } else { first_triangle };
            Node { first, ..node }
        }));
        self.triangles.extend(tree.triangles);
        Some(self.objects.len() as u32 - 1)
    }
}

/// The tree of one object, with indices from 0.
struct Tree {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
    depth: u32,
}

impl Tree {
    /// Builds a tree over triangles.
    fn new(triangles: Vec<Triangle>) -> Self {
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
fn build(boxes: &[Aabb], leaf_size: u32) -> Bvh2 {
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

/// Sets the boxes of inner nodes from those of their children.
fn refit(top: &mut [TopNode]) {
    // Children may be before or after their parent. So inner nodes are listed from the root, and set in reverse order.
    let mut order = Vec::with_capacity(top.len());
    let mut pending = vec![0u32];
    while let Some(index) = pending.pop() {
        if let Some(node) = top.get(index as usize).filter(|node| node.count == 0) {
            order.push(index as usize);
            pending.extend([node.first, node.first + 1]);
        }
    }
    for index in order.into_iter().rev() {
        let children = top[index].first as usize..top[index].first as usize + 2;
        let (min, max) = around(top[children].iter().map(|child| (child.min, child.max)));
        (top[index].min, top[index].max) = (min, max);
    }
}

/// A box of the world relative to `eye`, padded by more than the rounding error of objects seen from there.
pub(crate) fn box_about(eye: DVec3, min: DVec3, max: DVec3) -> ([f32; 3], [f32; 3]) {
    let (min, max) = (min - eye, max - eye);
    let slack = min.abs().max(max.abs()).max_element() * f64::from(f32::EPSILON) * 8.0;
    let below = |x: f64| ((x - slack) as f32).next_down().max(f32::MIN);
    let above = |x: f64| ((x + slack) as f32).next_up().min(f32::MAX);
    (min.to_array().map(below), max.to_array().map(above))
}

/// The box around boxes.
fn around(boxes: impl Iterator<Item = (DVec3, DVec3)>) -> (DVec3, DVec3) {
    boxes.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), b| (min.min(b.0), max.max(b.1)))
}

/// The centre of the bounding box of instances, in world space.
fn middle(scene: &Scene, placements: &[Placement]) -> DVec3 {
    let boxes = placements.par_iter().map(|p| {
        let positions = scene.meshes[p.mesh as usize].positions.iter().filter(|p| p.is_finite());
        around(positions.map(|v| p.origin + p.world_from_mesh * v.as_dvec3()).map(|v| (v, v)))
    });
    let (min, max) = around(boxes.collect::<Vec<_>>().into_iter());
    if min.cmple(max).all() { min + (max - min) * 0.5 } else { DVec3::ZERO }
}

/// The triangles of a mesh in mesh space.
fn own_triangles(scene: &Scene, placement: &Placement) -> Vec<Triangle> {
    triangles(scene, placement, OF_OBJECT, false, |p| p)
}

/// The triangles of an instance in world axes, relative to `origin`.
fn world_triangles(scene: &Scene, placement: &Placement, origin: DVec3) -> Vec<Triangle> {
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

/// For each node, whether an animation moves it or one of its ancestors.
fn moving_nodes(scene: &Scene) -> Vec<bool> {
    let mut moving = vec![false; scene.nodes.len()];
    for channel in scene.animations.iter().flat_map(|a| &a.channels) {
        if let Some(node) = moving.get_mut(channel.node as usize) {
            *node = true;
        }
    }
    for (index, node) in scene.nodes.iter().enumerate() {
        let parent = node.parent.and_then(|p| moving.get(p as usize).copied());
        moving[index] |= parent.unwrap_or(false);
    }
    moving
}
