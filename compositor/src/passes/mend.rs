//! Program: `shaders/compositor/mend.wgsl`. Tries pixels that the warp left over in all samples.

use std::collections::BTreeMap;

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_scene::{PlaneKind, RenderError};

use crate::drawing::{Shared, Variant};
use crate::targets::Target;

/// The pass: one dispatch a chunk.
#[derive(Debug, Default)]
pub(crate) struct MendPass(BTreeMap<Variant, ComputePipeline>);

/// Workgroups that share the list of a chunk. Its length is only known on the device, and an indirect dispatch costs
/// more than workgroups that find nothing to do.
const GROUPS: u32 = 64;

impl MendPass {
    /// `cells` are the cells as they were splatted, `views` the uniforms of all pieces.
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        variant: Variant,
        shared: &Shared<'_>,
        [views, cells]: [&wgpu::Buffer; 2],
        [color, range]: [&Target; 2],
    ) -> Result<(), RenderError> {
        let Some([depths, unsettled]) = shared.splatted else { return Ok(()) };
        let pipeline = self.0.entry(variant).or_insert_with(|| {
            gpu.compute_pipeline(&argus_shaders::compositor::MEND, &variant.entry_point())
        });
        let mut call = commands
            .compute("mend pixels", pipeline)
            .read("views", views)
            .read("inverse_range", shared.pool.view(PlaneKind::InverseRange)?)
            .read("radiance", shared.pool.view(PlaneKind::Radiance)?)
            .read("nearest", shared.nearest)
            .read("bilinear", shared.bilinear)
            .read("depths", depths)
            .read("unsettled", unsettled)
            .read("cells", cells)
            .write(if variant.fine { "linear_target" } else { "shown_target" }, &color.view)
            .write("range_target", &range.view);
        if variant.glossy {
            call = call
                .read("normal_plane", shared.pool.view(PlaneKind::Normal)?)
                .read("specular_plane", shared.pool.view(PlaneKind::Specular)?)
                .read("lights", shared.lights);
        }
        call.dispatch([GROUPS, 1, 1]);
        Ok(())
    }
}
