//! Program: `shaders/compositor/mips.wgsl`. Coarser levels of samples' radiance, for views that are coarser than they.

use std::sync::Arc;

use argus_gpu::{ComputePipeline, Gpu, wgpu};
use argus_scene::{PlaneFormat, PlaneKind, RenderError};
use argus_shaders::layout::compositor::Mips;

use crate::pool::Pool;

/// The pass, run once a sample.
#[derive(Debug)]
pub(crate) struct MipsPass {
    /// Shared exponents, and halves.
    pipelines: [ComputePipeline; 2],
}

/// Bytes that rows of a copy between buffer and texture are aligned to.
const ROW: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

impl MipsPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let program = &argus_shaders::compositor::MIPS;
        let pipeline = |wide| gpu.compute_pipeline_with(program, "coarsen", &[("wide", wide)]);
        Self { pipelines: [pipeline(0.0), pipeline(1.0)] }
    }

    /// Fills the coarser levels of layers whose first is there.
    pub(crate) fn run(&self, gpu: &Arc<Gpu>, pool: &Pool, layers: &[u32]) -> Result<(), RenderError> {
        let radiance = pool.texture(PlaneKind::Radiance)?;
        let wide = pool.class.radiance == PlaneFormat::Rgba16Float;
        let texel_bytes = pool.class.radiance.texel_bytes() as u32;
        let size = |level: u32| pool.class.size.map(|side| (side >> level).max(1));
        let texels = |level: u32| size(level)[0] * size(level)[1];
        let pitch = |level: u32| (size(level)[0] * texel_bytes).next_multiple_of(ROW);
        let levels = radiance.mip_level_count();
        if levels < 2 {
            return Ok(());
        }
        let range_bytes = (1..levels).map(|level| u64::from(texels(level)) * 4).sum();
        let word_bytes = (1..levels).map(|level| u64::from(pitch(level) * size(level)[1])).sum();
        let ranges = gpu.buffer("mip ranges", range_bytes, wgpu::BufferUsages::STORAGE);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let words = gpu.buffer("mip texels", word_bytes, usage);
        let finer_views: Vec<wgpu::TextureView> = (0..levels - 1)
            .map(|level| {
                radiance.create_view(&wgpu::TextureViewDescriptor {
                    dimension: Some(wgpu::TextureViewDimension::D2Array),
                    base_mip_level: level,
                    mip_level_count: Some(1),
                    ..Default::default()
                })
            })
            .collect();
        let mut commands = gpu.commands("coarsen samples");
        for &layer in layers {
            let (mut finer_range, mut range, mut offset) = (0, 0, 0);
            for (level, finer) in (1..levels).zip(&finer_views) {
                let [width, height] = size(level);
                let immediates = Mips {
                    size: [width, height],
                    finer: size(level - 1),
                    layer,
                    from_sample: u32::from(level == 1),
                    finer_range,
                    range,
                    word: offset / 4,
                    pitch: pitch(level) / 4,
                };
                commands
                    .compute("coarsen samples", &self.pipelines[usize::from(wide)])
                    .read("inverse_range", pool.view(PlaneKind::InverseRange)?)
                    .read("radiance", finer)
                    .write("ranges", &ranges)
                    .write("words", &words)
                    .immediates(bytemuck::bytes_of(&immediates))
                    .dispatch_threads([width, height, 1]);
                commands.encoder().copy_buffer_to_texture(
                    wgpu::TexelCopyBufferInfo {
                        buffer: &words,
                        layout: wgpu::TexelCopyBufferLayout {
                            offset: u64::from(offset),
                            bytes_per_row: Some(pitch(level)),
                            rows_per_image: None,
                        },
                    },
                    wgpu::TexelCopyTextureInfo {
                        texture: radiance,
                        mip_level: level,
                        origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
                        aspect: wgpu::TextureAspect::All,
                    },
                    wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                );
                finer_range = range;
                range += texels(level);
                offset += pitch(level) * height;
            }
        }
        commands.submit().wait()?;
        Ok(())
    }
}
