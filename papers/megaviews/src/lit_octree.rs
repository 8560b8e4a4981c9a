//! The scene as an octree of shaded surfaces. Cameras look it up (`omni_maps.rs`), and it lights other surfaces
//! (`papers/virtual-lights`).
//!
//! Once a pose, the octree is built; each leaf stores the triangle that it shows to either side. Once a lighting, the
//! leaves are shaded in chunks, and inner nodes are averaged from their children.

use std::sync::Arc;
use std::time::Instant;

use crate::hierarchy::{HierarchyError, Octree, OctreeBuilder, RootCube, Triangle};
use crate::layout::SURFEL_BYTES;
use crate::many_views::{Settings, Texel};
use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::{InvalidField, Lighting, RenderError, Scene, Stage};
use argus_shaders::layout::sampler::{LEAF_BLOCK, LeafChunk};
use bytemuck::Zeroable;
use glam::{DVec3, Vec3};

use argus_sampler::plug::{
    CHUNK_SIDE, Cull, Footprint, Frame, GBufferUse, LightSharing, LitScene, Placement, Resident, Tile,
    TileContext, image_of, timing, upload,
};

use crate::passes::{Leaves, NodeSurfaces, OwnNodes, ShadeLeaves, Surfels};

/// Bit in the index of a single-sided triangle, as in `shaders/shade_leaves.wgsl`.
const SINGLE_SIDED: u32 = 1 << 31;

/// The lit octree of one scene on one device.
pub struct LitOctree {
    levels: u32,
    shade: ShadeLeaves,
    surfels: Surfels,
    /// Kept, because its pipelines are reused.
    builder: Option<OctreeBuilder>,
    faced: Option<Faced>,
    lit: Option<Lit>,
}

/// The octree of the posed scene, and the triangles that its leaves show.
struct Faced {
    octree: Arc<Octree>,
    triangle_ids: wgpu::Buffer,
    facing: wgpu::Buffer,
    ends: wgpu::Buffer,
}

/// Radiance of the octree's nodes under some lights.
struct Lit {
    lighting: Lighting,
    /// Seconds. Ignored where light does not change with time.
    time_secs: f64,
    surfels: wgpu::Buffer,
}

/// Leaves that are shaded in one submission.
pub struct Chunk {
    /// The image that they are shaded in, as a tile.
    pub tile: Tile,
    /// Edge of a leaf, metres.
    cell: f32,
    uniform: wgpu::Buffer,
}

/// Nodes and their radiance.
pub struct LitNodes<'a> {
    /// The octree.
    pub octree: &'a Arc<Octree>,
    /// Radiance of either side: [`crate::layout::SURFEL_BYTES`] a node.
    pub surfels: &'a wgpu::Buffer,
    /// For each level, starting with the leaves, the index after its last node.
    pub ends: &'a wgpu::Buffer,
}

impl LitOctree {
    /// The lit octree of a scene on a device.
    pub fn new(gpu: &Gpu, resident: &Resident, g_buffer: GBufferUse, levels: u32) -> Self {
        Self {
            levels,
            shade: ShadeLeaves::new(gpu, resident.features, g_buffer),
            surfels: Surfels::new(gpu),
            builder: None,
            faced: None,
            lit: None,
        }
    }

    /// Changes the number of levels.
    pub fn set_levels(&mut self, levels: u32) {
        if levels != self.levels {
            self.forget_pose();
        }
        self.levels = levels;
    }

    /// Marks the octree as out of date, because surfaces moved.
    pub fn forget_pose(&mut self) {
        self.faced = None;
        self.forget_light();
    }

    /// Marks the lighting as out of date.
    pub fn forget_light(&mut self) {
        self.lit = None;
    }

    /// Builds the octree unless it is up to date. Returns the cost, or `None` for a scene without surfaces.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if an array exceeds what the device can bind, or the errors of the device.
    pub fn pose(
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
                    // A mirroring transform reverses winding; front faces stay front faces.
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

    /// Builds the octree of the posed scene and shades its leaves, unless both are up to date. Returns the cost, or
    /// `None` for a scene without surfaces.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`], [`RenderError::OutOfMemory`], or the errors of the device.
    pub fn ready(
        &mut self,
        scene: &mut LitScene<'_>,
        lighting: &Lighting,
        time_secs: f64,
    ) -> Result<Option<Vec<Stage>>, RenderError> {
        let gpu = scene.gpu;
        let posed = self.pose(gpu, scene.scene, &scene.resident.instances)?;
        let (Some(mut stages), Some(root)) = (posed, self.octree().map(|octree| octree.root)) else {
            return Ok(None);
        };
        if self.is_lit(lighting, time_secs, scene.drifts()) {
            return Ok(Some(stages));
        }
        let begin = Instant::now();
        let (surfels, chunks) = (self.make_surfels(gpu)?, self.chunks(gpu));
        let g_buffer = scene.keeps_g_buffer();
        let eye = scene.eye(root.world_from_unit(DVec3::splat(0.5)), lighting)?;
        for chunk in &chunks {
            scene.check_wanted()?;
            let context = TileContext { places: self.places(), ..scene.context(&eye, &chunk.tile, g_buffer) };
            let mut frame = Frame::new(context, LightSharing::Leaves, "shade leaves", &mut stages);
            frame.footprint = Footprint::Equal(chunk.cell);
            self.shade(&mut frame.commands, &frame.context, chunk, &surfels);
            scene.add_light(&mut frame)?;
            self.keep(&mut frame.commands, &frame.context, chunk, &surfels);
            frame.commands.submit().wait()?;
        }
        let mut commands = gpu.commands("average surfels");
        self.light(&mut commands, surfels, lighting, time_secs);
        commands.submit().wait()?;
        timing::add_since(&mut stages, "shade leaves", begin);
        Ok(Some(stages))
    }

    /// The owner of each node, once the scene is posed: see [`OwnNodes::record`].
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

    /// The octree, once the scene is posed.
    pub fn octree(&self) -> Option<&Arc<Octree>> {
        self.faced.as_ref().map(|faced| &faced.octree)
    }

    /// The nodes, once they are lit.
    pub fn nodes(&self) -> Option<LitNodes<'_>> {
        let (Faced { octree, ends, .. }, Lit { surfels, .. }) = (self.faced.as_ref()?, self.lit.as_ref()?);
        Some(LitNodes { octree, surfels, ends })
    }

    /// Whether the leaves are up to date for these lights at this time.
    pub fn is_lit(&self, lighting: &Lighting, time_secs: f64, drifts: bool) -> bool {
        let is_now = |lit: &Lit| lit.lighting == *lighting && (!drifts || lit.time_secs == time_secs);
        self.lit.as_ref().is_some_and(is_now)
    }

    /// The leaves in chunks, to be shaded relative to the root's centre. Empty before the scene is posed.
    pub fn chunks(&self, gpu: &Gpu) -> Vec<Chunk> {
        let Some(Faced { octree, .. }) = &self.faced else { return Vec::new() };
        let most = CHUNK_SIDE * CHUNK_SIDE / 2;
        let edge = octree.root.edge;
        let chunk = |first: u32| {
            let texels = 2 * most.min(octree.leaf_count() - first);
            let size = [CHUNK_SIDE, texels.div_ceil(CHUNK_SIDE).next_multiple_of(LEAF_BLOCK)];
            let cell = (edge * (-f64::from(octree.depth)).exp2()) as f32;
            let params = LeafChunk {
                root_about_eye: [-0.5 * edge as f32; 3],
                edge: edge as f32,
                size,
                first,
                leaves: octree.leaf_count(),
                cell,
                ..LeafChunk::zeroed()
            };
            let uniform = gpu.upload("leaves", &[params], wgpu::BufferUsages::UNIFORM);
            Chunk { tile: image_of(size), cell, uniform }
        };
        (0..octree.leaf_count()).step_by(most as usize).map(chunk).collect()
    }

    /// Triangles of each leaf, as the list of the context's tile.
    pub fn places(&self) -> Option<wgpu::Buffer> {
        self.faced.as_ref().map(|faced| faced.facing.clone())
    }

    /// Allocates the surfels of all nodes.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they exceed what the device can bind.
    pub fn make_surfels(&self, gpu: &Gpu) -> Result<wgpu::Buffer, RenderError> {
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

    /// Shades a chunk's leaves, and stores the G-buffer that indirect light needs.
    pub fn shade(
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

    /// Stores the radiance of a chunk's leaves as surfels.
    pub fn keep(
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

    /// Averages leaves into inner nodes, and uses the result from now on.
    pub fn light(
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

/// Settings for maps of an octree, each view traversed alone. The bytes do not depend on earlier maps.
pub(crate) fn map_settings(side: u32, octree: &Octree) -> Settings {
    Settings {
        side,
        texel: Texel::RangeAndNode,
        disc: Settings::COVERING,
        shared_disc: Settings::COVERING,
        sharing: false,
        // Would depend on earlier frames.
        falls_back: false,
        // Culls the cell that the view stands in.
        own_cell: false,
        // A view has fewer pairs than leaves; what does not fit is traversed in parts. Rounded, so that the next pose's
        // octree needs the same size.
        queue_pairs: Some(octree.leaf_count().saturating_mul(8).clamp(1 << 16, 1 << 31).next_power_of_two()),
        view_depth: Some(octree.depth),
        ..Settings::default()
    }
}

/// Converts errors of hierarchies.
pub fn to_render_error(error: HierarchyError) -> RenderError {
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
