//! Omni samples from an octree of the scene rather than from its triangles ([`argus_scene::Sampling::MegaViews`]).
//!
//! Once a pose the scene's surfaces become an octree; once a lighting its leaves are shaded, each on both sides, which
//! does not depend on who looks; then one traversal renders the maps of all cameras of a batch, and each sub-sample of a
//! sample looks up which node its ray meets.
//!
//! Maps of cameras that are traversed together depend on one another: what looks alike from several is rendered once,
//! from the middle of them. So that a sample's bytes stay a function of its id, either none is shared, or among a block
//! of the rig's lattice that follows from the sample's index ([`argus_scene::Rig::block`]), whoever asked for which.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::hierarchy::{HierarchyError, Octree, OctreeBuilder, RootCube, Triangle};
use argus_gpu::many_views::{Knobs, ManyViews, Texel, ViewList, ViewPoint};
use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::camera::Face;
use argus_scene::{InvalidField, Lighting, MegaViews, RenderError, Rig, SampleId, Scene, Stage};
use argus_shaders::layout::sampler::{LEAF_BLOCK, LeafChunk, SURFEL_BYTES};
use bytemuck::Zeroable;
use glam::{DMat3, DVec2, Vec3};

use crate::passes::{Leaves, LookUp, NodeMaps, ResolveSample, ShadeLeaves, Surfels, TileContext};
use crate::resident::{Cull, Placement, Resident, upload};
use crate::tile::Tile;
use crate::{Indirect, SamplerKnobs};

/// Columns, and most rows, of the image that leaves are shaded in: half a million of them at a time.
const CHUNK_SIDE: u32 = 1024;
/// Bytes of maps that are rendered in one traversal where none are shared: 32 of 1024² texels a hemisphere.
const MOST_MAP_BYTES: u64 = 512 << 20;
/// Set in the number of a triangle whose back is not seen, as `shaders/sampler/shade_leaves.wgsl` has it.
const SINGLE_SIDED: u32 = 1 << 31;
/// Levels below the root that an octree over cameras may have.
const MOST_VIEW_LEVELS: u32 = 10;

/// What samples are looked up in, of one scene on one device.
pub(crate) struct OmniMaps {
    knobs: MegaViews,
    shade: ShadeLeaves,
    surfels: Surfels,
    look_up: LookUp,
    /// Such samples have no planes for reflections, whatever the scene has.
    pub(crate) resolve: ResolveSample,
    /// Its programs are made once.
    builder: Option<OctreeBuilder>,
    faced: Option<Faced>,
    lit: Option<Lit>,
    traversed: Option<Traversed>,
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

/// Maps of some cameras of a rig.
struct Traversed {
    rig: Rig,
    cameras: Vec<u64>,
    views: ManyViews,
}

/// Leaves that are shaded at a time.
pub(crate) struct Chunk {
    /// The image that they are shaded in.
    pub(crate) tile: Tile,
    uniform: wgpu::Buffer,
}

/// Samples whose maps are rendered in one traversal.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Group {
    /// The cameras that are traversed, ascending.
    cameras: Vec<u64>,
    /// Of each sample that was asked for, its place in the order and the number of its camera in the traversal.
    pub(crate) wanted: Vec<(usize, u32)>,
}

impl OmniMaps {
    /// For a scene that lies on a device.
    pub(crate) fn new(gpu: &Gpu, resident: &Resident, sampler: &SamplerKnobs, knobs: MegaViews) -> Self {
        let keeps_guides = sampler.indirect != Indirect::Off;
        Self {
            knobs,
            shade: ShadeLeaves::new(gpu, resident.features, keeps_guides),
            surfels: Surfels::new(gpu),
            look_up: LookUp::new(gpu, 1),
            resolve: ResolveSample::new(gpu, false, sampler.side()),
            builder: None,
            faced: None,
            lit: None,
            traversed: None,
        }
    }

    /// Takes other knobs.
    pub(crate) fn set_knobs(&mut self, knobs: MegaViews) {
        if knobs.levels != self.knobs.levels {
            self.forget_pose();
        }
        if knobs != self.knobs {
            self.traversed = None;
        }
        self.knobs = knobs;
    }

    /// Surfaces lie elsewhere.
    pub(crate) fn forget_pose(&mut self) {
        self.faced = None;
        self.traversed = None;
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
        let octree = match builder.build_faced(root, self.knobs.levels, triangles) {
            Err(HierarchyError::Empty) => return Ok(None),
            octree => octree.map_err(into_render)?,
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

    /// The cube around the scene, once it was posed.
    pub(crate) fn root(&self) -> Option<RootCube> {
        self.faced.as_ref().map(|faced| faced.octree.root)
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
            let told = LeafChunk {
                root_about_eye: [-0.5 * edge as f32; 3],
                edge: edge as f32,
                size,
                first,
                leaves: octree.leaf_count(),
                cell: (edge * (-f64::from(octree.depth)).exp2()) as f32,
                ..LeafChunk::zeroed()
            };
            let uniform = gpu.upload("leaves", &[told], wgpu::BufferUsages::UNIFORM);
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
            return Err(into_render(HierarchyError::TooLarge { what, needed: nodes * SURFEL_BYTES, limit }));
        }
        Ok(gpu.buffer("surfels", nodes.max(1) * SURFEL_BYTES, wgpu::BufferUsages::STORAGE))
    }

    /// Shades a chunk's leaves; `add_light` adds what else lights them before they are kept.
    pub(crate) fn shade(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        chunk: &Chunk,
        surfels: &wgpu::Buffer,
        add_light: impl FnOnce(&mut Commands),
    ) {
        let Some(Faced { octree, triangle_ids, facing, .. }) = &self.faced else { return };
        let leaves = Leaves { octree, triangle_ids, facing, surfels, chunk: &chunk.uniform };
        self.shade.record(commands, context, &leaves);
        add_light(commands);
        self.surfels.keep(commands, context, &leaves);
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

    /// Renders the maps of a group's cameras, unless they are there.
    ///
    /// # Errors
    /// A camera that the rig does not have; [`RenderError::OutOfMemory`] for more maps than the device can hold.
    pub(crate) fn traverse(
        &mut self,
        gpu: &Arc<Gpu>,
        rig: &Rig,
        group: &Group,
    ) -> Result<Vec<Stage>, RenderError> {
        let Some(Faced { octree, .. }) = &self.faced else {
            return Err(RenderError::Internal("the octree was not built".to_owned()));
        };
        let is_there = |t: &Traversed| t.rig == *rig && t.cameras == group.cameras;
        if self.traversed.as_ref().is_some_and(is_there) {
            return Ok(Vec::new());
        }
        let begin = Instant::now();
        let points = group
            .cameras
            .iter()
            .map(|&index| Ok(ViewPoint::everywhere(rig.camera(index)?.center())))
            .collect::<Result<Vec<_>, InvalidField>>()?;
        let list = ViewList::new(gpu, &octree.root, &points)?;
        let knobs = self.traversal(rig, octree, group, list.edge());
        let kept = self.traversed.take().filter(|traversed| *traversed.views.knobs() == knobs);
        let mut views = match kept {
            Some(traversed) => traversed.views,
            None => ManyViews::new(gpu, Arc::clone(octree), knobs).map_err(into_render)?,
        };
        views.render(&list).map_err(into_render)?;
        if views.maps().arrays.len() != self.look_up.arrays() {
            self.look_up = LookUp::new(gpu, views.maps().arrays.len());
        }
        self.traversed = Some(Traversed { rig: *rig, cameras: group.cameras.clone(), views });
        Ok(vec![Stage::new("traverse octree", begin.elapsed().as_secs_f64() * 1e3)])
    }

    /// How a group is traversed: by a function of its cameras alone.
    fn traversal(&self, rig: &Rig, octree: &Octree, group: &Group, edge: f64) -> Knobs {
        let alone = Knobs {
            side: self.knobs.map_side,
            texel: Texel::RangeAndNode,
            sharing: false,
            // What was rendered before decides nothing.
            falls_back: false,
            // A picture of what surrounds a camera, and not of the wall that it stands in.
            own_cell: false,
            // Each camera's pairs are fewer than leaves; what does not fit is traversed in parts.
            queue_pairs: Some(octree.leaf_count().saturating_mul(8).max(1 << 16)),
            view_depth: Some(octree.depth),
            ..Knobs::default()
        };
        let spacing = group.cameras.first().and_then(|&index| rig.spacing_of(index));
        let (Some(spacing), true) = (spacing, self.knobs.block > 1 && group.cameras.len() > 1) else {
            return alone;
        };
        // Cells of the octree over the cameras are narrower than the lattice, so that each camera has its own map.
        let cells = edge * octree.root.edge / spacing;
        let view_depth = (cells.log2().floor() as u32).saturating_add(1).max(1);
        if view_depth > MOST_VIEW_LEVELS {
            alone
        } else {
            Knobs { sharing: true, view_depth: Some(view_depth), ..alone }
        }
    }

    /// Shades a tile of a sample of the group that was traversed last, from its camera's map.
    pub(crate) fn look_up(&self, commands: &mut Commands, context: &TileContext<'_>, view: u32) {
        let (Some(faced), Some(lit), Some(traversed)) = (&self.faced, &self.lit, &self.traversed) else {
            return;
        };
        let maps = NodeMaps {
            octree: &faced.octree,
            views: &traversed.views,
            surfels: &lit.surfels,
            ends: &faced.ends,
        };
        self.look_up.record(commands, context, &maps, view);
    }
}

/// Samples by the traversal that they come from. Cameras that share nothing go together as they come, as many as a
/// device holds maps of; those of a block always go with all of it. What the rig does not have is of no group.
pub(crate) fn groups(rig: &Rig, ids: &[SampleId], knobs: &MegaViews) -> Vec<Group> {
    let texel_bytes = u64::from(Texel::RangeAndNode.bits()) / 8;
    let map_bytes = 2 * u64::from(knobs.map_side) * u64::from(knobs.map_side) * texel_bytes;
    let most = (MOST_MAP_BYTES / map_bytes.max(1)).max(1) as usize;
    let mut groups: Vec<Group> = Vec::new();
    for (order, id) in ids.iter().enumerate().filter(|(_, id)| rig.level(id.index).is_some()) {
        let block = rig.block(id.index, knobs.block);
        let is_of = |group: &Group| group.cameras.contains(&id.index);
        let has_room = |group: &Group| knobs.block == 1 && group.cameras.len() < most;
        let found = groups.iter().position(|group| is_of(group) || has_room(group));
        let group = found.unwrap_or_else(|| {
            groups.push(Group { cameras: Vec::new(), wanted: Vec::new() });
            groups.len() - 1
        });
        let Group { cameras, wanted } = &mut groups[group];
        if !cameras.contains(&id.index) {
            cameras.extend(block);
        }
        let view = cameras.iter().position(|&index| index == id.index).unwrap_or(0);
        wanted.push((order, view as u32));
    }
    groups
}

/// The image that leaves are shaded in, as a tile: of a list, whose rays nobody follows.
fn image_of(size: [u32; 2]) -> Tile {
    let face = Face { view_from_world: DMat3::IDENTITY, tan_half_fov: DVec2::ONE, offset: [0, 0], size };
    Tile { face, begin: [0, 0], size, side: 1 }
}

fn into_render(error: HierarchyError) -> RenderError {
    match error {
        HierarchyError::Gpu(error) => error.into(),
        HierarchyError::OutOfRange { .. } => InvalidField::new("sampling", error.to_string()).into(),
        HierarchyError::TooLarge { what, needed, limit } => RenderError::OutOfMemory(format!(
            "{what} take {} MiB, and this device binds at most {} MiB: megaviews needs fewer levels, smaller maps or \
             smaller blocks here",
            needed.div_ceil(1 << 20),
            limit >> 20
        )),
        HierarchyError::TooManyNodes { .. } => RenderError::OutOfMemory(error.to_string()),
        HierarchyError::Empty => RenderError::Internal(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::Camera;
    use glam::DVec3;

    use super::*;

    fn ids(indices: &[u64]) -> Vec<SampleId> {
        indices.iter().map(|&index| SampleId { epoch: 0, generation: 1, index }).collect()
    }

    #[test]
    fn samples_that_share_nothing_are_traversed_together_up_to_what_fits() {
        let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 64 };
        let corners = rig.nearest(&Camera::look_at(DVec3::splat(0.4), DVec3::X), 8);
        let asked: Vec<u64> = corners.iter().chain(&corners[..2]).copied().collect();
        let all = groups(&rig, &ids(&asked), &MegaViews { map_side: 64, levels: 4, block: 1 });
        assert_eq!(all.len(), 1);
        assert_eq!(all[0].cameras, corners);
        assert_eq!(all[0].wanted[8..], [(8, 0), (9, 1)]);

        let far = Camera::look_at(DVec3::splat(10.4), DVec3::X);
        let many: Vec<u64> = (0..40)
            .flat_map(|i| rig.nearest(&Camera { eye: far.eye + DVec3::X * f64::from(i), ..far }, 1))
            .collect();
        let large = MegaViews { map_side: 1024, levels: 4, block: 1 };
        let counts: Vec<usize> =
            groups(&rig, &ids(&many), &large).iter().map(|group| group.cameras.len()).collect();
        assert_eq!(counts, [32, 8]);
    }

    #[test]
    fn samples_of_a_block_are_traversed_with_all_of_it_whoever_is_asked_for() {
        let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 64 };
        let knobs = MegaViews { map_side: 64, levels: 4, block: 2 };
        let corners = rig.nearest(&Camera::look_at(DVec3::splat(0.4), DVec3::X), 8);
        let together = groups(&rig, &ids(&corners), &knobs);
        assert_eq!(together.len(), 1, "the corners of an aligned cell are one block");
        for &index in &corners {
            let alone = groups(&rig, &ids(&[index]), &knobs);
            assert_eq!(alone[0].cameras, together[0].cameras);
            let place = together[0].cameras.iter().position(|&camera| camera == index).unwrap();
            assert_eq!(alone[0].wanted, [(0, place as u32)]);
        }
    }
}
