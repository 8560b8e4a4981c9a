//! One chunk: what its passes read, on the device, and which pieces each pass draws.

use std::collections::BTreeMap;
use std::sync::Arc;

use argus_gpu::wgpu::BufferUsages;
use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::{Output, Outputs, RenderError, Search, ViewJob};
use argus_shaders::layout::compositor::{Fill, Reproject, ViewUniform};
use argus_shaders::layout::shared::Light;
use bytemuck::Zeroable as _;

use crate::batch::Batch;
use crate::draw_batch::{FixedBindings, PieceDraw, SharedBindings, SplatBuffers, SplatCall, Variant};
use crate::layout::{Chunk, Piece};
use crate::lights::light_about;
use crate::passes::second_pass::COUNTER_WORDS;
use crate::prepare::{ChunkOffsets, PreparedView};
use crate::sample_store::SampleStore;
use crate::targets::TargetPool;

/// Everything that the passes of a chunk read.
#[derive(Debug)]
pub(crate) struct ChunkInputs {
    /// A [`ViewUniform`] a piece.
    views: wgpu::Buffer,
    lights: wgpu::Buffer,
    pub(crate) blocks: wgpu::Buffer,
    pub(crate) splat: SplatBuffers,
    cell_bytes: u64,
    pub(crate) splats: Vec<SplatCall>,
    /// Pieces that start from an earlier frame.
    pub(crate) reprojects: Vec<Reproject>,
    /// Pixels of those frames.
    pub(crate) words: wgpu::Buffer,
    /// By index of the piece, for searches that splat.
    fills: BTreeMap<usize, Fill>,
    /// Indices of the pieces of each pipeline.
    pub(crate) draws: BTreeMap<(Search, Variant), Vec<usize>>,
    pub(crate) outputs: Outputs,
}

/// Distance of the pieces' uniforms in their buffer, bytes.
const VIEW_STRIDE: u64 = size_of::<ViewUniform>() as u64;
// The largest alignment that a device may ask for.
const _: () = assert!(VIEW_STRIDE.is_multiple_of(256));

impl ChunkInputs {
    /// Computes and uploads the inputs of a chunk.
    pub(crate) fn upload(gpu: &Gpu, pool: &mut TargetPool, chunk: &Chunk, batch: &Batch<'_>) -> Self {
        let mut uniforms: Vec<ViewUniform> = Vec::with_capacity(chunk.pieces.len());
        let (mut lights, mut blocks, mut words) = (Vec::new(), Vec::new(), Vec::new());
        let (mut splats, mut reprojects, mut fills) = (Vec::new(), Vec::new(), BTreeMap::new());
        let mut draws: BTreeMap<(Search, Variant), Vec<usize>> = BTreeMap::new();
        let mut outputs = Outputs::NONE;
        let mut first = ChunkOffsets::default();
        for (i, piece) in chunk.pieces.iter().enumerate() {
            let (view, job) = (batch.view(piece), batch.job(piece));
            (first.piece, first.light) = (i as u32, lights.len() as u32);
            uniforms.push(view.uniform(piece, &first));
            if let Some(held) = view.samples.first().filter(|_| view.glossy) {
                let lighting = &held.info.lighting;
                let bytes = lighting.visibility_bytes();
                let about = |(light, byte)| light_about(light, byte, job.camera.eye);
                lights.extend(lighting.lights.iter().zip(bytes).map(about));
            }
            if view.splats_first() {
                splats.append(&mut view.splats(piece, first.cell, &mut blocks));
                reprojects.extend(view.reproject(piece, first.cell, &mut words));
                fills.insert(i, view.fill(piece, first.cell));
                first.cell += view.cell_count(piece);
                first.unsettled +=
                    piece.part.width * piece.part.height * piece.side * piece.side + COUNTER_WORDS;
            }
            outputs = outputs.union(job.outputs);
            draws.entry((view.search, variant(view, job))).or_default().push(i);
        }
        if lights.is_empty() {
            // All programs bind lights and those for glossy samples read them. An empty array cannot be bound.
            lights.push(Light::zeroed());
        }
        let mut upload = |label, bytes: &[u8], usage| {
            let buffer = pool.buffer(gpu, label, bytes.len() as u64, usage);
            gpu.write(&buffer, bytes);
            buffer
        };
        let views = upload("views", bytemuck::cast_slice(&uniforms), BufferUsages::UNIFORM);
        let lights = upload("lights", bytemuck::cast_slice(&lights), BufferUsages::STORAGE);
        let blocks = upload("blocks", bytemuck::cast_slice(&blocks), BufferUsages::STORAGE);
        let words = upload("words", bytemuck::cast_slice(&words), BufferUsages::STORAGE);
        let cell_bytes = u64::from(first.cell) * 4;
        let mut scratch = |label, bytes: u64| pool.buffer(gpu, label, bytes, BufferUsages::STORAGE);
        let splat = SplatBuffers {
            cells: scratch("cells", cell_bytes),
            depths: scratch("depths", cell_bytes),
            unsettled: scratch("unsettled", u64::from(first.unsettled) * 4),
        };
        Self { views, lights, blocks, splat, cell_bytes, splats, reprojects, words, fills, draws, outputs }
    }

    /// Whether a search of the chunk starts from splatted depths.
    pub(crate) fn has_cells(&self) -> bool {
        !self.fills.is_empty()
    }

    /// Clears all cells to 0, which is infinitely far.
    pub(crate) fn clear_cells(&self, commands: &mut Commands) {
        commands.encoder().clear_buffer(&self.splat.cells, 0, Some(self.cell_bytes));
    }

    /// The fill of each piece that has cells.
    pub(crate) fn fills(&self) -> impl Iterator<Item = Fill> {
        self.fills.values().copied()
    }

    /// The bindings of a chunk, whose pieces have one pool, one set of reflection probes and one environment map.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if the samples of its views are not held.
    pub(crate) fn bindings<'a>(
        &'a self,
        sample_store: &'a SampleStore,
        fixed: &'a FixedBindings,
        chunk: &Chunk,
        batch: &'a Batch<'_>,
    ) -> Result<SharedBindings<'a>, RenderError> {
        let view = chunk.pieces.first().map(|piece| batch.view(piece));
        let pool = sample_store.pool(view.map_or(0, |view| view.pool))?;
        let probes = view.and_then(|view| view.probes.as_ref()).map(|(_, probes)| &**probes);
        let environment = view.and_then(|view| view.environment.as_deref());
        Ok(SharedBindings { pool, fixed, lights: &self.lights, probes, environment })
    }

    /// The pieces of one pipeline with their uniforms.
    pub(crate) fn pieces(&self, indices: &[usize], chunk: &Chunk, batch: &Batch<'_>) -> Vec<PieceDraw<'_>> {
        let draw = |&i: &usize| {
            let piece = chunk.pieces[i];
            let PreparedView { cell, level, .. } = *batch.view(&piece);
            let (offset, size) = (i as u64 * VIEW_STRIDE, wgpu::BufferSize::new(VIEW_STRIDE));
            let view = wgpu::BufferBinding { buffer: &self.views, offset, size };
            PieceDraw { piece, fill: self.fills.get(&i).copied(), cell, level, view }
        };
        indices.iter().map(draw).collect()
    }

    /// Sub-pixels that a search draws in this chunk.
    pub(crate) fn sub_pixels(&self, search: Search, chunk: &Chunk) -> u64 {
        let area = |piece: &Piece| piece.fine_size().iter().map(|&side| u64::from(side)).product::<u64>();
        let pieces = self.draws.iter().filter(|((of, _), _)| *of == search).flat_map(|(_, pieces)| pieces);
        pieces.map(|&i| area(&chunk.pieces[i])).sum()
    }
}

/// The pipeline variant of a view.
fn variant(view: &PreparedView, job: &ViewJob) -> Variant {
    let linear = view.linear;
    let confident = job.outputs.has(Output::Confidence);
    Variant {
        omni: view.omni,
        glossy: view.glossy,
        reflects: view.probes.is_some(),
        environment: view.environment.is_some(),
        linear,
        range: linear || confident || job.outputs.has(Output::Range),
        confident,
        between_levels: view.between_levels,
    }
}

/// Other work between the passes of a chunk.
pub(crate) struct Pauses<'a>(Option<(Arc<Gpu>, &'a mut dyn FnMut())>);

impl<'a> Pauses<'a> {
    /// No pauses: a chunk is one submission.
    pub(crate) fn none() -> Self {
        Self(None)
    }

    /// Runs `between` after each pass.
    pub(crate) fn with(gpu: &Arc<Gpu>, between: &'a mut dyn FnMut()) -> Self {
        Self(Some((Arc::clone(gpu), between)))
    }

    /// Completes the recorded passes and runs the other work, if there is any.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn pause(&mut self, commands: &mut Commands) -> Result<(), RenderError> {
        let Some((gpu, between)) = &mut self.0 else { return Ok(()) };
        std::mem::replace(commands, gpu.commands("compose views")).submit().wait()?;
        between();
        Ok(())
    }
}
