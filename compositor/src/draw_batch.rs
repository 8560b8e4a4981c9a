//! One draw of a search: its pipeline variant, its bindings and the pieces of views that it fills.

use argus_gpu::{Bindable, ColorTarget, ComputeCall, EnvironmentTexture, ReflectionProbes, wgpu};
use argus_scene::{PlaneKind, RenderError};
use argus_shaders::layout::compositor::{Fill, Splat};

use crate::layout::Piece;
use crate::pool::Pool;
use crate::settings::SearchBackend;
use crate::targets::{CONFIDENCE_FORMAT, ChunkTargets, LINEAR_FORMAT, RANGE_FORMAT, SRGB_FORMAT};

/// What decides which pipeline draws a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Variant {
    /// Samples are cubes; otherwise pinhole images.
    pub(crate) omni: bool,
    /// Samples have Normal and Specular planes.
    pub(crate) glossy: bool,
    /// Samples look up reflection probes.
    pub(crate) reflects: bool,
    /// The sky is an environment map.
    pub(crate) environment: bool,
    /// Sub-pixels are drawn as linear radiance, which *resolve* averages; otherwise pixels as sRGB.
    pub(crate) linear: bool,
    /// Range is written.
    pub(crate) range: bool,
    /// Confidence is computed and written; range is written too.
    pub(crate) confident: bool,
    /// The warp interpolates between two mip levels of the samples.
    pub(crate) between_levels: bool,
}

impl Variant {
    /// Entry point of the fragment programs of all searches.
    pub(crate) fn fragment_entry_point(self) -> &'static str {
        if self.linear { "write_linear" } else { "write_srgb" }
    }

    /// The variant of compute programs. They always write range: writes outside a target of one texel are dropped, so one
    /// pipeline serves both cases.
    pub(crate) fn of_compute(self) -> Self {
        Self { range: true, ..self }
    }

    /// Values of the programs' `override`s.
    pub(crate) fn constants(self) -> [(&'static str, f64); 6] {
        [
            ("omni", self.omni),
            ("glossy", self.glossy),
            ("reflects", self.reflects),
            ("has_environment", self.environment),
            ("confident", self.confident),
            ("linear", self.linear),
        ]
        .map(|(name, on)| (name, f64::from(u8::from(on))))
    }

    /// Formats of the fragment programs' attachments.
    pub(crate) fn formats(self) -> Vec<wgpu::TextureFormat> {
        let color = if self.linear { LINEAR_FORMAT } else { SRGB_FORMAT };
        [(true, color), (self.range, RANGE_FORMAT), (self.confident, CONFIDENCE_FORMAT)]
            .into_iter()
            .filter_map(|(on, format)| on.then_some(format))
            .collect()
    }
}

/// Textures and samplers that exist once a compositor.
#[derive(Debug)]
pub(crate) struct FixedBindings {
    pub(crate) nearest: wgpu::Sampler,
    /// Trilinear.
    pub(crate) bilinear: wgpu::Sampler,
    /// Bound where no surface looks up a reflection probe.
    pub(crate) no_probes: ReflectionProbes,
    /// Bound where the sky is no environment map.
    pub(crate) no_environment: EnvironmentTexture,
    /// Bound where samples have no LightVisibility plane: all light is seen.
    pub(crate) all_light_seen: wgpu::TextureView,
}

/// Resources that all draws of a chunk read.
#[derive(Debug)]
pub(crate) struct SharedBindings<'a> {
    pub(crate) pool: &'a Pool,
    pub(crate) fixed: &'a FixedBindings,
    /// Lights of every view, relative to its eye.
    pub(crate) lights: &'a wgpu::Buffer,
    /// Reflection probes of the samples; `None` if they look up none.
    pub(crate) probes: Option<&'a ReflectionProbes>,
    /// The environment map of the samples' sky; `None` if it has none.
    pub(crate) environment: Option<&'a EnvironmentTexture>,
}

impl<'a> SharedBindings<'a> {
    /// All resources under their names in WGSL.
    pub(crate) fn bindings(&self) -> Result<Vec<NamedBinding<'a>>, RenderError> {
        let probes = self.probes.unwrap_or(&self.fixed.no_probes);
        let reflectors = self.pool.view(PlaneKind::Reflector).unwrap_or_else(|_| probes.no_reflectors());
        let light_seen = self.pool.view(PlaneKind::LightVisibility).unwrap_or(&self.fixed.all_light_seen);
        let environment = self.environment.unwrap_or(&self.fixed.no_environment);
        let mut bindings = vec![
            NamedBinding::read("inverse_range", self.pool.view(PlaneKind::InverseRange)?),
            NamedBinding::read("radiance", self.pool.view(PlaneKind::Radiance)?),
            NamedBinding::read("nearest", &self.fixed.nearest),
            NamedBinding::read("bilinear", &self.fixed.bilinear),
            NamedBinding::read("normal_plane", self.pool.view_or_radiance(PlaneKind::Normal)?),
            NamedBinding::read("specular_plane", self.pool.view_or_radiance(PlaneKind::Specular)?),
            NamedBinding::read("light_visibility_plane", light_seen),
            NamedBinding::read("lights", self.lights),
            NamedBinding::read("reflector_plane", reflectors),
            NamedBinding::read("environment_map", environment.view()),
        ];
        bindings.extend(probes.bindings().map(|(name, resource)| NamedBinding::read(name, resource)));
        Ok(bindings)
    }

    /// [`SharedBindings::bindings`], one level of the display plane and the next coarser level.
    pub(crate) fn bindings_of_level(&self, level: u32) -> Result<Vec<NamedBinding<'a>>, RenderError> {
        let mut bindings = self.bindings()?;
        let display = self.pool.display()?;
        bindings.push(NamedBinding::read("display", display.level(level)));
        bindings.push(NamedBinding::read("coarser", display.level(level + 1)));
        Ok(bindings)
    }
}

/// A resource under its name in WGSL.
#[derive(Clone, Copy)]
pub(crate) struct NamedBinding<'a> {
    pub(crate) name: &'static str,
    pub(crate) writes: bool,
    pub(crate) resource: &'a dyn Bindable,
}

impl<'a> NamedBinding<'a> {
    pub(crate) fn read(name: &'static str, resource: &'a dyn Bindable) -> Self {
        Self { name, writes: false, resource }
    }

    pub(crate) fn write(name: &'static str, resource: &'a dyn Bindable) -> Self {
        Self { name, writes: true, resource }
    }

    /// Adds the binding to a compute call.
    pub(crate) fn bind(self, call: ComputeCall<'a>) -> ComputeCall<'a> {
        match self.writes {
            true => call.write(self.name, self.resource),
            false => call.read(self.name, self.resource),
        }
    }
}

/// Buffers that the passes of a splat share.
#[derive(Debug)]
pub(crate) struct SplatBuffers {
    /// Nearest splatted depth of each cell.
    pub(crate) cells: wgpu::Buffer,
    /// Depth of each cell after gaps are filled.
    pub(crate) depths: wgpu::Buffer,
    /// Pixels that the warp did not settle: `shaders/shared/unsettled.wgsl`.
    pub(crate) unsettled: wgpu::Buffer,
}

/// One dispatch of a splat.
#[derive(Debug)]
pub(crate) struct SplatCall {
    pub(crate) splat: Splat,
    pub(crate) block_count: u32,
    /// Whether texels are farther apart than cells, so that they are splatted as squares.
    pub(crate) sparse: bool,
}

/// One piece and its uniforms.
#[derive(Debug)]
pub(crate) struct PieceDraw<'a> {
    pub(crate) piece: Piece,
    /// Its cells; `None` for a search without cells.
    pub(crate) fill: Option<Fill>,
    /// Sub-pixels along the edge of a cell.
    pub(crate) cell: u32,
    /// Finest level of the display plane that is read.
    pub(crate) level: u32,
    pub(crate) view: wgpu::BufferBinding<'a>,
}

/// Pieces of one search and variant, and the images that they are drawn to.
#[derive(Debug)]
pub(crate) struct DrawBatch<'a> {
    pub(crate) variant: Variant,
    pub(crate) search_backend: SearchBackend,
    pub(crate) shared: &'a SharedBindings<'a>,
    pub(crate) splat: &'a SplatBuffers,
    pub(crate) pieces: &'a [PieceDraw<'a>],
    pub(crate) targets: &'a ChunkTargets,
}

impl<'a> DrawBatch<'a> {
    /// Attachments of the fragment programs of a variant.
    pub(crate) fn attachments(&self, variant: Variant) -> Vec<ColorTarget<'a>> {
        let targets = self.targets.drawn();
        let color = if variant.linear { &targets.linear } else { &targets.srgb };
        let all = [color, &targets.range, &targets.confidence];
        all.into_iter()
            .take(variant.formats().len())
            .map(|target| ColorTarget { view: &target.view, clear: None })
            .collect()
    }

    /// The targets under their names in compute programs.
    pub(crate) fn storage(&self) -> [NamedBinding<'a>; 4] {
        let targets = self.targets.drawn();
        [
            NamedBinding::write("srgb_target", &targets.srgb.view),
            NamedBinding::write("linear_target", &targets.linear.view),
            NamedBinding::write("range_target", &targets.range.view),
            NamedBinding::write("confidence_target", &targets.confidence.view),
        ]
    }
}
