//! Renders the samples of a set.

use argus_scene::{
    Cancel, FaceMask, InvalidField, RenderError, Sample, SampleId, SampleJob, Sampler, Sampling, Visibility,
};

use super::gpu_sampler::GpuSampler;
use super::ready_scene::BetweenTiles;
use super::surface_programs::ReflectionLookup;
use super::tile_loop::wait;
use super::unchanged::FaceTrails;
use crate::light::SampleOf;
use crate::stages::{Part, PartOutput};
use crate::tile::tiles_of_faces;

/// Sub-samples of a band of a sample that is traced on the CPU: about 20 ms of a core, with shading by a software driver.
const BAND_SUB_SAMPLES: u32 = 1 << 16;

impl GpuSampler {
    /// Renders the samples of a job. With `between`, other work runs between tiles.
    pub(super) fn render_set(
        &mut self,
        job: &SampleJob,
        cancel: &Cancel,
        mut between: Option<BetweenTiles<'_>>,
    ) -> Vec<Result<Sample, RenderError>> {
        let (of_probes, of_rig): (Vec<_>, Vec<_>) =
            job.ids.iter().copied().partition(SampleId::is_reflection_probe);
        let job_of_rig = SampleJob { ids: of_rig, ..job.clone() };
        let of_rig = match job.info.sampling {
            Sampling::Triangles => {
                let count = job_of_rig.ids.len() as f64;
                let mut rendered = Vec::new();
                for &id in &job_of_rig.ids {
                    let before = rendered.len() as f64;
                    // Each sample is an equal share of the job.
                    let mut between = between.as_mut().map(|between| {
                        |sampler: &mut dyn Sampler, share: f64| between(sampler, (before + share) / count)
                    });
                    let between = between.as_mut().map(|between| between as BetweenTiles<'_>);
                    rendered.push(self.render_sample(job, id, cancel, between));
                }
                rendered
            }
            Sampling::MegaViews(settings) => self.render_by_method(&job_of_rig, settings, cancel),
        };
        let of_probes: Vec<_> =
            of_probes.into_iter().map(|id| self.render_probe_sample(job, id, cancel)).collect();
        // In the order of the job's ids.
        let (mut of_rig, mut of_probes) = (of_rig.into_iter(), of_probes.into_iter());
        let missing = || Err(RenderError::Internal("a sample was neither rendered nor refused".to_owned()));
        let next = |id: &SampleId| if id.is_reflection_probe() { of_probes.next() } else { of_rig.next() };
        job.ids.iter().map(next).map(|sample| sample.unwrap_or_else(missing)).collect()
    }

    /// Renders one sample. With `between`, other work runs between its tiles.
    pub(super) fn render_sample(
        &mut self,
        job: &SampleJob,
        id: SampleId,
        cancel: &Cancel,
        mut between: Option<BetweenTiles<'_>>,
    ) -> Result<Sample, RenderError> {
        self.check_job(job)?;
        let reflections = job.info.reflections;
        let camera = job.info.camera(id.camera)?;
        let faces = job.faces_of(id).of_camera(&camera);
        let before = job.extended(id);
        let missing = faces.without(before.map_or(FaceMask::NONE, |sample| sample.faces));
        let mut tiles = tiles_of_faces(&camera, missing, self.settings.side())?;
        let mut scene = self.make_ready_for_sample(&job.info, &camera, cancel)?;
        // Rays cost the same in bands; the rasteriser would process all triangles for each band. Point-based light is shared
        // within a tile. All samples are cut alike, with and without `between`, so that their bytes are equal.
        if scene.backend == Visibility::Cpu && self.lights.indirect.is_none() {
            tiles = tiles.into_iter().flat_map(|tile| tile.bands(BAND_SUB_SAMPLES)).collect();
        }
        let planes = self.surface_programs.of(ReflectionLookup::probes(reflections)).resolve.planes(
            &self.gpu,
            &self.settings,
            camera.size(),
            job.to_host,
        );
        if let Some(before) = before {
            planes.take_over(&self.gpu, before)?;
        }
        let mut submitted = Vec::new();
        let of = SampleOf { camera, number: id.camera, shows: job.info.version.state };
        let mut trails = FaceTrails::begin(self, &scene, of, &tiles);
        let (parts, output) = (Part::of_tiles(tiles), PartOutput::Texels(&planes));
        let mut done = 0;
        let rendered = self.render_parts(&mut scene, &parts, output, cancel, |sampler, scene, part| {
            submitted.push(part.submitted);
            done += 1;
            trails.pause(sampler, done);
            if let Some(between) = &mut between {
                wait(&mut submitted, &mut scene.stages)?;
                sampler.run_between(scene, between, done as f64 / parts.len() as f64)?;
            }
            trails.resume(sampler, scene, done);
            Ok(())
        });
        trails.end(self);
        rendered?;
        wait(&mut submitted, &mut scene.stages)?;
        let planes = planes.hand_over(&self.gpu, job.to_host)?;
        Ok(Sample { id, camera, faces, planes, stages: scene.into_stages() })
    }

    /// Checks that samples of a set can be rendered here.
    pub(super) fn check_job(&self, job: &SampleJob) -> Result<(), RenderError> {
        self.check_alive()?;
        if job.info.scene != self.scene.hash {
            let reason = format!("this process holds scene {}, not {}", self.scene.hash, job.info.scene);
            return Err(InvalidField::new("sample.scene", reason).into());
        }
        self.settings.check_set(&job.info)?;
        self.methods.check_sampling(job.info.sampling)?;
        self.methods.check_reflections(job.info.reflections.as_ref())?;
        Ok(job.info.sampling.validate(&job.info.rig)?)
    }
}
