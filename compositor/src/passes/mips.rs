//! Program: `shaders/compositor/mips.wgsl`. Makes the mip levels of a sample's radiance and its display plane.

use std::ops::Range;

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_scene::{PlaneFormat, PlaneKind, RenderError};
use argus_shaders::layout::compositor::Mips;
use bytemuck::Zeroable as _;

use crate::pool::Pool;

/// A few dispatches a sample, when the sample is uploaded.
#[derive(Debug)]
pub(crate) struct MipsPass {
    /// By format of radiance: shared exponent, half floats.
    pipelines: [ComputePipeline; 2],
    display_rows: ComputePipeline,
}

/// Alignment of rows in copies between buffer and texture, bytes.
const ROW: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

impl MipsPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let program = &argus_shaders::compositor::MIPS;
        let pipeline = |wide| gpu.compute_pipeline_with(program, "coarsen", &[("wide", wide)]);
        let display_rows = gpu.compute_pipeline(program, "display_rows");
        Self { pipelines: [pipeline(0.0), pipeline(1.0)], display_rows }
    }

    /// Makes rows of the finest level of a layer's display plane. `exposure` is the factor from radiance to
    /// display-linear.
    pub(crate) fn display_rows(
        &self,
        commands: &mut Commands,
        pool: &Pool,
        layer: u32,
        exposure: f32,
        rows: Range<u32>,
    ) -> Result<(), RenderError> {
        let array = pool.array(PlaneKind::Radiance)?;
        let mips = Mips { first_row: rows.start, ..of_layer(pool, layer, exposure) };
        commands
            .compute("coarsen samples", &self.display_rows)
            .read("radiance", &array.levels[0])
            .read("specular", specular(pool)?)
            .write("display", &pool.display()?.levels[0])
            .immediates(bytemuck::bytes_of(&mips))
            .dispatch_threads([pool.class.size[0], rows.end - rows.start, 1]);
        Ok(())
    }

    /// Makes rows of a coarser level of a layer's radiance and display plane. The next finer level must exist.
    #[expect(clippy::too_many_arguments, reason = "a level's rows of a sample")]
    pub(crate) fn coarser(
        &self,
        commands: &mut Commands,
        pool: &Pool,
        layer: u32,
        exposure: f32,
        level: u32,
        rows: Range<u32>,
        scratch: &MipScratch,
    ) -> Result<(), RenderError> {
        let array = pool.array(PlaneKind::Radiance)?;
        let at = level as usize;
        let (Some(finer), Some(own)) = (scratch.levels.get(at - 1), scratch.levels.get(at)) else {
            return Err(RenderError::Internal(format!("samples have no level {level}")));
        };
        let mips = Mips {
            size: own.size,
            finer: finer.size,
            from_sample: u32::from(level == 1),
            finer_range: finer.first_range,
            range: own.first_range,
            word: own.first_byte / 4,
            pitch: own.pitch / 4,
            first_row: rows.start,
            ..of_layer(pool, layer, exposure)
        };
        let (width, height) = (own.size[0], rows.end - rows.start);
        let wide = pool.class.radiance == PlaneFormat::Rgba16Float;
        commands
            .compute("coarsen samples", &self.pipelines[usize::from(wide)])
            .read("inverse_range", pool.view(PlaneKind::InverseRange)?)
            .read("radiance", &array.levels[at - 1])
            .write("ranges", &scratch.ranges)
            .write("words", &scratch.words)
            .read("specular", specular(pool)?)
            .write("display", &pool.display()?.levels[at])
            .immediates(bytemuck::bytes_of(&mips))
            .dispatch_threads([width, height, 1]);
        commands.encoder().copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo {
                buffer: &scratch.words,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: u64::from(own.first_byte + rows.start * own.pitch),
                    bytes_per_row: Some(own.pitch),
                    rows_per_image: None,
                },
            },
            wgpu::TexelCopyTextureInfo {
                texture: &array.texture,
                mip_level: level,
                origin: wgpu::Origin3d { x: 0, y: rows.start, z: layer },
                aspect: wgpu::TextureAspect::All,
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        Ok(())
    }
}

/// The immediates that all programs share.
fn of_layer(pool: &Pool, layer: u32, exposure: f32) -> Mips {
    Mips { size: pool.class.size, layer, exposure, glossy: u32::from(pool.class.glossy), ..Mips::zeroed() }
}

/// The specular plane, or inverse range if there is none. Radiance cannot stand in, because this pass writes one of its
/// levels.
fn specular(pool: &Pool) -> Result<&wgpu::TextureView, RenderError> {
    pool.view(PlaneKind::Specular).or_else(|_| pool.view(PlaneKind::InverseRange))
}

/// Scratch buffers for the coarser levels of one sample.
#[derive(Debug)]
pub(crate) struct MipScratch {
    ranges: wgpu::Buffer,
    words: wgpu::Buffer,
    levels: Vec<Level>,
}

/// Position of a level in the scratch buffers. The finest level is not in them.
#[derive(Debug)]
struct Level {
    size: [u32; 2],
    /// Index of its first inverse range.
    first_range: u32,
    first_byte: u32,
    /// Bytes from one row to the next.
    pitch: u32,
}

impl MipScratch {
    /// Scratch buffers for the samples of a pool.
    pub(crate) fn new(gpu: &Gpu, pool: &Pool) -> Self {
        let texel_bytes = pool.class.radiance.texel_bytes() as u32;
        let (mut ranges, mut bytes) = (0, 0);
        let count = pool.array(PlaneKind::Radiance).map_or(1, |array| array.texture.mip_level_count());
        let level = |level: u32| {
            let size = pool.class.size.map(|side| (side >> level).max(1));
            let pitch = (size[0] * texel_bytes).next_multiple_of(ROW);
            let made = Level { size, first_range: ranges, first_byte: bytes, pitch };
            if level > 0 {
                ranges += size[0] * size[1];
                bytes += pitch * size[1];
            }
            made
        };
        let levels = (0..count).map(level).collect();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        Self {
            levels,
            ranges: gpu.buffer("mip ranges", u64::from(ranges.max(1)) * 4, wgpu::BufferUsages::STORAGE),
            words: gpu.buffer("mip texels", u64::from(bytes.max(4)), usage),
        }
    }
}
