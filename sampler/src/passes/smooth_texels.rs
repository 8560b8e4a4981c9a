//! Program: `shaders/sampler/smooth_texels.wgsl`. Shares what neighbouring texels found, within surfaces.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::surface_light::SmoothQuery;
use argus_shaders::sampler::SMOOTH_TEXELS;

use crate::lit_tile::LitTexels;

/// Programs for rows and columns of the filter's boxes.
pub(crate) struct SmoothTexels {
    steps: Vec<ComputePipeline>,
}

/// An image whose points are texels of a tile.
#[derive(Clone, Copy)]
pub(crate) struct TexelImage<'a> {
    /// Columns and rows.
    pub(crate) size: [u32; 2],
    /// The texel of each point.
    pub(crate) members: &'a wgpu::Buffer,
}

impl TexelImage<'_> {
    /// Number of points.
    pub(crate) fn count(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1])
    }
}

impl SmoothTexels {
    /// `reaches`: of the filter's boxes, texels.
    pub(crate) fn new(gpu: &Gpu, reaches: &[isize]) -> Self {
        Self::of(gpu, reaches, false)
    }

    /// For images whose points are all texels of the tile, of which those with a 1 in w are replaced.
    pub(crate) fn of_every_texel(gpu: &Gpu, reach: isize) -> Self {
        Self::of(gpu, &[reach], true)
    }

    fn of(gpu: &Gpu, reaches: &[isize], every_texel: bool) -> Self {
        let step = |reach: isize, columns: bool| {
            let [along_columns, every_texel] = [columns, every_texel].map(|is| f64::from(u8::from(is)));
            let constants = [
                ("filter_reach", reach as f64),
                ("along_columns", along_columns),
                ("every_texel", every_texel),
            ];
            gpu.compute_pipeline_with(&SMOOTH_TEXELS, "smooth_texels", &constants)
        };
        let steps = reaches.iter().flat_map(|reach| [false, true].map(|columns| step(*reach, columns)));
        Self { steps: steps.collect() }
    }

    /// Replaces values by means over the points around each that show the same surface. `name` is the row in the timing table.
    pub(crate) fn record_as(
        &self,
        name: &str,
        commands: &mut Commands,
        texels: &LitTexels,
        image: TexelImage<'_>,
        values: &wgpu::Buffer,
        spare: &wgpu::Buffer,
    ) {
        let query = SmoothQuery { size: image.size };
        let query = texels.gpu.upload("points that are smoothed", &[query], wgpu::BufferUsages::UNIFORM);
        let [mut before, mut after] = [values, spare];
        for step in &self.steps {
            texels
                .bind(commands.compute(name, step))
                .read("smooth_query", &query)
                .read("members", image.members)
                .read("unsmoothed", before)
                .write("smoothed", after)
                .dispatch_linear(image.count());
            std::mem::swap(&mut before, &mut after);
        }
    }
}
