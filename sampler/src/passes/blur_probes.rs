//! Program: `shaders/sampler/blur_probes.wgsl`. Makes the coarser levels of reflection probes from the finest.

use argus_gpu::{Commands, ComputeCall, ComputePipeline, Gpu, wgpu};
use argus_scene::reflection::{level_sides, map_size};
use argus_shaders::layout::sampler::ProbeLevel;
use argus_shaders::sampler::BLUR_PROBES;

/// Blurs.
pub struct BlurProbes {
    pipeline: ComputePipeline,
}

/// Probes while they are rendered.
pub struct ProbePlanes {
    /// Radiance and inverse range of the finest levels in full precision.
    finest: wgpu::Buffer,
    pub(crate) radiance: wgpu::Buffer,
    pub(crate) inverse_range: wgpu::Buffer,
    side: u32,
    count: u32,
}

impl ProbePlanes {
    /// Buffers of `count` probes.
    pub fn new(gpu: &Gpu, side: u32, count: u32) -> Self {
        let (storage, read) = (wgpu::BufferUsages::STORAGE, wgpu::BufferUsages::COPY_SRC);
        let texels = map_size(side).map(u64::from).iter().product::<u64>() * u64::from(count);
        Self {
            finest: gpu.buffer("around", u64::from(side + 2).pow(2) * u64::from(count) * 16, storage),
            radiance: gpu.buffer("radiance around", texels * 4, storage | read),
            inverse_range: gpu.buffer("ranges around", texels * 4, storage | read),
            side,
            count,
        }
    }

    /// Bytes of one probe while it is rendered.
    pub fn bytes_of_map(side: u32) -> u64 {
        let texels = map_size(side).map(u64::from).iter().product::<u64>();
        u64::from(side + 2).pow(2) * 16 + texels * 8
    }

    /// Dispatches a program that makes the finest level.
    pub fn finest_level(&self, call: ComputeCall<'_>) {
        self.level(call, self.side, 0, 0.0);
    }

    fn level(&self, call: ComputeCall<'_>, level_side: u32, level_row: u32, roughness: f32) {
        let [columns, rows] = map_size(self.side);
        let level = ProbeLevel { side: self.side, columns, rows, level_side, level_row, roughness };
        call.write("finest", &self.finest)
            .write("radiance_plane", &self.radiance)
            .write("inverse_range_plane", &self.inverse_range)
            .immediates(bytemuck::bytes_of(&level))
            .dispatch_threads([level_side + 2, level_side + 2, self.count]);
    }
}

impl BlurProbes {
    /// Makes the pipeline.
    pub fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&BLUR_PROBES, "blur") }
    }

    /// Makes the coarser levels of all probes from their finest.
    pub fn record(&self, commands: &mut Commands, planes: &ProbePlanes) {
        let levels = level_sides(planes.side).count();
        let mut row = 0;
        for (level, side) in level_sides(planes.side).enumerate() {
            if level > 0 {
                let roughness = level as f32 / (levels - 1).max(1) as f32;
                planes.level(commands.compute("blur probes", &self.pipeline), side, row, roughness);
            }
            row += side + 2;
        }
    }
}
