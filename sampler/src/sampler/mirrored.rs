//! Maps of what is around reflectors: made ready for whoever looks them up, and handed out as a sample.

use argus_gpu::Gpu;
use argus_scene::{Cancel, Lighting, RenderError, Sample, SampleId, SampleJob, Stage, Surroundings};

use super::{GpuSampler, check_wanted};
use crate::mirrors::{Mirrored, Mirrors};
use crate::passes::{ResolveSample, Shade, ShadeSample};
use crate::resident::Resident;
use crate::{Indirect, SamplerKnobs, timing};

/// How surfaces are shaded, and what they look up.
pub(super) struct Looks {
    shade: Shade,
    shade_sample: ShadeSample,
    resolve: ResolveSample,
    /// What is looked up where nothing is.
    nothing: Mirrored,
    /// Maps around reflectors, made when something is first to look them up.
    pub(super) mirrors: Option<Box<Mirrors>>,
}

/// One of the ways.
pub(super) struct Look<'a> {
    pub(super) shade: &'a Shade,
    pub(super) shade_sample: &'a ShadeSample,
    pub(super) resolve: &'a ResolveSample,
    pub(super) mirrored: &'a Mirrored,
}

impl Looks {
    /// Without maps.
    pub(super) fn new(gpu: &Gpu, resident: &Resident, knobs: &SamplerKnobs) -> Self {
        let (features, keeps_guides) = (resident.features, knobs.indirect != Indirect::Off);
        Self {
            shade: Shade::new(gpu, features, keeps_guides, false),
            shade_sample: ShadeSample::new(gpu, features, keeps_guides, false, knobs.side()),
            resolve: ResolveSample::new(gpu, features.specular, 1, false),
            nothing: Mirrored::none(gpu),
            mirrors: None,
        }
    }

    /// The way that has those reflections, once their maps are made.
    pub(super) fn of(&self, reflections: Option<Surroundings>) -> Look<'_> {
        let mirrors = self.mirrors.as_deref().filter(|_| reflections.is_some());
        match mirrors.and_then(|mirrors| Some((mirrors, mirrors.mirrored()?))) {
            Some((Mirrors { shade, shade_sample, resolve, .. }, mirrored)) => {
                Look { shade, shade_sample, resolve, mirrored }
            }
            None => Look {
                shade: &self.shade,
                shade_sample: &self.shade_sample,
                resolve: &self.resolve,
                mirrored: &self.nothing,
            },
        }
    }
}

impl GpuSampler {
    /// Makes the maps of surroundings ready, if they are asked for; what that cost.
    pub(super) fn mirror(
        &mut self,
        reflections: Option<Surroundings>,
        lighting: &Lighting,
        time_secs: f64,
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        let Some(of) = reflections else { return Ok(Vec::new()) };
        let drifts = self.drifts();
        let mut mirrors = match self.looks.mirrors.take().filter(|mirrors| mirrors.of == of) {
            Some(mirrors) => mirrors,
            None => Box::new(Mirrors::new(&self.gpu, &self.scene, &self.resident, &self.knobs, of)?),
        };
        // Programs outlive an order that nobody waits for any more.
        let stages = match mirrors.is_made(lighting, time_secs, drifts) {
            true => Ok(Vec::new()),
            false => self.make_mirrors(&mut mirrors, lighting, time_secs, cancel),
        };
        self.looks.mirrors = Some(mirrors);
        stages
    }

    fn make_mirrors(
        &mut self,
        mirrors: &mut Mirrors,
        lighting: &Lighting,
        time_secs: f64,
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        check_wanted(cancel)?;
        let mut stages =
            self.light_octree(&mut mirrors.octree, lighting, time_secs, cancel)?.unwrap_or_default();
        let made = mirrors.make(&self.gpu, &self.scene, &self.resident, lighting, time_secs)?;
        timing::add(&mut stages, made);
        Ok(stages)
    }

    /// A set's surroundings.
    pub(super) fn render_surroundings(
        &mut self,
        job: &SampleJob,
        id: SampleId,
        cancel: &Cancel,
    ) -> Result<Sample, RenderError> {
        self.check_job(job)?;
        // Refuses them where the set has none.
        job.info.camera(id.camera)?;
        let (lighting, time_secs) = (&job.info.lighting, job.info.time_secs());
        let mut stages = self.pose(time_secs);
        stages.extend(self.light(lighting, time_secs)?);
        stages.extend(self.mirror(job.info.reflections, lighting, time_secs, cancel)?);
        let sample = self.looks.mirrors.as_ref().and_then(|mirrors| mirrors.sample(id));
        let sample = sample.ok_or_else(|| RenderError::Internal("there are no surroundings".to_owned()))?;
        Ok(Sample { stages, ..sample })
    }
}
