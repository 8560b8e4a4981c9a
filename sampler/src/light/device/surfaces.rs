//! The light of emitters and of other surfaces on the device: by rays, or from light cells.

use argus_gpu::Gpu;
use argus_scene::RenderError;

use super::super::cells::{ALONE_RAYS, Asking, DeviceLookup, Eye};
use super::super::filter::{REACH_OF_CELLS, REACHES};
use super::super::path_light::PathLight;
use super::super::pattern::{SLOTS, disc_points};
use super::super::tracing::LightTracing;
use super::{DeviceLight, LitTile, Programs};
use crate::LightSettings;
use crate::frame::{Footprint, Frame};
use crate::lit_cells::{CellOutcome, MOST_LACKING};
use crate::passes::{
    AloneLight, AloneRays, EmitterRays, GatherRays, LookUpCells, SkyFrom, SmoothTexels, smooth_cells,
};

/// Most rays of a gathering texel: `PathSettings::gather`.
const MOST_GATHER: usize = 256;
/// Most times that cells are filled for a tile. Each fills thousands of corners.
const MOST_FILLS: usize = 256;

impl Programs {
    fn smooth(&self, gpu: &Gpu) -> &SmoothTexels {
        self.smooth.get_or_init(|| SmoothTexels::new(gpu, &REACHES))
    }

    fn smooth_cells(&self, gpu: &Gpu) -> &SmoothTexels {
        self.smooth_cells.get_or_init(|| SmoothTexels::of_every_texel(gpu, REACH_OF_CELLS))
    }

    fn emitters(&self, gpu: &Gpu) -> &EmitterRays {
        self.emitters.get_or_init(|| EmitterRays::new(gpu))
    }

    fn gather(&self, gpu: &Gpu) -> &GatherRays {
        self.gather.get_or_init(|| GatherRays::new(gpu, &disc_points(SLOTS * MOST_GATHER)))
    }

    fn cells(&self, gpu: &Gpu, has_across: bool) -> &LookUpCells {
        self.cells[usize::from(has_across)].get_or_init(|| LookUpCells::new(gpu, has_across))
    }

    fn alone(&self, gpu: &Gpu) -> &AloneRays {
        let points = || disc_points(SLOTS * ALONE_RAYS);
        self.alone.get_or_init(|| AloneRays::new(gpu, self.features, ALONE_RAYS as u32, &points()))
    }
}

impl DeviceLight {
    /// Records the light of emitting triangles.
    pub(in crate::light) fn trace_emitters(
        &self,
        frame: &mut Frame<'_>,
        tile: &mut LitTile,
        tracing: &LightTracing,
        settings: LightSettings,
    ) {
        if !tracing.emitters.any() {
            return;
        }
        let (gpu, programs) = (frame.context.gpu, &self.programs);
        let points = tracing.emitters.points(frame.context.eye.position, settings);
        let smooth = settings.filter.then(|| programs.smooth(gpu));
        let (texels, rays) = (&tile.texels, settings.emitter_rays);
        let commands = &mut frame.commands;
        programs.emitters(gpu).record(commands, texels, self.tracing(tile), &points, rays, smooth);
        tile.parts.emitters = true;
    }

    /// Records the light of other surfaces by so many rays, unless it was looked up.
    pub(in crate::light) fn gather_paths(&self, frame: &mut Frame<'_>, tile: &mut LitTile, rays: u32) {
        let Some(leaves) = tile.leaves.as_ref().filter(|_| !tile.parts.surfaces && rays > 0) else { return };
        let (gpu, programs) = (frame.context.gpu, &self.programs);
        let leaves = leaves.about(gpu, frame.context.eye.position);
        let (tracing, smooth) = (self.tracing(tile), programs.smooth(gpu));
        programs.gather(gpu).record(&mut frame.commands, &tile.texels, tracing, &leaves, rays, smooth);
        tile.parts.surfaces = true;
    }

    /// Records the lookup of light cells, unless rays light the job. What was found is read with the finished image if that may wait
    /// and cells are expected to be whole; else at once, and cells that lack are filled.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if cells are larger than the device can bind, or the errors of the device.
    pub(in crate::light) fn look_up_cells(
        &self,
        frame: &mut Frame<'_>,
        tile: &mut LitTile,
        tracing: &LightTracing,
        paths: &PathLight,
    ) -> Result<(), RenderError> {
        let may_wait = frame.may_wait && paths.expects_whole_cells();
        for _ in 0..MOST_FILLS {
            let Some(lookup) = self.survey(frame, tile, tracing, paths)? else { return Ok(()) };
            if may_wait {
                self.record_lookup(frame, tile, tracing, &lookup);
                frame.outcome = Some(lookup.cells.outcome.clone());
                paths.await_outcome(lookup);
                return Ok(());
            }
            let outcome = read_outcome(frame, &lookup)?;
            if paths.take(&lookup, &outcome) {
                self.record_lookup(frame, tile, tracing, &lookup);
                return Ok(());
            }
            let lacking = read_lacking(frame, &lookup, &outcome)?;
            if !paths.fill_lacking(tracing, &lookup, &outcome, &lacking) {
                return Ok(());
            }
        }
        Err(RenderError::Internal("light cells lack after they were filled".to_owned()))
    }

    /// Records what finds the cells of a tile; `None` if rays light the job.
    fn survey(
        &self,
        frame: &mut Frame<'_>,
        tile: &LitTile,
        tracing: &LightTracing,
        paths: &PathLight,
    ) -> Result<Option<DeviceLookup>, RenderError> {
        let (gpu, position) = (frame.context.gpu, frame.context.eye.position);
        let about = &tracing.rays.about(position);
        let (pixel, reflected) = (frame.context.tile.pixel_angle(), frame.footprint != Footprint::Pixels);
        let eye = Eye { position, about, pixel, reflected, trail: None };
        let texels = &tile.texels;
        let across = match &frame.footprint {
            Footprint::Pixels => Vec::new(),
            Footprint::Equal(side) => vec![*side; texels.count as usize],
            Footprint::Areas(sides) => sides.clone(),
        };
        let lookup =
            paths.begin_on_device(tracing, eye, gpu, Asking { texels: texels.count, across: &across })?;
        if let Some(lookup) = &lookup {
            self.programs.cells(gpu, reflected).survey(&mut frame.commands, texels, &lookup.cells);
        }
        Ok(lookup)
    }

    /// Records the lookup in what a survey found, the rays of texels that no cells describe, and the filter over both.
    fn record_lookup(
        &self,
        frame: &mut Frame<'_>,
        tile: &mut LitTile,
        tracing: &LightTracing,
        lookup: &DeviceLookup,
    ) {
        let Some(leaves) = &tile.leaves else { return };
        let (gpu, programs) = (frame.context.gpu, &self.programs);
        let has_across = frame.footprint != Footprint::Pixels;
        let Frame { commands, context, .. } = frame;
        let (texels, rays) = (&tile.texels, self.tracing(tile));
        programs.cells(gpu, has_across).look_up(commands, texels, &lookup.cells);
        let leaves = leaves.about(gpu, context.eye.position);
        let reach = tracing.lighting.sky.reach.map_or(f32::MAX, |reach| reach as f32);
        let smooth = programs.smooth(gpu);
        let by = AloneLight { tracing: rays, leaves: &leaves, reach };
        programs.alone(gpu).record(commands, context, texels, by, smooth);
        // What reflections show has no neighbours in the image.
        if !has_across {
            smooth_cells(commands, texels, programs.smooth_cells(gpu));
        }
        (tile.parts.sky, tile.parts.surfaces) = (SkyFrom::Cells, true);
    }
}

/// Reads back what a device found of cells.
fn read_outcome(frame: &mut Frame<'_>, lookup: &DeviceLookup) -> Result<CellOutcome, RenderError> {
    let outcome = &lookup.cells.outcome;
    let [bytes] = frame.read_back([(outcome, outcome.size())], "add direct light")?;
    CellOutcome::new(&bytes).ok_or_else(|| RenderError::Internal("an outcome lacks bytes".to_owned()))
}

/// Reads back the numbers of corners that lack.
fn read_lacking(
    frame: &mut Frame<'_>,
    lookup: &DeviceLookup,
    outcome: &CellOutcome,
) -> Result<Vec<u64>, RenderError> {
    let bytes = u64::from(outcome.lacking.min(MOST_LACKING)) * 8;
    if bytes == 0 {
        return Ok(Vec::new());
    }
    let [bytes] = frame.read_back([(&lookup.cells.lacking, bytes)], "add direct light")?;
    Ok(bytes.as_chunks::<8>().0.iter().map(|number| u64::from_le_bytes(*number)).collect())
}
