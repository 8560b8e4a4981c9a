//! Reflection probes: prepared for shading, and returned as a sample of the set.

use std::time::{Duration, Instant};

use argus_gpu::Gpu;
use argus_scene::camera::Face;
use argus_scene::{
    Cancel, LightLevel, Lighting, ProbeSource, ReflectionProbeSet, RenderError, Sample, SampleId, SampleJob,
    Stage, ViewJob,
};

use super::tile_loop::ReadyScene;
use super::{GpuSampler, check_wanted};
use crate::passes::{ResolveSample, Shade, ShadeSample};
use crate::probe_renderer::{ProbeBindings, ProbePrograms, ProbeRenderer};
use crate::reflected_light::ReflectedScene;
use crate::resident::{Features, GuideUse, Resident};
use crate::tile::{Tile, tiles};
use crate::view_reflections::ViewReflections;
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
    /// The programs of direct views that look up no probes, made when such a view first asks for reflections.
    pub(super) of_views: Option<Box<ViewReflections>>,
    /// The scene as reflections are found in it, made when a job first asks for reflections by rays or points.
    pub(super) reflected: Option<ReflectedScene>,
}

/// What reflections of a job are taken from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ReflectionLookup {
    /// Surfaces reflect only lights and the sky.
    Nothing,
    /// Probes.
    Probes(ReflectionProbeSet),
    /// What the view's own pixels reflect.
    View(ReflectionProbeSet),
}

impl ReflectionLookup {
    /// What samples and lists of pixels reflect.
    pub(super) fn probes(set: Option<ReflectionProbeSet>) -> Self {
        set.map_or(Self::Nothing, Self::Probes)
    }

    /// What direct views reflect.
    pub(super) fn of_view(set: Option<ReflectionProbeSet>) -> Self {
        match set {
            Some(set) if !set.knobs.source.serves_direct_views() => Self::View(set),
            set => Self::probes(set),
        }
    }
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
            of_views: None,
            reflected: None,
        }
    }

    /// Whether programs of these knobs and features are the same.
    pub(super) fn are_of(knobs: [&SamplerKnobs; 2], features: [Features; 2]) -> bool {
        let of = |knobs: &SamplerKnobs| (GuideUse::of(knobs), knobs.side(), knobs.effects.any());
        of(knobs[0]) == of(knobs[1]) && features[0] == features[1]
    }

    /// Forgets reflections, which show the light of a scene.
    pub(super) fn forget_reflections(&mut self) {
        (self.probes, self.of_views, self.reflected) = (None, None, None);
    }

    /// The programs for a job with those reflections, once they are ready.
    pub(super) fn of(&self, reflections: ReflectionLookup) -> SurfaceProgram<'_> {
        let without = SurfaceProgram {
            shade: &self.shade,
            shade_sample: &self.shade_sample,
            resolve: &self.resolve,
            probe_bindings: &self.nothing,
        };
        match (reflections, self.probes.as_deref(), self.of_views.as_deref()) {
            (ReflectionLookup::Probes(_), Some(probes), _) => match probes.probe_bindings() {
                Some(probe_bindings) => {
                    let ProbeRenderer { shade, shade_sample, resolve, .. } = probes;
                    SurfaceProgram { shade, shade_sample, resolve, probe_bindings }
                }
                None => without,
            },
            (ReflectionLookup::View(_), _, Some(ViewReflections { shade, bindings, .. })) => {
                SurfaceProgram { shade, probe_bindings: bindings, ..without }
            }
            _ => without,
        }
    }
}

impl GpuSampler {
    /// Prepares what a job reflects. Returns the cost.
    pub(super) fn prepare_reflections(
        &mut self,
        reflections: ReflectionLookup,
        lit: (&Lighting, LightLevel),
        time_secs: f64,
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        let set = match reflections {
            ReflectionLookup::Nothing => return Ok(Vec::new()),
            ReflectionLookup::Probes(set) => return self.prepare_probes(Some(set), lit, time_secs, cancel),
            ReflectionLookup::View(set) => set,
        };
        self.methods.check_reflections(Some(&set))?;
        let of_views = match self.surface_programs.of_views.take().filter(|views| views.set == set) {
            Some(of_views) => of_views,
            None => Box::new(ViewReflections::new(&self.gpu, &self.scene, &self.resident, &self.knobs, set)?),
        };
        self.surface_programs.of_views = Some(of_views);
        self.ready_reflected(set.knobs.source, time_secs)
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
        let points = self.methods.points.as_ref();
        self.surface_programs.reflected = match before {
            Some(reflected) if reflected.is_ready(source) => Some(reflected),
            before => {
                let begin = Instant::now();
                let at = (self.visibility.prepare_packets(&self.resident), time_secs);
                let reflected = ReflectedScene::posed(before, (source, points), &self.scene, at)?;
                timing::add_since(&mut stages, "build trees for reflections", begin);
                Some(reflected)
            }
        };
        Ok(stages)
    }

    /// Finds the reflectors in a direct view, and fills their maps if it looks reflections up there. The scene must be ready
    /// for the view. Adds the cost to the scene's stages.
    pub(super) fn see_reflectors(&mut self, view: &ViewJob, faces: &[Face], scene: &mut ReadyScene) {
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
                let (eye, rays) = (view.camera.eye, tile.rays());
                let layers = visibility.layers_of_tile(resident, eye, &rays);
                let ids = visibility.prepare_packets(resident).trace(eye, &rays);
                let layered = layers.iter().flat_map(|ray| ray.layers.iter().map(|layer| layer.surface.ids));
                ids.into_iter().chain(layered.collect::<Vec<_>>())
            };
            tiles(faces, 1).iter().flat_map(of_tile).collect()
        };
        scene.maps = views.see((&reflected.found_by, &self.scene), (view, scene.time_secs), ids);
        if scene.maps.is_some() {
            timing::add_since(&mut scene.stages, "reflection points", begin);
        }
    }

    /// Prepares the reflection probes, if the job asks for reflections. Returns the cost.
    pub(super) fn prepare_probes(
        &mut self,
        reflections: Option<ReflectionProbeSet>,
        (lighting, light): (&Lighting, LightLevel),
        time_secs: f64,
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        let Some(set) = reflections else { return Ok(Vec::new()) };
        self.methods.check_reflections(Some(&set))?;
        let drifts = self.drifts();
        let mut probes = match self.surface_programs.probes.take().filter(|probes| probes.set == set) {
            Some(probes) => probes,
            None => {
                let (gpu, resident, methods) = (&self.gpu, &self.resident, &self.methods);
                Box::new(ProbeRenderer::new(gpu, &self.scene, resident, &self.knobs, (set, methods))?)
            }
        };
        // Keeps the programs if the job was cancelled.
        let stages = match probes.is_made((lighting, light), time_secs, drifts) {
            true => Ok(Vec::new()),
            false => self.render_probes(&mut probes, (lighting, light, time_secs), cancel),
        };
        self.surface_programs.probes = Some(probes);
        stages
    }

    fn render_probes(
        &mut self,
        probes: &mut ProbeRenderer,
        at: (&Lighting, LightLevel, f64),
        cancel: &Cancel,
    ) -> Result<Vec<Stage>, RenderError> {
        check_wanted(cancel)?;
        let (gpu, (lighting, _, time_secs)) = (self.gpu.clone(), at);
        let places = probes.places(&gpu, &self.scene, time_secs)?;
        let (side, mut stages) = (probes.set.knobs.side, Vec::new());
        let (begin, bytes) = match &mut probes.source {
            ProbePrograms::Method(method) => {
                let mut scene = self.lit_scene(cancel);
                stages.extend(method.ready(&mut scene, lighting, time_secs)?);
                let begin = Instant::now();
                (begin, method.render(&mut scene, lighting, &places, side)?)
            }
            ProbePrograms::Filled(from) => {
                let begin = Instant::now();
                let at = (lighting, time_secs);
                let bytes = self.render_probe_points(
                    (from, &probes.reflectors),
                    &places,
                    side,
                    at,
                    cancel,
                    &mut stages,
                )?;
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
        stages.extend(self.prepare_probes(job.info.reflections, (lighting, light), time_secs, cancel)?);
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
