//! The passes, one file each.

mod map_lookup;
mod own_nodes;
mod resample_probes;
mod shade_leaves;
mod surfels;

use argus_gpu::ComputeCall;

use crate::many_views::ManyViews;
pub(crate) use map_lookup::{MapLookup, Maps as NodeMaps};
pub(crate) use own_nodes::{NodeSurfaces, OwnNodes};
pub(crate) use resample_probes::ResampleProbes;
pub(crate) use shade_leaves::{Leaves, ShadeLeaves};
pub(crate) use surfels::Surfels;

/// Binds what `shaders/shared/node_maps.wgsl` reads.
pub fn with_node_maps<'a>(call: ComputeCall<'a>, views: &'a ManyViews) -> ComputeCall<'a> {
    let arrays = &views.maps().arrays;
    // Missing arrays are never read.
    let array = |i: usize| arrays.get(i).unwrap_or(&arrays[0]);
    call.read("map_of_view", views.map_of_view())
        .read("maps0", array(0))
        .read("maps1", array(1))
        .read("maps2", array(2))
        .read("maps3", array(3))
}
