//! Program: `shaders/filter_indirect.wgsl`. Filters gathered light along surfaces and adds it to radiance.

use crate::programs::FILTER_INDIRECT;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};

use super::gather::Gathered;

/// A cross-bilateral filter, rows then columns.
pub(crate) struct FilterIndirect {
    rows: ComputePipeline,
    columns: ComputePipeline,
}

impl FilterIndirect {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self {
            rows: gpu.compute_pipeline(&FILTER_INDIRECT, "filter_rows"),
            columns: gpu.compute_pipeline(&FILTER_INDIRECT, "add_filtered_columns"),
        }
    }

    /// Adds a tile's indirect light to its radiance.
    pub(crate) fn record(&self, commands: &mut Commands, gathered: &Gathered<'_>, shaded: &wgpu::Buffer) {
        let scratch = gathered.scratch;
        let [width, height] = scratch.size();
        commands
            .compute("filter indirect light", &self.rows)
            .read("gathering", &gathered.gathering)
            .read("g_surfaces", &gathered.g_buffer.surfaces)
            .read("gathered", &scratch.light[0])
            .write("filtered", &scratch.light[1])
            .dispatch_threads([width, height, 1]);
        commands
            .compute("add indirect light", &self.columns)
            .read("gathering", &gathered.gathering)
            .read("g_surfaces", &gathered.g_buffer.surfaces)
            .read("g_materials", &gathered.g_buffer.materials)
            .read("gathered", &scratch.light[1])
            .write("shaded", shaded)
            .dispatch_threads([width, height, 1]);
    }
}
