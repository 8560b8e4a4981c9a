//! Program: `shaders/compositor/mips.wgsl`. Coarser levels of samples' radiance, for views that are coarser than they, and
//! the display plane.

use std::sync::Arc;

use argus_gpu::{ComputePipeline, Gpu, wgpu};
use argus_scene::{PlaneFormat, PlaneKind, RenderError};
use argus_shaders::layout::compositor::Mips;
use bytemuck::Zeroable as _;

use crate::pool::Pool;

/// The pass, run once a sample.
#[derive(Debug)]
pub(crate) struct MipsPass {
    /// Shared exponents, and halves.
    pipelines: [ComputePipeline; 2],
    finest: ComputePipeline,
}

/// Bytes that rows of a copy between buffer and texture are aligned to.
const ROW: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

impl MipsPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let program = &argus_shaders::compositor::MIPS;
        let pipeline = |wide| gpu.compute_pipeline_with(program, "coarsen", &[("wide", wide)]);
        let finest = gpu.compute_pipeline(program, "finest");
        Self { pipelines: [pipeline(0.0), pipeline(1.0)], finest }
    }

    /// Fills the coarser levels of layers whose first is there, and their display planes for an exposure (radiance to
    /// display-linear).
    pub(crate) fn run(
        &self,
        gpu: &Arc<Gpu>,
        pool: &Pool,
        layers: &[u32],
        exposure: f32,
    ) -> Result<(), RenderError> {
        let array = pool.array(PlaneKind::Radiance)?;
        let radiance = &array.texture;
        let display = &pool.display()?.levels;
        let wide = pool.class.radiance == PlaneFormat::Rgba16Float;
        let texel_bytes = pool.class.radiance.texel_bytes() as u32;
        let size = |level: u32| pool.class.size.map(|side| (side >> level).max(1));
        let texels = |level: u32| size(level)[0] * size(level)[1];
        let pitch = |level: u32| (size(level)[0] * texel_bytes).next_multiple_of(ROW);
        let levels = radiance.mip_level_count();
        let range_bytes = (1..levels).map(|level| u64::from(texels(level)) * 4).sum::<u64>().max(4);
        let word_bytes =
            (1..levels).map(|level| u64::from(pitch(level) * size(level)[1])).sum::<u64>().max(4);
        let ranges = gpu.buffer("mip ranges", range_bytes, wgpu::BufferUsages::STORAGE);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let words = gpu.buffer("mip texels", word_bytes, usage);
        let inverse_range = pool.view(PlaneKind::InverseRange)?;
        // Not the radiance where there is none, as in other passes: a level of it is written to here.
        let specular = pool.view(PlaneKind::Specular).unwrap_or(inverse_range);
        let mut commands = gpu.commands("coarsen samples");
        for &layer in layers {
            let (mut finer_range, mut range, mut offset) = (0, 0, 0);
            let mips = Mips {
                size: size(0),
                layer,
                exposure,
                glossy: u32::from(pool.class.glossy),
                ..Mips::zeroed()
            };
            commands
                .compute("coarsen samples", &self.finest)
                .read("radiance", &array.levels[0])
                .read("specular", specular)
                .write("display", &display[0])
                .immediates(bytemuck::bytes_of(&mips))
                .dispatch_threads([size(0)[0], size(0)[1], 1]);
            for level in 1..levels {
                let [width, height] = size(level);
                let immediates = Mips {
                    size: [width, height],
                    finer: size(level - 1),
                    from_sample: u32::from(level == 1),
                    finer_range,
                    range,
                    word: offset / 4,
                    pitch: pitch(level) / 4,
                    ..mips
                };
                commands
                    .compute("coarsen samples", &self.pipelines[usize::from(wide)])
                    .read("inverse_range", inverse_range)
                    .read("radiance", &array.levels[level as usize - 1])
                    .write("ranges", &ranges)
                    .write("words", &words)
                    .read("specular", specular)
                    .write("display", &display[level as usize])
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
