//! Program: `shaders/adopt_maps.wgsl`. Assigns the maps of a many-views traversal to VPLs.

use crate::layout::AdoptMaps as Parameters;
use crate::programs::ADOPT_MAPS;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_megaviews::many_views::ManyViews;

/// Assigns a map to each VPL.
pub(crate) struct AdoptMaps {
    pipeline: ComputePipeline,
}

impl AdoptMaps {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&ADOPT_MAPS, "adopt_maps") }
    }

    /// Writes, for each view of the latest frame, its map and the map's centre.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        views: &ManyViews,
        parameters: Parameters,
        eyes: &wgpu::Buffer,
    ) {
        let uniform = gpu.upload("adopt maps", &[parameters], wgpu::BufferUsages::UNIFORM);
        commands
            .compute("adopt maps", &self.pipeline)
            .read("adopt", &uniform)
            .read("map_of_view", views.map_of_view())
            .read("map_centers", views.map_centers())
            .write("eyes", eyes)
            .dispatch_threads([parameters.count, 1, 1]);
    }
}
