//! Drawing pieces: what the passes of both searches have in common.

use std::collections::BTreeMap;

use argus_gpu::{ColorTarget, Commands, Gpu, RenderPipeline, RenderPipelineDesc, wgpu};
use argus_scene::{PlaneKind, RenderError};
use argus_shaders::Program;

use crate::layout::Piece;
use crate::pool::Pool;
use crate::targets::Target;

/// sRGB and the source a pixel.
pub(crate) const SHOWN: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Uint;
/// Metres, 0 for nothing.
pub(crate) const RANGE: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
/// Linear radiance and the source a sub-pixel. Halves: 11 bits of a value that is shown in 8.
pub(crate) const FINE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// What decides which pipeline draws a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Variant {
    /// The samples are cubes rather than pinhole images.
    pub(crate) omni: bool,
    /// The samples carry what specular needs.
    pub(crate) glossy: bool,
    /// Sub-pixels are drawn, to be averaged.
    pub(crate) fine: bool,
    /// Range is written.
    pub(crate) range: bool,
}

impl Variant {
    /// Programs of both searches, and the mending of one, name their entry points alike.
    pub(crate) fn entry_point(self) -> String {
        let kind = if self.omni { "omni" } else { "pinhole" };
        let to = if self.fine { "keep" } else { "show" };
        format!("{to}_{kind}{}", if self.glossy { "_glossy" } else { "" })
    }

    fn pipeline(self, gpu: &Gpu, program: &'static Program) -> RenderPipeline {
        let targets = [if self.fine { FINE } else { SHOWN }, RANGE];
        gpu.render_pipeline(&RenderPipelineDesc {
            program,
            vertex: "vertex",
            fragment: Some(&self.entry_point()),
            buffers: &[],
            targets: if self.range { &targets } else { &targets[..1] },
            depth: None,
            primitive: wgpu::PrimitiveState::default(),
        })
    }
}

/// What all draws of a chunk read.
#[derive(Debug)]
pub(crate) struct Shared<'a> {
    pub(crate) pool: &'a Pool,
    pub(crate) nearest: &'a wgpu::Sampler,
    pub(crate) bilinear: &'a wgpu::Sampler,
    /// Lights of every view, relative to its eye.
    pub(crate) lights: &'a wgpu::Buffer,
    /// What the splat left: its search's alone.
    pub(crate) splatted: Option<&'a Splatted>,
}

/// Buffers that the passes of the splat hand to each other.
#[derive(Debug)]
pub(crate) struct Splatted {
    /// The nearest texel of each cell.
    pub(crate) cells: wgpu::Buffer,
    /// The same with gaps closed.
    pub(crate) depths: wgpu::Buffer,
    /// Pixels that one sample at that depth did not settle.
    pub(crate) unsettled: wgpu::Buffer,
}

/// One piece and its uniforms.
#[derive(Debug)]
pub(crate) struct Draw<'a> {
    pub(crate) piece: Piece,
    pub(crate) view: wgpu::BufferBinding<'a>,
}

/// One search's pipelines, made when they are first needed: a scene calls for one or two of them.
#[derive(Debug)]
pub(crate) struct Pipelines {
    program: &'static Program,
    made: BTreeMap<Variant, RenderPipeline>,
}

impl Pipelines {
    pub(crate) fn new(program: &'static Program) -> Self {
        Self { program, made: BTreeMap::new() }
    }

    pub(crate) fn get(&mut self, gpu: &Gpu, variant: Variant) -> &RenderPipeline {
        self.made.entry(variant).or_insert_with(|| variant.pipeline(gpu, self.program))
    }
}

/// Draws pieces of one variant into the targets: the body of both searches' passes.
pub(crate) fn draw_pieces(
    commands: &mut Commands,
    name: &str,
    pipeline: &RenderPipeline,
    variant: Variant,
    shared: &Shared<'_>,
    draws: &[Draw<'_>],
    [color, range]: [&Target; 2],
) -> Result<(), RenderError> {
    let mut targets = vec![ColorTarget { view: &color.view, clear: None }];
    if variant.range {
        targets.push(ColorTarget { view: &range.view, clear: None });
    }
    let radiance = shared.pool.view(PlaneKind::Radiance)?;
    let inverse_range = shared.pool.view(PlaneKind::InverseRange)?;
    let mut pass = commands.render(name, &targets, None);
    for draw in draws {
        let [x, y] = draw.piece.fine_target();
        let side = draw.piece.side;
        pass.viewport(x, y, draw.piece.part.width * side, draw.piece.part.height * side);
        let mut call = pass
            .draw(pipeline)
            .read("view", &draw.view)
            .read("inverse_range", inverse_range)
            .read("radiance", radiance)
            .read("nearest", shared.nearest)
            .read("bilinear", shared.bilinear);
        if variant.glossy {
            call = call
                .read("normal_plane", shared.pool.view(PlaneKind::Normal)?)
                .read("specular_plane", shared.pool.view(PlaneKind::Specular)?)
                .read("lights", shared.lights);
        }
        if let Some(splatted) = shared.splatted {
            call = call.read("depths", &splatted.depths).write("unsettled", &splatted.unsettled);
        }
        call.vertices(0..3, 0..1);
    }
    Ok(())
}
