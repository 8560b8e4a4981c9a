//! Program: `shaders/compositor/mend.wgsl`. Tries pixels that the warp left over in all samples.

use std::collections::BTreeMap;

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_scene::{PlaneKind, RenderError};

use crate::drawing::{Shared, Variant};
use crate::targets::Target;

/// The pass: one dispatch a piece.
#[derive(Debug, Default)]
pub(crate) struct MendPass(BTreeMap<Variant, ComputePipeline>);

impl MendPass {
    /// `views` are the uniforms of each piece.
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        variant: Variant,
        shared: &Shared<'_>,
        views: &[wgpu::BufferBinding<'_>],
        [color, range]: [&Target; 2],
    ) -> Result<(), RenderError> {
        let Some(splatted) = shared.splatted else { return Ok(()) };
        let pipeline = self.0.entry(variant).or_insert_with(|| {
            gpu.compute_pipeline(&argus_shaders::compositor::MEND, &variant.entry_point())
        });
        // Workgroups that share a piece's list. Its length is only known on the device, and an indirect dispatch costs
        // more than workgroups that find nothing to do; on a software driver even those are not free.
        let groups = if gpu.is_software() { 1 } else { 16 };
        for view in views {
            let mut call = commands
                .compute("mend pixels", pipeline)
                .read("view", view)
                .read("inverse_range", shared.pool.view(PlaneKind::InverseRange)?)
                .read("radiance", shared.pool.view(PlaneKind::Radiance)?)
                .read("nearest", shared.nearest)
                .read("bilinear", shared.bilinear)
                .read("depths", &splatted.depths)
                .read("unsettled", &splatted.unsettled)
                .read("cells", &splatted.cells)
                .write(if variant.fine { "linear_target" } else { "shown_target" }, &color.view)
                .write("range_target", &range.view);
            if variant.glossy {
                call = call
                    .read("normal_plane", shared.pool.view(PlaneKind::Normal)?)
                    .read("specular_plane", shared.pool.view(PlaneKind::Specular)?)
                    .read("lights", shared.lights);
            }
            call.dispatch([groups, 1, 1]);
        }
        Ok(())
    }
}
