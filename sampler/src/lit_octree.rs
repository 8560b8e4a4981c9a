//! The scene as an octree of shaded surfaces: what cameras look up ([`crate::omni_maps`]) and what lights other surfaces
//! ([`crate::point_based`]).
//!
//! Once a pose the scene's surfaces become an octree, whose leaves know which triangle they show to either side; once a
//! lighting the leaves are shaded, in chunks and as a list, by whoever drives this; then nodes are averaged from their
//! children.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::hierarchy::{HierarchyError, Octree, OctreeBuilder, RootCube, Triangle};
use argus_gpu::many_views::{Knobs, Texel};
use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::camera::Face;
use argus_scene::{InvalidField, Lighting, RenderError, Scene, Stage};
use argus_shaders::layout::sampler::{LEAF_BLOCK, LeafChunk, SURFEL_BYTES};
use bytemuck::Zeroable;
use glam::{DMat3, DVec2, Vec3};

use crate::passes::{Leaves, NodeSurfaces, OwnNodes, ShadeLeaves, Surfels, TileContext};
use crate::resident::{Cull, Placement, Resident, upload};
use crate::tile::Tile;

/// Columns, and most rows, of the image that leaves are shaded in: half a million of them at a time.
const CHUNK_SIDE: u32 = 1024;
/// Set in the number of a triangle whose back is not seen, as `shaders/sampler/shade_leaves.wgsl` has it.
const SINGLE_SIDED: u32 = 1 << 31;

/// The octree of one scene on one device, and what its nodes show.
pub(crate) struct LitOctree {
    levels: u32,
    shade: ShadeLeaves,
    surfels: Surfels,
    /// Its programs are made once.
    builder: Option<OctreeBuilder>,
    faced: Option<Faced>,
    lit: Option<Lit>,
}

/// The scene's octree as its surfaces lie, and which triangles its leaves show.
struct Faced {
    octree: Arc<Octree>,
    triangle_ids: wgpu::Buffer,
    facing: wgpu::Buffer,
    ends: wgpu::Buffer,
}

/// What the octree's nodes show under some lights.
struct Lit {
    lighting: Lighting,
    /// Seconds; where no light drifts, any time is the same.
    time_secs: f64,
    surfels: wgpu::Buffer,
}

/// Leaves that are shaded at a time.
pub(crate) struct Chunk {
    /// The image that they are shaded in.
    pub(crate) tile: Tile,
    uniform: wgpu::Buffer,
}

/// Nodes and what they show.
pub(crate) struct LitNodes<'a> {
    pub(crate) octree: &'a Arc<Octree>,
    /// Radiance of either side: [`argus_shaders::layout::sampler::SURFEL_BYTES`] a node.
    pub(crate) surfels: &'a wgpu::Buffer,
    /// Of each level of the octree, the leaves' first, the number of the node after its last.
    pub(crate) ends: &'a wgpu::Buffer,
}

impl LitOctree {
    /// For a scene that lies on a device; `keeps_guides` for whoever adds indirect light to leaves.
    pub(crate) fn new(gpu: &Gpu, resident: &Resident, keeps_guides: bool, levels: u32) -> Self {
        Self {
            levels,
            shade: ShadeLeaves::new(gpu, resident.features, keeps_guides),
            surfels: Surfels::new(gpu),
            builder: None,
            faced: None,
            lit: None,
        }
    }

    /// Takes another number of levels.
    pub(crate) fn set_levels(&mut self, levels: u32) {
        if levels != self.levels {
            self.forget_pose();
        }
        self.levels = levels;
    }

    /// Surfaces lie elsewhere.
    pub(crate) fn forget_pose(&mut self) {
        self.faced = None;
        self.forget_light();
    }

    /// Surfaces are lit by other lights.
    pub(crate) fn forget_light(&mut self) {
        self.lit = None;
    }

    /// Builds the octree unless surfaces lie where they did; `None` where there are none, so that all is sky.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] where an array is larger than the device can bind, or the device.
    pub(crate) fn pose(
        &mut self,
        gpu: &Arc<Gpu>,
        scene: &Scene,
        placements: &[Placement],
    ) -> Result<Option<Vec<Stage>>, RenderError> {
        if self.faced.is_some() {
            return Ok(Some(Vec::new()));
        }
        let begin = Instant::now();
        let (mut triangles, mut ids) = (Vec::new(), Vec::new());
        for placement in placements {
            for (primitive, mut corners) in
                (0u32..).zip(placement.triangles(&scene.meshes[placement.mesh as usize]))
            {
                if placement.world_from_mesh.determinant() < 0.0 {
                    // A mirror turns triangles around, and their fronts stay fronts.
                    corners.swap(1, 2);
                }
                let triangle = Triangle { corners, color: Vec3::ONE };
                if triangle.is_surface() {
                    triangles.push(triangle);
                    let single = if placement.class.cull == Cull::None { 0 } else { SINGLE_SIDED };
                    ids.push([placement.instance, primitive | single]);
                }
            }
        }
        let root = RootCube::around(&scene.bounds());
        if triangles.is_empty() {
            return Ok(None);
        }
        let builder = self.builder.get_or_insert_with(|| OctreeBuilder::new(gpu));
        let octree = match builder.build_faced(root, self.levels, triangles) {
            Err(HierarchyError::Empty) => return Ok(None),
            octree => octree.map_err(to_render_error)?,
        };
        let storage = wgpu::BufferUsages::STORAGE;
        let ends: Vec<u32> = octree.levels.iter().rev().map(|[first, count]| first + count).collect();
        let facing = octree.facing.clone();
        self.faced = Some(Faced {
            triangle_ids: upload(gpu, "triangles of the octree", &ids, storage)?,
            facing: facing.ok_or_else(|| RenderError::Internal("leaves face nowhere".to_owned()))?,
            ends: upload(gpu, "ends of levels", &ends, storage)?,
            octree: Arc::new(octree),
        });
        Ok(Some(vec![Stage::new("build octree", begin.elapsed().as_secs_f64() * 1e3)]))
    }

    /// Which of its nodes belong to whom, once the scene was posed: see [`OwnNodes::record`].
    pub(crate) fn owners(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        pass: &OwnNodes,
        probe_of_instance: &wgpu::Buffer,
    ) -> Option<wgpu::Buffer> {
        let Faced { octree, triangle_ids, facing, .. } = self.faced.as_ref()?;
        Some(pass.record(gpu, commands, &NodeSurfaces { octree, facing, triangle_ids, probe_of_instance }))
    }

    /// The octree, once the scene was posed.
    pub(crate) fn octree(&self) -> Option<&Arc<Octree>> {
        self.faced.as_ref().map(|faced| &faced.octree)
    }

    /// Nodes and what they show, once they were lit.
    pub(crate) fn nodes(&self) -> Option<LitNodes<'_>> {
        let (Faced { octree, ends, .. }, Lit { surfels, .. }) = (self.faced.as_ref()?, self.lit.as_ref()?);
        Some(LitNodes { octree, surfels, ends })
    }

    /// Whether leaves are shaded as these lights light them at this time.
    pub(crate) fn is_lit(&self, lighting: &Lighting, time_secs: f64, drifts: bool) -> bool {
        let is_now = |lit: &Lit| lit.lighting == *lighting && (!drifts || lit.time_secs == time_secs);
        self.lit.as_ref().is_some_and(is_now)
    }

    /// The leaves in chunks to be shaded about the middle of the root, once it was posed.
    pub(crate) fn chunks(&self, gpu: &Gpu) -> Vec<Chunk> {
        let Some(Faced { octree, .. }) = &self.faced else { return Vec::new() };
        let most = CHUNK_SIDE * CHUNK_SIDE / 2;
        let edge = octree.root.edge;
        let chunk = |first: u32| {
            let texels = 2 * most.min(octree.leaf_count() - first);
            let size = [CHUNK_SIDE, texels.div_ceil(CHUNK_SIDE).next_multiple_of(LEAF_BLOCK)];
            let params = LeafChunk {
                root_about_eye: [-0.5 * edge as f32; 3],
                edge: edge as f32,
                size,
                first,
                leaves: octree.leaf_count(),
                cell: (edge * (-f64::from(octree.depth)).exp2()) as f32,
                ..LeafChunk::zeroed()
            };
            let uniform = gpu.upload("leaves", &[params], wgpu::BufferUsages::UNIFORM);
            Chunk { tile: image_of(size), uniform }
        };
        (0..octree.leaf_count()).step_by(most as usize).map(chunk).collect()
    }

    /// Where each leaf's surfaces lie: that the context's tile is a list.
    pub(crate) fn places(&self) -> Option<wgpu::Buffer> {
        self.faced.as_ref().map(|faced| faced.facing.clone())
    }

    /// Memory for what nodes show.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] where that is more than the device can bind.
    pub(crate) fn make_surfels(&self, gpu: &Gpu) -> Result<wgpu::Buffer, RenderError> {
        let nodes = self.faced.as_ref().map_or(0, |faced| u64::from(faced.octree.node_count()));
        let limits = gpu.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if nodes * SURFEL_BYTES > limit {
            let what = "what nodes of the octree show";
            return Err(to_render_error(HierarchyError::TooLarge {
                what,
                needed: nodes * SURFEL_BYTES,
                limit,
            }));
        }
        Ok(gpu.buffer("surfels", nodes.max(1) * SURFEL_BYTES, wgpu::BufferUsages::STORAGE))
    }

    /// Shades a chunk's leaves, and keeps what indirect light needs of them.
    pub(crate) fn shade(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        chunk: &Chunk,
        surfels: &wgpu::Buffer,
    ) {
        if let Some(leaves) = self.leaves(chunk, surfels) {
            self.shade.record(commands, context, &leaves);
        }
    }

    /// Takes over what a chunk's leaves were shaded with, and whatever was added to that.
    pub(crate) fn keep(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        chunk: &Chunk,
        surfels: &wgpu::Buffer,
    ) {
        if let Some(leaves) = self.leaves(chunk, surfels) {
            self.surfels.keep(commands, context, &leaves);
        }
    }

    fn leaves<'a>(&'a self, chunk: &'a Chunk, surfels: &'a wgpu::Buffer) -> Option<Leaves<'a>> {
        let Faced { octree, triangle_ids, facing, .. } = self.faced.as_ref()?;
        Some(Leaves { octree, triangle_ids, facing, surfels, chunk: &chunk.uniform })
    }

    /// Averages what leaves show into the nodes above them, and goes by it from now on.
    pub(crate) fn light(
        &mut self,
        commands: &mut Commands,
        surfels: wgpu::Buffer,
        lighting: &Lighting,
        time_secs: f64,
    ) {
        let Some(Faced { octree, .. }) = &self.faced else { return };
        self.surfels.average(commands, octree, &surfels);
        self.lit = Some(Lit { lighting: lighting.clone(), time_secs, surfels });
    }
}

/// The image that leaves are shaded in, as a tile: of a list, whose rays nobody follows.
fn image_of(size: [u32; 2]) -> Tile {
    let face = Face { view_from_world: DMat3::IDENTITY, tan_half_fov: DVec2::ONE, offset: [0, 0], size };
    Tile { face, begin: [0, 0], size, side: 1 }
}

/// How pictures of an octree are taken, each from a view of its own: a function of nothing that was rendered before.
pub(crate) fn map_knobs(side: u32, octree: &Octree) -> Knobs {
    Knobs {
        side,
        texel: Texel::RangeAndNode,
        disc: Knobs::COVERING,
        shared_disc: Knobs::COVERING,
        sharing: false,
        // What was rendered before decides nothing.
        falls_back: false,
        // A picture of what surrounds a view, and not of the wall that it stands in.
        own_cell: false,
        // Each view's pairs are fewer than leaves; what does not fit is traversed in parts. As many at the next moment, when
        // leaves are about as many.
        queue_pairs: Some(octree.leaf_count().saturating_mul(8).clamp(1 << 16, 1 << 31).next_power_of_two()),
        view_depth: Some(octree.depth),
        ..Knobs::default()
    }
}

/// What a hierarchy refuses, in a sampler's words.
pub(crate) fn to_render_error(error: HierarchyError) -> RenderError {
    match error {
        HierarchyError::Gpu(error) => error.into(),
        HierarchyError::OutOfRange { .. } => InvalidField::new("sampling", error.to_string()).into(),
        HierarchyError::TooLarge { what, needed, limit } => RenderError::OutOfMemory(format!(
            "{what} take {} MiB, and this device binds at most {} MiB: fewer levels or smaller maps take less",
            needed.div_ceil(1 << 20),
            limit >> 20
        )),
        HierarchyError::TooManyNodes { .. } => RenderError::OutOfMemory(error.to_string()),
        HierarchyError::Empty => RenderError::Internal(error.to_string()),
    }
}
