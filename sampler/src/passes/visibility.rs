//! Program: `shaders/sampler/visibility.wgsl`. Rasterises the visibility buffer: instance and triangle of each
//! sub-sample.

use std::collections::BTreeMap;

use argus_gpu::{ColorTarget, Commands, DepthTarget, Gpu, RenderPipeline, RenderPipelineDesc, wgpu};
use argus_shaders::sampler::VISIBILITY;

use super::TileContext;
use crate::draws::DrawList;
use crate::resident::{Cull, DrawClass, Features, Resident};
use crate::scratch;

/// One draw pass a tile, with a pipeline for each draw class of the scene.
pub(crate) struct Rasteriser {
    pipelines: BTreeMap<DrawClass, RenderPipeline>,
}

impl Rasteriser {
    /// Makes the pipelines of the classes that `resident` has.
    pub(crate) fn new(gpu: &Gpu, resident: &Resident) -> Self {
        let mut pipelines = BTreeMap::new();
        for placement in &resident.instances {
            pipelines
                .entry(placement.class)
                .or_insert_with(|| pipeline(gpu, placement.class, resident.features));
        }
        Self { pipelines }
    }

    /// Fills the visibility buffer. Sky is 0.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        list: &DrawList,
        draws: &wgpu::Buffer,
    ) {
        let TileContext { resident, eye, targets, .. } = context;
        let color = ColorTarget { view: &targets.visibility, clear: Some(wgpu::Color::TRANSPARENT) };
        let depth = DepthTarget { view: &targets.depth, clear: true };
        let mut pass = commands.render("rasterise", &[color], Some(depth));
        for (class, pipeline) in &self.pipelines {
            let begin = list.calls.partition_point(|call| call.class < *class);
            let end = list.calls.partition_point(|call| call.class <= *class);
            if begin == end {
                continue;
            }
            let mut bound = pass.draw(pipeline).read("draws", draws);
            if class.cutout {
                bound = bound
                    .read("attributes", &resident.attributes)
                    .read("meshes", &resident.meshes)
                    .read("instances", &eye.instances)
                    .read("materials", &resident.materials)
                    .read("slots", &resident.slots)
                    .read("texel_levels", &resident.texel_levels)
                    .read("texels", &resident.texels);
            }
            let raw = bound.begin();
            raw.set_vertex_buffer(0, resident.vertices.slice(..));
            raw.set_index_buffer(resident.indices.slice(..), wgpu::IndexFormat::Uint32);
            for call in &list.calls[begin..end] {
                raw.draw_indexed(call.indices.clone(), call.base_vertex, call.draws.clone());
            }
        }
    }
}

fn pipeline(gpu: &Gpu, class: DrawClass, features: Features) -> RenderPipeline {
    let (vertex, fragment) =
        if class.cutout { ("place_cutout", "identify_cutout") } else { ("place", "identify") };
    let (front_face, cull_mode) = match class.cull {
        Cull::None => (wgpu::FrontFace::Ccw, None),
        Cull::Back => (wgpu::FrontFace::Ccw, Some(wgpu::Face::Back)),
        Cull::MirroredBack => (wgpu::FrontFace::Cw, Some(wgpu::Face::Back)),
    };
    let alpha = features.alpha_constants();
    gpu.render_pipeline(&RenderPipelineDesc {
        program: &VISIBILITY,
        vertex,
        fragment: Some(fragment),
        buffers: &[wgpu::VertexBufferLayout {
            array_stride: 16,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &wgpu::vertex_attr_array![0 => Float32x3],
        }],
        targets: &[scratch::VISIBILITY],
        depth: Some(scratch::DEPTH),
        primitive: wgpu::PrimitiveState { front_face, cull_mode, ..Default::default() },
        constants: if class.cutout { &alpha } else { &[] },
    })
}
