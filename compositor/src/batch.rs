//! One batch: its prepared views, and the frames that their pieces are assembled into.

use std::collections::BTreeMap;
use std::time::Instant;

use argus_scene::{Cancel, Frame, Provenance, RenderError, Stage, ViewJob};
use rayon::prelude::*;

use crate::frames::{ChunkImages, FrameAssembly};
use crate::layout::{Chunk, Piece, Rect, ViewExtent, chunks};
use crate::prepare::PreparedView;
use crate::settings::CompositorSettings;

/// The views of a batch that can be composed, and the errors of the others.
#[derive(Debug)]
pub(crate) struct Batch<'a> {
    pub(crate) jobs: &'a [ViewJob],
    pub(crate) views: Vec<PreparedView>,
    /// One a view.
    assemblies: Vec<FrameAssembly>,
    /// One a job; `None` for a job whose view is composed.
    errors: Vec<Option<RenderError>>,
    /// Milliseconds of the whole batch.
    stages: Vec<Stage>,
}

impl<'a> Batch<'a> {
    /// Prepares each job with `prepare`, which takes the job's index.
    pub(crate) fn new(
        jobs: &'a [ViewJob],
        mut prepare: impl FnMut(usize, &ViewJob) -> Result<PreparedView, RenderError>,
    ) -> Self {
        let began = Instant::now();
        let mut errors = vec![None; jobs.len()];
        let mut views = Vec::with_capacity(jobs.len());
        for (index, job) in jobs.iter().enumerate() {
            match prepare(index, job) {
                Ok(view) => views.push(view),
                Err(error) => errors[index] = Some(error),
            }
        }
        let assembly = |view: &PreparedView| {
            let ViewJob { width, height, outputs, .. } = jobs[view.job];
            FrameAssembly::new(width, height, outputs)
        };
        let assemblies = views.iter().map(assembly).collect();
        Self {
            jobs,
            views,
            assemblies,
            errors,
            stages: vec![Stage::new("prepare views", milliseconds(began))],
        }
    }

    /// The view of a piece.
    pub(crate) fn view(&self, piece: &Piece) -> &PreparedView {
        &self.views[piece.view]
    }

    /// The job of a piece.
    pub(crate) fn job(&self, piece: &Piece) -> &ViewJob {
        &self.jobs[self.view(piece).job]
    }

    /// Computes the views on the processor that are not for the device.
    pub(crate) fn compose_on_host(&mut self, cancel: &Cancel) {
        let own: Vec<usize> = (0..self.views.len()).filter(|index| self.views[*index].on_host).collect();
        if own.is_empty() {
            return;
        }
        let began = Instant::now();
        let compose = |index: &usize| {
            let view = &self.views[*index];
            match cancel.is_cancelled() {
                true => Err(RenderError::Cancelled),
                false => Ok(view.host_inputs(self.jobs[view.job].outputs)?.compose()),
            }
        };
        let composed: Vec<Result<ChunkImages, RenderError>> = own.par_iter().map(compose).collect();
        for (index, images) in own.into_iter().zip(composed) {
            let ViewJob { width, height, .. } = self.jobs[self.views[index].job];
            let part = Rect { x: 0, y: 0, width, height };
            let piece = Piece { view: index, part, target: [0, 0], side: self.views[index].side };
            let chunk = Chunk { pieces: vec![piece], size: [width, height] };
            let outcome = images.map(|images| self.add_pieces(&chunk, &images));
            self.end_chunk(&chunk, outcome.map(|()| Vec::new()));
        }
        self.add_stage(Stage::new("warp frames", milliseconds(began)));
    }

    /// The views for the device, cut into chunks.
    pub(crate) fn chunks(&self, settings: &CompositorSettings) -> Vec<Chunk> {
        let extent = |view: &PreparedView| {
            let ViewJob { width, height, .. } = self.jobs[view.job];
            let probes = view.probes.as_ref().map(|(id, _)| *id);
            let environment = view.environment.as_ref().and_then(|environment| environment.hash());
            let PreparedView { side, linear, pool, .. } = *view;
            ViewExtent { width, height, side, linear, pool, probes, environment }
        };
        let own: Vec<usize> = (0..self.views.len()).filter(|index| !self.views[*index].on_host).collect();
        let extents: Vec<ViewExtent> = own.iter().map(|index| extent(&self.views[*index])).collect();
        let mut chunks = chunks(&extents, settings);
        // Among all views of the batch.
        chunks.iter_mut().flat_map(|chunk| &mut chunk.pieces).for_each(|piece| piece.view = own[piece.view]);
        chunks
    }

    /// Adds the pieces of a chunk to their frames.
    pub(crate) fn add_pieces(&mut self, chunk: &Chunk, images: &ChunkImages) {
        for piece in &chunk.pieces {
            self.assemblies[piece.view].add(chunk, piece, images);
        }
    }

    /// Records how a chunk ended: the times of its stages, or the error of all its views.
    pub(crate) fn end_chunk(&mut self, chunk: &Chunk, outcome: Result<Vec<Stage>, RenderError>) {
        match outcome {
            Ok(stages) => stages.into_iter().for_each(|stage| self.add_stage(stage)),
            Err(error) => {
                for piece in &chunk.pieces {
                    self.errors[self.views[piece.view].job] = Some(error.clone());
                }
            }
        }
    }

    /// Adds a stage to the row of its name.
    fn add_stage(&mut self, stage: Stage) {
        match self.stages.iter_mut().find(|row| row.name == stage.name) {
            Some(row) => row.ms += stage.ms,
            None => self.stages.push(stage),
        }
    }

    /// One result a job. The batch's time is divided evenly among its views.
    pub(crate) fn finish(mut self, device: &str) -> Vec<Result<Frame, RenderError>> {
        let share = 1.0 / self.views.len().max(1) as f64;
        self.stages.iter_mut().for_each(|stage| stage.ms *= share);
        let mut frames: BTreeMap<usize, Frame> = BTreeMap::new();
        for (view, assembly) in self.views.iter().zip(self.assemblies) {
            if let Some(first) = view.samples.first() {
                let provenance = Provenance {
                    scene: first.info.scene,
                    state: first.info.version.state,
                    plan: self.jobs[view.job].plan.clone(),
                    specification: Some(first.info.specification()),
                    device: device.to_owned(),
                    history: view.reprojection.is_ok(),
                };
                frames.insert(view.job, assembly.finish(provenance, self.stages.clone()));
            }
        }
        let missing = || RenderError::Internal("a view was neither composed nor refused".to_owned());
        let result = |(job, error): (usize, Option<RenderError>)| match error {
            Some(error) => Err(error),
            None => frames.remove(&job).ok_or_else(missing),
        };
        self.errors.into_iter().enumerate().map(result).collect()
    }
}

/// Milliseconds since a moment.
pub(crate) fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
