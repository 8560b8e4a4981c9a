//! The passes, one file each. The program of `x.rs` is `shaders/sampler/x.wgsl`.

mod add_direct;
mod add_reflections;
mod adopt_maps;
mod blend;
mod blur_probes;
mod choose_receivers;
mod cull_vpls;
mod filter_indirect;
mod gather;
mod imperfect;
mod map_lookup;
mod own_nodes;
mod receive;
mod resample_points;
mod resample_probes;
mod resolve_sample;
mod resolve_view;
mod shade;
mod shade_leaves;
mod shade_points;
mod shade_sample;
mod spread;
mod surfels;
mod trace;
mod trace_cutouts;
mod visibility;

use std::sync::Arc;

use argus_gpu::many_views::ManyViews;
use argus_gpu::{ComputeCall, Gpu, wgpu};

use crate::eye::Eye;
use crate::resident::Resident;
use crate::scratch::{Extras, Scratch, Targets};
use crate::tile::Tile;

pub(crate) use add_direct::AddDirect;
pub(crate) use add_reflections::AddReflections;
pub(crate) use adopt_maps::AdoptMaps;
pub(crate) use blend::{Blend, Placed, Shaded};
pub(crate) use blur_probes::{BlurProbes, ProbePlanes};
pub(crate) use choose_receivers::{BlockUniform, ChooseReceivers, OF_BLOCK};
pub(crate) use cull_vpls::CullVpls;
pub(crate) use filter_indirect::FilterIndirect;
pub(crate) use gather::{Gather, Gathered, IndirectScratch, Maps, blocks};
pub(crate) use imperfect::Imperfect;
pub(crate) use map_lookup::{MapLookup, Maps as NodeMaps};
pub(crate) use own_nodes::{NodeSurfaces, OwnNodes};
pub(crate) use receive::{Batch, Receive};
pub(crate) use resample_points::ResamplePoints;
pub(crate) use resample_probes::ResampleProbes;
pub(crate) use resolve_sample::{PlaneBuffers, ResolveSample};
pub(crate) use resolve_view::ResolveView;
pub(crate) use shade::Shade;
pub(crate) use shade_leaves::{Leaves, ShadeLeaves};
pub(crate) use shade_points::ShadePoints;
pub(crate) use shade_sample::ShadeSample;
pub(crate) use spread::{Spread, SpreadFrom};
pub(crate) use surfels::Surfels;
pub(crate) use trace::Trace;
pub(crate) use visibility::Rasteriser;

/// Binds what `shaders/shared/node_maps.wgsl` reads.
fn with_node_maps<'a>(call: ComputeCall<'a>, views: &'a ManyViews) -> ComputeCall<'a> {
    let arrays = &views.maps().arrays;
    // Missing arrays are never read.
    let array = |i: usize| arrays.get(i).unwrap_or(&arrays[0]);
    call.read("map_of_view", views.map_of_view())
        .read("maps0", array(0))
        .read("maps1", array(1))
        .read("maps2", array(2))
        .read("maps3", array(3))
}

/// What the passes of a tile share.
pub(crate) struct TileContext<'a> {
    pub(crate) gpu: &'a Arc<Gpu>,
    pub(crate) resident: &'a Resident,
    pub(crate) eye: &'a Eye,
    pub(crate) tile: &'a Tile,
    /// Uniform of the tile's rays.
    pub(crate) rays: wgpu::Buffer,
    /// For a list of pixels: the position of each in the tile of the rays.
    pub(crate) places: Option<wgpu::Buffer>,
    pub(crate) targets: Targets,
}

impl<'a> TileContext<'a> {
    /// Uploads a tile's rays and takes targets of its size.
    pub(crate) fn new(
        gpu: &'a Arc<Gpu>,
        resident: &'a Resident,
        eye: &'a Eye,
        tile: &'a Tile,
        scratch: &mut Scratch,
        extras: Extras,
    ) -> Self {
        let rays = gpu.upload("rays", &[tile.rays()], wgpu::BufferUsages::UNIFORM);
        let targets = scratch.targets(gpu, tile.sub_samples(), extras);
        Self { gpu, resident, eye, tile, rays, places: None, targets }
    }

    /// The context with one ray a texel, for shading what the tile's sub-samples see.
    pub(crate) fn of_texels(self, texels: &'a Tile) -> Self {
        let rays = self.gpu.upload("rays", &[texels.rays()], wgpu::BufferUsages::UNIFORM);
        Self { tile: texels, rays, ..self }
    }

    /// Binds what a program reads to shade surfaces.
    fn with_surfaces<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        let Self { resident, eye, .. } = self;
        call.read("lighting", &eye.lighting)
            .read("lights", &eye.lights)
            .read("vertices", &resident.vertices)
            .read("attributes", &resident.attributes)
            .read("indices", &resident.indices)
            .read("meshes", &resident.meshes)
            .read("instances", &eye.instances)
            .read("materials", &resident.materials)
            .read("slots", &resident.slots)
            .read("texel_levels", &resident.texel_levels)
            .read("texels", &resident.texels)
            .read("texels_srgb", &resident.texels_srgb)
    }
}
