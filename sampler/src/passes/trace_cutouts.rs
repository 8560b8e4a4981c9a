//! Program: `shaders/sampler/trace_cutouts.wgsl`. Traces alpha-tested triangles in front of opaque ones, by packets of
//! rays.

use std::sync::OnceLock;

use argus_gpu::{Commands, ComputePipeline, wgpu};
use argus_shaders::sampler::TRACE_CUTOUTS;

use super::TileContext;

/// The trees that packets go through.
pub(super) struct TracedTrees<'a> {
    pub(super) children: &'a wgpu::TextureView,
    pub(super) triangles: &'a wgpu::TextureView,
    pub(super) top: &'a wgpu::Buffer,
    pub(super) placed: &'a wgpu::Buffer,
    /// Set by packets that ended early.
    pub(super) unfinished: &'a wgpu::Buffer,
    /// Inverse distance of the near plane, in units of the rays' directions.
    pub(super) nearest_inverse: f64,
}

/// Traces alpha-tested triangles against the result of [`super::Trace`].
#[derive(Default)]
pub(super) struct TraceCutouts(OnceLock<ComputePipeline>);

impl TraceCutouts {
    /// Updates the visibility buffer where a cut-out is in front.
    pub(super) fn record(&self, commands: &mut Commands, context: &TileContext<'_>, trees: &TracedTrees<'_>) {
        let TileContext { gpu, resident, eye, targets, tile, rays, .. } = context;
        let pipeline = self.0.get_or_init(|| {
            let mut constants = vec![("rows", 1.0), ("nearest_inverse", trees.nearest_inverse)];
            constants.extend(resident.features.alpha_constants());
            gpu.compute_pipeline_with(&TRACE_CUTOUTS, "trace_cutouts", &constants)
        });
        let [width, height] = tile.sub_samples();
        commands
            .compute("trace cut-outs", pipeline)
            .read("rays", rays)
            .read("children", trees.children)
            .read("triangles", trees.triangles)
            .read("top", trees.top)
            .read("placed", trees.placed)
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
            .write("unfinished", trees.unfinished)
            .dispatch([width.div_ceil(8), height.div_ceil(8), 1]);
    }
}
