//! Omni samples from an octree of the scene rather than from its triangles ([`argus_scene::Sampling::MegaViews`]).
//!
//! The octree's leaves are shaded on both sides, which does not depend on who looks ([`LitOctree`]); then one traversal
//! renders the maps of all cameras of a batch, and each sub-sample of a sample looks up which node its ray meets.
//!
//! Maps of cameras that are traversed together depend on one another: what looks alike from several is rendered once,
//! from the middle of them. So that a sample's bytes stay a function of its id, either none is shared, or among a block
//! of the rig's lattice that follows from the sample's index ([`argus_scene::Rig::block`]), whoever asked for which.
//!
//! # Steps
//!
//! Once a pose: the octree, and the two triangles that each leaf shows, one to either side. Once a lighting: *shade leaves* shades a list
//! of points with the functions that shade what rays meet (`shaders/shared/surface.wgsl`), with textures as wide as a cell; *surfels*
//! averages them up the tree. Once a batch: one traversal for all waiting cameras (up to eight, the corners of a cell). Once a sample:
//! *look up* replaces visibility and shading. A sub-sample's ray finds a node in its camera's map; its range is where the texel's central
//! ray meets the node's plane, kept within the node's cell. The cell that a camera stands in is left out (`Knobs::own_cell`).
//!
//! # Format
//!
//! A sample is stored as cube faces, like any other. The warp searches along straight lines of pinhole images, which a paraboloid is not.
//! A texel of a face asks the map four times and takes one surface, as it would of triangles.
//!
//! # Sharing
//!
//! By default cameras are traversed each by itself. With `--map-block 2|4` an aligned block of the lattice is traversed together. Blocks
//! are off by default for a geometric reason: a shared node of the scene is at least as large as the cameras' distance, seen as a texel.
//! At 16² texels that is a sixteenth of the scene; at 256² it never happens.
//!
//! # Losses against triangles
//!
//! Mirrors and gloss (no planes for them), cut-outs (leaves hold whole triangles), detail below a cell, and the back of single-sided
//! surfaces, which counts as sky. `argus study omni-maps` measures them.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::hierarchy::Octree;
use argus_gpu::many_views::{Knobs, ManyViews, Texel, ViewList, ViewPoint};
use argus_gpu::{Commands, Gpu};
use argus_scene::{InvalidField, MegaViews, RenderError, Rig, SampleId, Stage};

use crate::lit_octree::{LitOctree, pictures, refused};
use crate::passes::{LookUp, NodeMaps, ResolveSample, TileContext};
use crate::resident::Resident;
use crate::{Indirect, SamplerKnobs};

/// Bytes of maps that are rendered in one traversal where none are shared: 32 of 1024² texels a hemisphere.
const MOST_MAP_BYTES: u64 = 512 << 20;
/// Levels below the root that an octree over cameras may have.
const MOST_VIEW_LEVELS: u32 = 10;

/// What samples are looked up in, of one scene on one device.
pub(crate) struct OmniMaps {
    knobs: MegaViews,
    pub(crate) octree: LitOctree,
    look_up: LookUp,
    /// Such samples have no planes for reflections, whatever the scene has.
    pub(crate) resolve: ResolveSample,
    /// Programs outlast the octree that they were made for.
    views: Option<ManyViews>,
    /// What cameras of which rig have maps in them.
    traversed: Option<(Rig, Vec<u64>)>,
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
            octree: LitOctree::new(gpu, resident, keeps_guides, knobs.levels),
            look_up: LookUp::new(gpu, 1),
            resolve: ResolveSample::new(gpu, false, sampler.side(), false),
            views: None,
            traversed: None,
        }
    }

    /// Takes other knobs.
    pub(crate) fn set_knobs(&mut self, knobs: MegaViews) {
        self.octree.set_levels(knobs.levels);
        if knobs != self.knobs {
            self.traversed = None;
        }
        self.knobs = knobs;
    }

    /// Surfaces lie elsewhere.
    pub(crate) fn forget_pose(&mut self) {
        self.octree.forget_pose();
        self.traversed = None;
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
        let knobs = self.traversal(rig, octree, group, list.edge());
        let mut views = ManyViews::kept_or_new(self.views.take(), gpu, octree, knobs).map_err(refused)?;
        views.render(&list).map_err(refused)?;
        if views.maps().arrays.len() != self.look_up.arrays() {
            self.look_up = LookUp::new(gpu, views.maps().arrays.len());
        }
        self.views = Some(views);
        self.traversed = Some((*rig, group.cameras.clone()));
        Ok(vec![Stage::new("traverse octree", begin.elapsed().as_secs_f64() * 1e3)])
    }

    /// How a group is traversed: by a function of its cameras alone.
    fn traversal(&self, rig: &Rig, octree: &Octree, group: &Group, edge: f64) -> Knobs {
        let alone = pictures(self.knobs.map_side, octree);
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
        let (Some(lit), Some(views)) = (self.octree.nodes(), &self.views) else { return };
        let maps = NodeMaps { octree: lit.octree, views, surfels: lit.surfels, ends: lit.ends };
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
    for (order, id) in ids.iter().enumerate().filter(|(_, id)| rig.level(id.camera).is_some()) {
        let block = rig.block(id.camera, knobs.block);
        let is_of = |group: &Group| group.cameras.contains(&id.camera);
        let has_room = |group: &Group| knobs.block == 1 && group.cameras.len() < most;
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
