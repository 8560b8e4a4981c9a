//! Omni samples from an octree of the scene ([`argus_scene::Sampling::MegaViews`]).
//!
//! The octree's leaves are shaded on both sides, independent of the viewer ([`LitOctree`]). One traversal renders the
//! maps of all cameras of a batch. Each sub-sample then looks up the node that its ray meets.
//!
//! Cameras that share a traversal depend on one another: nodes that look alike from several cameras are rendered once,
//! from their centre. To keep a sample's bytes a function of its id, either no camera shares, or all cameras of a fixed
//! block of the rig's lattice do ([`argus_scene::Rig::block`]).
//!
//! # Steps
//!
//! Once a pose: the octree, and the triangle that each leaf shows to either side. Once a lighting: *shade leaves* shades
//! the leaves with the functions of `shaders/shared/surface.wgsl`, with textures filtered to a cell; *surfels* averages
//! them up the tree. Once a batch: one traversal for all waiting cameras (up to eight, the corners of a cell). Once a
//! sample: *map lookup* replaces visibility and shading. A sub-sample's ray finds a node in its camera's map. Its range
//! is where the texel's central ray meets the node's plane, clamped to the node's cell. The cell that a camera stands in
//! is culled (`Settings::own_cell`).
//!
//! # Format
//!
//! A sample is stored as cube faces, because the warp searches along straight lines of pinhole images. A texel of a face
//! looks up the map four times and takes one surface, as with triangles.
//!
//! # Sharing
//!
//! By default each camera is traversed alone. With `--map-block 2|4` an aligned block of the lattice shares a traversal.
//! Sharing is off by default, because a shared node appears at most a texel large and is at least as large as the
//! distance between cameras. At 16² texels such nodes are a sixteenth of the scene; at 256² there are none.
//!
//! # Losses against triangles
//!
//! Reflection and gloss (no planes), cut-outs (leaves hold whole triangles), detail smaller than a cell, and the back of
//! single-sided surfaces (rendered as sky). `argus-lab study method omni-maps` measures them.

use std::sync::Arc;
use std::time::Instant;

use crate::hierarchy::Octree;
use crate::many_views::{ManyViews, Settings, Texel, ViewList, ViewPoint};
use argus_gpu::{Commands, Gpu};
use argus_sampler::plug::{GBufferUse, LitScene, ResolveSample, TileContext};
use argus_scene::{InvalidField, MegaViews, RenderError, Rig, SampleId, Stage};

use crate::lit_octree::{LitOctree, map_settings, to_render_error};
use crate::passes::{MapLookup, NodeMaps};

/// Most bytes of maps in one traversal without sharing: 32 maps of 1024² texels a hemisphere.
const MOST_MAP_BYTES: u64 = 512 << 20;
/// Most levels of the octree over cameras.
const MOST_VIEW_LEVELS: u32 = 10;

/// The maps of one scene's sample cameras on one device.
pub(crate) struct OmniMaps {
    settings: MegaViews,
    pub(crate) octree: LitOctree,
    look_up: MapLookup,
    /// Resolves samples without planes for reflections.
    pub(crate) resolve: ResolveSample,
    /// Kept across octrees, because its programs are reused.
    views: Option<ManyViews>,
    /// The rig and cameras whose maps are rendered.
    traversed: Option<(Rig, Vec<u64>)>,
}

/// Samples of one traversal.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Group {
    /// Indices of the cameras, ascending.
    cameras: Vec<u64>,
    /// For each requested sample its position in the job and the index of its camera in the traversal.
    pub(crate) wanted: Vec<(usize, u32)>,
}

impl OmniMaps {
    /// The maps of a scene on a device.
    pub(crate) fn new(scene: &LitScene<'_>, settings: MegaViews) -> Self {
        let (gpu, resident, sampler) = (scene.gpu, scene.resident, scene.settings);
        let g_buffer = GBufferUse::of(sampler);
        Self {
            settings,
            octree: LitOctree::new(gpu, resident, g_buffer, settings.levels),
            look_up: MapLookup::new(gpu, resident.features, 1),
            resolve: ResolveSample::new(gpu, false, sampler.side(), false, false),
            views: None,
            traversed: None,
        }
    }

    /// Changes the settings.
    pub(crate) fn set_settings(&mut self, settings: MegaViews) {
        self.octree.set_levels(settings.levels);
        if settings != self.settings {
            self.traversed = None;
        }
        self.settings = settings;
    }

    /// Marks all as out of date, because surfaces moved.
    pub(crate) fn forget_pose(&mut self) {
        self.octree.forget_pose();
        self.traversed = None;
    }

    /// Renders the maps of a group's cameras, unless they are up to date.
    ///
    /// # Errors
    /// The rig lacks a camera; [`RenderError::OutOfMemory`] for more maps than the device can hold.
    pub(crate) fn traverse(
        &mut self,
        gpu: &Arc<Gpu>,
        rig: &Rig,
        group: &Group,
    ) -> Result<Vec<Stage>, RenderError> {
        let Some(octree) = self.octree.octree() else {
            return Err(RenderError::Internal("the octree was not built".to_owned()));
        };
        if self.traversed.as_ref().is_some_and(|(of, cameras)| of == rig && *cameras == group.cameras) {
            return Ok(Vec::new());
        }
        self.traversed = None;
        let begin = Instant::now();
        let points = group
            .cameras
            .iter()
            .map(|&index| Ok(ViewPoint::everywhere(rig.camera(index)?.center())))
            .collect::<Result<Vec<_>, InvalidField>>()?;
        let list = ViewList::new(gpu, &octree.root, &points)?;
        let settings = self.traversal(rig, octree, group, list.edge());
        let mut views =
            ManyViews::reuse_or_new(self.views.take(), gpu, octree, settings).map_err(to_render_error)?;
        views.render(&list).map_err(to_render_error)?;
        self.look_up.set_arrays(gpu, views.maps().arrays.len());
        self.views = Some(views);
        self.traversed = Some((*rig, group.cameras.clone()));
        Ok(vec![Stage::new("traverse octree", begin.elapsed().as_secs_f64() * 1e3)])
    }

    /// Settings of a group's traversal, a function of its cameras alone.
    fn traversal(&self, rig: &Rig, octree: &Octree, group: &Group, edge: f64) -> Settings {
        let alone = map_settings(self.settings.map_side, octree);
        let spacing = group.cameras.first().and_then(|&index| rig.spacing_of(index));
        let (Some(spacing), true) = (spacing, self.settings.block > 1 && group.cameras.len() > 1) else {
            return alone;
        };
        // Cells of the octree over cameras are narrower than the lattice, so each camera has its own map.
        let cells = edge * octree.root.edge / spacing;
        let view_depth = (cells.log2().floor() as u32).saturating_add(1).max(1);
        if view_depth > MOST_VIEW_LEVELS {
            alone
        } else {
            Settings { sharing: true, view_depth: Some(view_depth), ..alone }
        }
    }

    /// Looks up a tile of a sample in its camera's map. The sample belongs to the group that was traversed last.
    pub(crate) fn look_up(&self, commands: &mut Commands, context: &TileContext<'_>, view: u32) {
        let (Some(lit), Some(views)) = (self.octree.nodes(), &self.views) else { return };
        let maps = NodeMaps { octree: lit.octree, views, surfels: lit.surfels, ends: lit.ends };
        self.look_up.record(commands, context, &maps, view);
    }
}

/// Groups samples by traversal. Without sharing, cameras are grouped in order, as many as fit in memory. With sharing, a
/// group has all cameras of a block. Indices that the rig does not have are in no group.
pub(crate) fn groups(rig: &Rig, ids: &[SampleId], settings: &MegaViews) -> Vec<Group> {
    let texel_bytes = u64::from(Texel::RangeAndNode.bits()) / 8;
    let map_bytes = 2 * u64::from(settings.map_side) * u64::from(settings.map_side) * texel_bytes;
    let most = (MOST_MAP_BYTES / map_bytes.max(1)).max(1) as usize;
    let mut groups: Vec<Group> = Vec::new();
    for (order, id) in ids.iter().enumerate().filter(|(_, id)| rig.level(id.camera).is_some()) {
        let block = rig.block(id.camera, settings.block);
        let is_of = |group: &Group| group.cameras.contains(&id.camera);
        let has_room = |group: &Group| settings.block == 1 && group.cameras.len() < most;
        let found = groups.iter().position(|group| is_of(group) || has_room(group));
        let group = found.unwrap_or_else(|| {
            groups.push(Group { cameras: Vec::new(), wanted: Vec::new() });
            groups.len() - 1
        });
        let Group { cameras, wanted } = &mut groups[group];
        if !cameras.contains(&id.camera) {
            cameras.extend(block);
        }
        let view = cameras.iter().position(|&index| index == id.camera).unwrap_or(0);
        wanted.push((order, view as u32));
    }
    groups
}

#[cfg(test)]
mod tests {
    use argus_scene::Camera;
    use glam::DVec3;

    use super::*;

    fn ids(indices: &[u64]) -> Vec<SampleId> {
        indices.iter().map(|&index| SampleId { version: 0, camera: index }).collect()
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
    fn samples_of_a_block_are_always_traversed_with_the_whole_block() {
        let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 64 };
        let settings = MegaViews { map_side: 64, levels: 4, block: 2 };
        let corners = rig.nearest(&Camera::look_at(DVec3::splat(0.4), DVec3::X), 8);
        let together = groups(&rig, &ids(&corners), &settings);
        assert_eq!(together.len(), 1, "the corners of an aligned cell are one block");
        for &index in &corners {
            let alone = groups(&rig, &ids(&[index]), &settings);
            assert_eq!(alone[0].cameras, together[0].cameras);
            let place = together[0].cameras.iter().position(|&camera| camera == index).unwrap();
            assert_eq!(alone[0].wanted, [(0, place as u32)]);
        }
    }
}
