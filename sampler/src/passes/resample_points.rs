//! Program: `shaders/sampler/resample_points.wgsl`. Makes the finest level of reflection probes from cube maps of points.

use argus_gpu::{Commands, ComputePipeline, EnvironmentTexture, Gpu, wgpu};
use argus_shaders::sampler::RESAMPLE_POINTS;

use super::blur_probes::ProbePlanes;
use crate::resident::Features;

/// Resamples.
pub(crate) struct ResamplePoints {
    pipeline: ComputePipeline,
}

impl ResamplePoints {
    /// The pipeline for cube maps of `cube_side` texels on an edge.
    pub(crate) fn new(gpu: &Gpu, features: Features, cube_side: u32) -> Self {
        let constants = [features.sky_constant(), ("cube_side", f64::from(cube_side))];
        Self { pipeline: gpu.compute_pipeline_with(&RESAMPLE_POINTS, "resample_points", &constants) }
    }

    /// Makes the finest level of a probe from each cube map. `texels` are two words a texel of all maps: 1 + the index of the
    /// point that it sees, or 0 for sky, and the inverse of its range. `points` is the radiance of all points. The sky is that
    /// of a lighting uniform and an environment map.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        texels: &wgpu::Buffer,
        points: &wgpu::Buffer,
        lighting: &wgpu::Buffer,
        environment: &EnvironmentTexture,
        planes: &ProbePlanes,
    ) {
        let call = commands
            .compute("resample points", &self.pipeline)
            .read("texels", texels)
            .read("points", points)
            .read("lighting", lighting)
            .read("environment_map", environment.view());
        planes.finest_level(call);
    }
}
