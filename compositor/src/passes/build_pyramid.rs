//! Program: `shaders/compositor/build_pyramid.wgsl`. Builds the pyramid of a sample's nearest surfaces.

use std::sync::Arc;

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_scene::{PlaneKind, RenderError};
use argus_shaders::layout::compositor::BuildPyramid;

use crate::pool::Pool;
use crate::pyramid::TILE;

/// One dispatch a sample, when a pyramid search first reads it.
#[derive(Debug)]
pub(crate) struct BuildPyramidPass {
    pipeline: ComputePipeline,
}

impl BuildPyramidPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&argus_shaders::compositor::BUILD_PYRAMID, "build_tile") }
    }

    /// Builds the missing pyramids of some layers of a pool from the samples' inverse range.
    ///
    /// # Errors
    /// Whatever the device fails with.
    pub(crate) fn make(
        &self,
        gpu: &Arc<Gpu>,
        pool: &mut Pool,
        layers: impl Iterator<Item = u32>,
    ) -> Result<(), RenderError> {
        let pyramids = pool.pyramids_mut(gpu)?;
        let missing: Vec<u32> = layers.filter(|&layer| !pyramids.is_made(layer)).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let (inverse_range, levels) = (pool.view(PlaneKind::InverseRange)?, pool.pyramids()?);
        let mut commands = gpu.commands("make pyramids");
        for &layer in &missing {
            self.record(&mut commands, inverse_range, pool.class.size, levels, layer);
        }
        commands.submit().wait()?;
        pool.pyramids_mut(gpu)?.set_made(&missing);
        Ok(())
    }

    /// Builds all levels of the sample in a layer. `size` is in texels.
    fn record(
        &self,
        commands: &mut Commands,
        inverse_range: &wgpu::TextureView,
        size: [u32; 2],
        levels: &wgpu::TextureView,
        layer: u32,
    ) {
        let [width, height] = size;
        commands
            .compute("make pyramid", &self.pipeline)
            .read("inverse_range", inverse_range)
            .write("levels", levels)
            .immediates(bytemuck::bytes_of(&BuildPyramid { layer, width, height }))
            .dispatch([width.div_ceil(TILE), height.div_ceil(TILE), 1]);
    }
}
