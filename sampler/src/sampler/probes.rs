//! Reflection probes: prepared for shading, and returned as a sample of the set.

use std::time::{Duration, Instant};

use argus_gpu::Gpu;
use argus_scene::{
    Cancel, InvalidField, Lighting, ReflectionProbeSet, RenderError, Sample, SampleId, SampleJob, Stage,
};

use super::{GpuSampler, check_wanted};
use crate::passes::{ResolveSample, Shade, ShadeSample};
use crate::probe_renderer::{ProbeBindings, ProbePrograms, ProbeRenderer};
use crate::resident::{GuideUse, Resident};
use crate::{SamplerKnobs, timing};

/// Programs that shade and resolve surfaces, without and with reflection probes.
pub(super) struct SurfacePrograms {
    shade: Shade,
    shade_sample: ShadeSample,
    resolve: ResolveSample,
    /// Bound where surfaces look up no probes.
    nothing: ProbeBindings,
    /// Reflection probes and their programs, made when a job first asks for reflections.
    pub(super) probes: Option<Box<ProbeRenderer>>,
}

/// The programs of one job.
pub(super) struct SurfaceProgram<'a> {
    pub(super) shade: &'a Shade,
    pub(super) shade_sample: &'a ShadeSample,
    pub(super) resolve: &'a ResolveSample,
    pub(super) probe_bindings: &'a ProbeBindings,
}

impl SurfacePrograms {
    /// Programs without reflection probes.
    pub(super) fn new(gpu: &Gpu, resident: &Resident, knobs: &SamplerKnobs) -> Self {
        let (features, guides) = (resident.features, GuideUse::of(knobs));
        Self {
            shade: Shade::new(gpu, features, guides, false),
            shade_sample: ShadeSample::new(gpu, features, guides, false, knobs.side()),
            resolve: ResolveSample::new(gpu, features.specular, 1, false, knobs.effects.any()),
            nothing: ProbeBindings::none(gpu),
            probes: None,
        }
    }

    /// The programs for a job with those reflections, once their probes are made.
    pub(super) fn of(&self, reflections: Option<ReflectionProbeSet>) -> SurfaceProgram<'_> {
        let probes = self.probes.as_deref().filter(|_| reflections.is_some());
        match probes.and_then(|probes| Some((probes, probes.probe_bindings()?))) {
            Some((ProbeRenderer { shade, shade_sample, resolve, .. }, probe_bindings)) => {
                SurfaceProgram { shade, shade_sample, resolve, probe_bindings }
            }
            None => SurfaceProgram {
                shade: &self.shade,
                shade_sample: &self.shade_sample,
                resolve: &self.resolve,
                probe_bindings: &self.nothing,
            },
        }
    }
}

impl GpuSampler {
    /// Prepares the reflection probes, if the job asks for reflections. Returns the cost.
    pub(super) fn prepare_probes(
        &mut self,
        reflections: Option<ReflectionProbeSet>,
        lighting: &Lighting,
        time_secs: f64,
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        let Some(set) = reflections else { return Ok(Vec::new()) };
        let drifts = self.drifts();
        let mut probes = match self.surface_programs.probes.take().filter(|probes| probes.set == set) {
            Some(probes) => probes,
            None => Box::new(ProbeRenderer::new(&self.gpu, &self.scene, &self.resident, &self.knobs, set)?),
        };
        // Keeps the programs if the job was cancelled.
        let stages = match probes.is_made(lighting, time_secs, drifts) {
            true => Ok(Vec::new()),
            false => self.render_probes(&mut probes, lighting, time_secs, cancel),
        };
        self.surface_programs.probes = Some(probes);
        stages
    }

    fn render_probes(
        &mut self,
        probes: &mut ProbeRenderer,
        lighting: &Lighting,
        time_secs: f64,
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        check_wanted(cancel)?;
        let (gpu, at) = (self.gpu.clone(), (lighting, time_secs));
        let places = probes.places(&gpu, &self.scene, &self.resident, time_secs)?;
        let (side, mut stages) = (probes.set.knobs.side, Vec::new());
        let viewers = probes.set.eye;
        let (begin, bytes) = match &mut probes.source {
            ProbePrograms::Octree(from) => {
                let lit = self.light_octree(&mut from.octree, lighting, time_secs, cancel)?;
                stages.extend(lit.unwrap_or_default());
                let begin = Instant::now();
                (begin, from.render(&gpu, &self.resident, lighting, &places, side)?)
            }
            ProbePrograms::Points(from) => {
                let none = || InvalidField::new("reflections.viewpoints", "must be given for points");
                let viewers = viewers.ok_or_else(none)?;
                let begin = Instant::now();
                let bytes =
                    self.render_probe_points(from, &places, (&viewers, side), at, cancel, &mut stages)?;
                // What no stage of the points accounts for.
                (begin + stage_time(&stages), bytes)
            }
        };
        let made = probes.take_over(&gpu, (places, bytes), at, begin)?;
        timing::add(&mut stages, made);
        Ok(stages)
    }

    /// Renders a set's reflection probes as a sample.
    pub(super) fn render_probe_sample(
        &mut self,
        job: &SampleJob,
        id: SampleId,
        cancel: &Cancel,
    ) -> Result<Sample, RenderError> {
        self.check_job(job)?;
        // Fails if the set has no reflections.
        job.info.camera(id.camera)?;
        let (lighting, light) = (&job.info.lighting, job.info.version.state.light);
        let time_secs = job.info.time_secs();
        let mut stages = self.pose(time_secs)?;
        stages.extend(self.light(lighting, light, time_secs)?);
        stages.extend(self.prepare_probes(job.info.reflections, lighting, time_secs, cancel)?);
        let sample = self.surface_programs.probes.as_ref().and_then(|probes| probes.sample(id));
        let sample =
            sample.ok_or_else(|| RenderError::Internal("there are no reflection probes".to_owned()))?;
        Ok(Sample { stages, ..sample })
    }
}

/// The time of some stages.
fn stage_time(stages: &[Stage]) -> Duration {
    let ms: f64 = stages.iter().map(|stage| stage.ms).sum();
    Duration::try_from_secs_f64(ms * 1e-3).unwrap_or_default()
}
