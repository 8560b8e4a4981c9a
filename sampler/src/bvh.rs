//! Hierarchies over the placed scene, for the tracers.
//!
//! Two levels: [`Object`]s hold triangles, [`PlacedObject`]s place them, and a top tree finds the placed objects
//! that a ray may meet. Meshes that are placed once and never move, or whose copies cost little, are merged into
//! one object in world axes about an origin of its own: the meshes of a building overlap, and a ray would enter
//! most of them. Meshes that are placed many times, or move, stay objects of their own.
//!
//! Trees come from obvhs (its "medium" build: PLOC, then reinsertion). Boxes of triangles are exact: the f32
//! corners are in them as they are. Boxes of placed objects are f64 in the world and are made f32 about an eye
//! ([`Hierarchy::top_about`]), outwards, so that an eye or a scene far from the world's zero loses nothing.

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
const MOST_COPIES: usize = 1 << 16;
/// Most triangles of a leaf.
const A_LEAF: u32 = 8;

/// A triangle's [`Triangle::flags`].
pub(crate) mod flags {
    /// Not seen from behind: where its corners, in the order that they are stored in, appear clockwise.
    pub(crate) const ONE_SIDED: u32 = 1;
    /// A hit counts only where alpha reaches the cutoff.
    pub(crate) const CUTOUT: u32 = 2;
    /// The second and third corner are exchanged, because the transform mirrors.
    pub(crate) const MIRRORED: u32 = 4;
}

/// [`Triangle::instance`] of a triangle whose object says it.
pub(crate) const OF_OBJECT: u32 = u32::MAX;

/// A triangle as tracers read it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Triangle {
    /// First corner, in the object's space.
    pub(crate) a: [f32; 3],
    /// Index into [`Scene::instances`], or [`OF_OBJECT`].
    pub(crate) instance: u32,
    /// Second corner.
    pub(crate) b: [f32; 3],
    /// Which triangle of its mesh.
    pub(crate) primitive: u32,
    /// Third corner.
    pub(crate) c: [f32; 3],
    /// See [`flags`].
    pub(crate) flags: u32,
}

/// A node of a tree of triangles, or of the top tree about an eye. A leaf if `count` is not 0.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Node {
    /// Smallest coordinates.
    pub(crate) min: [f32; 3],
    /// Triangles of a leaf; 0 for an inner node.
    pub(crate) count: u32,
    /// Largest coordinates.
    pub(crate) max: [f32; 3],
    /// Of an inner node: its first child in [`Hierarchy::nodes`] (of the top tree: in its own list), the second
    /// follows it. Of a leaf: its first triangle in [`Hierarchy::triangles`] (of the top tree: its placed object).
    pub(crate) first: u32,
}

/// A tree of triangles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Object {
    /// Its root in [`Hierarchy::nodes`].
    pub(crate) root: u32,
    /// Edges from the root to the deepest leaf: a traversal that pushes both children of a node and pops one
    /// holds at most one more than that.
    #[allow(dead_code, reason = "bounds the stack of the tracer on the device")]
    pub(crate) depth: u32,
    /// How many triangles it has.
    pub(crate) triangles: u32,
    /// Box around its triangles.
    min: DVec3,
    max: DVec3,
}

/// An object in the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlacedObject {
    /// Index into [`Hierarchy::objects`].
    pub(crate) object: u32,
    /// Index into [`Scene::instances`]; [`OF_OBJECT`] for the merged one, whose triangles say it.
    pub(crate) instance: u32,
    /// Directions and differences.
    pub(crate) object_from_world: DMat3,
    /// World space position of the object's zero.
    pub(crate) origin: DVec3,
}

/// A node of the top tree.
#[derive(Debug, Clone, Copy)]
struct TopNode {
    min: DVec3,
    max: DVec3,
    count: u32,
    first: u32,
}

/// What tracers traverse.
pub(crate) struct Hierarchy {
    /// Of all objects, one tree after another.
    pub(crate) nodes: Vec<Node>,
    /// Of all objects, leaf by leaf.
    pub(crate) triangles: Vec<Triangle>,
    pub(crate) objects: Vec<Object>,
    /// In the order of the top tree's leaves, one to a leaf.
    pub(crate) placed: Vec<PlacedObject>,
    /// As [`Object::depth`].
    #[allow(dead_code, reason = "bounds the stack of the tracer on the device")]
    pub(crate) top_depth: u32,
    top: Vec<TopNode>,
    /// Which instances are part of the merged object, which never moves.
    merged: Vec<bool>,
    merged_object: Option<PlacedObject>,
    /// The object of each mesh that has one of its own.
    object_of_mesh: BTreeMap<u32, Option<u32>>,
}

impl Hierarchy {
    /// Over the instances that can be seen, on all of rayon's threads.
    pub(crate) fn new(scene: &Scene, placements: &[Placement]) -> Self {
        let moving = moving_nodes(scene);
        let mut copies = vec![0usize; scene.meshes.len()];
        placements.iter().for_each(|p| copies[p.mesh as usize] += 1);
        let merges = |p: &Placement| {
            let node = scene.instances[p.instance as usize].node;
            let moves = node.is_some_and(|node| moving.get(node as usize).copied().unwrap_or(false));
            let added = (copies[p.mesh as usize] - 1) * scene.meshes[p.mesh as usize].triangles();
            !moves && added <= MOST_COPIES
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
        };
        merged.iter().for_each(|p| hierarchy.merged[p.instance as usize] = true);
        hierarchy.merged_object = hierarchy.push(Tree::new(all.concat())).map(|object| PlacedObject {
            object,
            instance: OF_OBJECT,
            object_from_world: DMat3::IDENTITY,
            origin,
        });
        hierarchy.pose(scene, placements);
        hierarchy
    }

    /// Puts what has an object of its own where it is now; `placements` are those of all that can be seen.
    pub(crate) fn pose(&mut self, scene: &Scene, placements: &[Placement]) {
        let apart = || placements.iter().filter(|p| !self.merged[p.instance as usize]);
        // Meshes that were never seen before: all of them at first, later those that a scale of zero hid.
        let mut missing: BTreeMap<u32, &Placement> = apart().map(|p| (p.mesh, p)).collect();
        missing.retain(|mesh, _| !self.object_of_mesh.contains_key(mesh));
        let missing: Vec<(u32, &Placement)> = missing.into_iter().collect();
        let trees: Vec<(u32, Tree)> =
            missing.par_iter().map(|&(mesh, p)| (mesh, Tree::new(own_triangles(scene, p)))).collect();
        for (mesh, tree) in trees {
            // A mesh without triangles is nowhere.
            let object = self.push(tree);
            self.object_of_mesh.insert(mesh, object);
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

    /// Builds the top tree over placed objects.
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
        widen(&mut top);
        self.top = top;
        self.placed = order;
    }

    /// The top tree, relative to `eye`; empty if there is nothing to see. Boxes are wider than what they hold by
    /// more than rounding moves an object that is seen from there.
    pub(crate) fn top_about(&self, eye: DVec3) -> Vec<Node> {
        let about = |node: &TopNode| {
            let (min, max) = box_about(eye, node.min, node.max);
            Node { min, max, count: node.count, first: node.first }
        };
        self.top.iter().map(about).collect()
    }

    /// Hands the placed objects whose boxes a ray meets to `visit`, which says how far along the ray anything is
    /// still of interest, in units of the direction; `inverse` is the direction's.
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
            // World boxes come from transformed corners, which rounding may move by more than the test does.
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

    /// The box around a placed object in the world.
    pub(crate) fn world_box(&self, placed: &PlacedObject) -> (DVec3, DVec3) {
        let object = &self.objects[placed.object as usize];
        let world_from_object = placed.object_from_world.inverse();
        let corners = (0..8).map(|i| {
            let pick = |axis: usize| if i >> axis & 1 == 0 { object.min[axis] } else { object.max[axis] };
            placed.origin + world_from_object * DVec3::new(pick(0), pick(1), pick(2))
        });
        around(corners.map(|corner| (corner, corner)))
    }

    /// Takes a tree in; none if it is empty.
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

/// One object's tree, counted from zero.
struct Tree {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
    depth: u32,
}

impl Tree {
    fn new(triangles: Vec<Triangle>) -> Self {
        let boxes: Vec<Aabb> = triangles
            .par_iter()
            .map(|t| {
                let [a, b, c] = [t.a, t.b, t.c].map(Vec3A::from_array);
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let bvh = build(&boxes, A_LEAF);
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

/// obvhs' "medium" build, step by step: its helper function also validates the tree whenever debug assertions are
/// on, which takes longer than the build. `max_depth` is exact afterwards.
fn build(boxes: &[Aabb], a_leaf: u32) -> Bvh2 {
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
    collapse(&mut bvh, a_leaf, params.collapse_traversal_cost);
    optimizer.run(&mut bvh, ratio * params.post_collapse_reinsertion_batch_ratio_multiplier, None);
    bvh.reorder_in_stack_traversal_order();
    // Reinsertion can deepen the tree beyond what the builder noted.
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

/// Gives inner nodes the boxes around their children.
fn widen(top: &mut [TopNode]) {
    // Children may lie before or after their parent: parents are noted first, and filled in reverse.
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

/// A box of the world relative to `eye`, wider by more than rounding moves an object that is seen from there.
pub(crate) fn box_about(eye: DVec3, min: DVec3, max: DVec3) -> ([f32; 3], [f32; 3]) {
    let (min, max) = (min - eye, max - eye);
    let slack = min.abs().max(max.abs()).max_element() * f64::from(f32::EPSILON) * 8.0;
    let below = |x: f64| ((x - slack) as f32).next_down().max(f32::MIN);
    let above = |x: f64| ((x + slack) as f32).next_up().min(f32::MAX);
    (min.to_array().map(below), max.to_array().map(above))
}

fn around(boxes: impl Iterator<Item = (DVec3, DVec3)>) -> (DVec3, DVec3) {
    boxes.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), b| (min.min(b.0), max.max(b.1)))
}

/// The middle of instances' vertices, in the world.
fn middle(scene: &Scene, placements: &[Placement]) -> DVec3 {
    let boxes = placements.par_iter().map(|p| {
        let positions = scene.meshes[p.mesh as usize].positions.iter().filter(|p| p.is_finite());
        around(positions.map(|v| p.origin + p.world_from_mesh * v.as_dvec3()).map(|v| (v, v)))
    });
    let (min, max) = around(boxes.collect::<Vec<_>>().into_iter());
    if min.cmple(max).all() { min + (max - min) * 0.5 } else { DVec3::ZERO }
}

/// A mesh's triangles in its own space.
fn own_triangles(scene: &Scene, placement: &Placement) -> Vec<Triangle> {
    triangles(scene, placement, OF_OBJECT, false, |p| p)
}

/// An instance's triangles in world axes about `origin`.
fn world_triangles(scene: &Scene, placement: &Placement, origin: DVec3) -> Vec<Triangle> {
    let offset = placement.origin - origin;
    let mirrored = placement.world_from_mesh.determinant() < 0.0;
    triangles(scene, placement, placement.instance, mirrored, |p| {
        (offset + placement.world_from_mesh * p.as_dvec3()).as_vec3()
    })
}

/// Triangles that have an area and three corners.
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

/// Which nodes an animation moves, themselves or with a parent.
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
