//! Composes batches of views.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use argus_gpu::wgpu::util::DeviceExt;
use argus_gpu::{Commands, EnvironmentTexture, Gpu, ReflectionProbes, wgpu};
use argus_scene::{
    Cancel, Compositor, Frame, Output, Plan, RenderError, SampleId, SampleSet, Search, Stage, ViewJob, Warp,
};

use crate::autotune::Autotune;
use crate::batch::{Batch, milliseconds};
use crate::chunk::{ChunkInputs, Pauses};
use crate::draw_batch::{DrawBatch, FixedBindings};
use crate::layout::Chunk;
use crate::pass_plan::{PassPlan, pass_plan};
use crate::passes::bounds::BoundsPass;
use crate::passes::build_pyramid::BuildPyramidPass;
use crate::passes::fill::FillPass;
use crate::passes::highlight::HighlightPass;
use crate::passes::mips::MipsPass;
use crate::passes::reproject::ReprojectPass;
use crate::passes::resolve::ResolvePass;
use crate::passes::second_pass::SecondPass;
use crate::passes::sky_mask::SkyMaskPass;
use crate::passes::splat::SplatPass;
use crate::prepare::PreparedView;
use crate::radiance;
use crate::sample_store::SampleStore;
use crate::sample_upload::UploadContext;
use crate::search_pipelines::{self, SearchPipelines};
use crate::settings::{CompositorSettings, SearchBackend};
use crate::targets::{ChunkTargets, TargetPool};

/// Reconstructs views from samples on a GPU.
#[derive(Debug)]
pub struct GpuCompositor {
    pub(crate) gpu: Arc<Gpu>,
    settings: CompositorSettings,
    pub(crate) sample_store: SampleStore,
    targets: TargetPool,
    pub(crate) fixed: FixedBindings,
    bounds: BoundsPass,
    mips: MipsPass,
    splat: SplatPass,
    reproject: ReprojectPass,
    fill: FillPass,
    sky_mask: SkyMaskPass,
    second_pass: SecondPass,
    highlight: HighlightPass,
    build_pyramid: BuildPyramidPass,
    searches: BTreeMap<Search, SearchPipelines>,
    pub(crate) resolve: ResolvePass,
    autotune: BTreeMap<Search, Autotune>,
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
    /// Makes a compositor with default settings. It holds no samples.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if the device lacks what the passes need.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self, RenderError> {
        Self::with_settings(gpu, CompositorSettings::default())
    }

    /// Makes a compositor with these settings. It holds no samples.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if the device lacks what the passes need.
    pub fn with_settings(gpu: Arc<Gpu>, settings: CompositorSettings) -> Result<Self, RenderError> {
        if !gpu.device.features().contains(wgpu::Features::IMMEDIATES) {
            let reason = format!("the device `{}` has no immediates (push constants)", gpu.kind());
            return Err(RenderError::Internal(reason));
        }
        // Compute programs take four times as long there.
        let frames_on_host = gpu.is_software() && settings.search_backend == SearchBackend::Auto;
        let sampler = |filter| {
            gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: filter,
                min_filter: filter,
                // Interpolates between levels, so that a change of level is invisible.
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                ..Default::default()
            })
        };
        Ok(Self {
            settings,
            sample_store: SampleStore::new(frames_on_host),
            targets: TargetPool::default(),
            fixed: FixedBindings {
                nearest: sampler(wgpu::FilterMode::Nearest),
                bilinear: sampler(wgpu::FilterMode::Linear),
                no_probes: ReflectionProbes::none(&gpu),
                no_environment: EnvironmentTexture::none(&gpu),
                all_light_seen: all_light_seen(&gpu),
            },
            bounds: BoundsPass::new(&gpu),
            mips: MipsPass::new(&gpu),
            splat: SplatPass::new(&gpu),
            reproject: ReprojectPass::new(&gpu),
            fill: FillPass::new(&gpu),
            sky_mask: SkyMaskPass::default(),
            second_pass: SecondPass::default(),
            highlight: HighlightPass::default(),
            build_pyramid: BuildPyramidPass::new(&gpu),
            searches: BTreeMap::new(),
            resolve: ResolvePass::new(&gpu),
            autotune: BTreeMap::new(),
            gpu,
        })
    }

    /// The passes of a view, and why each is on or off.
    ///
    /// # Errors
    /// A sample that is not held, or a plan that no compositor can follow.
    pub fn plan(&self, job: &ViewJob) -> Result<Vec<PassPlan>, RenderError> {
        let view = PreparedView::new(0, job, &self.sample_store, &self.settings)?;
        let planes = [view.glossy, view.probes.is_some()];
        let reprojection = view.reprojection.as_ref().err().copied();
        Ok(pass_plan(&job.plan, job.outputs, planes, reprojection, self.settings.splat_samples))
    }

    /// The program that a search runs as: the setting's, or the faster one on this device. `None` while autotuning.
    pub fn search_backend(&self, search: Search) -> Option<SearchBackend> {
        match self.settings.search_backend {
            SearchBackend::Auto => self.autotune.get(&search).and_then(Autotune::decided),
            fixed => Some(fixed),
        }
    }

    /// Number of samples that are held, reflection probes included.
    pub fn held(&self) -> usize {
        self.sample_store.len()
    }

    /// Prepares the views of a batch.
    pub(crate) fn prepare<'a>(&mut self, jobs: &'a [ViewJob]) -> Batch<'a> {
        let Self { gpu, bounds, mips, build_pyramid, sample_store, settings, .. } = self;
        Batch::new(jobs, |index, job| {
            if let Plan::Warp(Warp { search, samples, .. }) = &job.plan
                && *search != Search::Splat
            {
                sample_store.hold_on_device(&UploadContext { gpu, bounds, mips, settings }, samples)?;
            }
            let view = PreparedView::new(index, job, sample_store, settings)?;
            if view.search == Search::Pyramid {
                sample_store.make_pyramids(gpu, build_pyramid, settings, &view.samples)?;
            }
            Ok(view)
        })
    }

    /// Composes views that have either radiance alone or none.
    fn compose_alike(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>> {
        let batch = self.prepare(views);
        self.compose_batch(batch, cancel, &mut |this, chunk, batch| {
            this.compose_chunk(chunk, batch, &mut Pauses::none())
        })
    }

    /// Composes a batch chunk by chunk. After a cancellation the remaining views fail with [`RenderError::Cancelled`].
    pub(crate) fn compose_batch(
        &mut self,
        mut batch: Batch<'_>,
        cancel: &Cancel,
        compose_chunk: ComposeChunk<'_>,
    ) -> Vec<Result<Frame, RenderError>> {
        batch.compose_on_host(cancel);
        for chunk in batch.chunks(&self.settings) {
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
        let shared = &inputs.bindings(&self.sample_store, &self.fixed, chunk, batch)?;
        let mut commands = gpu.commands("compose views");
        if inputs.has_cells() {
            inputs.clear_cells(&mut commands);
            let ChunkInputs { splat, blocks, splats, words, reprojects, .. } = inputs;
            self.splat.record(&mut commands, splat, blocks, splats, shared.pool)?;
            pauses.pause(&mut commands)?;
            self.reproject.record(&mut commands, splat, words, reprojects);
            self.fill.record(&mut commands, splat, inputs.fills());
            pauses.pause(&mut commands)?;
        }
        for (&(search, variant), pieces) in &inputs.draws {
            let search_backend = self.autotune.entry(search).or_default().next(self.settings.search_backend);
            let pieces = &inputs.pieces(pieces, chunk, batch);
            let draws = &DrawBatch { variant, search_backend, shared, splat: &inputs.splat, pieces, targets };
            if search == Search::Splat {
                self.sky_mask.record(gpu, &mut commands, draws)?;
                pauses.pause(&mut commands)?;
            }
            let pipelines = self.searches.entry(search).or_insert_with(|| SearchPipelines::new(search));
            pipelines.record(gpu, &mut commands, draws)?;
            if search == Search::Splat {
                pauses.pause(&mut commands)?;
                self.second_pass.record(gpu, &mut commands, draws)?;
                pauses.pause(&mut commands)?;
                self.highlight.record(gpu, &mut commands, draws)?;
            }
            pauses.pause(&mut commands)?;
        }
        self.resolve.record(&mut commands, chunk, |piece| batch.view(piece).exposure(), targets);
        self.end_chunk(work, chunk, batch, commands)
    }

    /// Uploads the inputs of a chunk and takes its targets.
    pub(crate) fn begin_chunk(&mut self, chunk: &Chunk, batch: &Batch<'_>) -> ChunkWork {
        let began = Instant::now();
        let inputs = ChunkInputs::upload(&self.gpu, &mut self.targets, chunk, batch);
        let first = chunk.pieces.first().map(|piece| batch.view(piece));
        let (side, linear) = first.map_or((1, false), |view| (view.side, view.linear));
        let sub_pixels = linear.then_some(side);
        let targets =
            ChunkTargets::take(&mut self.targets, &self.gpu, chunk.size, sub_pixels, inputs.outputs);
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

    /// Records the times of the chunk's searches for autotuning.
    fn note_times(&mut self, chunk: &Chunk, inputs: &ChunkInputs, stages: &[Stage]) {
        let searches: BTreeSet<Search> = inputs.draws.keys().map(|(search, _)| *search).collect();
        for search in searches {
            let name = search_pipelines::name(search);
            let Some(stage) = stages.iter().find(|stage| stage.name == name) else { continue };
            let tuning = self.autotune.entry(search).or_default();
            let search_backend = tuning.next(self.settings.search_backend);
            if let Some(search_backend) =
                tuning.note(search_backend, stage.ms, inputs.sub_pixels(search, chunk))
            {
                tracing::info!(search = search.name(), ?search_backend, "the faster program on this device");
            }
        }
    }
}

impl Compositor for GpuCompositor {
    fn device(&self) -> &str {
        self.gpu.kind()
    }

    fn hold(&mut self, set: &SampleSet) -> Result<(), RenderError> {
        let Self { gpu, bounds, mips, settings, sample_store, .. } = self;
        sample_store.hold(&UploadContext { gpu, bounds, mips, settings }, set, &|| false).map(drop)
    }

    fn hold_slice(&mut self, set: &SampleSet) -> Result<bool, RenderError> {
        let Self { gpu, bounds, mips, settings, sample_store, .. } = self;
        let began = Instant::now();
        sample_store.hold(&UploadContext { gpu, bounds, mips, settings }, set, &|| {
            milliseconds(began) >= settings.slice_ms
        })
    }

    fn release(&mut self, ids: &[SampleId]) {
        self.sample_store.release(ids);
        self.sample_store.trim();
    }

    fn compose(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>> {
        if views.iter().any(|view| view.outputs.has(Output::Radiance)) {
            return radiance::joined(views, self.compose_alike(&radiance::apart(views), cancel));
        }
        self.compose_alike(views, cancel)
    }

    /// Composes the view with every pipeline that similar views may need: both programs of its search unless one is
    /// fixed, with and without interpolation between mip levels.
    fn ready(&mut self, view: &ViewJob, between: &mut dyn FnMut()) -> Result<(), RenderError> {
        let chosen = self.settings.search_backend;
        let backends = if chosen == SearchBackend::Auto {
            vec![SearchBackend::Fragment, SearchBackend::Compute]
        } else {
            vec![chosen]
        };
        let mut done = Ok(());
        for (search_backend, between_levels) in
            backends.into_iter().flat_map(|search_backend| [(search_backend, false), (search_backend, true)])
        {
            self.settings.search_backend = search_backend;
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
        self.settings.search_backend = chosen;
        done
    }
}

/// A LightVisibility plane of one texel that sees all light.
fn all_light_seen(gpu: &Gpu) -> wgpu::TextureView {
    let size = wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 };
    let descriptor = wgpu::TextureDescriptor {
        label: Some("all light is seen"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let layout = wgpu::util::TextureDataOrder::LayerMajor;
    let texture = gpu.device.create_texture_with_data(&gpu.queue, &descriptor, layout, &[255; 4]);
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}
