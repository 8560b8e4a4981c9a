//! The passes of a tile, one file each; the program of `x.rs` is `shaders/sampler/x.wgsl`.

mod adopt_maps;
mod cull_vpls;
mod filter_indirect;
mod gather;
mod imperfect;
mod look_up;
mod resolve_sample;
mod resolve_view;
mod shade;
mod shade_leaves;
mod surfels;
mod trace;
mod trace_cutouts;
mod visibility;

use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};

use crate::eye::Eye;
use crate::resident::Resident;
use crate::scratch::Targets;
use crate::tile::Tile;

pub(crate) use adopt_maps::AdoptMaps;
pub(crate) use cull_vpls::CullVpls;
pub(crate) use filter_indirect::FilterIndirect;
pub(crate) use gather::{Gather, Gathered, IndirectScratch, Maps, blocks};
pub(crate) use imperfect::Imperfect;
pub(crate) use look_up::{LookUp, Maps as NodeMaps};
pub(crate) use resolve_sample::{PlaneBuffers, ResolveSample};
pub(crate) use resolve_view::ResolveView;
pub(crate) use shade::{Shade, Shading};
pub(crate) use shade_leaves::{Leaves, ShadeLeaves};
pub(crate) use surfels::Surfels;
pub(crate) use trace::Trace;
pub(crate) use visibility::Rasteriser;

/// A tile about to be rendered: all that its passes have in common.
pub(crate) struct TileContext<'a> {
    pub(crate) gpu: &'a Arc<Gpu>,
    pub(crate) resident: &'a Resident,
    pub(crate) eye: &'a Eye,
    pub(crate) tile: &'a Tile,
    /// The tile's rays, a uniform.
    pub(crate) rays: wgpu::Buffer,
    /// Of a tile whose pixels are a list: where each lies in the tile that the rays are of.
    pub(crate) places: Option<wgpu::Buffer>,
    pub(crate) targets: Targets,
    /// Where shading leaves what indirect light needs of each surface, if there is any.
    pub(crate) indirect: Option<IndirectScratch>,
}
