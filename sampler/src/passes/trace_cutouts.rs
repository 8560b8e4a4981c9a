//! Program: `shaders/sampler/trace_cutouts.wgsl`. Traces alpha-tested triangles in front of opaque ones, by packets of
//! rays.

use std::sync::OnceLock;

use argus_gpu::{Commands, ComputePipeline, wgpu};
use argus_shaders::sampler::TRACE_CUTOUTS;

use super::TileContext;
use super::trace::Trace;

/// Traces alpha-tested triangles against the result of [`Trace`].
#[derive(Default)]
pub(super) struct TraceCutouts(OnceLock<ComputePipeline>);

impl TraceCutouts {
    /// Updates the visibility buffer where a cut-out is in front.
    pub(super) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        trace: &Trace,
        top: &wgpu::Buffer,
        placed: &wgpu::Buffer,
    ) {
        let TileContext { gpu, resident, eye, targets, tile, rays, .. } = context;
        let pipeline = self.0.get_or_init(|| {
            let mut constants = vec![("rows", 1.0), ("nearest_inverse", trace.nearest_inverse())];
            constants.extend(resident.features.alpha_constants());
            gpu.compute_pipeline_with(&TRACE_CUTOUTS, "trace_cutouts", &constants)
        });
        let [width, height] = tile.sub_samples();
        commands
            .compute("trace cut-outs", pipeline)
            .read("rays", rays)
            .read("children", &trace.children)
            .read("triangles", &trace.triangles)
            .read("top", top)
            .read("placed", placed)
            .read("inverse_distances", &targets.shaded)
            .read("attributes", &resident.attributes)
            .read("indices", &resident.indices)
            .read("meshes", &resident.meshes)
            .read("instances", &eye.instances)
            .read("materials", &resident.materials)
            .read("slots", &resident.slots)
            .read("texel_levels", &resident.texel_levels)
            .read("texels", &resident.texels)
            .write("visibility", &targets.visibility)
            .write("unfinished", &trace.unfinished)
            .dispatch([width.div_ceil(8), height.div_ceil(8), 1]);
    }
}
