//! The trees of scattered rays on a device, for `shaders/sampler/scattered_rays.wgsl`.
//!
//! They are made of the same hierarchy as those of the CPU, with smaller leaves. Nodes hold eight boxes in 80 bytes,
//! rounded outwards. Triangles are f32 about their object's origin, so that both test the same corners.

mod collapse;
mod masks;
mod node;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};
use argus_scene::RenderError;
use argus_shaders::layout::sampler::{SurfaceMask, TracedObject};
use glam::{DVec3, Vec3};

use crate::bvh::{OF_OBJECT, PlacedObject, TopNode, Triangle, flags};
use crate::packets::PacketTracer;
use crate::packets::cutouts::Cutouts;
use crate::resident::upload;
use collapse::{Binary, Bounds, LEAF};
use masks::Masks;
use node::{LeafUse, Record};

/// Entries of a ray's stack; `MOST_ENTRIES` of `shaders/shared/scattered/stack.wgsl`.
const MOST_ENTRIES: u32 = 48;
/// Position of a triangle's first mask in the word of its flags; `RECORD_SHIFT` of the program.
const RECORD_SHIFT: u32 = 5;

/// A scene's trees on a device.
pub(crate) struct DeviceTrees {
    pub(crate) nodes: wgpu::Buffer,
    pub(crate) triangles: wgpu::Buffer,
    pub(crate) masks: wgpu::Buffer,
    pub(crate) mask_triangles: wgpu::Buffer,
    pub(crate) mask_texels: wgpu::Buffer,
    /// Whether some surface has a mask, and whether some hides a part of what is behind it.
    pub(crate) has_masks: bool,
    pub(crate) has_transparent: bool,
    objects: Vec<Tree>,
    /// The pose: placed objects, and the binary tree over them.
    placed: Vec<PlacedObject>,
    top: Vec<TopNode>,
    /// The version of the hierarchy that they are of.
    version: u64,
}

/// The tree of an object.
#[derive(Clone, Copy)]
struct Tree {
    root: u32,
    levels: u32,
    bounds: Bounds,
}

/// A scene's placed objects relative to an eye, on a device.
pub(crate) struct DevicePlaced {
    pub(crate) top: wgpu::Buffer,
    pub(crate) placed: wgpu::Buffer,
    /// Whether a tree over placed objects is walked.
    pub(crate) has_objects: bool,
    /// Box around all objects, relative to the eye.
    pub(crate) around: [Vec3; 2],
    /// The eye in the space of the merged object.
    pub(crate) merged_eye: Vec3,
}

impl DeviceTrees {
    /// Uploads the trees of a tracer's hierarchy, with its textures for alpha and transmission.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they are larger than the device can bind.
    pub(crate) fn new(gpu: &Arc<Gpu>, tracer: &PacketTracer) -> Result<Self, RenderError> {
        let hierarchy = tracer.hierarchy();
        let mut nodes = vec![node::empty()];
        let mut order = Vec::with_capacity(hierarchy.triangles.len());
        let bounds_of = |at: u32| bounds(&hierarchy.triangles[at as usize]);
        let (mut objects, mut ends) = (Vec::with_capacity(hierarchy.objects.len()), Vec::new());
        for object in &hierarchy.objects {
            let tree = Binary::new(&hierarchy.nodes, object.root, LEAF, &bounds_of);
            let (root, levels) = node::append(&tree, &mut nodes, &mut LeafUse::Triangles(&mut order));
            objects.push(Tree { root, levels, bounds: tree.bounds(0) });
            ends.push(order.len());
        }
        let mut masks = Masks::default();
        let (mut triangles, mut begin) = (Vec::with_capacity(order.len()), 0);
        for (end, mesh) in ends.into_iter().zip(hierarchy.meshes()) {
            let triangle =
                |&at: &u32| record(&hierarchy.triangles[at as usize], mesh, tracer.cutouts(), &mut masks);
            triangles.extend(order[begin..end].iter().map(triangle));
            begin = end;
        }
        masks.texels.resize(masks.texels.len().next_multiple_of(4), 0);
        let storage = wgpu::BufferUsages::STORAGE;
        let most = 1 << (u32::BITS - RECORD_SHIFT);
        if masks.triangles.len() > most {
            return Err(RenderError::OutOfMemory(format!("more than {most} triangles have alpha")));
        }
        Ok(Self {
            nodes: upload(gpu, "nodes of scattered rays", &nodes, storage)?,
            triangles: upload(gpu, "triangles of scattered rays", &triangles, storage)?,
            masks: upload::<SurfaceMask>(gpu, "masks of scattered rays", &masks.masks, storage)?,
            mask_triangles: upload(gpu, "corners of masks", &masks.triangles, storage)?,
            mask_texels: upload(gpu, "texels of masks", &masks.texels, storage)?,
            has_masks: !masks.triangles.is_empty(),
            has_transparent: tracer.cutouts().has_transparent,
            objects,
            placed: hierarchy.placed.clone(),
            top: hierarchy.top.clone(),
            version: hierarchy.version,
        })
    }

    /// Takes over the pose of a tracer. Trees are built anew only if meshes are visible now that never were, or deform.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub(crate) fn pose(&mut self, gpu: &Arc<Gpu>, tracer: &PacketTracer) -> Result<(), RenderError> {
        let hierarchy = tracer.hierarchy();
        if hierarchy.version != self.version {
            *self = Self::new(gpu, tracer)?;
        }
        (self.placed, self.top) = (hierarchy.placed.clone(), hierarchy.top.clone());
        Ok(())
    }

    /// Bytes of the trees.
    pub(crate) fn bytes(&self) -> u64 {
        let buffers = [&self.nodes, &self.triangles, &self.masks, &self.mask_triangles, &self.mask_texels];
        buffers.iter().map(|buffer| buffer.size()).sum()
    }

    /// Uploads the placed objects about `eye`, which should be near to where rays start.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they are larger than the device can bind, or the trees too deep for the program.
    pub(crate) fn about(&self, gpu: &Gpu, eye: DVec3) -> Result<DevicePlaced, RenderError> {
        let placed: Vec<TracedObject> = self.placed.iter().map(|p| self.traced(p, eye)).collect();
        let has_objects = placed.len() != 1;
        let (mut top, mut around, mut levels) = (vec![node::empty()], Bounds::NOTHING, 0);
        if has_objects && !placed.is_empty() {
            (top, around, levels) = self.top_tree(eye);
        }
        levels += self.objects.iter().map(|tree| tree.levels).max().unwrap_or(0);
        if levels > MOST_ENTRIES {
            let message = format!("the trees of this scene have {levels} levels, rays follow {MOST_ENTRIES}");
            return Err(RenderError::OutOfMemory(message));
        }
        let storage = wgpu::BufferUsages::STORAGE;
        let merged = self.placed.iter().find(|placed| placed.instance == OF_OBJECT);
        Ok(DevicePlaced {
            top: upload(gpu, "placed objects' tree", &top, storage)?,
            placed: upload(gpu, "placed objects", &placed, storage)?,
            has_objects,
            around: [around.min, around.max].map(Vec3::from_array),
            merged_eye: merged.map_or(Vec3::ZERO, |placed| (eye - placed.origin).as_vec3()),
        })
    }

    /// The tree over placed objects about an eye, its box, and its levels.
    fn top_tree(&self, eye: DVec3) -> (Vec<Record>, Bounds, u32) {
        let binary: Vec<_> = self.top.iter().map(|node| node.about(eye)).collect();
        let mut boxes = vec![Bounds::NOTHING; self.placed.len()];
        for node in binary.iter().filter(|node| node.count > 0) {
            boxes[node.first as usize] = Bounds { min: node.min, max: node.max };
        }
        let tree = Binary::new(&binary, 0, 1, &|at| boxes[at as usize]);
        let mut nodes = Vec::new();
        let (_, levels) = node::append(&tree, &mut nodes, &mut LeafUse::Objects);
        (nodes, tree.bounds(0), levels)
    }

    /// A placed object in the program's layout.
    fn traced(&self, placed: &PlacedObject, eye: DVec3) -> TracedObject {
        let m = placed.object_from_world;
        let exact = m * (eye - placed.origin);
        let rounded = exact.as_vec3();
        let tree = self.objects[placed.object as usize];
        let row = |i: usize| {
            let row = m.row(i).as_vec3();
            [row.x, row.y, row.z, rounded[i]]
        };
        TracedObject {
            tree_from_eye_x: row(0),
            tree_from_eye_y: row(1),
            tree_from_eye_z: row(2),
            eye_rest: (exact - rounded.as_dvec3()).as_vec3().to_array(),
            root: tree.root,
            min: tree.bounds.min,
            instance: placed.instance,
            max: tree.bounds.max,
            is_shifted: u32::from(m == glam::DMat3::IDENTITY),
        }
    }
}

fn bounds(triangle: &Triangle) -> Bounds {
    let [a, b, c] = [triangle.a, triangle.b, triangle.c].map(|corner| Bounds { min: corner, max: corner });
    a.with(b).with(c)
}

/// A triangle in the program's layout, three vectors. `mesh`: that of its object; `None` for the merged object.
fn record(triangle: &Triangle, mesh: Option<u32>, cutouts: &Cutouts, masks: &mut Masks) -> [u32; 12] {
    let mut word = triangle.flags;
    if word & (flags::CUTOUT | flags::GLASS_IN_PARTS) != 0 {
        let of_instance = || Some(cutouts.scene().instances.get(triangle.instance as usize)?.mesh);
        let mesh = if triangle.instance == OF_OBJECT { mesh } else { of_instance() };
        // A triangle without a mask hides all.
        word = match mesh.and_then(|mesh| masks.take(cutouts, mesh, triangle.primitive)) {
            Some(first) => word | first << RECORD_SHIFT,
            None => word & !(flags::CUTOUT | flags::GLASS_IN_PARTS),
        };
    }
    let [a, b, c] = [triangle.a, triangle.b, triangle.c].map(|corner| corner.map(f32::to_bits));
    let [x, y, z] = [triangle.instance, triangle.primitive, word];
    [a[0], a[1], a[2], x, b[0], b[1], b[2], y, c[0], c[1], c[2], z]
}
