//! Samples that a method renders otherwise than from triangles.

use argus_scene::{Cancel, MegaViews, RenderError, Sample, SampleJob, Stage};

use super::gpu_sampler::{GpuSampler, Moment};
use crate::lit_scene::LitScene;
use crate::plug::SampleResults;
use crate::settings::missing;
use crate::timing;

impl GpuSampler {
    /// Renders samples of one set by the method that is plugged in.
    pub(super) fn render_by_method(
        &mut self,
        job: &SampleJob,
        settings: MegaViews,
        cancel: &Cancel,
    ) -> Vec<Result<Sample, RenderError>> {
        match self.try_by_method(job, settings, cancel) {
            Ok(Some(samples)) => samples,
            // A scene without surfaces is all sky; the triangle path renders it.
            Ok(None) => job.ids.iter().map(|&id| self.render_sample(job, id, cancel, None)).collect(),
            Err(error) => vec![Err(error); job.ids.len()],
        }
    }

    fn try_by_method(
        &mut self,
        job: &SampleJob,
        settings: MegaViews,
        cancel: &Cancel,
    ) -> Result<Option<SampleResults>, RenderError> {
        let stages = self.ready_for_method(job)?;
        let mut samples = match (self.samples.take(), &self.methods.samples) {
            (Some(samples), _) => samples,
            (None, Some(new)) => {
                let new = new.clone();
                new(&self.lit_scene(cancel), settings)
            }
            (None, None) => return Err(missing("sampling", job.info.sampling.name()).into()),
        };
        let rendered = samples.render(&mut self.lit_scene(cancel), job, settings, stages);
        self.samples = Some(samples);
        rendered
    }

    /// The posed and lit scene, for methods that render from it.
    pub(super) fn lit_scene<'a>(&'a mut self, cancel: &'a Cancel) -> LitScene<'a> {
        LitScene {
            gpu: &self.gpu,
            scene: &self.scene,
            resident: &self.resident,
            settings: &self.settings,
            lights: &mut self.lights,
            scratch: &mut self.scratch,
            cancel,
        }
    }

    /// Whether light changes with time in a static scene.
    pub(super) fn drifts(&self) -> bool {
        self.settings.indirect.drifts()
    }

    /// Poses and lights the scene of a set. Returns the cost.
    fn ready_for_method(&mut self, job: &SampleJob) -> Result<Vec<Stage>, RenderError> {
        self.check_job(job)?;
        let (lighting, light) = (&job.info.lighting, job.info.version.state.light);
        let time_secs = job.info.time_secs();
        let mut stages = self.pose(Moment::of(job.info.version.state, time_secs))?;
        timing::add(&mut stages, self.light(lighting, light, time_secs, false)?);
        self.begin_cells(self.cells_of_samples());
        Ok(stages)
    }
}
