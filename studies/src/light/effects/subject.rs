//! A scene, rendered with every set of effects that the study compares.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_gpu::Gpu;
use argus_sampler::{GpuSampler, Indirect, LightSettings, RadianceFormat, SamplerSettings};
use argus_scene::effects::EffectCosts;
use argus_scene::metrics::flip_map;
use argus_scene::{
    Camera, EffectPlan, EffectRequest, Effects, LightEffects, Outputs, Plan, RigKind, RigSettings, SampleJob,
    SampleSetInfo, ViewJob, Visibility,
};

use super::options::Options;
use super::rendering::{Images, Rendering, frames, images, sample};
use super::scenes;
use super::stages::mean_stages;
use super::switches::{SWITCHABLE, is_on, neutral, switched};
use crate::bench::Bench;

/// A scene and its renderings.
pub(super) struct Subject<'a> {
    pub(super) options: &'a Options,
    /// What rows are compared with: `auto`, except in tests.
    pub(super) base: Effects,
    pub(super) bench: Bench,
    pub(super) views: Vec<Camera>,
    /// One for each set of effects.
    pub(super) renderings: Vec<Rendering>,
}

/// Rays of a rendering.
pub(super) fn light(rays: u32) -> LightSettings {
    LightSettings { sky_rays: rays, emitter_rays: rays, ..LightSettings::default() }
}

impl<'a> Subject<'a> {
    pub(super) fn new(options: &'a Options, gpu: &Arc<Gpu>, spec: &str, base: Effects) -> Result<Self> {
        let scene = scenes::open(spec)?;
        let rig =
            RigSettings { kind: Some(RigKind::Cell), face: Some(options.face), ..RigSettings::default() };
        let settings = |effects| SamplerSettings {
            effects,
            light: LightSettings::default(),
            indirect: Indirect::Off,
            radiance: RadianceFormat::HalfFloat,
            ..SamplerSettings::default()
        };
        let bench = Bench::with_scene(gpu, Arc::clone(&scene), &rig, settings(LightEffects::NONE))?;
        let mut views = bench.suggested();
        views.truncate(options.views.max(1));
        let mut subject = Self { options, base, bench, views, renderings: Vec::new() };
        let plan = subject.plan(base, None);
        let neutral = neutral(&plan);
        for effects in subject.cases(&plan).into_iter().map(|(_, effects)| effects).chain(neutral) {
            if subject.renderings.iter().all(|rendering| rendering.effects != effects) {
                subject.renderings.push(Rendering {
                    effects,
                    sampler: GpuSampler::with_methods(
                        Arc::clone(gpu),
                        Arc::clone(&scene),
                        settings(effects),
                        crate::methods::methods(),
                    )?,
                    views: Vec::new(),
                    samples: Vec::new(),
                    images: Images::default(),
                    judged: Images::default(),
                    halved: Images::default(),
                });
            }
        }
        Ok(subject)
    }

    pub(super) fn plan(&self, effects: Effects, costs: Option<&EffectCosts>) -> EffectPlan {
        let request = EffectRequest { effects, indirect: Some(Indirect::Off), ..EffectRequest::default() };
        EffectPlan::of(&self.bench.scene, &request, costs)
    }

    /// The rows: their names and effects.
    pub(super) fn cases(&self, auto: &EffectPlan) -> Vec<(String, LightEffects)> {
        let of_auto = auto.light_effects();
        let mut cases = vec![("auto".to_owned(), of_auto)];
        for effects in [Effects::All, Effects::None] {
            cases.push((effects.to_string(), self.plan(effects, None).light_effects()));
        }
        for effect in SWITCHABLE {
            let is_on = is_on(of_auto, effect);
            let word = if is_on { "without" } else { "with" };
            cases.push((format!("auto {word} {effect}"), switched(of_auto, effect, !is_on)));
        }
        cases
    }

    pub(super) fn rendering(&self, effects: LightEffects) -> Result<&Rendering> {
        self.renderings.iter().find(|rendering| rendering.effects == effects).context("no such rendering")
    }

    /// Costs of all effects for a view of this size, from a view with a quarter of the pixels.
    pub(super) fn costs(&mut self) -> Result<EffectCosts> {
        let [width, height] = self.options.size.map(|n| n.div_ceil(2));
        let job = self.job(self.views[0], [width, height]);
        let all = self.plan(Effects::All, None).light_effects();
        let rendering = self.renderings.iter_mut().find(|rendering| rendering.effects == all);
        let sampler = &mut rendering.context("all effects are rendered")?.sampler;
        let mut stages = Vec::new();
        // The first also builds trees and compiles pipelines.
        for _ in 0..2 {
            let frames = frames(sampler, std::slice::from_ref(&job))?;
            stages = frames.into_iter().flat_map(|frame| frame.stages).collect();
        }
        let [whole_width, whole_height] = self.options.size;
        let factor = f64::from(whole_width * whole_height) / f64::from(width * height);
        Ok(EffectCosts::of_stages(&self.bench.scene, &stages).scaled(factor))
    }

    pub(super) fn job(&self, camera: Camera, size: [u32; 2]) -> ViewJob {
        let plan = Plan::direct(self.options.samples_per_pixel);
        let job = self.bench.job(camera, size, Outputs::COLOR, plan);
        ViewJob { visibility: Visibility::Cpu, ..job }
    }

    /// Renders everything: rounds in which the renderings alternate, then those with many rays.
    pub(super) fn measure(&mut self) -> Result<()> {
        let jobs: Vec<ViewJob> =
            self.views.iter().map(|camera| self.job(*camera, self.options.size)).collect();
        let ids = self.bench.sample_ids(&self.views[0], 1);
        let (bench, options) = (&self.bench, self.options);
        let exposure = bench.scene.lighting.exposure;
        let sample_job = |effects| {
            let info = SampleSetInfo { effects, visibility: Visibility::Cpu, ..(*bench.info).clone() };
            SampleJob::new(Arc::new(info), ids.clone(), true)
        };
        for round in 0..=options.rounds {
            for rendering in &mut self.renderings {
                let begin = Instant::now();
                let views = frames(&mut rendering.sampler, &jobs)?;
                let view_ms = begin.elapsed().as_secs_f64() * 1e3 / jobs.len() as f64;
                let job = sample_job(rendering.effects);
                let begin = Instant::now();
                let sample = sample(&mut rendering.sampler, &job)?;
                let sample_ms = begin.elapsed().as_secs_f64() * 1e3;
                if round > 0 || options.rounds == 0 {
                    let stages = mean_stages(views.iter().map(|frame| frame.stages.as_slice()));
                    rendering.views.push((view_ms, stages));
                    rendering.samples.push((sample_ms, sample.stages.clone()));
                }
                if round == options.rounds {
                    rendering.images = images(&views, &sample, exposure)?;
                }
            }
        }
        for rendering in &mut self.renderings {
            let job = sample_job(rendering.effects);
            let mut render = |rays: u32| -> Result<Images> {
                rendering.sampler.set_light(light(rays))?;
                let views = frames(&mut rendering.sampler, &jobs)?;
                images(&views, &sample(&mut rendering.sampler, &job)?, exposure)
            };
            rendering.judged = render(options.many_rays)?;
            if rendering.effects.emitters {
                rendering.halved = render((options.many_rays / 2).max(1))?;
            }
            rendering.sampler.set_light(LightSettings::default())?;
        }
        Ok(())
    }

    /// Writes the pictures of all rows, and where they differ from `auto`.
    pub(super) fn save(&self, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let scene: String = self.bench.scene.name.chars().map(file_character).collect();
        let auto = self.plan(self.base, None);
        let before = self.rendering(auto.light_effects())?;
        for (name, effects) in self.cases(&auto) {
            let after = self.rendering(effects)?;
            let name: String = name.chars().map(file_character).collect();
            for (view, (before, after)) in before.images.views.iter().zip(&after.images.views).enumerate() {
                after.save(folder.join(format!("effects-{scene}-{name}-{view}.png")))?;
                if before != after {
                    let map = flip_map(before, after)?;
                    map.save(folder.join(format!("effects-{scene}-{name}-{view}-flip.png")))?;
                }
            }
        }
        Ok(())
    }
}

/// A character of a file's name.
fn file_character(character: char) -> char {
    if character.is_ascii_alphanumeric() || character == '.' { character } else { '-' }
}
