//! Program: `shaders/sampler/resolve_view.wgsl`. Colour, radiance and range of a direct view's pixels.

use argus_gpu::{Commands, ComputePipeline, Gpu, PendingReadback, wgpu};
use argus_shaders::layout::sampler::ResolveView as Parameters;
use argus_shaders::sampler::RESOLVE_VIEW;

use super::TileContext;

/// Turns shaded sub-samples into display colours, and visible triangles into ranges.
pub(crate) struct ResolveView {
    color: ComputePipeline,
    radiance: ComputePipeline,
    range: ComputePipeline,
    pixel_range: ComputePipeline,
    ray_range: ComputePipeline,
}

impl ResolveView {
    /// The pipelines, which are the same for all scenes.
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self {
            color: gpu.compute_pipeline(&RESOLVE_VIEW, "resolve_color"),
            radiance: gpu.compute_pipeline(&RESOLVE_VIEW, "resolve_radiance"),
            range: gpu.compute_pipeline(&RESOLVE_VIEW, "resolve_range"),
            pixel_range: gpu.compute_pipeline(&RESOLVE_VIEW, "resolve_pixel_range"),
            ray_range: gpu.compute_pipeline(&RESOLVE_VIEW, "resolve_ray_range"),
        }
    }

    /// Averages a tile's sub-samples. Reads back three sRGB bytes a pixel, rows tightly packed.
    pub(crate) fn record_color(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        exposure: f32,
    ) -> PendingReadback {
        let TileContext { gpu, targets, tile, .. } = context;
        let parameters = Parameters { size: tile.size, side: tile.side, exposure };
        let parameters = gpu.upload("resolve view", &[parameters], wgpu::BufferUsages::UNIFORM);
        let pixels = tile.size[0] * tile.size[1];
        let groups = pixels.div_ceil(4);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let color = gpu.buffer("color", u64::from(groups) * 12, usage);
        commands
            .compute("resolve color", &self.color)
            .read("resolve", &parameters)
            .read("shaded", &targets.shaded)
            .write("color", &color)
            .dispatch_threads([groups, 1, 1]);
        commands.read_buffer(&color, 0..u64::from(groups) * 12)
    }

    /// Averages a tile's sub-samples. Reads back three f32 a pixel, rows tightly packed.
    pub(crate) fn record_radiance(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
    ) -> PendingReadback {
        let TileContext { gpu, targets, tile, .. } = context;
        let parameters = Parameters { size: tile.size, side: tile.side, exposure: 1.0 };
        let parameters = gpu.upload("resolve view", &[parameters], wgpu::BufferUsages::UNIFORM);
        let bytes = u64::from(tile.size[0]) * u64::from(tile.size[1]) * 12;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let radiance = gpu.buffer("radiance", bytes, usage);
        commands
            .compute("resolve radiance", &self.radiance)
            .read("resolve", &parameters)
            .read("shaded", &targets.shaded)
            .write("radiance", &radiance)
            .dispatch_threads([tile.size[0], tile.size[1], 1]);
        commands.read_buffer(&radiance, 0..bytes)
    }

    /// Intersects the central ray of each pixel with its visible triangle. The tile has one sub-sample a pixel. Reads
    /// back metres, an f32 a pixel.
    pub(crate) fn record_range(&self, commands: &mut Commands, context: &TileContext<'_>) -> PendingReadback {
        let TileContext { gpu, resident, eye, tile, rays, places, directions, targets, .. } = context;
        let bytes = u64::from(tile.size[0]) * u64::from(tile.size[1]) * 4;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let range = gpu.buffer("range", bytes, usage);
        let pipeline = match (places, directions) {
            (Some(_), _) => &self.pixel_range,
            (None, Some(_)) => &self.ray_range,
            (None, None) => &self.range,
        };
        let mut call = commands
            .compute("resolve range", pipeline)
            .read("rays", rays)
            .read("visibility", &targets.visibility)
            .read("vertices", &resident.vertices)
            .read("indices", &resident.indices)
            .read("meshes", &resident.meshes)
            .read("instances", &eye.instances)
            .write("range", &range);
        if let Some(places) = places {
            call = call.read("places", places);
        }
        if let Some(directions) = directions {
            call = call.read("directions", directions);
        }
        call.dispatch_threads([tile.size[0], tile.size[1], 1]);
        commands.read_buffer(&range, 0..bytes)
    }
}
