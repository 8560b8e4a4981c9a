//! Prepares views: their samples, transforms and uniforms, computed in f64.

mod on_host;

use std::sync::Arc;

use argus_gpu::{EnvironmentTexture, ReflectionProbes};
use argus_scene::camera::Face;
use argus_scene::{FaceMask, InvalidField, Output, Plan, RenderError, SampleId, Search, ViewJob, Warp};
use argus_shaders::layout::compositor::{
    CellProjection, Fill, MAX_SAMPLES, Reproject, Splat, ViewSample, ViewUniform,
};
use bytemuck::Zeroable;
use glam::DVec2;

use crate::arrays::PoolClass;
use crate::cull::{VisibleTile, cell_size, push_blocks, spacings, visible_tiles};
use crate::draw_batch::SplatCall;
use crate::geometry::{PixelFromFace, ViewGeometry, bounds_about, view_sample};
use crate::layout::{Piece, Rect};
use crate::lights::lighting_uniform;
use crate::reprojection::Reprojection;
use crate::sample_store::{HeldSample, SampleStore};
use crate::settings::CompositorSettings;

/// One view of a batch.
#[derive(Debug)]
pub(crate) struct PreparedView {
    /// Index of its job in the batch.
    pub(crate) job: usize,
    pub(crate) search: Search,
    pub(crate) side: u32,
    /// Whether sub-pixels are drawn as linear radiance: where there are several, or radiance itself is asked for.
    pub(crate) linear: bool,
    pub(crate) samples: Vec<Arc<HeldSample>>,
    /// The faces that are used of each sample. Directions in other faces are not seen by it.
    masks: Vec<FaceMask>,
    pub(crate) pool: usize,
    /// Whether it is computed on the processor: from frames that are in memory alone, or that differ in size.
    pub(crate) on_host: bool,
    pub(crate) omni: bool,
    pub(crate) glossy: bool,
    /// Reflection probes that the samples look up.
    pub(crate) probes: Option<(SampleId, Arc<ReflectionProbes>)>,
    /// The environment map that the samples were shaded with.
    pub(crate) environment: Option<Arc<EnvironmentTexture>>,
    /// Coarsest mip level of the samples whose texels are no larger than most sub-pixels.
    pub(crate) level: u32,
    /// Whether the warp interpolates between that level and the next coarser one.
    pub(crate) between_levels: bool,
    geometry: ViewGeometry,
    steps: u32,
    /// Sub-pixels along the edge of a cell.
    pub(crate) cell: u32,
    sources: Vec<SplatSource>,
    /// The earlier frame that its search starts from in place of a splat, or why there is none.
    pub(crate) reprojection: Result<Reprojection, &'static str>,
}

/// Most texels of a level along the edge of a pixel for which that level is used alone: `fetch_from` in
/// `shaders/shared/fetch.wgsl`.
const LEVEL_TEXELS: f64 = 0.707;

/// A pixel is unresolved if its texel covers more pixels than this to a side and lies at a surface's edge. The edge is known to
/// half a texel.
const COARSE_EDGE: f32 = 4.0;

/// A pixel is unresolved if its texel covers more pixels than this to a side.
const COARSE: f32 = 16.0;

/// Cells of a splat that seeds a search are this many times larger than those of the splat search.
const SEED_CELL_FACTOR: u32 = 4;

/// Mip level of texels that are so many pixels apart; it has a fraction.
fn level_of(spacing: f64) -> f64 {
    (LEVEL_TEXELS / spacing.max(1e-6)).log2().max(0.0)
}

/// A face that a view is splatted from.
#[derive(Debug)]
struct SplatSource {
    sample: usize,
    face: usize,
    pixel_from_face: PixelFromFace,
    tiles: Vec<VisibleTile>,
}

impl PreparedView {
    /// Looks up a job's samples and culls their tiles.
    ///
    /// # Errors
    /// [`RenderError::MissingSample`], or [`RenderError::Invalid`] for a plan that no compositor can follow.
    pub(crate) fn new(
        index: usize,
        job: &ViewJob,
        sample_store: &SampleStore,
        settings: &CompositorSettings,
    ) -> Result<Self, RenderError> {
        let Plan::Warp(Warp { search, steps, supersampling, samples, faces, .. }) = &job.plan else {
            return Err(InvalidField::new("plan", "a compositor has no triangles to render directly").into());
        };
        let within = |field, value: usize, most| InvalidField::within(field, value, 1..=most);
        let (of_probes, of_rig): (Vec<SampleId>, Vec<SampleId>) =
            samples.iter().copied().partition(SampleId::is_reflection_probe);
        within("plan.samples", of_rig.len(), MAX_SAMPLES)?;
        within("plan.supersampling", *supersampling as usize, 8)?;
        if search.takes_steps() {
            within("plan.steps", *steps as usize, 4096)?;
        }
        job.camera.validate()?;
        within("width", job.width as usize, 1 << 16)?;
        within("height", job.height as usize, 1 << 16)?;
        if faces.partial().any(|(_, mask)| mask.is_empty()) {
            return Err(InvalidField::new("plan.faces", "must name at least one face of a sample").into());
        }
        let samples = sample_store.of_plan(&of_rig, faces)?;
        let used = |held: &Arc<HeldSample>, id: &SampleId| faces.of(id.camera).of_camera(&held.camera);
        let masks = samples.iter().zip(&of_rig).map(|(held, id)| used(held, id)).collect();
        let pool = samples.first().map_or(0, |held| held.pool);
        let on_host = sample_store.serves_on_host(*search, &samples);
        if !on_host && samples.iter().any(|held| held.pool != pool) {
            let reason = "samples of one plan must be of one size and format, unless they are frames that are splatted";
            return Err(InvalidField::new("plan.samples", reason).into());
        }
        // Frames have colour and range alone.
        let class = if on_host { None } else { Some(sample_store.pool(pool)?.class) };
        let is = |of: fn(&PoolClass) -> bool| class.as_ref().is_some_and(of);
        // Samples without a Reflector plane look up no probes.
        let of_probes = of_probes.first().filter(|_| is(|class| class.reflects));
        let probes = of_probes.map(|&id| Ok::<_, RenderError>((id, sample_store.probes(id)?))).transpose()?;
        let environment = samples.first().and_then(|held| sample_store.environment(&held.info));
        let geometry = ViewGeometry::new(&job.camera, job.width, job.height, *supersampling);
        let mut view = Self {
            job: index,
            search: *search,
            side: *supersampling,
            linear: *supersampling > 1 || job.outputs.has(Output::Radiance),
            samples,
            masks,
            pool,
            on_host,
            omni: is(|class| class.omni),
            glossy: is(|class| class.glossy),
            probes,
            environment,
            level: 0,
            between_levels: false,
            geometry,
            steps: *steps,
            cell: 1,
            sources: Vec::new(),
            reprojection: Err("the search begins nowhere"),
        };
        if view.search == Search::Seeded {
            let history = job.history.as_ref().ok_or("no earlier frame is at hand");
            let reprojection =
                |history| Reprojection::new(history, &view.geometry, &of_rig, settings.max_reprojections);
            view.reprojection = history.and_then(reprojection);
        }
        match &view.reprojection {
            Ok(reprojection) => view.cell = cell_size(reprojection.spacing(), view.geometry.size),
            Err(_) if view.splats_first() => view.find_sources(settings.splat_samples),
            Err(_) => {}
        }
        Ok(view)
    }

    fn find_sources(&mut self, splat_samples: usize) {
        for (sample, held) in self.samples.iter().enumerate().take(splat_samples.max(1)) {
            for (face, (pinhole, tiles)) in held.faces.iter().zip(&held.tiles).enumerate() {
                if !self.masks[sample].has(face) {
                    continue;
                }
                let pixel_from_face = self.geometry.pixel_from_face(held.camera.center(), pinhole);
                let tiles = visible_tiles(&self.geometry, pinhole, &pixel_from_face, tiles);
                if !tiles.is_empty() {
                    self.sources.push(SplatSource { sample, face, pixel_from_face, tiles });
                }
            }
        }
        let tiles = self.sources.iter().flat_map(|source| &source.tiles);
        let [dense, spacing] = spacings(tiles, self.geometry.size);
        let coarser = if self.search == Search::Seeded { SEED_CELL_FACTOR } else { 1 };
        self.cell = cell_size(spacing, self.geometry.size).saturating_mul(coarser);
        self.level = level_of(spacing) as u32;
        self.between_levels = self.search == Search::Splat && level_of(dense) > f64::from(self.level);
    }

    /// Factor from linear radiance to display-linear.
    pub(crate) fn exposure(&self) -> f32 {
        self.samples.first().map_or(1.0, |sample| sample.info.lighting.exposure)
    }

    /// Whether its search starts from cells.
    pub(crate) fn splats_first(&self) -> bool {
        matches!(self.search, Search::Splat | Search::Seeded)
    }

    /// The cells that a part of the view needs: those of its sub-pixels, and one more on every side for the fill pass.
    fn cells_of(&self, part: Rect) -> CellRect {
        let (side, cell) = (self.side, self.cell);
        let span = |at: u32, length: u32| {
            let first = (at * side / cell) as i32 - 1;
            let last = (((at + length) * side - 1) / cell) as i32 + 1;
            (first, last - first + 1)
        };
        let (first_column, columns) = span(part.x, part.width);
        let (first_row, rows) = span(part.y, part.height);
        CellRect { first_column, first_row, columns, rows }
    }

    /// The uniforms of a piece.
    pub(crate) fn uniform(&self, piece: &Piece, first: &ChunkOffsets) -> ViewUniform {
        let [corner, right, down] = self.geometry.directions().map(|d| d.as_vec3().to_array());
        let held = self.samples.first();
        let eye = self.geometry.eye;
        let bounds = held.map(|held| bounds_about(&held.info.bounds, eye)).unwrap_or_default();
        let extent = held.map(|held| bounds_about(&held.info.extent, eye)).unwrap_or_default();
        // In sub-pixels.
        let [coarse_edge, coarse] = [COARSE_EDGE, COARSE].map(|pixels| pixels * self.side as f32);
        let cells = self.cells_of(piece.part);
        let mut samples = [ViewSample::zeroed(); MAX_SAMPLES];
        for ((slot, held), mask) in samples.iter_mut().zip(&self.samples).zip(&self.masks) {
            *slot = view_sample(self.geometry.eye, &held.camera, &held.faces[0], (held.layer, *mask));
        }
        let side = piece.side;
        ViewUniform {
            corner,
            sample_count: self.samples.len() as u32,
            right,
            steps: self.steps,
            down,
            first_light: first.light,
            bounds_min: bounds[0],
            cell: self.cell as f32,
            bounds_max: bounds[1],
            first_cell: first.cell,
            forward: self.geometry.forward().as_vec3().to_array(),
            tolerance: self.tolerance(),
            piece_origin: [(piece.part.x * side) as f32, (piece.part.y * side) as f32],
            target_origin: piece.fine_target().map(|at| at as f32),
            cell_origin: [cells.first_column, cells.first_row],
            cell_columns: cells.columns,
            first_unsettled: first.unsettled,
            piece: first.piece,
            footprint: self.footprint(),
            piece_size: piece.fine_size(),
            extent_min: extent[0],
            coarse_edge,
            extent_max: extent[1],
            coarse,
            lighting: held.map_or(Zeroable::zeroed(), |held| lighting_uniform(&held.info.lighting)),
            probes: self
                .probes
                .as_ref()
                .map_or(Zeroable::zeroed(), |(_, probes)| probes.uniform(self.geometry.eye)),
            samples,
            _pad: [0.0; 32],
        }
    }

    /// Relative difference of range within which a texel belongs to the surface at a depth. It is 1% plus the change of a
    /// surface at 45° over one cell and one texel, at most 10%.
    fn tolerance(&self) -> f32 {
        let cell = f64::from(self.cell) * self.geometry.pixel_at_unit_depth().max_element();
        let texel = |face: &Face| {
            2.0 * (face.tan_half_fov.x / f64::from(face.size[0]))
                .max(face.tan_half_fov.y / f64::from(face.size[1]))
        };
        let texel = self.samples.first().and_then(|held| held.faces.first()).map_or(0.0, texel);
        (0.01 + cell + texel).min(0.1) as f32
    }

    /// Texels of the nearest sample along the edge of a sub-pixel, at equal distance from both cameras.
    fn footprint(&self) -> f32 {
        self.samples.first().map_or(1.0, |held| self.footprint_in(held))
    }

    /// Texels of a sample along the edge of a sub-pixel, at equal distance from both cameras.
    fn footprint_in(&self, held: &HeldSample) -> f32 {
        let face = held.faces.first();
        let texel = |face: &Face| face.texel().min_element();
        // The shorter edges of both, because blur is worse than slight aliasing.
        face.map_or(1.0, |face| (self.geometry.pixel_at_unit_depth().min_element() / texel(face)) as f32)
    }

    /// Number of cells of a piece; 0 for a search without cells.
    pub(crate) fn cell_count(&self, piece: &Piece) -> u32 {
        if !self.splats_first() {
            return 0;
        }
        let cells = self.cells_of(piece.part);
        (cells.columns * cells.rows) as u32
    }

    /// The fill of a piece.
    pub(crate) fn fill(&self, piece: &Piece, first_cell: u32) -> Fill {
        let cells = self.cells_of(piece.part);
        Fill { first_cell, columns: cells.columns, rows: cells.rows }
    }

    /// The reprojection of an earlier frame into a piece, if there is one. Its pixels are appended to `words`.
    pub(crate) fn reproject(
        &self,
        piece: &Piece,
        first_cell: u32,
        words: &mut Vec<u32>,
    ) -> Option<Reproject> {
        let reprojection = self.reprojection.as_ref().ok()?;
        Some(reprojection.call(self.cells_of(piece.part).projection(first_cell), self.cell, words))
    }

    /// The splats of a piece. Their blocks are appended to `blocks`.
    pub(crate) fn splats(&self, piece: &Piece, first_cell: u32, blocks: &mut Vec<u32>) -> Vec<SplatCall> {
        let cells = self.cells_of(piece.part);
        let cell = f64::from(self.cell);
        let from = DVec2::new(f64::from(cells.first_column), f64::from(cells.first_row)) * cell;
        let to = from + DVec2::new(f64::from(cells.columns), f64::from(cells.rows)) * cell;
        let mut calls = Vec::with_capacity(self.sources.len());
        for source in &self.sources {
            let held = &self.samples[source.sample];
            let face = &held.faces[source.face];
            let (scale, bias) = (face.texel(), face.top_left());
            let projection =
                source.pixel_from_face.projection(cells.projection(first_cell), self.cell, scale, bias);
            for sparse in [false, true] {
                let first_block = blocks.len() as u32;
                let block_count = push_blocks(&source.tiles, sparse, [from, to], self.cell, face, blocks);
                if block_count == 0 {
                    continue;
                }
                let splat = Splat {
                    projection,
                    face_offset: face.offset,
                    face_size: face.size,
                    layer: held.layer,
                    first_block,
                    source: source.sample as u32,
                    _pad: 0,
                };
                calls.push(SplatCall { splat, block_count, sparse });
            }
        }
        calls
    }
}

/// Offsets of a piece in the chunk's buffers, in elements.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ChunkOffsets {
    /// Index of the piece in the chunk.
    pub(crate) piece: u32,
    pub(crate) cell: u32,
    pub(crate) light: u32,
    pub(crate) unsettled: u32,
}

/// A rectangle of a view's cells.
#[derive(Debug, Clone, Copy)]
struct CellRect {
    first_column: i32,
    first_row: i32,
    columns: i32,
    rows: i32,
}

impl CellRect {
    /// The projection into these cells, whose first index is `first_cell`. The fields of the image are zero.
    fn projection(&self, first_cell: u32) -> CellProjection {
        CellProjection {
            first_cell,
            cell_columns: self.columns,
            cell_rows: self.rows,
            origin_column: self.first_column,
            origin_row: self.first_row,
            ..CellProjection::zeroed()
        }
    }
}
