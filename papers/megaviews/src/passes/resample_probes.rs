//! Program: `shaders/resample_probes.wgsl`. Makes the finest level of reflection probes from maps of nodes.

use crate::programs::RESAMPLE_PROBES;
use argus_gpu::{Commands, ComputePipeline, EnvironmentTexture, Gpu, wgpu};

use super::NodeMaps;
use argus_sampler::plug::{Features, ProbePlanes};

/// Resamples. The pipeline depends on the number of arrays of maps.
pub(crate) struct ResampleProbes {
    pipeline: ComputePipeline,
    arrays: usize,
    features: Features,
}

impl ResampleProbes {
    pub(crate) fn new(gpu: &Gpu, features: Features, arrays: usize) -> Self {
        let constants = [("arrays", arrays as f64), features.sky_constant()];
        let pipeline = gpu.compute_pipeline_with(&RESAMPLE_PROBES, "resample", &constants);
        Self { pipeline, arrays, features }
    }

    /// Makes the pipeline anew if it is for another number of arrays.
    pub(crate) fn set_arrays(&mut self, gpu: &Gpu, arrays: usize) {
        if arrays != self.arrays {
            *self = Self::new(gpu, self.features, arrays);
        }
    }

    /// Makes the finest level of a probe from each of the first views of `maps`. The sky is that of a lighting uniform and an
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
        let call = maps
            .bind(commands.compute("resample probes", &self.pipeline))
            .read("lookup", &lookup)
            .read("lighting", lighting)
            .read("environment_map", environment.view());
        planes.finest_level(call);
    }
}
