//! Drawing pieces: what the passes of all searches have in common.

use std::collections::BTreeMap;

use argus_gpu::{
    Bindable, ColorTarget, Commands, ComputeCall, ComputePipeline, Gpu, RenderPipeline, RenderPipelineDesc,
    Surroundings, wgpu,
};
use argus_scene::{PlaneKind, RenderError};
use argus_shaders::Program;
use argus_shaders::layout::compositor::Fill;

use crate::knobs::Twin;
use crate::layout::Piece;
use crate::pool::Pool;
use crate::targets::Target;

/// sRGB and the source a pixel.
pub(crate) const SHOWN: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Uint;
/// Metres, 0 for nothing.
pub(crate) const RANGE: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
/// How sure a pixel is, in the low byte. So wide since every device lets compute programs write it.
pub(crate) const CONFIDENCE: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
/// Linear radiance and the source a sub-pixel. Halves: 11 bits of a value that is shown in 8.
pub(crate) const FINE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// What decides which pipeline draws a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Variant {
    /// The samples are cubes rather than pinhole images.
    pub(crate) omni: bool,
    /// The samples carry what specular needs.
    pub(crate) glossy: bool,
    /// They look up what is around their surfaces.
    pub(crate) reflects: bool,
    /// Sub-pixels are drawn, to be averaged.
    pub(crate) fine: bool,
    /// Range is written.
    pub(crate) range: bool,
    /// Confidence is found and written; range is, too.
    pub(crate) confident: bool,
    /// The splat's warp blends between two levels of the samples.
    pub(crate) between_levels: bool,
}

impl Variant {
    /// Programs of all searches, and the mending of one, name their entry points alike.
    pub(crate) fn entry_point(self) -> &'static str {
        if self.fine { "keep" } else { "show" }
    }

    /// The name in compute programs of the target that [`Variant::entry_point`] writes.
    pub(crate) fn target(self) -> &'static str {
        if self.fine { "linear_target" } else { "shown_target" }
    }

    /// Values of the programs' `override`s.
    pub(crate) fn constants(self) -> [(&'static str, f64); 5] {
        [
            ("omni", self.omni),
            ("glossy", self.glossy),
            ("reflects", self.reflects),
            ("confident", self.confident),
            ("linear", self.fine),
        ]
        .map(|(name, on)| (name, f64::from(u8::from(on))))
    }

    /// Formats of the targets that fragment programs draw to.
    pub(crate) fn formats(self) -> Vec<wgpu::TextureFormat> {
        let color = if self.fine { FINE } else { SHOWN };
        [(true, color), (self.range, RANGE), (self.confident, CONFIDENCE)]
            .into_iter()
            .filter_map(|(on, format)| on.then_some(format))
            .collect()
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
    /// Maps that the samples' surfaces look up.
    pub(crate) surroundings: &'a Surroundings,
}

impl<'a> Shared<'a> {
    /// All of it under the names that the programs have for it.
    pub(crate) fn bindings(&self) -> Result<Vec<Extra<'a>>, RenderError> {
        let reflectors =
            self.pool.view(PlaneKind::Reflector).unwrap_or_else(|_| self.surroundings.no_words());
        let mut bindings = vec![
            Extra::read("inverse_range", self.pool.view(PlaneKind::InverseRange)?),
            Extra::read("radiance", self.pool.view(PlaneKind::Radiance)?),
            Extra::read("nearest", self.nearest),
            Extra::read("bilinear", self.bilinear),
            Extra::read("normal_plane", self.pool.view_or_radiance(PlaneKind::Normal)?),
            Extra::read("specular_plane", self.pool.view_or_radiance(PlaneKind::Specular)?),
            Extra::read("lights", self.lights),
            Extra::read("reflector_plane", reflectors),
        ];
        let around = self.surroundings.bindings().map(|(name, resource)| Extra::read(name, resource));
        bindings.extend(around);
        Ok(bindings)
    }

    /// The bindings, with a level of the display plane and the next coarser one, for programs that read levels.
    pub(crate) fn bindings_of_level(&self, level: u32) -> Result<Vec<Extra<'a>>, RenderError> {
        let mut bindings = self.bindings()?;
        let display = self.pool.display()?;
        bindings.push(Extra::read("display", display.level(level)));
        bindings.push(Extra::read("coarser", display.level(level + 1)));
        Ok(bindings)
    }
}

/// A resource under the name that a program has for it.
#[derive(Clone, Copy)]
pub(crate) struct Extra<'a> {
    pub(crate) name: &'static str,
    pub(crate) writes: bool,
    pub(crate) resource: &'a dyn Bindable,
}

impl<'a> Extra<'a> {
    pub(crate) fn read(name: &'static str, resource: &'a dyn Bindable) -> Self {
        Self { name, writes: false, resource }
    }

    pub(crate) fn write(name: &'static str, resource: &'a dyn Bindable) -> Self {
        Self { name, writes: true, resource }
    }

    /// The call that has it, too.
    pub(crate) fn bind(self, call: ComputeCall<'a>) -> ComputeCall<'a> {
        match self.writes {
            true => call.write(self.name, self.resource),
            false => call.read(self.name, self.resource),
        }
    }
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
    /// Its cells, if its search has any.
    pub(crate) fill: Option<Fill>,
    /// Sub-pixels on the edge of a cell.
    pub(crate) cell: u32,
    /// Level of the display plane whose texels are no larger than most of the view's pixels.
    pub(crate) level: u32,
    pub(crate) view: wgpu::BufferBinding<'a>,
}

/// Pieces of one variant, and where they are drawn.
#[derive(Debug)]
pub(crate) struct Canvas<'a> {
    pub(crate) variant: Variant,
    /// Which of the search's two programs draws.
    pub(crate) twin: Twin,
    pub(crate) shared: &'a Shared<'a>,
    pub(crate) draws: &'a [Draw<'a>],
    pub(crate) targets: Drawn<'a>,
}

/// Targets that pieces are drawn to; those that no piece asks for have one texel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drawn<'a> {
    pub(crate) color: &'a Target,
    pub(crate) range: &'a Target,
    pub(crate) confidence: &'a Target,
}

impl<'a> Drawn<'a> {
    /// Attachments of the fragment programs of a variant.
    pub(crate) fn attachments(&self, variant: Variant) -> Vec<ColorTarget<'a>> {
        let all = [self.color, self.range, self.confidence];
        all.iter().take(variant.formats().len()).map(|t| ColorTarget { view: &t.view, clear: None }).collect()
    }

    /// The same under the names that compute programs have for them.
    pub(crate) fn storage(&self, variant: Variant) -> [Extra<'a>; 3] {
        [
            Extra::write(variant.target(), &self.color.view),
            Extra::write("range_target", &self.range.view),
            Extra::write("confidence_target", &self.confidence.view),
        ]
    }
}

/// One search's programs: the fragment program and its compute twin, by variant. Made when they are first needed: a
/// scene calls for one or two of them.
#[derive(Debug)]
pub(crate) struct Drawing {
    program: &'static Program,
    /// Its row in the timing table.
    name: &'static str,
    /// It looks at the display plane.
    of_display: bool,
    fragment: BTreeMap<Variant, RenderPipeline>,
    compute: BTreeMap<Variant, ComputePipeline>,
}

impl Drawing {
    pub(crate) fn new(program: &'static Program, name: &'static str) -> Self {
        Self { program, name, of_display: false, fragment: BTreeMap::new(), compute: BTreeMap::new() }
    }

    /// Of a program that looks at the display plane.
    pub(crate) fn of_display(program: &'static Program, name: &'static str) -> Self {
        Self { of_display: true, ..Self::new(program, name) }
    }

    /// Draws pieces; `extras` is what this search reads and writes beside what all do.
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        canvas: &Canvas<'_>,
        extras: &[Extra<'_>],
    ) -> Result<(), RenderError> {
        let bindings = |draw: &Draw<'_>| {
            let mut bindings = match self.of_display {
                true => canvas.shared.bindings_of_level(draw.level)?,
                false => canvas.shared.bindings()?,
            };
            bindings.extend_from_slice(extras);
            Ok(bindings)
        };
        let bindings = canvas.draws.iter().map(bindings).collect::<Result<Vec<_>, RenderError>>()?;
        match canvas.twin {
            Twin::Compute => self.record_compute(gpu, commands, canvas, &bindings),
            _ => self.record_fragment(gpu, commands, canvas, &bindings),
        }
        Ok(())
    }

    /// Values of the program's `override`s.
    fn constants(&self, variant: Variant) -> Vec<(&'static str, f64)> {
        let mut constants = variant.constants().to_vec();
        if self.of_display {
            constants.push(("between_levels", f64::from(u8::from(variant.between_levels))));
        }
        constants
    }

    fn record_fragment(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        canvas: &Canvas<'_>,
        bindings: &[Vec<Extra<'_>>],
    ) {
        let variant = canvas.variant;
        let (program, constants) = (self.program, self.constants(variant));
        let pipeline = self.fragment.entry(variant).or_insert_with(|| {
            gpu.render_pipeline(&RenderPipelineDesc {
                program,
                vertex: "vertex",
                fragment: Some(variant.entry_point()),
                buffers: &[],
                targets: &variant.formats(),
                depth: None,
                primitive: wgpu::PrimitiveState::default(),
                constants: &constants,
            })
        });
        let targets = canvas.targets.attachments(variant);
        let mut pass = commands.render(self.name, &targets, None);
        for (draw, bindings) in canvas.draws.iter().zip(bindings) {
            let [x, y] = draw.piece.fine_target();
            let [width, height] = draw.piece.fine_size();
            pass.viewport(x, y, width, height);
            let mut call = pass.draw(pipeline).read("view", &draw.view);
            for extra in bindings {
                call = match extra.writes {
                    true => call.write(extra.name, extra.resource),
                    false => call.read(extra.name, extra.resource),
                };
            }
            call.vertices(0..3, 0..1);
        }
    }

    fn record_compute(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        canvas: &Canvas<'_>,
        bindings: &[Vec<Extra<'_>>],
    ) {
        // What is written to a range that is not there is dropped: one pipeline does.
        let variant = Variant { range: true, ..canvas.variant };
        let (program, constants) = (self.program, self.constants(variant));
        let pipeline = self.compute.entry(variant).or_insert_with(|| {
            let entry = format!("{}_twin", variant.entry_point());
            gpu.compute_pipeline_with(program, &entry, &constants)
        });
        let storage = canvas.targets.storage(variant);
        let mut pass = commands.compute_pass(self.name);
        for (draw, bindings) in canvas.draws.iter().zip(bindings) {
            let call = pass.call(pipeline).read("view", &draw.view);
            let call = bindings.iter().chain(&storage).fold(call, |call, extra| extra.bind(call));
            let [width, height] = draw.piece.fine_size();
            call.dispatch_threads([width, height, 1]);
        }
    }
}
