//! The role of a sampler, as workers call it.

use std::sync::Arc;
use std::time::Duration;

use argus_scene::{
    Cancel, CellPages, CellReport, FaceMask, Frame, LightEffects, LightLevel, PixelJob, Pixels, RenderError,
    Sample, SampleJob, SampleSetInfo, Sampler, SceneState, ViewJob, Visibility,
};

use super::gpu_sampler::GpuSampler;
use super::ready_scene::BetweenTiles;
use crate::passes::TileContext;
use crate::scratch::Extras;
use crate::tile::sample_tiles;

impl Sampler for GpuSampler {
    fn device(&self) -> &str {
        self.gpu.kind()
    }

    fn usual_visibility(&self) -> Visibility {
        // On software drivers, packets were fastest at every size and scene that was measured.
        if self.gpu.is_software() { Visibility::Cpu } else { Visibility::Raster }
    }

    fn measure_backends(&mut self, info: &SampleSetInfo) -> Result<Vec<(Visibility, f64)>, RenderError> {
        self.check_alive()?;
        if self.gpu.is_software() {
            // Views would wait for a second until the same is measured again (`argus-lab study device visibility`).
            return Ok(vec![(self.usual_visibility(), 0.0)]);
        }
        let camera = info.rig.camera(0)?;
        let tiles = sample_tiles(&camera, self.settings.side())?;
        let Some(tile) = tiles.first() else { return Ok(vec![(Visibility::Raster, 0.0)]) };
        let eye = self.eye(camera.center(), &info.lighting)?;
        let (gpu, resident) = (&self.gpu, &self.resident);
        let context = TileContext::new(gpu, resident, &eye, tile, &mut self.scratch, Extras::default());
        self.visibility.measure(&context)
    }

    fn prepare_light(&mut self, info: &SampleSetInfo, light: LightLevel) -> Result<bool, RenderError> {
        self.prepare_level(info, light)
    }

    fn fill_light(&mut self, time: Duration, refines: bool) -> bool {
        self.fill_cells(time, refines)
    }

    fn light_cells(&self) -> Option<CellReport> {
        self.cell_report()
    }

    fn cell_pages(&self) -> Option<Arc<dyn CellPages>> {
        self.path_light()?.cell_pages()
    }

    fn unchanged_faces(
        &mut self,
        job: &SampleJob,
        earlier: (&Sample, SceneState),
        cancel: &Cancel,
    ) -> Result<FaceMask, RenderError> {
        self.unchanged_in(job, earlier, cancel)
    }

    fn render_samples(&mut self, job: &SampleJob, cancel: &Cancel) -> Vec<Result<Sample, RenderError>> {
        self.render_set(job, cancel, None)
    }

    fn render_samples_in_slices(
        &mut self,
        job: &SampleJob,
        cancel: &Cancel,
        between: BetweenTiles<'_>,
    ) -> Vec<Result<Sample, RenderError>> {
        self.render_set(job, cancel, Some(between))
    }

    fn render_views(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>> {
        views.iter().map(|view| self.render_view(view, cancel)).collect()
    }

    fn render_view_in_slices(
        &mut self,
        view: &ViewJob,
        cancel: &Cancel,
        between: BetweenTiles<'_>,
    ) -> Result<Frame, RenderError> {
        match view.band_rows > 0 && view.plan.is_whole() {
            true => self.render_all_pixels(view, cancel, Some(between)),
            false => self.render_view(view, cancel),
        }
    }

    fn render_with(&mut self, effects: LightEffects, view: &ViewJob) -> Option<Result<Frame, RenderError>> {
        self.render_with_effects(effects, view)
    }

    fn render_pixels(&mut self, jobs: &[PixelJob], cancel: &Cancel) -> Vec<Result<Pixels, RenderError>> {
        self.render_lists(jobs, cancel)
    }
}
