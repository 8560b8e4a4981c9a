//! A batch of views, from top to bottom.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use argus_gpu::{Commands, Gpu, Surroundings, wgpu};
use argus_scene::{Cancel, Compositor, Frame, RenderError, SampleId, SampleSet, Search, Stage, ViewJob};

use crate::batch::{Batch, milliseconds};
use crate::chunk::{ChunkInputs, Pauses};
use crate::draw_batch::{DrawBatch, FixedBindings, SharedBindings};
use crate::holdings::Holdings;
use crate::intake::Tools;
use crate::knobs::{CompositorKnobs, Twin};
use crate::layout::Chunk;
use crate::passes::bounds::BoundsPass;
use crate::passes::clear::ClearPass;
use crate::passes::fill::FillPass;
use crate::passes::fixed_point::FixedPointPass;
use crate::passes::halve::HalvePass;
use crate::passes::highlight::HighlightPass;
use crate::passes::linear::LinearPass;
use crate::passes::mend::MendPass;
use crate::passes::mips::MipsPass;
use crate::passes::pyramid::PyramidPass;
use crate::passes::recall::RecallPass;
use crate::passes::resolve::ResolvePass;
use crate::passes::seeded::SeededPass;
use crate::passes::splat::SplatPass;
use crate::passes::warp::WarpPass;
use crate::plan::{PassPlan, plan};
use crate::prepare::PreparedView;
use crate::targets::{ChunkTargets, TargetPool};
use crate::trial::Trial;

/// Reconstructs views from samples on a GPU.
#[derive(Debug)]
pub struct GpuCompositor {
    pub(crate) gpu: Arc<Gpu>,
    knobs: CompositorKnobs,
    pub(crate) holdings: Holdings,
    targets: TargetPool,
    pub(crate) fixed: FixedBindings,
    bounds: BoundsPass,
    mips: MipsPass,
    splat: SplatPass,
    recall: RecallPass,
    fill: FillPass,
    clear: ClearPass,
    warp: WarpPass,
    mend: MendPass,
    highlight: HighlightPass,
    linear: LinearPass,
    fixed_point: FixedPointPass,
    seeded: SeededPass,
    halve: HalvePass,
    pyramid: PyramidPass,
    pub(crate) resolve: ResolvePass,
    trials: BTreeMap<Search, Trial>,
}

/// Composes one chunk of a batch and returns the times of its stages.
type ComposeChunk<'a> =
    &'a mut dyn FnMut(&mut GpuCompositor, &Chunk, &mut Batch<'_>) -> Result<Vec<Stage>, RenderError>;

/// A chunk while its passes are recorded.
pub(crate) struct ChunkWork {
    began: Instant,
    pub(crate) inputs: ChunkInputs,
    pub(crate) targets: ChunkTargets,
}

impl GpuCompositor {
    /// A compositor with default knobs that holds nothing yet.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if the device lacks what the passes need.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self, RenderError> {
        Self::with_knobs(gpu, CompositorKnobs::default())
    }

    /// A compositor that holds nothing yet.
    ///
    /// # Errors
    /// As [`GpuCompositor::new`].
    pub fn with_knobs(gpu: Arc<Gpu>, knobs: CompositorKnobs) -> Result<Self, RenderError> {
        if !gpu.device.features().contains(wgpu::Features::IMMEDIATES) {
            let reason = format!("the device `{}` has no immediates (push constants)", gpu.kind());
            return Err(RenderError::Internal(reason));
        }
        let sampler = |filter| {
            gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: filter,
                min_filter: filter,
                // Between levels too: a change of level would show.
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                ..Default::default()
            })
        };
        Ok(Self {
            knobs,
            holdings: Holdings::default(),
            targets: TargetPool::default(),
            fixed: FixedBindings {
                nearest: sampler(wgpu::FilterMode::Nearest),
                bilinear: sampler(wgpu::FilterMode::Linear),
                no_surroundings: Surroundings::none(&gpu),
            },
            bounds: BoundsPass::new(&gpu),
            mips: MipsPass::new(&gpu),
            splat: SplatPass::new(&gpu),
            recall: RecallPass::new(&gpu),
            fill: FillPass::new(&gpu),
            clear: ClearPass::default(),
            warp: WarpPass::new(),
            mend: MendPass::default(),
            highlight: HighlightPass::default(),
            linear: LinearPass::new(),
            fixed_point: FixedPointPass::new(),
            seeded: SeededPass::new(),
            halve: HalvePass::new(&gpu),
            pyramid: PyramidPass::new(),
            resolve: ResolvePass::new(&gpu),
            trials: BTreeMap::new(),
            gpu,
        })
    }

    /// Which passes a view calls for, and why each is on or off.
    ///
    /// # Errors
    /// As the view itself would fail: a sample that is not held, a plan that cannot be followed.
    pub fn plan(&self, job: &ViewJob) -> Result<Vec<PassPlan>, RenderError> {
        let view = PreparedView::new(0, job, &self.holdings, &self.knobs)?;
        let looks = [view.glossy, view.surroundings.is_some()];
        let recalled = view.recalled.as_ref().err().copied();
        Ok(plan(&job.plan, job.outputs, looks, recalled, self.knobs.splatting))
    }

    /// Which of a search's two programs draws: what the knob says, or what was found to be the faster on this device;
    /// `None` while that is being tried.
    pub fn twin(&self, search: Search) -> Option<Twin> {
        match self.knobs.twin {
            Twin::Auto => self.trials.get(&search).and_then(Trial::decided),
            fixed => Some(fixed),
        }
    }

    /// Number of samples that are held.
    pub fn held(&self) -> usize {
        self.holdings.len()
    }

    /// Prepares the views of a batch.
    pub(crate) fn prepare<'a>(&mut self, jobs: &'a [ViewJob]) -> Batch<'a> {
        let Self { gpu, halve, holdings, knobs, .. } = self;
        Batch::new(jobs, |index, job| {
            let view = PreparedView::new(index, job, holdings, knobs)?;
            if view.search == Search::Pyramid {
                holdings.make_pyramids(gpu, halve, knobs, &view.samples)?;
            }
            Ok(view)
        })
    }

    /// Composes a batch chunk by chunk. After a cancellation the remaining views fail with [`RenderError::Cancelled`].
    pub(crate) fn compose_batch(
        &mut self,
        mut batch: Batch<'_>,
        cancel: &Cancel,
        compose_chunk: ComposeChunk<'_>,
    ) -> Vec<Result<Frame, RenderError>> {
        for chunk in batch.chunks(&self.knobs) {
            let outcome = match cancel.is_cancelled() {
                true => Err(RenderError::Cancelled),
                false => compose_chunk(self, &chunk, &mut batch),
            };
            batch.end_chunk(&chunk, outcome);
        }
        batch.finish(self.gpu.kind())
    }

    /// Reconstructs the pieces of a chunk and adds them to their frames. The list of all passes, in order.
    fn compose_chunk(
        &mut self,
        chunk: &Chunk,
        batch: &mut Batch<'_>,
        pauses: &mut Pauses<'_>,
    ) -> Result<Vec<Stage>, RenderError> {
        let gpu = &Arc::clone(&self.gpu);
        let work = self.begin_chunk(chunk, batch);
        let ChunkWork { inputs, targets, .. } = &work;
        let shared = &SharedBindings::new(&self.holdings, &self.fixed, inputs, chunk, batch)?;
        let mut commands = gpu.commands("compose views");
        if inputs.has_cells() {
            inputs.clear_cells(&mut commands);
            self.splat.record(&mut commands, inputs, shared.pool)?;
            pauses.pause(&mut commands)?;
            self.recall.record(&mut commands, inputs);
            self.fill.record(&mut commands, inputs);
            pauses.pause(&mut commands)?;
        }
        for (&(search, variant), pieces) in &inputs.draws {
            let twin = self.trials.entry(search).or_default().next(self.knobs.twin);
            let pieces = &inputs.pieces(pieces, chunk, batch);
            let draws = &DrawBatch { variant, twin, shared, splat: &inputs.splat, pieces, targets };
            match search {
                Search::Splat => {
                    self.clear.record(gpu, &mut commands, draws)?;
                    pauses.pause(&mut commands)?;
                    self.warp.record(gpu, &mut commands, draws)?;
                    pauses.pause(&mut commands)?;
                    self.mend.record(gpu, &mut commands, draws)?;
                    pauses.pause(&mut commands)?;
                    self.highlight.record(gpu, &mut commands, draws)?;
                }
                Search::Linear => self.linear.record(gpu, &mut commands, draws)?,
                Search::FixedPoint => self.fixed_point.record(gpu, &mut commands, draws)?,
                Search::Seeded => self.seeded.record(gpu, &mut commands, draws)?,
                Search::Pyramid => self.pyramid.record(gpu, &mut commands, draws)?,
            }
            pauses.pause(&mut commands)?;
        }
        self.resolve.record(&mut commands, chunk, batch, targets);
        self.end_chunk(work, chunk, batch, commands)
    }

    /// Uploads the inputs of a chunk and takes its targets.
    pub(crate) fn begin_chunk(&mut self, chunk: &Chunk, batch: &Batch<'_>) -> ChunkWork {
        let began = Instant::now();
        let inputs = ChunkInputs::upload(&self.gpu, &mut self.targets, chunk, batch);
        let side = chunk.pieces.first().map_or(1, |piece| piece.side);
        let targets = ChunkTargets::take(&mut self.targets, &self.gpu, chunk.size, side, inputs.outputs);
        ChunkWork { began, inputs, targets }
    }

    /// Completes the passes of a chunk and adds its pieces to their frames. Returns the times of its stages.
    pub(crate) fn end_chunk(
        &mut self,
        work: ChunkWork,
        chunk: &Chunk,
        batch: &mut Batch<'_>,
        mut commands: Commands,
    ) -> Result<Vec<Stage>, RenderError> {
        let ChunkWork { began, inputs, targets } = work;
        let readback = targets.read_back(&mut commands);
        let recorded = milliseconds(began);
        let mut finished = commands.submit().wait()?;
        self.note_times(chunk, &inputs, &finished.stages);
        let unpacking = Instant::now();
        batch.add_pieces(chunk, &readback.take(&mut finished));
        targets.give_back(&mut self.targets);
        let mut stages = vec![Stage::new("record passes", recorded)];
        stages.append(&mut finished.stages);
        stages.push(Stage::new("unpack frames", milliseconds(unpacking)));
        Ok(stages)
    }

    /// Tells the trials of the chunk's searches what drawing took.
    fn note_times(&mut self, chunk: &Chunk, inputs: &ChunkInputs, stages: &[Stage]) {
        let searches: BTreeSet<Search> = inputs.draws.keys().map(|(search, _)| *search).collect();
        for search in searches {
            let name = match search {
                Search::Splat => WarpPass::NAME,
                Search::Linear => LinearPass::NAME,
                Search::FixedPoint => FixedPointPass::NAME,
                Search::Seeded => SeededPass::NAME,
                Search::Pyramid => PyramidPass::NAME,
            };
            let Some(stage) = stages.iter().find(|stage| stage.name == name) else { continue };
            let trial = self.trials.entry(search).or_default();
            let twin = trial.next(self.knobs.twin);
            if let Some(twin) = trial.note(twin, stage.ms, inputs.sub_pixels(search, chunk)) {
                tracing::info!(search = search.name(), ?twin, "the faster program on this device");
            }
        }
    }
}

impl Compositor for GpuCompositor {
    fn device(&self) -> &str {
        self.gpu.kind()
    }

    fn hold(&mut self, set: &SampleSet) -> Result<(), RenderError> {
        let Self { gpu, bounds, mips, knobs, holdings, .. } = self;
        holdings.hold(&Tools { gpu, bounds, mips, knobs }, set, &|| false).map(drop)
    }

    fn hold_slice(&mut self, set: &SampleSet) -> Result<bool, RenderError> {
        let Self { gpu, bounds, mips, knobs, holdings, .. } = self;
        let began = Instant::now();
        holdings.hold(&Tools { gpu, bounds, mips, knobs }, set, &|| milliseconds(began) >= knobs.slice_ms)
    }

    fn release(&mut self, ids: &[SampleId]) {
        self.holdings.release(ids);
        self.holdings.trim();
    }

    fn compose(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>> {
        let batch = self.prepare(views);
        self.compose_batch(batch, cancel, &mut |this, chunk, batch| {
            this.compose_chunk(chunk, batch, &mut Pauses::none())
        })
    }

    /// Composes the view with each of the programs that others like it may call for: both twins of its search until one is
    /// chosen, with and without blending between levels.
    fn ready(&mut self, view: &ViewJob, between: &mut dyn FnMut()) -> Result<(), RenderError> {
        let chosen = self.knobs.twin;
        let twins = if chosen == Twin::Auto { vec![Twin::Fragment, Twin::Compute] } else { vec![chosen] };
        let mut done = Ok(());
        for (twin, between_levels) in twins.into_iter().flat_map(|twin| [(twin, false), (twin, true)]) {
            self.knobs.twin = twin;
            let mut batch = self.prepare(std::slice::from_ref(view));
            for view in &mut batch.views {
                view.between_levels = between_levels && view.search == Search::Splat;
            }
            let pauses = &mut Pauses::with(&self.gpu, &mut *between);
            let frames = self.compose_batch(batch, &Cancel::default(), &mut |this, chunk, batch| {
                this.compose_chunk(chunk, batch, pauses)
            });
            done = done.and(frames.into_iter().try_for_each(|frame| frame.map(drop)));
        }
        self.knobs.twin = chosen;
        done
    }
}
