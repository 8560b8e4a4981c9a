//! Program: `shaders/compositor/bare_fetch.wgsl`. Measures the least that a batch can cost: one colour fetch a pixel.

use std::collections::BTreeMap;

use argus_gpu::{Commands, Gpu, RenderPipeline, RenderPipelineDesc, wgpu};
use argus_scene::{Cancel, Frame, Plan, PlaneKind, RenderError, Search, Stage, ViewJob, Warp};

use crate::GpuCompositor;
use crate::batch::Batch;
use crate::compositor::ChunkWork;
use crate::draw_batch::{DrawBatch, Variant};
use crate::layout::Chunk;
use crate::settings::SearchBackend;

/// Composes batches without any reconstruction, for studies. The frames are meaningless.
#[derive(Debug, Default)]
pub struct BareFetch(BTreeMap<(bool, bool), RenderPipeline>);

impl BareFetch {
    /// Composes views with one nearest colour fetch a pixel in place of a search. Preparation, targets, resolve and readback
    /// are those of [`argus_scene::Compositor::compose`].
    ///
    /// # Errors
    /// The errors that the views would have when composed.
    pub fn compose(
        &mut self,
        compositor: &mut GpuCompositor,
        views: &[ViewJob],
        cancel: &Cancel,
    ) -> Vec<Result<Frame, RenderError>> {
        let unsearched = |job: &ViewJob| match &job.plan {
            // The linear search prepares nothing but the view.
            Plan::Warp(warp) => {
                let warp = Warp { search: Search::Linear, steps: 1, ..warp.clone() };
                ViewJob { plan: Plan::Warp(warp), ..job.clone() }
            }
            Plan::Direct { .. } => job.clone(),
        };
        let views: Vec<ViewJob> = views.iter().map(unsearched).collect();
        let batch = compositor.prepare(&views);
        compositor.compose_batch(batch, cancel, &mut |compositor, chunk, batch| {
            self.compose_chunk(compositor, chunk, batch)
        })
    }

    fn compose_chunk(
        &mut self,
        compositor: &mut GpuCompositor,
        chunk: &Chunk,
        batch: &mut Batch<'_>,
    ) -> Result<Vec<Stage>, RenderError> {
        let work = compositor.begin_chunk(chunk, batch);
        let ChunkWork { inputs, targets, .. } = &work;
        let GpuCompositor { gpu, sample_store, fixed, resolve, .. } = compositor;
        let shared = &inputs.bindings(sample_store, fixed, chunk, batch)?;
        let mut commands = gpu.commands("fetch colours");
        for (&(_, variant), pieces) in &inputs.draws {
            let pieces = &inputs.pieces(pieces, chunk, batch);
            let search_backend = SearchBackend::Fragment;
            let draws = &DrawBatch { variant, search_backend, shared, splat: &inputs.splat, pieces, targets };
            self.record(gpu, &mut commands, draws)?;
        }
        resolve.record(&mut commands, chunk, |piece| batch.view(piece).exposure(), targets);
        compositor.end_chunk(work, chunk, batch, commands)
    }

    fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
    ) -> Result<(), RenderError> {
        let variant = Variant { confident: false, between_levels: false, ..batch.variant };
        let pipeline = self.0.entry((variant.linear, variant.range)).or_insert_with(|| {
            gpu.render_pipeline(&RenderPipelineDesc {
                program: &argus_shaders::compositor::BARE_FETCH,
                vertex: "vertex",
                fragment: Some(variant.fragment_entry_point()),
                buffers: &[],
                targets: &variant.formats(),
                depth: None,
                primitive: wgpu::PrimitiveState::default(),
                constants: &[],
            })
        });
        let attachments = batch.attachments(variant);
        let radiance = batch.shared.pool.view(PlaneKind::Radiance)?;
        let mut pass = commands.render("fetch colours", &attachments, None);
        for draw in batch.pieces {
            let [x, y] = draw.piece.fine_target();
            let [width, height] = draw.piece.fine_size();
            pass.viewport(x, y, width, height);
            pass.draw(pipeline)
                .read("view", &draw.view)
                .read("radiance", radiance)
                .read("nearest", &batch.shared.fixed.nearest)
                .vertices(0..3, 0..1);
        }
        Ok(())
    }
}
