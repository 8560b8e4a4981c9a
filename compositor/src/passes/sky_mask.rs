//! Program: `shaders/compositor/sky_mask.wgsl`. Marks cells that show the sky.

use std::collections::BTreeMap;

use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_scene::{PlaneKind, RenderError};
use argus_shaders::layout::compositor::SkyMask;

use crate::draw_batch::DrawBatch;

/// One dispatch a piece. Pipelines by whether samples are cubes.
#[derive(Debug, Default)]
pub(crate) struct SkyMaskPass(BTreeMap<bool, ComputePipeline>);

/// Sub-pixels along the edge of the block that one ray is tested for.
const BLOCK: u32 = 4;

impl SkyMaskPass {
    /// Tests the empty cells of all pieces.
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
    ) -> Result<(), RenderError> {
        let shared = batch.shared;
        let omni = shared.pool.class.omni;
        let pipeline = self.0.entry(omni).or_insert_with(|| {
            let constants = [("omni", f64::from(u8::from(omni)))];
            gpu.compute_pipeline_with(&argus_shaders::compositor::SKY_MASK, "mask_block", &constants)
        });
        let inverse_range = shared.pool.view(PlaneKind::InverseRange)?;
        let mut pass = commands.compute_pass("mask sky");
        for (draw, fill) in batch.pieces.iter().filter_map(|draw| Some((draw, draw.fill?))) {
            let side = (BLOCK / draw.cell).max(1);
            let immediates = SkyMask { columns: fill.columns as u32, rows: fill.rows as u32, side };
            pass.call(pipeline)
                .read("view", &draw.view)
                .read("inverse_range", inverse_range)
                .read("nearest", &shared.fixed.nearest)
                .write("depths", &batch.splat.depths)
                .immediates(bytemuck::bytes_of(&immediates))
                .dispatch_threads([immediates.columns.div_ceil(side), immediates.rows.div_ceil(side), 1]);
        }
        Ok(())
    }
}
