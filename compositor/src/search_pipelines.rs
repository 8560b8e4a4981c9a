//! The searches: the program of each, and its pipelines in fragments and in compute, by variant.

use std::collections::BTreeMap;

use argus_gpu::{Commands, ComputePipeline, Gpu, RenderPipeline, RenderPipelineDesc, wgpu};
use argus_scene::{RenderError, Search};
use argus_shaders::{Program, compositor};

use crate::draw_batch::{DrawBatch, NamedBinding, PieceDraw, Variant};
use crate::settings::SearchBackend;

/// Pipelines of one search, made when a batch first needs them. A scene needs one or two variants.
#[derive(Debug)]
pub(crate) struct SearchPipelines {
    search: Search,
    program: &'static Program,
    /// Row in the timing table.
    name: &'static str,
    reads_display: bool,
    fragment: BTreeMap<Variant, RenderPipeline>,
    compute: BTreeMap<Variant, ComputePipeline>,
}

/// Row of a search in the timing table.
pub(crate) const fn name(search: Search) -> &'static str {
    match search {
        Search::Splat => "warp views",
        Search::Linear => "search views",
        Search::Seeded => "refine views",
        Search::Pyramid => "follow rays",
    }
}

impl SearchPipelines {
    pub(crate) fn new(search: Search) -> Self {
        let program = match search {
            Search::Splat => &compositor::WARP,
            Search::Linear => &compositor::LINEAR,
            Search::Seeded => &compositor::SEEDED,
            Search::Pyramid => &compositor::PYRAMID,
        };
        let reads_display = search == Search::Splat;
        Self {
            search,
            program,
            name: name(search),
            reads_display,
            fragment: BTreeMap::new(),
            compute: BTreeMap::new(),
        }
    }

    /// Draws pieces.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if the pool lacks a plane.
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
    ) -> Result<(), RenderError> {
        let bindings = |draw: &PieceDraw<'_>| {
            let mut bindings = match self.reads_display {
                true => batch.shared.bindings_of_level(draw.level)?,
                false => batch.shared.bindings()?,
            };
            match self.search {
                Search::Splat | Search::Seeded => {
                    bindings.push(NamedBinding::read("depths", &batch.splat.depths));
                }
                Search::Pyramid => {
                    bindings.push(NamedBinding::read("nearest_surfaces", batch.shared.pool.pyramids()?));
                }
                Search::Linear => {}
            }
            Ok(bindings)
        };
        let bindings = batch.pieces.iter().map(bindings).collect::<Result<Vec<_>, RenderError>>()?;
        match batch.search_backend {
            SearchBackend::Compute => self.record_compute(gpu, commands, batch, &bindings),
            _ => self.record_fragment(gpu, commands, batch, &bindings),
        }
        Ok(())
    }

    /// Values of the program's `override`s.
    fn constants(&self, variant: Variant) -> Vec<(&'static str, f64)> {
        let mut constants = variant.constants().to_vec();
        if self.reads_display {
            constants.push(("between_levels", f64::from(u8::from(variant.between_levels))));
        }
        constants
    }

    fn record_fragment(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
        bindings: &[Vec<NamedBinding<'_>>],
    ) {
        let variant = batch.variant;
        let (program, constants) = (self.program, self.constants(variant));
        let pipeline = self.fragment.entry(variant).or_insert_with(|| {
            gpu.render_pipeline(&RenderPipelineDesc {
                program,
                vertex: "vertex",
                fragment: Some(variant.fragment_entry_point()),
                buffers: &[],
                targets: &variant.formats(),
                depth: None,
                primitive: wgpu::PrimitiveState::default(),
                constants: &constants,
            })
        });
        let attachments = batch.attachments(variant);
        let mut pass = commands.render(self.name, &attachments, None);
        for (draw, bindings) in batch.pieces.iter().zip(bindings) {
            let [x, y] = draw.piece.fine_target();
            let [width, height] = draw.piece.fine_size();
            pass.viewport(x, y, width, height);
            let mut call = pass.draw(pipeline).read("view", &draw.view);
            for binding in bindings {
                call = call.read(binding.name, binding.resource);
            }
            call.vertices(0..3, 0..1);
        }
    }

    fn record_compute(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
        bindings: &[Vec<NamedBinding<'_>>],
    ) {
        let variant = batch.variant.of_compute();
        let (program, constants) = (self.program, self.constants(variant));
        let pipeline = self
            .compute
            .entry(variant)
            .or_insert_with(|| gpu.compute_pipeline_with(program, "write_compute", &constants));
        let storage = batch.storage();
        let mut pass = commands.compute_pass(self.name);
        for (draw, bindings) in batch.pieces.iter().zip(bindings) {
            let call = pass.call(pipeline).read("view", &draw.view);
            let call = bindings.iter().chain(&storage).fold(call, |call, binding| binding.bind(call));
            let [width, height] = draw.piece.fine_size();
            call.dispatch_threads([width, height, 1]);
        }
    }
}
