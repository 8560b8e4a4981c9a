//! Program: `shaders/sampler/resample_probes.wgsl`. Makes the levels of reflection probes from maps of nodes.

use argus_gpu::{Commands, ComputePipeline, EnvironmentTexture, Gpu, wgpu};
use argus_scene::reflection::{level_sides, map_size};
use argus_shaders::layout::sampler::ResampleProbes as Step;
use argus_shaders::sampler::RESAMPLE_PROBES;

use super::NodeMaps;
use crate::resident::Features;

/// Resamples and blurs. The pipeline depends on the number of arrays of maps.
pub(crate) struct ResampleProbes {
    resample: ComputePipeline,
    blur: ComputePipeline,
    arrays: usize,
    features: Features,
}

/// Probes while they are rendered.
pub(crate) struct ProbePlanes {
    /// Radiance and inverse range of the finest levels in full precision.
    finest: wgpu::Buffer,
    pub(crate) radiance: wgpu::Buffer,
    pub(crate) inverse_range: wgpu::Buffer,
    side: u32,
    count: u32,
}

impl ProbePlanes {
    /// Buffers of `count` probes.
    pub(crate) fn new(gpu: &Gpu, side: u32, count: u32) -> Self {
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
    pub(crate) fn bytes_of_map(side: u32) -> u64 {
        let texels = map_size(side).map(u64::from).iter().product::<u64>();
        u64::from(side + 2).pow(2) * 16 + texels * 8
    }
}

impl ResampleProbes {
    pub(crate) fn new(gpu: &Gpu, features: Features, arrays: usize) -> Self {
        let constants = [("arrays", arrays as f64), features.sky_constant()];
        Self {
            resample: gpu.compute_pipeline_with(&RESAMPLE_PROBES, "resample", &constants),
            blur: gpu.compute_pipeline_with(&RESAMPLE_PROBES, "blur", &constants),
            arrays,
            features,
        }
    }

    /// Makes the pipelines anew if they are for another number of arrays.
    pub(crate) fn set_arrays(&mut self, gpu: &Gpu, arrays: usize) {
        if arrays != self.arrays {
            *self = Self::new(gpu, self.features, arrays);
        }
    }

    /// Makes a probe from each of the first views of `maps`. The sky is that of a lighting uniform and an
    /// environment map.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        maps: &NodeMaps<'_>,
        (lighting, environment): (&wgpu::Buffer, &EnvironmentTexture),
        planes: &ProbePlanes,
    ) {
        let lookup = maps.lookup(gpu, 0);
        let [columns, rows] = map_size(planes.side);
        let levels = level_sides(planes.side).count();
        let mut level_row = 0;
        for (level, level_side) in level_sides(planes.side).enumerate() {
            let roughness = level as f32 / (levels - 1).max(1) as f32;
            let step = Step { side: planes.side, columns, rows, level_side, level_row, roughness };
            let call = match level {
                0 => maps
                    .bind(commands.compute("resample probes", &self.resample))
                    .read("lookup", &lookup)
                    .read("lighting", lighting)
                    .read("environment_map", environment.view()),
                _ => commands.compute("blur probes", &self.blur),
            };
            call.write("finest", &planes.finest)
                .write("radiance_plane", &planes.radiance)
                .write("inverse_range_plane", &planes.inverse_range)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_threads([level_side + 2, level_side + 2, planes.count]);
            level_row += level_side + 2;
        }
    }
}
