//! What hierarchies are made of.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3};

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
    /// Index into [`argus_scene::Scene::instances`], or [`OF_OBJECT`].
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
    /// Inner node: index of the first of its two children in [`super::Hierarchy::nodes`], or in the list of the top-level tree.
    /// Leaf: index of its first triangle in [`super::Hierarchy::triangles`], or of its object in [`super::Hierarchy::placed`].
    pub(crate) first: u32,
}

/// A tree of triangles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Object {
    /// Index of its root in [`super::Hierarchy::nodes`].
    pub(crate) root: u32,
    /// Edges from the root to the deepest leaf. The stack of a traversal that pushes both children of a node and pops one
    /// has at most `depth + 1` entries.
    #[allow(dead_code, reason = "bounds the stack of the tracer on the device")]
    pub(crate) depth: u32,
    /// Number of its triangles.
    pub(crate) triangles: u32,
    /// Bounding box of its triangles: smallest coordinates.
    pub(super) min: DVec3,
    /// Largest coordinates of the box.
    pub(super) max: DVec3,
}

/// An object with its transform from world space.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlacedObject {
    /// Index into [`super::Hierarchy::objects`].
    pub(crate) object: u32,
    /// Index into [`argus_scene::Scene::instances`]; [`OF_OBJECT`] for the merged object, whose triangles have their own.
    pub(crate) instance: u32,
    /// Linear part of the transform from world space to the object's space.
    pub(crate) object_from_world: DMat3,
    /// Position of the object's origin in world space.
    pub(crate) origin: DVec3,
}

/// A node of the top-level tree, in world space. The fields are those of [`Node`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct TopNode {
    pub(super) min: DVec3,
    pub(super) max: DVec3,
    pub(super) count: u32,
    pub(super) first: u32,
}

impl TopNode {
    /// The node relative to an eye: see [`super::Hierarchy::top_about`].
    pub(crate) fn about(&self, eye: DVec3) -> Node {
        let (min, max) = box_about(eye, self.min, self.max);
        Node { min, max, count: self.count, first: self.first }
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
pub(super) fn around(boxes: impl Iterator<Item = (DVec3, DVec3)>) -> (DVec3, DVec3) {
    boxes.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), b| (min.min(b.0), max.max(b.1)))
}
