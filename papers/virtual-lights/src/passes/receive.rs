//! Program: `shaders/receive.wgsl`. Integrates the light that receivers receive from their maps.

use crate::layout::Receive as Parameters;
use crate::programs::RECEIVE;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_megaviews::many_views::ManyViews;

use argus_megaviews::with_node_maps;

/// One workgroup a receiver. The pipeline depends on the number of arrays of maps.
pub(crate) struct Receive {
    pipeline: ComputePipeline,
    arrays: usize,
}

/// Receivers of one traversal.
pub(crate) struct Batch<'a> {
    /// All receivers.
    pub(crate) receivers: &'a wgpu::Buffer,
    /// First receiver of the batch, and number of receivers.
    pub(crate) first: u32,
    pub(crate) count: u32,
    /// Maps of the receivers, in the same order.
    pub(crate) views: &'a ManyViews,
    /// Radiance of the nodes.
    pub(crate) surfels: &'a wgpu::Buffer,
}

impl Receive {
    pub(crate) fn new(gpu: &Gpu, arrays: usize) -> Self {
        let constants = [("arrays", arrays as f64)];
        Self { pipeline: gpu.compute_pipeline_with(&RECEIVE, "receive_light", &constants), arrays }
    }

    /// Number of arrays of the pipeline.
    pub(crate) fn arrays(&self) -> usize {
        self.arrays
    }

    /// Writes the light of a batch to `received`: four floats a receiver.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &Batch<'_>,
        received: &wgpu::Buffer,
    ) {
        let set = batch.views.maps();
        let params =
            Parameters { first: batch.first, count: batch.count, map_shift: set.shift, map_side: set.side };
        let params = gpu.upload("receive", &[params], wgpu::BufferUsages::UNIFORM);
        let across = batch.count.min(1 << 15);
        with_node_maps(commands.compute("receive light", &self.pipeline), batch.views)
            .read("receive", &params)
            .read("receivers", batch.receivers)
            .read("surfels", batch.surfels)
            .write("received", received)
            .dispatch([across, batch.count.div_ceil(across.max(1)), 1]);
    }
}
