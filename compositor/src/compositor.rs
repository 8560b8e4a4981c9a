//! A batch of views, from top to bottom.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use argus_gpu::wgpu::BufferUsages;
use argus_gpu::{Commands, Gpu, Surroundings, wgpu};
use argus_scene::{
    Cancel, Compositor, Frame, Plan, PlaneKind, Provenance, RenderError, SampleId, SampleSet, Search, Stage,
    ViewJob, Warp,
};
use argus_shaders::layout::compositor::{Fill, Recall, ViewUniform};
use argus_shaders::layout::shared::Light;
use bytemuck::Zeroable as _;

use crate::drawing::{CONFIDENCE, Canvas, Draw, Drawn, FINE, RANGE, SHOWN, Shared, Splatted, Variant};
use crate::frames::{Assembly, Images};
use crate::holdings::Holdings;
use crate::intake::Tools;
use crate::knobs::{CompositorKnobs, Twin};
use crate::layout::{Chunk, Extent, Piece, chunks};
use crate::lights::light_about;
use crate::passes::bounds::BoundsPass;
use crate::passes::clear::ClearPass;
use crate::passes::fill::FillPass;
use crate::passes::fixed_point::FixedPointPass;
use crate::passes::floor::FloorPass;
use crate::passes::halve::HalvePass;
use crate::passes::highlight::HighlightPass;
use crate::passes::linear::LinearPass;
use crate::passes::mend::{COUNTS, MendPass};
use crate::passes::mips::MipsPass;
use crate::passes::pyramid::PyramidPass;
use crate::passes::recall::RecallPass;
use crate::passes::resolve::ResolvePass;
use crate::passes::seeded::SeededPass;
use crate::passes::splat::{SplatCall, SplatPass};
use crate::passes::warp::WarpPass;
use crate::plan::{PassPlan, plan};
use crate::prepare::{First, PreparedView};
use crate::targets::Targets;
use crate::trial::Trial;

/// Reconstructs views from samples on a GPU.
#[derive(Debug)]
pub struct GpuCompositor {
    gpu: Arc<Gpu>,
    knobs: CompositorKnobs,
    holdings: Holdings,
    targets: Targets,
    nearest: wgpu::Sampler,
    bilinear: wgpu::Sampler,
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
    resolve: ResolvePass,
    floor: FloorPass,
    trials: BTreeMap<Search, Trial>,
    /// Bound where no surface looks anything up.
    no_surroundings: Surroundings,
}

/// What becomes of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Work {
    /// Its views are reconstructed.
    Views,
    /// One colour is fetched a pixel: what they are measured by.
    Floor,
    /// Programs are made ready for such views, those that fetch from two levels of the samples or from one.
    Ready { between_levels: bool },
}

/// Called between the passes of a chunk, where each is a submission of its own.
type Pauses<'a> = Option<&'a mut dyn FnMut()>;

/// Everything that the passes of a chunk read, and which of them run.
struct ChunkData {
    /// A piece's uniforms each.
    views: wgpu::Buffer,
    lights: wgpu::Buffer,
    blocks: wgpu::Buffer,
    splatted: Splatted,
    cell_bytes: u64,
    splats: Vec<SplatCall>,
    /// Of views that begin from an earlier frame, and the words of those frames' pixels.
    recalls: Vec<Recall>,
    words: wgpu::Buffer,
    /// One a piece whose search splats.
    fills: BTreeMap<usize, Fill>,
    /// By search and pipeline: indices into the chunk's pieces.
    draws: BTreeMap<(Search, Variant), Vec<usize>>,
}

/// Distance of pieces' uniforms in their buffer.
const VIEW_STRIDE: u64 = size_of::<ViewUniform>() as u64;
// The largest alignment that a device may ask for.
const _: () = assert!(VIEW_STRIDE.is_multiple_of(256));

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
            targets: Targets::default(),
            nearest: sampler(wgpu::FilterMode::Nearest),
            bilinear: sampler(wgpu::FilterMode::Linear),
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
            floor: FloorPass::default(),
            trials: BTreeMap::new(),
            no_surroundings: Surroundings::none(&gpu),
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

    /// The floor of what a batch can cost: the same preparation, targets, resolve and readback as
    /// [`argus_scene::Compositor::compose`], and one nearest colour fetch a pixel in place of any reconstruction. For
    /// studies: the frames show nothing of use.
    ///
    /// # Errors
    /// As the views themselves would fail.
    pub fn compose_floor(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>> {
        let unsearched = |job: &ViewJob| match &job.plan {
            // The linear search prepares nothing but the view.
            Plan::Warp(warp) => {
                let warp = Warp { search: Search::Linear, steps: 1, ..warp.clone() };
                ViewJob { plan: Plan::Warp(warp), ..job.clone() }
            }
            Plan::Direct { .. } => job.clone(),
        };
        let views: Vec<ViewJob> = views.iter().map(unsearched).collect();
        self.compose_batch(&views, Work::Floor, cancel, &mut None)
    }

    /// Number of samples that are held.
    pub fn held(&self) -> usize {
        self.holdings.len()
    }

    /// The views that can be composed, cut into chunks, each drawn and read back in one submission.
    fn compose_batch(
        &mut self,
        jobs: &[ViewJob],
        work: Work,
        cancel: &Cancel,
        pauses: &mut Pauses<'_>,
    ) -> Vec<Result<Frame, RenderError>> {
        let began = Instant::now();
        let mut results: Vec<Option<RenderError>> = vec![None; jobs.len()];
        let mut views = Vec::with_capacity(jobs.len());
        for (index, job) in jobs.iter().enumerate() {
            let prepared = PreparedView::new(index, job, &self.holdings, &self.knobs);
            match prepared.and_then(|view| self.with_pyramids(view)) {
                Ok(mut view) => {
                    if let Work::Ready { between_levels } = work {
                        view.between_levels = between_levels && view.search == Search::Splat;
                    }
                    views.push(view);
                }
                Err(error) => results[index] = Some(error),
            }
        }
        let mut stages = vec![Stage::new("prepare views", milliseconds(began))];
        let extent = |v: &PreparedView| {
            let ViewJob { width, height, .. } = jobs[v.job];
            let surroundings = v.surroundings.as_ref().map(|(id, _)| *id);
            Extent { width, height, side: v.side, pool: v.pool, surroundings }
        };
        let extents: Vec<Extent> = views.iter().map(extent).collect();
        let mut assemblies: Vec<Assembly> = views
            .iter()
            .map(|v| Assembly::new(jobs[v.job].width, jobs[v.job].height, jobs[v.job].outputs))
            .collect();
        for chunk in chunks(&extents, &self.knobs) {
            let outcome = if cancel.is_cancelled() {
                Err(RenderError::Cancelled)
            } else {
                self.compose_chunk(&chunk, &views, jobs, work, &mut assemblies, pauses)
            };
            match outcome {
                Ok(passes) => passes.into_iter().for_each(|stage| add_stage(&mut stages, stage)),
                Err(error) => chunk.pieces.iter().for_each(|piece| {
                    results[views[piece.view].job] = Some(error.clone());
                }),
            }
        }
        // A batch's cost is shared evenly.
        let share = 1.0 / views.len().max(1) as f64;
        stages.iter_mut().for_each(|stage| stage.ms *= share);
        let mut frames: BTreeMap<usize, Frame> = BTreeMap::new();
        for (view, assembly) in views.iter().zip(assemblies) {
            if let Some(first) = view.samples.first() {
                let provenance = Provenance {
                    scene: first.info.scene,
                    epoch: first.info.version.state.epoch,
                    plan: jobs[view.job].plan.clone(),
                    specification: Some(first.info.specification()),
                    device: self.gpu.kind().to_owned(),
                    history: view.recalled.is_ok(),
                };
                frames.insert(view.job, assembly.finish(provenance, stages.clone()));
            }
        }
        let missing = || RenderError::Internal("a view was neither composed nor refused".to_owned());
        let result = |(i, error): (usize, Option<RenderError>)| match error {
            Some(error) => Err(error),
            None => frames.remove(&i).ok_or_else(missing),
        };
        results.into_iter().enumerate().map(result).collect()
    }

    /// The view, with pyramids of its samples if its search needs them.
    fn with_pyramids(&mut self, view: PreparedView) -> Result<PreparedView, RenderError> {
        if view.search == Search::Pyramid {
            self.holdings.make_pyramids(&self.gpu, &self.halve, &self.knobs, &view.samples)?;
        }
        Ok(view)
    }

    /// Draws the pieces of a chunk, brings them back and adds them to their frames.
    fn compose_chunk(
        &mut self,
        chunk: &Chunk,
        views: &[PreparedView],
        jobs: &[ViewJob],
        work: Work,
        assemblies: &mut [Assembly],
        pauses: &mut Pauses<'_>,
    ) -> Result<Vec<Stage>, RenderError> {
        let began = Instant::now();
        let data = self.upload(chunk, views, jobs);
        let side = chunk.pieces.first().map_or(1, |piece| piece.side);
        let any_range = chunk.pieces.iter().any(|piece| jobs[views[piece.view].job].outputs.range);
        let any_confidence = chunk.pieces.iter().any(|piece| jobs[views[piece.view].job].outputs.confidence);
        let fine = (side > 1).then(|| chunk.size.map(|pixels| pixels * side));
        let shown = self.targets.take(&self.gpu, chunk.size, SHOWN);
        // Attached only where range is asked for or averaged; else of a size that costs nothing.
        let range_size = if any_range || any_confidence || side > 1 { chunk.size } else { [1, 1] };
        let range = self.targets.take(&self.gpu, range_size, RANGE);
        let confidence_size = |size| if any_confidence { size } else { [1, 1] };
        let confidence = self.targets.take(&self.gpu, confidence_size(chunk.size), CONFIDENCE);
        let fine = fine.map(|size| {
            [(size, FINE), (size, RANGE), (confidence_size(size), CONFIDENCE)]
                .map(|(size, format)| self.targets.take(&self.gpu, size, format))
        });
        let final_targets = Drawn { color: &shown, range: &range, confidence: &confidence };
        let fine_targets = fine.as_ref().map(|[color, range, confidence]| Drawn { color, range, confidence });
        let drawn = fine_targets.unwrap_or(final_targets);

        let gpu = self.gpu.clone();
        let mut pause = |commands: &mut Commands| -> Result<(), RenderError> {
            let Some(between) = pauses else { return Ok(()) };
            std::mem::replace(commands, gpu.commands("compose views")).submit().wait()?;
            between();
            Ok(())
        };
        let mut commands = self.gpu.commands("compose views");
        let pool = self.holdings.pool(chunk.pieces.first().map_or(0, |piece| views[piece.view].pool))?;
        let around = chunk.pieces.first().and_then(|piece| views[piece.view].surroundings.as_ref());
        let shared = Shared {
            pool,
            nearest: &self.nearest,
            bilinear: &self.bilinear,
            lights: &data.lights,
            surroundings: around.map_or(&self.no_surroundings, |(_, maps)| maps),
        };
        if !data.fills.is_empty() {
            // Cells that no texel reaches stay 0: infinitely far.
            commands.encoder().clear_buffer(&data.splatted.cells, 0, Some(data.cell_bytes));
            if !data.splats.is_empty() {
                let inverse_range = pool.view(PlaneKind::InverseRange)?;
                let cells = &data.splatted.cells;
                self.splat.record(&mut commands, &data.splats, inverse_range, &data.blocks, cells);
                pause(&mut commands)?;
            }
            if !data.recalls.is_empty() {
                self.recall.record(&mut commands, &data.recalls, &data.words, &data.splatted.cells);
            }
            let fills: Vec<Fill> = data.fills.values().copied().collect();
            self.fill.record(&mut commands, &fills, &data.splatted.cells, &data.splatted.depths);
            pause(&mut commands)?;
        }
        for (&(search, variant), pieces) in &data.draws {
            let draws: Vec<Draw<'_>> = pieces
                .iter()
                .map(|&i| {
                    let piece = chunk.pieces[i];
                    let fill = data.fills.get(&i).copied();
                    let cell = views[piece.view].cell;
                    Draw {
                        piece,
                        fill,
                        cell,
                        level: views[piece.view].level,
                        view: part(&data.views, i, VIEW_STRIDE),
                    }
                })
                .collect();
            if search == Search::Splat && work != Work::Floor {
                self.clear.record(&self.gpu, &mut commands, &draws, &shared, &data.splatted)?;
                pause(&mut commands)?;
            }
            let twin = self.trials.entry(search).or_default().next(self.knobs.twin);
            let canvas = Canvas { variant, twin, shared: &shared, draws: &draws, targets: drawn };
            match search {
                _ if work == Work::Floor => self.floor.record(&self.gpu, &mut commands, &canvas)?,
                Search::Splat => {
                    self.warp.record(&self.gpu, &mut commands, &canvas, &data.splatted)?;
                    pause(&mut commands)?;
                    self.mend.record(&self.gpu, &mut commands, &canvas, &data.splatted)?;
                    pause(&mut commands)?;
                    if variant.glossy {
                        self.highlight.record(&self.gpu, &mut commands, &canvas, &data.splatted)?;
                    }
                }
                Search::Linear => self.linear.record(&self.gpu, &mut commands, &canvas)?,
                Search::FixedPoint => self.fixed_point.record(&self.gpu, &mut commands, &canvas)?,
                Search::Seeded => self.seeded.record(&self.gpu, &mut commands, &canvas, &data.splatted)?,
                Search::Pyramid => self.pyramid.record(&self.gpu, &mut commands, &canvas)?,
            }
            pause(&mut commands)?;
        }
        if let Some(fine_targets) = fine_targets {
            let exposure =
                |p: &Piece| views[p.view].samples.first().map_or(1.0, |s| s.info.lighting.exposure);
            let pieces: Vec<(Piece, f32)> = chunk.pieces.iter().map(|p| (*p, exposure(p))).collect();
            self.resolve.record(&mut commands, &pieces, any_confidence, fine_targets, final_targets);
        }
        let shown_ticket = commands.read_texture(&shown.texture);
        let range_ticket = any_range.then(|| commands.read_texture(&range.texture));
        let confidence_ticket = any_confidence.then(|| commands.read_texture(&confidence.texture));
        let uploaded = milliseconds(began);
        let mut finished = commands.submit().wait()?;
        self.note_times(chunk, &data, &finished.stages);

        let unpacking = Instant::now();
        let shown_bytes = finished.take(shown_ticket);
        let range_bytes = range_ticket.map(|ticket| finished.take(ticket)).unwrap_or_default();
        let confidence_bytes = confidence_ticket.map(|ticket| finished.take(ticket)).unwrap_or_default();
        let images = Images { shown: &shown_bytes, range: &range_bytes, confidence: &confidence_bytes };
        for piece in &chunk.pieces {
            assemblies[piece.view].add(chunk, piece, &images);
        }
        for target in [shown, range, confidence].into_iter().chain(fine.into_iter().flatten()) {
            self.targets.give_back(target);
        }
        let mut stages = vec![Stage::new("record passes", uploaded)];
        stages.append(&mut finished.stages);
        stages.push(Stage::new("unpack frames", milliseconds(unpacking)));
        Ok(stages)
    }

    /// Tells the trials of the chunk's searches what drawing took.
    fn note_times(&mut self, chunk: &Chunk, data: &ChunkData, stages: &[Stage]) {
        let searches: BTreeSet<Search> = data.draws.keys().map(|(search, _)| *search).collect();
        for search in searches {
            let name = match search {
                Search::Splat => WarpPass::NAME,
                Search::Linear => LinearPass::NAME,
                Search::FixedPoint => FixedPointPass::NAME,
                Search::Seeded => SeededPass::NAME,
                Search::Pyramid => PyramidPass::NAME,
            };
            let pieces = data.draws.iter().filter(|((s, _), _)| *s == search).flat_map(|(_, pieces)| pieces);
            let area = |piece: &Piece| piece.fine_size().iter().map(|&side| u64::from(side)).product::<u64>();
            let sub_pixels = pieces.map(|&i| area(&chunk.pieces[i])).sum();
            let Some(stage) = stages.iter().find(|stage| stage.name == name) else { continue };
            let trial = self.trials.entry(search).or_default();
            let twin = trial.next(self.knobs.twin);
            if let Some(twin) = trial.note(twin, stage.ms, sub_pixels) {
                tracing::info!(search = search.name(), ?twin, "the faster program on this device");
            }
        }
    }

    /// Uploads what the passes of a chunk read.
    fn upload(&mut self, chunk: &Chunk, views: &[PreparedView], jobs: &[ViewJob]) -> ChunkData {
        let mut uniforms: Vec<ViewUniform> = Vec::with_capacity(chunk.pieces.len());
        let (mut lights, mut blocks, mut words) = (Vec::new(), Vec::new(), Vec::new());
        let (mut splats, mut recalls, mut fills) = (Vec::new(), Vec::new(), BTreeMap::new());
        let mut draws: BTreeMap<(Search, Variant), Vec<usize>> = BTreeMap::new();
        let mut first = First::default();
        for (i, piece) in chunk.pieces.iter().enumerate() {
            let view = &views[piece.view];
            let job = &jobs[view.job];
            (first.piece, first.light) = (i as u32, lights.len() as u32);
            uniforms.push(view.uniform(piece, &first));
            if let Some(held) = view.samples.first().filter(|_| view.glossy) {
                let about = |light| light_about(light, job.camera.eye);
                lights.extend(held.info.lighting.lights.iter().map(about));
            }
            if view.splats_first() {
                splats.append(&mut view.splats(piece, first.cell, &mut blocks));
                recalls.extend(view.recall(piece, first.cell, &mut words));
                fills.insert(i, view.fill(piece, first.cell));
                first.cell += view.cell_count(piece);
                first.unsettled += piece.part.width * piece.part.height * piece.side * piece.side + COUNTS;
            }
            let fine = view.side > 1;
            let confident = job.outputs.confidence;
            let range = fine || confident || job.outputs.range;
            let (omni, glossy, between_levels) = (view.omni, view.glossy, view.between_levels);
            let reflects = view.surroundings.is_some();
            let variant = Variant { omni, glossy, reflects, fine, range, confident, between_levels };
            draws.entry((view.search, variant)).or_default().push(i);
        }
        let mut upload = |label, bytes: &[u8], usage| {
            let buffer = self.targets.buffer(&self.gpu, label, bytes.len() as u64, usage);
            self.gpu.write(&buffer, bytes);
            buffer
        };
        let views = upload("views", bytemuck::cast_slice(&uniforms), BufferUsages::UNIFORM);
        if lights.is_empty() {
            // Bound by all programs, read by those for glossy samples: an array of none cannot be bound.
            lights.push(Light::zeroed());
        }
        let lights = upload("lights", bytemuck::cast_slice(&lights), BufferUsages::STORAGE);
        let blocks = upload("blocks", bytemuck::cast_slice(&blocks), BufferUsages::STORAGE);
        let words = upload("words", bytemuck::cast_slice(&words), BufferUsages::STORAGE);
        let cell_bytes = u64::from(first.cell) * 4;
        let mut scratch =
            |label, bytes: u64| self.targets.buffer(&self.gpu, label, bytes, BufferUsages::STORAGE);
        let splatted = Splatted {
            cells: scratch("cells", cell_bytes),
            depths: scratch("depths", cell_bytes),
            unsettled: scratch("unsettled", u64::from(first.unsettled) * 4),
        };
        ChunkData { views, lights, blocks, splatted, cell_bytes, splats, recalls, words, fills, draws }
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
        self.compose_batch(views, Work::Views, cancel, &mut None)
    }

    /// Composes the view with each of the programs that others like it may call for: both twins of its search until one is
    /// chosen, with and without blending between levels.
    fn ready(&mut self, view: &ViewJob, between: &mut dyn FnMut()) -> Result<(), RenderError> {
        let chosen = self.knobs.twin;
        let twins = if chosen == Twin::Auto { vec![Twin::Fragment, Twin::Compute] } else { vec![chosen] };
        let mut done = Ok(());
        for (twin, between_levels) in twins.into_iter().flat_map(|twin| [(twin, false), (twin, true)]) {
            self.knobs.twin = twin;
            let work = Work::Ready { between_levels };
            let views = std::slice::from_ref(view);
            let frames = self.compose_batch(views, work, &Cancel::default(), &mut Some(&mut *between));
            done = done.and(frames.into_iter().try_for_each(|frame| frame.map(drop)));
        }
        self.knobs.twin = chosen;
        done
    }
}

/// Element `index` of an array with the given stride.
fn part(buffer: &wgpu::Buffer, index: usize, stride: u64) -> wgpu::BufferBinding<'_> {
    wgpu::BufferBinding { buffer, offset: index as u64 * stride, size: wgpu::BufferSize::new(stride) }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// Adds a stage to the row of its name.
fn add_stage(stages: &mut Vec<Stage>, stage: Stage) {
    match stages.iter_mut().find(|s| s.name == stage.name) {
        Some(row) => row.ms += stage.ms,
        None => stages.push(stage),
    }
}
