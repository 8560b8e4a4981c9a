//! Scattered rays for light on the CPU: shadow rays, sky rays and bounces.
//!
//! [`LightRays`] holds the trees of [`crate::bvh`] with eight children a node and up to eight triangles a leaf. One ray is
//! tested against eight boxes at once, then against eight triangles. Rays may start anywhere and share nothing, so each
//! is traced alone; many threads may trace at once. Everything is f32, about the eye for placed objects and about the
//! object's own origin for triangles; [`crate::packets`] has an f64 tracer of single rays.
//!
//! The traversal is compiled twice, with and without AVX2. Both give the same bits on every machine: multiplications and
//! additions are never fused.

pub(crate) mod device;
#[cfg(test)]
mod tests;
mod tree;
mod walk;

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};

use crate::bvh::{OF_OBJECT, box_about};
use crate::packets::PacketTracer;
use crate::packets::cutouts::Cutouts;
use crate::packets::lanes::{LANES, Lanes, Plain};
use tree::{Block, Ids, LEAF, Node, Root, Trees, UNUSED};
use walk::{Leaves, Shear, Slabs, walk};

/// Pending references that a traversal has room for, 8 bytes each. Deeper trees are refused: more than 73 levels, where
/// those of buildings have about ten.
const STACK: usize = 512;

/// Distance off a surface at which a ray starts, as a share of its coordinates: f32 coordinates may be off by less.
const OFF_SURFACE: f32 = 5e-7;

/// Which faces of single-sided triangles rays pass. Rays hit both faces of all other triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CullMode {
    /// None: a wall keeps light out from either side. Glass lets light pass and is not hit, nor are its clear parts.
    None,
    /// Back faces, as views do.
    Back,
}

/// The nearest surface along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RayHit {
    /// Index into [`argus_scene::Scene::instances`].
    pub(crate) instance: u32,
    /// Index of the triangle in its mesh.
    pub(crate) primitive: u32,
    /// Distance in units of the direction.
    pub(crate) t: f32,
    /// Weights of the mesh's second and third corner.
    pub(crate) weights: [f32; 2],
    /// Whether the front face (counter-clockwise) is hit.
    pub(crate) front: bool,
}

/// Traces scattered rays through a scene at its current pose.
#[derive(Clone)]
pub(crate) struct LightRays {
    trees: Trees,
    /// The version of the hierarchy that the trees are of.
    version: u64,
    faces: CullMode,
    /// The top tree over [`Self::placed`]; its boxes are set by [`Self::about`].
    top: Vec<Node>,
    top_root: u32,
    placed: Vec<Placed>,
    cutouts: Arc<Cutouts>,
    has_avx2: bool,
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
    fn coverage(&self, ids: [u32; 2], beta: f32, gamma: f32) -> f32 {
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
            around: (Vec3::from_array(around.0), Vec3::from_array(around.1)),
            merged_eye: merged.map_or(Vec3::ZERO, |object| object.eye.as_vec3()),
            objects,
        }
    }
}

fn has_avx2() -> bool {
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
struct ObjectAbout {
    root: Root,
    instance: u32,
    object_from_world: Option<DMat3>,
    /// The eye in the object's space.
    eye: DVec3,
}

/// A scene relative to an eye. Threads may share it. No ray allocates.
pub(crate) struct LightRaysAbout<'a> {
    rays: &'a LightRays,
    top: Vec<Node>,
    /// Box around everything.
    around: (Vec3, Vec3),
    objects: Vec<ObjectAbout>,
    /// The eye in the space of the merged object.
    merged_eye: Vec3,
}

impl LightRaysAbout<'_> {
    /// Whether anything is hit at 0 < t < `most`, in units of the direction. `origin` is relative to the eye. Rays pass
    /// through transparent parts of cut-outs. False for a ray that is not finite or has no direction.
    pub(crate) fn is_blocked(&self, origin: Vec3, direction: Vec3, most: f32) -> bool {
        if !is_ray(origin, direction, most) {
            return false;
        }
        #[cfg(target_arch = "x86_64")]
        {
            use crate::packets::lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(about: &LightRaysAbout<'_>, origin: Vec3, direction: Vec3, most: f32) -> bool {
                about.is_blocked_by::<Avx2>(origin, direction, most)
            }
            if self.rays.has_avx2 {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, origin, direction, most) };
            }
        }
        self.is_blocked_by::<Plain>(origin, direction, most)
    }

    /// The share of light that passes a ray at 0 < t < `most`, in units of the direction. `origin` is relative to the eye. Rays
    /// pass through transparent parts of cut-outs, and in part through transparent surfaces. 1 for a ray that is not finite
    /// or has no direction.
    pub(crate) fn passed(&self, origin: Vec3, direction: Vec3, most: f32) -> f32 {
        if !self.rays.cutouts.has_transparent {
            return f32::from(u8::from(!self.is_blocked(origin, direction, most)));
        }
        if !is_ray(origin, direction, most) {
            return 1.0;
        }
        #[cfg(target_arch = "x86_64")]
        {
            use crate::packets::lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(about: &LightRaysAbout<'_>, origin: Vec3, direction: Vec3, most: f32) -> f32 {
                about.passed_by::<Avx2>(origin, direction, most)
            }
            if self.rays.has_avx2 {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, origin, direction, most) };
            }
        }
        self.passed_by::<Plain>(origin, direction, most)
    }

    /// The nearest hit at 0 < t < `most`, in units of the direction. `origin` is relative to the eye. Rays pass through
    /// transparent parts of cut-outs, and meet transparent surfaces as often as their alpha says. `None` for a ray that is not finite or has no direction.
    pub(crate) fn nearest(&self, origin: Vec3, direction: Vec3, most: f32) -> Option<RayHit> {
        if !is_ray(origin, direction, most) {
            return None;
        }
        #[cfg(target_arch = "x86_64")]
        {
            use crate::packets::lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(
                about: &LightRaysAbout<'_>,
                origin: Vec3,
                direction: Vec3,
                most: f32,
            ) -> Option<RayHit> {
                about.nearest_by::<Avx2>(origin, direction, most)
            }
            if self.rays.has_avx2 {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, origin, direction, most) };
            }
        }
        self.nearest_by::<Plain>(origin, direction, most)
    }

    /// Distance off a surface at which a ray from `point` (relative to the eye) must start so as not to hit the surface
    /// itself, in f32 coordinates. `found_by`: the length of the ray that found the point, 0 for a point of a triangle.
    pub(crate) fn offset(&self, point: Vec3, found_by: f32) -> f32 {
        (point.length() + (point + self.merged_eye).length() + found_by) * OFF_SURFACE
    }

    #[inline(always)]
    fn is_blocked_by<L: Lanes>(&self, origin: Vec3, direction: Vec3, most: f32) -> bool {
        let lanes = std::marker::PhantomData::<L>;
        self.any_by(&mut AnyObject { about: self, origin, direction, passed: None, lanes }, most)
    }

    #[inline(always)]
    fn passed_by<L: Lanes>(&self, origin: Vec3, direction: Vec3, most: f32) -> f32 {
        let lanes = std::marker::PhantomData::<L>;
        let mut objects = AnyObject { about: self, origin, direction, passed: Some(1.0), lanes };
        if self.any_by(&mut objects, most) { 0.0 } else { objects.passed.unwrap_or(1.0) }
    }

    /// Whether a ray is blocked.
    #[inline(always)]
    fn any_by<L: Lanes>(&self, objects: &mut AnyObject<'_, L>, most: f32) -> bool {
        if self.objects.len() == 1 {
            return objects.visit(0, most) < 0.0;
        }
        if self.objects.is_empty() {
            return false;
        }
        let slabs = Slabs::<L>::new(objects.origin, objects.direction, self.around);
        walk::<L, false>(&self.top, self.rays.top_root, &slabs, most, objects) < 0.0
    }

    #[inline(always)]
    fn nearest_by<L: Lanes>(&self, origin: Vec3, direction: Vec3, most: f32) -> Option<RayHit> {
        let lanes = std::marker::PhantomData::<L>;
        let mut objects = NearestObject { about: self, origin, direction, nearest: None, lanes };
        if self.objects.len() == 1 {
            objects.visit(0, most);
        } else if !self.objects.is_empty() {
            let slabs = Slabs::<L>::new(origin, direction, self.around);
            walk::<L, true>(&self.top, self.rays.top_root, &slabs, most, &mut objects);
        }
        objects.nearest
    }

    /// A placed object, and a ray in its space as boxes and triangles are tested by it; `None` if the ray is not finite there
    /// or has no direction.
    #[inline(always)]
    fn enter<L: Lanes>(
        &self,
        leaf: u32,
        origin: Vec3,
        direction: Vec3,
    ) -> Option<(&ObjectAbout, Slabs<L>, Shear)> {
        let object = self.objects.get(leaf as usize)?;
        let (origin, direction) = self.ray_in(object, origin, direction)?;
        let slabs = Slabs::new(origin, direction, (object.root.min, object.root.max));
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

/// NaN fails.
#[inline(always)]
fn is_ray(origin: Vec3, direction: Vec3, most: f32) -> bool {
    origin.is_finite() && direction.is_finite() && direction != Vec3::ZERO && most > 0.0
}

/// Placed objects, until one blocks a ray.
struct AnyObject<'a, L> {
    about: &'a LightRaysAbout<'a>,
    origin: Vec3,
    direction: Vec3,
    /// The share of light that passes transparent surfaces; `None` if they are met or not.
    passed: Option<f32>,
    lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for AnyObject<'_, L> {
    #[inline(always)]
    fn visit(&mut self, leaf: u32, limit: f32) -> f32 {
        let Some((object, slabs, ray)) = self.about.enter::<L>(leaf, self.origin, self.direction) else {
            return limit;
        };
        let rays = self.about.rays;
        let instance = object.instance;
        let mut triangles = AnyTriangle { rays, ray, instance, passed: self.passed, lanes: self.lanes };
        let limit = walk::<L, false>(&rays.trees.nodes, object.root.reference, &slabs, limit, &mut triangles);
        self.passed = triangles.passed;
        limit
    }
}

/// Triangles, until one blocks a ray.
struct AnyTriangle<'a, L> {
    rays: &'a LightRays,
    ray: Shear,
    instance: u32,
    passed: Option<f32>,
    lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for AnyTriangle<'_, L> {
    #[inline(always)]
    fn visit(&mut self, leaf: u32, limit: f32) -> f32 {
        let Some(block) = self.rays.trees.blocks.get(leaf as usize) else { return limit };
        let Some(met) = self.ray.meet::<L>(block, limit) else { return limit };
        if met.hit & !block.cutout != 0 {
            return -1.0;
        }
        let ids = &self.rays.trees.ids[leaf as usize];
        let weights = Weights::new(met.area.to_array(), [met.parts[0].to_array(), met.parts[1].to_array()]);
        let is_stopped = match &mut self.passed {
            None => weights.any_stops(met.hit, block, ids, self.instance, self.rays),
            Some(passed) => {
                *passed *= weights.passed(met.hit, block, ids, self.instance, self.rays);
                *passed == 0.0
            }
        };
        if is_stopped { -1.0 } else { limit }
    }
}

/// Placed objects, for the nearest hit.
struct NearestObject<'a, L> {
    about: &'a LightRaysAbout<'a>,
    origin: Vec3,
    direction: Vec3,
    nearest: Option<RayHit>,
    lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for NearestObject<'_, L> {
    #[inline(always)]
    fn visit(&mut self, leaf: u32, limit: f32) -> f32 {
        let Some((object, slabs, ray)) = self.about.enter::<L>(leaf, self.origin, self.direction) else {
            return limit;
        };
        let rays = self.about.rays;
        let (instance, nearest) = (object.instance, None);
        let mut triangles = NearestTriangle { rays, ray, instance, nearest, lanes: self.lanes };
        let limit = walk::<L, true>(&rays.trees.nodes, object.root.reference, &slabs, limit, &mut triangles);
        self.nearest = triangles.nearest.or(self.nearest);
        limit
    }
}

/// Triangles, for the nearest hit.
struct NearestTriangle<'a, L> {
    rays: &'a LightRays,
    ray: Shear,
    instance: u32,
    nearest: Option<RayHit>,
    lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for NearestTriangle<'_, L> {
    #[inline(always)]
    fn visit(&mut self, leaf: u32, mut limit: f32) -> f32 {
        let Some(block) = self.rays.trees.blocks.get(leaf as usize) else { return limit };
        let Some(met) = self.ray.meet::<L>(block, limit) else { return limit };
        let ids = &self.rays.trees.ids[leaf as usize];
        let weights = Weights::new(met.area.to_array(), [met.parts[0].to_array(), met.parts[1].to_array()]);
        let t = met.t.to_array();
        let mut hit = met.hit;
        while hit != 0 {
            let lane = hit.trailing_zeros() as usize % LANES;
            hit &= hit - 1;
            if t[lane] < limit && weights.stops(lane, block, ids, self.instance, self.rays) {
                limit = t[lane];
                self.nearest = Some(weights.hit(lane, limit, block, ids, self.instance));
            }
        }
        limit
    }
}

/// Where in the triangles of a block a ray hits them.
struct Weights {
    area: [f32; LANES],
    parts: [[f32; LANES]; 2],
}

impl Weights {
    #[inline(always)]
    fn new(area: [f32; LANES], parts: [[f32; LANES]; 2]) -> Self {
        Self { area, parts }
    }

    /// Weights of the mesh's second and third corner.
    #[inline(always)]
    fn of(&self, lane: usize, block: &Block) -> [f32; 2] {
        let weights = [self.parts[0][lane] / self.area[lane], self.parts[1][lane] / self.area[lane]];
        if block.mirrored >> lane & 1 == 1 { [weights[1], weights[0]] } else { weights }
    }

    /// The share of light that passes hit triangles, all of which have alpha.
    #[inline(never)]
    fn passed(&self, hit: u32, block: &Block, ids: &Ids, instance: u32, rays: &LightRays) -> f32 {
        let lanes = (0..LANES).filter(|lane| hit >> lane & 1 == 1);
        lanes
            .map(|lane| {
                let [beta, gamma] = self.of(lane, block);
                1.0 - rays.coverage(resolved(ids[lane], instance), beta, gamma)
            })
            .product()
    }

    /// Whether a hit triangle is opaque there.
    #[inline(always)]
    fn stops(&self, lane: usize, block: &Block, ids: &Ids, instance: u32, rays: &LightRays) -> bool {
        if block.cutout >> lane & 1 == 0 {
            return true;
        }
        let [beta, gamma] = self.of(lane, block);
        let ids = resolved(ids[lane], instance);
        let opens = rays.cutouts.let_through(ids, beta, gamma);
        !(opens || rays.faces == CullMode::None && rays.cutouts.let_light_through(ids, beta, gamma))
    }

    /// Whether any of the hit triangles is opaque where it is hit.
    #[inline(never)]
    fn any_stops(&self, hit: u32, block: &Block, ids: &Ids, instance: u32, rays: &LightRays) -> bool {
        (0..LANES).any(|lane| hit >> lane & 1 == 1 && self.stops(lane, block, ids, instance, rays))
    }

    #[inline(always)]
    fn hit(&self, lane: usize, t: f32, block: &Block, ids: &Ids, instance: u32) -> RayHit {
        let [instance, primitive] = resolved(ids[lane], instance);
        RayHit { instance, primitive, t, weights: self.of(lane, block), front: self.area[lane] > 0.0 }
    }
}

/// Ids of a triangle of an object with this instance.
#[inline(always)]
fn resolved([own, primitive]: [u32; 2], instance: u32) -> [u32; 2] {
    [if own == OF_OBJECT { instance } else { own }, primitive]
}
