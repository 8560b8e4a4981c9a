//! Reflection probes: prepared for shading, and returned as a sample of the set.

use std::time::{Duration, Instant};

use argus_scene::camera::{CameraRays, Face};
use argus_scene::{
    Cancel, ProbeSource, ReflectionProbeSet, RenderError, Sample, SampleId, SampleJob, Stage, ViewJob,
};

use super::gpu_sampler::{GpuSampler, Moment};
use super::ready_scene::ReadyScene;
use super::surface_programs::{ReflectionLookup, SurfacePrograms};
use crate::frame::check_wanted;
use crate::probe_renderer::{LitAt, ProbePrograms, ProbeRenderer};
use crate::ray_tile::RayTile;
use crate::reflected_light::ReflectedScene;
use crate::tile::{Tile, tiles};
use crate::timing;
use crate::view_reflections::ViewReflections;

impl GpuSampler {
    /// Prepares what a job reflects. Returns the cost.
    pub(super) fn prepare_reflections(
        &mut self,
        reflections: ReflectionLookup,
        lit: LitAt<'_>,
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        let set = match reflections {
            ReflectionLookup::Nothing => return Ok(Vec::new()),
            ReflectionLookup::Probes(set) => return self.prepare_probes(Some(set), lit, cancel),
            ReflectionLookup::View(set) => set,
        };
        self.methods.check_reflections(Some(&set))?;
        let of_views = match self.surface_programs.of_views.take().filter(|views| views.set == set) {
            Some(of_views) => of_views,
            None => {
                Box::new(ViewReflections::new(&self.gpu, &self.scene, &self.resident, &self.settings, set)?)
            }
        };
        self.surface_programs.of_views = Some(of_views);
        self.ready_reflected(set.settings.source, lit.time_secs)
    }

    /// Prepares the scene for reflections by rays or points, at its present pose. Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for a scene of too many triangles.
    pub(super) fn ready_reflected(
        &mut self,
        source: ProbeSource,
        time_secs: f64,
    ) -> Result<Vec<Stage>, RenderError> {
        let before = self.surface_programs.reflected.take();
        let mut stages = Vec::new();
        let points = (self.methods.points.as_ref(), &self.gpu);
        self.surface_programs.reflected = match before {
            Some(reflected) if reflected.is_ready(source) => Some(reflected),
            before => {
                let begin = Instant::now();
                let tracer = self.visibility.prepare_packets(&self.resident);
                let reflected =
                    ReflectedScene::posed(before, source, points, &self.scene, tracer, time_secs)?;
                timing::add_since(&mut stages, "build trees for reflections", begin);
                Some(reflected)
            }
        };
        Ok(stages)
    }

    /// Finds the reflectors in a direct view, and fills their maps if it looks reflections up there. The scene must be ready
    /// for the view. Adds the cost to the scene's stages.
    pub(super) fn see_reflectors(
        &mut self,
        view: &ViewJob,
        (faces, lens): (&[Face], Option<&CameraRays>),
        scene: &mut ReadyScene,
    ) {
        let SurfacePrograms { of_views: Some(views), reflected: Some(reflected), .. } =
            &self.surface_programs
        else {
            return;
        };
        if !matches!(scene.reflections, ReflectionLookup::View(_)) {
            return;
        }
        let begin = Instant::now();
        let (visibility, resident) = (&mut self.visibility, &self.resident);
        visibility.prepare_packets(resident);
        // One ray a pixel. Reflectors may be transparent.
        let ids = || {
            let of_tile = |tile: &Tile| {
                let eye = view.camera.eye;
                let (layers, ids) = match lens.map(|rays| RayTile::new(rays, *tile)) {
                    None => {
                        let rays = tile.rays();
                        let layers = visibility.layers_of_tile(resident, eye, &rays);
                        (layers, visibility.prepare_packets(resident).trace(eye, &rays))
                    }
                    Some(RayTile { directions, .. }) => {
                        let width = tile.size[0];
                        let layers = visibility.layers_of_rays(resident, eye, &directions, width);
                        (layers, visibility.prepare_packets(resident).trace_listed(eye, &directions, width))
                    }
                };
                let layered = layers.iter().flat_map(|ray| ray.layers.iter().map(|layer| layer.surface.ids));
                ids.into_iter().chain(layered.collect::<Vec<_>>())
            };
            tiles(faces, 1).iter().flat_map(of_tile).collect()
        };
        scene.maps = views.see(reflected, &self.scene, view, scene.moment.time_secs, ids);
        if scene.maps.is_some() {
            timing::add_since(&mut scene.stages, "reflection points", begin);
        }
    }

    /// Prepares the reflection probes, if the job asks for reflections. Returns the cost.
    pub(super) fn prepare_probes(
        &mut self,
        reflections: Option<ReflectionProbeSet>,
        lit: LitAt<'_>,
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        let Some(set) = reflections else { return Ok(Vec::new()) };
        self.methods.check_reflections(Some(&set))?;
        let drifts = self.drifts();
        let mut probes = match self.surface_programs.probes.take().filter(|probes| probes.set == set) {
            Some(probes) => probes,
            None => {
                let (gpu, resident, new) = (&self.gpu, &self.resident, self.methods.probes.as_ref());
                Box::new(ProbeRenderer::new(gpu, &self.scene, resident, &self.settings, set, new)?)
            }
        };
        // Keeps the programs if the job was cancelled.
        let stages = match probes.is_made(lit, drifts) {
            true => Ok(Vec::new()),
            false => self.render_probes(&mut probes, lit, cancel),
        };
        self.surface_programs.probes = Some(probes);
        stages
    }

    fn render_probes(
        &mut self,
        probes: &mut ProbeRenderer,
        lit: LitAt<'_>,
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        check_wanted(cancel)?;
        self.begin_cells(self.cells_of_samples());
        let (gpu, LitAt { lighting, time_secs, .. }) = (self.gpu.clone(), lit);
        let places = probes.places(&gpu, &self.scene, time_secs)?;
        let (side, mut stages) = (probes.set.settings.side, Vec::new());
        let (begin, bytes) = match &mut probes.source {
            ProbePrograms::Method(method) => {
                let mut scene = self.lit_scene(cancel);
                stages.extend(method.ready(&mut scene, lighting, time_secs)?);
                let begin = Instant::now();
                (begin, method.render(&mut scene, lighting, &places, side)?)
            }
            ProbePrograms::Filled(from) => {
                let begin = Instant::now();
                let reflectors = &probes.reflectors;
                let bytes = self.render_probe_points(from, reflectors, &places, lit, cancel, &mut stages)?;
                // What no stage of the points accounts for.
                (begin + stage_time(&stages), bytes)
            }
        };
        let made = probes.take_over(&gpu, places, bytes, lit, begin)?;
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
        let mut stages = self.pose(Moment::of(job.info.version.state, time_secs))?;
        stages.extend(self.light(lighting, light, time_secs, false)?);
        stages.extend(self.prepare_probes(
            job.info.reflections,
            LitAt { lighting, light, time_secs },
            cancel,
        )?);
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
