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

mod nodes;
mod trees;

use std::collections::BTreeMap;

use argus_scene::Scene;
use glam::{DMat3, DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use rayon::prelude::*;

use crate::resident::Placement;
use nodes::around;
pub(crate) use nodes::{Node, OF_OBJECT, Object, PlacedObject, TopNode, Triangle, box_about, flags};
use trees::{Tree, build, own_triangles, world_triangles};

/// Most triangles that copies of one mesh may add to the merged object.
const MAX_COPIED_TRIANGLES: usize = 1 << 16;

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

/// The centre of the bounding box of instances, in world space.
fn middle(scene: &Scene, placements: &[Placement]) -> DVec3 {
    let boxes = placements.par_iter().map(|p| {
        let positions = scene.meshes[p.mesh as usize].positions.iter().filter(|p| p.is_finite());
        around(positions.map(|v| p.origin + p.world_from_mesh * v.as_dvec3()).map(|v| (v, v)))
    });
    let (min, max) = around(boxes.collect::<Vec<_>>().into_iter());
    if min.cmple(max).all() { min + (max - min) * 0.5 } else { DVec3::ZERO }
}

/// For each node, whether an animation or a client moves it or one of its ancestors.
fn moving_nodes(scene: &Scene) -> Vec<bool> {
    let by_clients = scene.by_request.iter().flat_map(|moved| moved.movers.iter().copied());
    let driven =
        scene.animations.iter().flat_map(|animation| &animation.channels).map(|channel| channel.node);
    scene.hanging_from(by_clients.chain(driven))
}
