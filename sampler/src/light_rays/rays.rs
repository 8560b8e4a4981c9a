//! A scene that scattered rays are traced in, at its pose and about an eye.

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};

use super::tree::{CullMode, LEAF, Node, Root, Trees, UNUSED};
use super::walk::{Shear, Slabs};
use crate::bvh::{OF_OBJECT, box_about};
use crate::packets::PacketTracer;
use crate::packets::cutouts::Cutouts;
use crate::packets::lanes::{LANES, Lanes};
use crate::ray_watch::RayWatch;

/// Distance off a surface at which a ray starts, as a share of its coordinates: f32 coordinates may be off by less.
const OFF_SURFACE: f32 = 5e-7;

/// Traces scattered rays through a scene at its current pose.
#[derive(Clone)]
pub(crate) struct LightRays {
    pub(super) trees: Trees,
    /// The version of the hierarchy that the trees are of.
    version: u64,
    pub(super) faces: CullMode,
    /// The top tree over [`Self::placed`]; its boxes are set by [`Self::about`].
    pub(super) top: Vec<Node>,
    pub(super) top_root: u32,
    placed: Vec<Placed>,
    pub(super) cutouts: Arc<Cutouts>,
    pub(super) has_avx2: bool,
}

/// An object in the world.
#[derive(Clone)]
struct Placed {
    object: u32,
    /// Instance of all its triangles, or [`OF_OBJECT`].
    instance: u32,
    /// Transform of directions; `None` for the identity.
    object_from_world: Option<DMat3>,
    /// World space position of the object's zero.
    origin: DVec3,
    /// Box in the world.
    min: DVec3,
    max: DVec3,
}

impl LightRays {
    /// The share of light that a triangle blocks, by instance and index, at the weights of its second and third corner.
    pub(super) fn coverage(&self, ids: [u32; 2], beta: f32, gamma: f32) -> f32 {
        let passes = self.faces == CullMode::None && self.cutouts.let_light_through(ids, beta, gamma);
        if passes { 0.0 } else { self.cutouts.coverage(ids, beta, gamma) }
    }

    /// Reads alpha and transmission from another tracer's scene, whose triangles are the same.
    pub(crate) fn share_textures(&mut self, tracer: &PacketTracer) {
        self.cutouts = Arc::clone(tracer.cutouts());
    }

    /// Builds trees from a packet tracer's hierarchy, and shares its textures for alpha tests. `None` if the hierarchy is
    /// too large or too deep: 2²⁸ triangles, or 73 levels.
    pub(crate) fn new(tracer: &PacketTracer, faces: CullMode) -> Option<Self> {
        let mut rays = Self {
            trees: Trees::new(tracer.hierarchy(), faces)?,
            version: tracer.hierarchy().version,
            faces,
            top: Vec::new(),
            top_root: UNUSED,
            placed: Vec::new(),
            cutouts: Arc::clone(tracer.cutouts()),
            has_avx2: has_avx2(),
        };
        rays.place(tracer)?;
        Some(rays)
    }

    /// Takes over the pose of the packet tracer, which has been posed before. Only the top tree is rebuilt, unless meshes
    /// are visible now that never were, or deform. Returns `None`, and must not be used any more, if a tree is too large or too deep.
    #[must_use]
    #[allow(dead_code, reason = "for the light of scenes that move")]
    pub(crate) fn pose(&mut self, tracer: &PacketTracer) -> Option<()> {
        if tracer.hierarchy().version != self.version {
            self.trees = Trees::new(tracer.hierarchy(), self.faces)?;
            self.version = tracer.hierarchy().version;
        }
        self.place(tracer)
    }

    fn place(&mut self, tracer: &PacketTracer) -> Option<()> {
        let hierarchy = tracer.hierarchy();
        (self.top, self.top_root) = self.trees.top(hierarchy)?;
        let placed = hierarchy.placed.iter().map(|placed| {
            let (min, max) = hierarchy.world_box(placed);
            let m = placed.object_from_world;
            Placed {
                object: placed.object,
                instance: placed.instance,
                object_from_world: (m != DMat3::IDENTITY).then_some(m),
                origin: placed.origin,
                min,
                max,
            }
        });
        self.placed = placed.collect();
        Some(())
    }

    /// Bytes of the trees.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.trees.nodes[..])
            + size_of_val(&self.trees.blocks[..])
            + size_of_val(&self.trees.ids[..])
    }

    /// The scene about `eye`, which should be near to where rays start. Takes time proportional to the number of placed
    /// objects.
    pub(crate) fn about(&self, eye: DVec3) -> LightRaysAbout<'_> {
        let mut top = self.top.clone();
        // Nodes follow their parents.
        for at in (0..top.len()).rev() {
            for lane in 0..LANES {
                let child = top[at].children[lane];
                if child == UNUSED {
                    continue;
                }
                let (min, max) = match self.placed.get((child & !LEAF) as usize) {
                    Some(placed) if child & LEAF != 0 => box_about(eye, placed.min, placed.max),
                    _ => top[child as usize].around(),
                };
                top[at].set_box(lane, min, max);
            }
        }
        let objects = self.placed.iter().map(|placed| {
            let offset = eye - placed.origin;
            ObjectAbout {
                root: self.trees.roots[placed.object as usize],
                instance: placed.instance,
                object_from_world: placed.object_from_world,
                eye: placed.object_from_world.map_or(offset, |m| m * offset),
            }
        });
        let objects: Vec<ObjectAbout> = objects.collect();
        let around = top.first().map_or(([0.0; 3], [0.0; 3]), Node::around);
        let merged = objects.iter().find(|object| object.instance == OF_OBJECT);
        LightRaysAbout {
            rays: self,
            top,
            around: [around.0, around.1].map(Vec3::from_array),
            merged_eye: merged.map_or(Vec3::ZERO, |object| object.eye.as_vec3()),
            objects,
            watch: None,
        }
    }
}

/// Whether rays are traced eight at a time by this processor.
pub(crate) fn has_avx2() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        is_x86_feature_detected!("avx2")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        false
    }
}

/// A placed object relative to an eye.
pub(super) struct ObjectAbout {
    pub(super) root: Root,
    pub(super) instance: u32,
    pub(super) object_from_world: Option<DMat3>,
    /// The eye in the object's space.
    pub(super) eye: DVec3,
}

/// A scene relative to an eye. Threads may share it. No ray allocates.
pub(crate) struct LightRaysAbout<'a> {
    pub(super) rays: &'a LightRays,
    pub(super) top: Vec<Node>,
    /// Box around everything.
    pub(super) around: [Vec3; 2],
    pub(super) objects: Vec<ObjectAbout>,
    /// The eye in the space of the merged object.
    pub(super) merged_eye: Vec3,
    /// Is told of all rays.
    pub(super) watch: Option<&'a dyn RayWatch>,
}

impl<'a> LightRaysAbout<'a> {
    /// Tells `watch` of all rays from now on.
    pub(crate) fn watched(self, watch: Option<&'a dyn RayWatch>) -> Self {
        Self { watch, ..self }
    }

    /// Distance off a surface at which a ray from `point` (relative to the eye) must start so as not to hit the surface
    /// itself, in f32 coordinates. `found_by`: the length of the ray that found the point, 0 for a point of a triangle.
    pub(crate) fn offset(&self, point: Vec3, found_by: f32) -> f32 {
        (point.length() + (point + self.merged_eye).length() + found_by) * OFF_SURFACE
    }

    /// A placed object, and a ray in its space as boxes and triangles are tested by it; `None` if the ray is not finite there
    /// or has no direction.
    #[inline(always)]
    pub(super) fn enter<L: Lanes>(
        &self,
        leaf: u32,
        origin: Vec3,
        direction: Vec3,
    ) -> Option<(&ObjectAbout, Slabs<L>, Shear)> {
        let object = self.objects.get(leaf as usize)?;
        let (origin, direction) = self.ray_in(object, origin, direction)?;
        let slabs = Slabs::new(origin, direction, [object.root.min, object.root.max]);
        Some((object, slabs, Shear::new(origin, direction)))
    }

    /// A ray in an object's space; `None` if it is not finite there or has no direction.
    #[inline(always)]
    fn ray_in(&self, object: &ObjectAbout, origin: Vec3, direction: Vec3) -> Option<(Vec3, Vec3)> {
        let Some(m) = &object.object_from_world else {
            return Some(((object.eye + origin.as_dvec3()).as_vec3(), direction));
        };
        // f64, so that each coordinate is rounded once.
        let origin = (object.eye + *m * origin.as_dvec3()).as_vec3();
        let direction = (*m * direction.as_dvec3()).as_vec3();
        (origin.is_finite() && direction.is_finite() && direction != Vec3::ZERO)
            .then_some((origin, direction))
    }
}
