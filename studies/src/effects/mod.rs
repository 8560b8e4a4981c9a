//! Effects: what each effect of direct light costs, and how much it changes, beside the bound of the effect plan.
//!
//! Each scene is rendered with the effects that `auto`, `all` and `none` give, with each effect of `auto` switched off, and
//! with each other one switched on. All of them are measured in the same rounds, in turn. A row compares a rendering with
//! that of `auto`, and says:
//!
//! - `within`: no byte changed by more than the plan's bound. A bound of 1 says nothing, and is not judged.
//! - `moves`: effects that are switched off change some byte.
//! - `cheap`: effects of `auto` that changed no byte cost at most 5% of the frame.
//!
//! # Texels that several triangles share
//! Without rays, a texel of a sample is lit once for each of its triangles; with rays, once, at one of them. This changes
//! texels where triangles meet, and is no effect's. So a sample without effects is judged by its rendering with rays that
//! light nothing: with emitters, where the plan says that nothing emits. `path_bytes` is how far the two are apart. Views
//! are lit at each sub-sample either way.
//!
//! # Noise
//! Bounds are those of converged light. Light of the sky and of emitters is a mean over few rays. Shared rays are no
//! noise here: two renderings cast the same rays for the effects that both have. What an effect of few rays adds is judged
//! in renderings with many rays ([`Options::many_rays`]). Their noise is estimated by their largest difference from
//! renderings with half as many: for independent rays, half the rays are as far from all of them as all of them are from
//! the converged light. At most two bytes of it are added to the bound, and only where emitters are switched: what is seen
//! of the sky and of lights is a share between 0 and 1, whose noise never leaves the bound.

mod judgement;
mod scenes;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::{GpuSampler, Indirect, LightKnobs, RadianceFormat, SamplerKnobs};
use argus_scene::effects::{EffectCosts, EffectKind, EffectRow, SHARED_STAGE};
use argus_scene::metrics::flip_map;
use argus_scene::tone::display_from_radiance;
use argus_scene::{
    Camera, Cancel, EffectPlan, EffectRequest, Effects, Frame, LightEffects, Outputs, Plan, PlaneData,
    PlaneFormat, PlaneKind, RigKind, RigKnobs, Sample, SampleJob, SampleSetInfo, Sampler as _, Stage,
    ViewJob, Visibility,
};
use glam::Vec3;
use half::f16;
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::bench::Bench;
use crate::median::median;
use crate::{Effort, Machine, Report, report};
use judgement::{Against, Change, Found, IDLE_SHARE, MOST_NOISE, Verdicts, bound_bytes};

/// What the study measures.
#[derive(Debug, Clone)]
pub struct Options {
    /// Scenes: `matt` (a ball that nothing shades), `room` (closed, at night, with a lamp), or as [`argus_scene::open`]
    /// takes them.
    pub scenes: Vec<String>,
    /// View size in pixels.
    pub size: [u32; 2],
    /// Samples a pixel of views: 1, 4 or 16.
    pub samples_per_pixel: u32,
    /// Most views of a scene: the first of its own viewpoints.
    pub views: usize,
    /// Side of a cube face of the sample, texels.
    pub face: u32,
    /// Rays to the sky and to emitters of the renderings whose change is judged, 2 to 64.
    pub many_rays: u32,
    /// Measured rounds, after one that is not counted; times are their medians.
    pub rounds: usize,
    /// Folder for pictures of all rows.
    pub pictures: Option<PathBuf>,
}

impl Default for Options {
    /// Takes some minutes on two cores.
    fn default() -> Self {
        let scenes = ["matt", "room", "rooms", "terrain:100000", "mirrors"];
        Self {
            scenes: scenes.map(str::to_owned).to_vec(),
            size: [200, 150],
            samples_per_pixel: 4,
            views: 3,
            face: 128,
            many_rays: 32,
            rounds: 5,
            pictures: None,
        }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        let scenes = ["matt", "room", "terrain:3000"];
        Self {
            scenes: scenes.map(str::to_owned).to_vec(),
            size: [64, 48],
            views: 1,
            face: 24,
            many_rays: 16,
            rounds: 1,
            ..Self::default()
        }
    }
}

/// Effects that a request can switch.
const SWITCHABLE: [EffectKind; 4] =
    [EffectKind::Shadows, EffectKind::SoftShadows, EffectKind::SkyVisibility, EffectKind::Emitters];

/// Runs the study; `progress` counts scenes.
///
/// # Errors
/// A scene that cannot be opened, no GPU, a render that fails, or a folder that cannot be written to.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_length(options.scenes.len() as u64);
    let mut rows = Vec::new();
    for spec in &options.scenes {
        progress.set_message(spec.clone());
        let mut subject = Subject::new(options, &gpu, spec, Effects::Auto)?;
        let costs = subject.costs()?;
        let plan = subject.plan(subject.base, Some(&costs));
        subject.measure()?;
        if let Some(folder) = &options.pictures {
            subject.save(folder)?;
        }
        rows.extend(subject.rows(plan)?);
        progress.inc(1);
    }
    let Options { size: [width, height], views, samples_per_pixel: samples, face, rounds, .. } = *options;
    let mut report = Report::new(options.scenes.join(" "), Machine::here(gpu.kind()), rows);
    report.notes.push(format!(
        "Up to {views} views of {width}×{height} pixels with {samples} samples a pixel, and a sample of six faces of {face}² texels, stored \
        as half floats. Times are medians of {rounds} rounds in which the rows alternate; times_auto is a time divided by that of \
        auto. Indirect light and reflection probes are off."
    ));
    report.notes.push(format!(
        "changed_bytes, mean_bytes, flip: views with the usual rays, against those of auto. judged_bytes: views and sample \
        with {} rays to the sky and to emitters; noise_bytes: their largest difference from half as many rays, of which up to \
        {MOST_NOISE} are added to the bound. within: judged_bytes are within bound_bytes (– where the bound says nothing). \
        path_bytes: by how much more a sample's texels differ where one \
        of the two has no rays at all, and so lights each triangle of a texel; it is not judged. moves: what is switched off \
        changes a byte. cheap: what changes none costs at most {} of the frame.",
        options.many_rays, IDLE_SHARE
    ));
    report.notes.push(
        "predicted_ms: of the switched effect in a view, from a view with a quarter of the pixels and all effects. \
        measured_ms: the effect's own stages in views of auto, or saved_ms, in views with the effect, where auto leaves it \
        out. light_ms: reading surfaces back, which all effects share."
            .to_owned(),
    );
    Ok(report)
}

/// Images of a rendering: views, and the faces of the sample.
#[derive(Default)]
struct Images {
    views: Vec<RgbImage>,
    sample: Vec<RgbImage>,
}

/// A set of effects, and what was measured of it.
struct Rendering {
    effects: LightEffects,
    sampler: GpuSampler,
    /// Of each round: milliseconds and stages, a view's mean.
    views: Vec<(f64, Vec<Stage>)>,
    samples: Vec<(f64, Vec<Stage>)>,
    /// With the usual rays.
    images: Images,
    /// With many rays, and with half as many.
    judged: Images,
    halved: Images,
}

impl Rendering {
    fn view_ms(&self) -> f64 {
        median(&self.views.iter().map(|(ms, _)| *ms).collect::<Vec<_>>())
    }

    fn sample_ms(&self) -> f64 {
        median(&self.samples.iter().map(|(ms, _)| *ms).collect::<Vec<_>>())
    }
}

/// A scene and its renderings.
struct Subject<'a> {
    options: &'a Options,
    /// What rows are compared with: `auto`, except in tests.
    base: Effects,
    bench: Bench,
    views: Vec<Camera>,
    /// One for each set of effects.
    renderings: Vec<Rendering>,
}

/// Rays of a rendering.
fn light(rays: u32) -> LightKnobs {
    LightKnobs { sky_rays: rays, emitter_rays: rays, filter: true }
}

impl<'a> Subject<'a> {
    fn new(options: &'a Options, gpu: &Arc<Gpu>, spec: &str, base: Effects) -> Result<Self> {
        let scene = scenes::open(spec)?;
        let rig = RigKnobs { kind: Some(RigKind::Cell), face: Some(options.face), ..RigKnobs::default() };
        let knobs = |effects| SamplerKnobs {
            effects,
            light: LightKnobs::default(),
            indirect: Indirect::Off,
            radiance: RadianceFormat::HalfFloat,
            ..SamplerKnobs::default()
        };
        let bench = Bench::with_scene(gpu, Arc::clone(&scene), &rig, knobs(LightEffects::NONE))?;
        let mut views = bench.suggested();
        views.truncate(options.views.max(1));
        let mut subject = Self { options, base, bench, views, renderings: Vec::new() };
        let plan = subject.plan(base, None);
        let neutral = neutral(&plan);
        for effects in subject.cases(&plan).into_iter().map(|(_, effects)| effects).chain(neutral) {
            if subject.renderings.iter().all(|rendering| rendering.effects != effects) {
                subject.renderings.push(Rendering {
                    effects,
                    sampler: GpuSampler::with_knobs(Arc::clone(gpu), Arc::clone(&scene), knobs(effects))?,
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

    fn plan(&self, effects: Effects, costs: Option<&EffectCosts>) -> EffectPlan {
        let request = EffectRequest { effects, indirect: Some(Indirect::Off), ..EffectRequest::default() };
        EffectPlan::of(&self.bench.scene, &request, costs)
    }

    /// The rows: their names and effects.
    fn cases(&self, auto: &EffectPlan) -> Vec<(String, LightEffects)> {
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

    fn rendering(&self, effects: LightEffects) -> Result<&Rendering> {
        self.renderings.iter().find(|rendering| rendering.effects == effects).context("no such rendering")
    }

    /// Costs of all effects for a view of this size, from a view with a quarter of the pixels.
    fn costs(&mut self) -> Result<EffectCosts> {
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

    fn job(&self, camera: Camera, size: [u32; 2]) -> ViewJob {
        let plan = Plan::Direct { samples_per_pixel: self.options.samples_per_pixel };
        let job = self.bench.job(camera, size, Outputs::COLOR, plan);
        ViewJob { visibility: Visibility::Cpu, ..job }
    }

    /// Renders everything: rounds in which the renderings alternate, then those with many rays.
    fn measure(&mut self) -> Result<()> {
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
            rendering.sampler.set_light(LightKnobs::default())?;
        }
        Ok(())
    }

    /// Writes the pictures of all rows, and where they differ from `auto`.
    fn save(&self, folder: &Path) -> Result<()> {
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

    /// The table's rows. `plan` is that of `auto`, whose bounds are judged, with predicted costs.
    fn rows(&self, mut plan: EffectPlan) -> Result<Vec<Map<String, Value>>> {
        let of_auto = plan.light_effects();
        let auto = self.rendering(of_auto)?;
        plan.measured_in(&typical(&auto.views));
        let neutral = neutral(&plan);
        let mut rows = Vec::new();
        for (name, effects) in self.cases(&plan) {
            let rendering = self.rendering(effects)?;
            // Soft shadows beyond an `auto` without shadows add both.
            let changed: Vec<EffectKind> = SWITCHABLE
                .into_iter()
                .filter(|&effect| is_on(effects, effect) != is_on(of_auto, effect))
                .collect();
            let against = match changed.first() {
                None => Against::Itself,
                Some(&effect) if is_on(of_auto, effect) => Against::Off,
                Some(_) => Against::On,
            };
            let has_more = if against == Against::On { rendering } else { auto };
            let stages = [typical(&has_more.views), typical(&has_more.samples)];
            let alone = !of_auto.any() || !effects.any();
            let cost = |stages: &[Stage]| -> f64 {
                let own: f64 = changed.iter().filter_map(|effect| effect.ms_of(stages)).sum();
                own + if alone { ms_of(stages, SHARED_STAGE) } else { 0.0 }
            };
            let share = (cost(&stages[0]) / has_more.view_ms()).max(cost(&stages[1]) / has_more.sample_ms());
            if against == Against::On {
                for &effect in &changed {
                    if let Some(ms) = effect.ms_of(&stages[0]) {
                        plan.measured(effect, ms);
                    }
                }
            }
            let shown = Change::between(&auto.images.views, &rendering.images.views)?;
            let views = Change::between(&auto.judged.views, &rendering.judged.views)?;
            let by_rays = |effects: LightEffects| match neutral {
                Some(neutral) if !effects.any() => neutral,
                _ => effects,
            };
            let [before, after] = [of_auto, effects]
                .map(|effects| self.rendering(by_rays(effects)).map(|with| &with.judged.sample));
            let sample = Change::between(before?, after?)?;
            let judged = views.most.max(sample.most);
            let whole = Change::between(&auto.judged.sample, &rendering.judged.sample)?;
            let emits = plan.row(EffectKind::Emitters).is_some_and(|row| row.bound > 0.0);
            let noise = match emits && changed.contains(&EffectKind::Emitters) {
                true => {
                    let emits = if effects.emitters { rendering } else { auto };
                    let of = |images: &Images| {
                        images.views.iter().chain(&images.sample).cloned().collect::<Vec<_>>()
                    };
                    Change::between(&of(&emits.halved), &of(&emits.judged))?.most
                }
                false => 0,
            };
            let bound = bound_bytes(&plan, &changed);
            let found = Found { against, bound, changed: judged, noise, share };
            let verdicts = Verdicts::of(&found);
            // Of rows in which one effect is switched, with those that it needs.
            let of_plan = |cost: fn(&EffectRow) -> Option<f64>| match name.starts_with("auto w") {
                true => changed.iter().filter_map(|&effect| cost(plan.row(effect)?)).reduce(|a, b| a + b),
                false => None,
            };
            rows.push(report::row(json!({
                "scene": self.bench.scene.name,
                "row": name,
                "effects": effects.to_string(),
                "view_ms": rendering.view_ms(),
                "view_times_auto": rendering.view_ms() / auto.view_ms(),
                "sample_ms": rendering.sample_ms(),
                "sample_times_auto": rendering.sample_ms() / auto.sample_ms(),
                "light_ms": ms_of(&typical(&rendering.views), SHARED_STAGE),
                "predicted_ms": of_plan(|row| row.predicted_ms),
                "measured_ms": of_plan(|row| row.measured_ms),
                "saved_ms": of_plan(|row| row.saved_ms),
                "share": (against != Against::Itself).then_some(share),
                "bound_bytes": bound.filter(|_| against != Against::Itself),
                "changed_bytes": shown.most,
                "mean_bytes": shown.mean,
                "flip": shown.flip,
                "judged_bytes": judged,
                "path_bytes": whole.most.saturating_sub(sample.most),
                "noise_bytes": noise,
                "within": verdicts.within,
                "moves": verdicts.moves,
                "cheap": verdicts.cheap,
                "passed": verdicts.passed(),
            })));
        }
        Ok(rows)
    }
}

/// Effects that cast rays and light nothing; `None` if every effect may light something.
fn neutral(plan: &EffectPlan) -> Option<LightEffects> {
    let is_dark = plan.row(EffectKind::Emitters).is_some_and(|row| !row.on && row.bound == 0.0);
    is_dark.then_some(LightEffects { emitters: true, ..LightEffects::NONE })
}

/// Whether some effects include one. Soft shadows have no effect without shadows.
fn is_on(effects: LightEffects, effect: EffectKind) -> bool {
    match effect {
        EffectKind::Shadows => effects.shadows,
        EffectKind::SoftShadows => effects.shadows && effects.soft_shadows,
        EffectKind::SkyVisibility => effects.sky_visibility,
        EffectKind::Emitters => effects.emitters,
        _ => false,
    }
}

/// Effects with one switched on or off. Soft shadows need shadows, and go with them.
fn switched(effects: LightEffects, effect: EffectKind, on: bool) -> LightEffects {
    match effect {
        EffectKind::Shadows => {
            LightEffects { shadows: on, soft_shadows: effects.soft_shadows && on, ..effects }
        }
        EffectKind::SoftShadows => {
            LightEffects { shadows: effects.shadows || on, soft_shadows: on, ..effects }
        }
        EffectKind::SkyVisibility => LightEffects { sky_visibility: on, ..effects },
        EffectKind::Emitters => LightEffects { emitters: on, ..effects },
        _ => effects,
    }
}

fn frames(sampler: &mut GpuSampler, jobs: &[ViewJob]) -> Result<Vec<Frame>> {
    Ok(sampler.render_views(jobs, &Cancel::new()).into_iter().collect::<Result<_, _>>()?)
}

fn sample(sampler: &mut GpuSampler, job: &SampleJob) -> Result<Sample> {
    sampler
        .render_samples(job, &Cancel::new())
        .pop()
        .context("no sample is near the view")?
        .map_err(Into::into)
}

/// Displayed views and faces of a sample.
fn images(frames: &[Frame], sample: &Sample, exposure: f32) -> Result<Images> {
    let view = |frame: &Frame| -> Result<RgbImage> {
        let bytes = frame.color.as_ref().context("the frame has no colour")?.to_vec();
        RgbImage::from_raw(frame.width, frame.height, bytes).context("the frame is short")
    };
    let plane = sample.plane(PlaneKind::Radiance).context("the sample has no radiance")?;
    let PlaneData::Host(bytes) = &plane.data else { anyhow::bail!("the sample is on the device") };
    anyhow::ensure!(plane.format == PlaneFormat::Rgba16Float, "radiance is not stored as half floats");
    let pixels: Vec<u8> = bytes
        .as_chunks::<8>()
        .0
        .iter()
        .flat_map(|&[r0, r1, g0, g1, b0, b1, ..]| {
            let [r, g, b] = [[r0, r1], [g0, g1], [b0, b1]].map(|half| f16::from_le_bytes(half).to_f32());
            display_from_radiance(Vec3::new(r, g, b), exposure)
        })
        .collect();
    let [width, height] = plane.size;
    Ok(Images {
        views: frames.iter().map(view).collect::<Result<_>>()?,
        sample: vec![RgbImage::from_raw(width, height, pixels).context("the sample is short")?],
    })
}

/// Mean of stages of several views, by name.
fn mean_stages<'a>(views: impl ExactSizeIterator<Item = &'a [Stage]>) -> Vec<Stage> {
    let count = views.len() as f64;
    let mut sum: Vec<Stage> = Vec::new();
    for stage in views.flatten() {
        match sum.iter_mut().find(|known| known.name == stage.name) {
            Some(known) => known.ms += stage.ms / count,
            None => sum.push(Stage::new(stage.name.clone(), stage.ms / count)),
        }
    }
    sum
}

/// Medians of stages over rounds, by name.
fn typical(rounds: &[(f64, Vec<Stage>)]) -> Vec<Stage> {
    let Some((_, last)) = rounds.last() else { return Vec::new() };
    let of = |name: &str| -> Vec<f64> { rounds.iter().map(|(_, stages)| ms_of(stages, name)).collect() };
    last.iter().map(|stage| Stage::new(stage.name.clone(), median(&of(&stage.name)))).collect()
}

/// Milliseconds of the stages of a name.
fn ms_of(stages: &[Stage], name: &str) -> f64 {
    // From 0.0, because the sum of no floats is -0.0.
    stages.iter().filter(|stage| stage.name == name).fold(0.0, |sum, stage| sum + stage.ms)
}

/// A character of a file's name.
fn file_character(character: char) -> char {
    if character.is_ascii_alphanumeric() || character == '.' { character } else { '-' }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of a quick run. `wrong` falsifies the plan.
    fn rows(spec: &str, base: Effects, wrong: impl Fn(&mut EffectPlan)) -> Vec<Map<String, Value>> {
        let options = Options { size: [32, 24], face: 16, many_rays: 4, rounds: 1, ..Options::quick() };
        let gpu = Gpu::new(&GpuOptions::default()).unwrap();
        let mut subject = Subject::new(&options, &gpu, spec, base).unwrap();
        let costs = subject.costs().unwrap();
        let mut plan = subject.plan(base, Some(&costs));
        wrong(&mut plan);
        subject.measure().unwrap();
        subject.rows(plan).unwrap()
    }

    fn of<'a>(rows: &'a [Map<String, Value>], name: &str) -> &'a Map<String, Value> {
        rows.iter().find(|row| row["row"] == name).unwrap()
    }

    #[test]
    fn a_wrong_bound_is_found_out() {
        let name = "auto without emitters";
        assert_eq!(of(&rows("room", Effects::Auto, |_| {}), name)["passed"], true);
        let rows = rows("room", Effects::Auto, |plan| {
            plan.rows.iter_mut().for_each(|row| row.bound = 1e-6);
        });
        assert_eq!((&of(&rows, name)["within"], &of(&rows, name)["passed"]), (&false.into(), &false.into()));
    }

    #[test]
    fn an_effect_that_changes_nothing_is_found_out() {
        // Penumbras of the moon's shadows, in a closed room.
        let effects = LightEffects { sky_visibility: false, ..LightEffects::ALL };
        let rows = rows("room", Effects::List(effects), |_| {});
        let row = of(&rows, "auto without soft-shadows");
        assert_eq!(
            (&row["changed_bytes"], &row["moves"], &row["passed"]),
            (&0.into(), &false.into(), &false.into())
        );
        assert!(row["share"].as_f64().unwrap() >= 0.0 && row["cheap"].is_boolean());
    }

    #[test]
    fn effects_are_switched_with_those_that_need_them() {
        let none = LightEffects::NONE;
        let soft = switched(none, EffectKind::SoftShadows, true);
        assert_eq!(soft, LightEffects { shadows: true, soft_shadows: true, ..none });
        assert_eq!(switched(soft, EffectKind::Shadows, false), none);
        assert_eq!(switched(soft, EffectKind::SoftShadows, false), LightEffects { shadows: true, ..none });
        for effect in SWITCHABLE {
            assert!(is_on(switched(none, effect, true), effect) && !is_on(none, effect));
            assert!(!is_on(switched(LightEffects::ALL, effect, false), effect));
        }
    }

    #[test]
    fn stages_are_averaged_over_views_and_the_median_of_rounds() {
        let stage = |ms| vec![Stage::new("a", ms)];
        let views = [stage(1.0), stage(3.0), vec![Stage::new("b", 3.0)]];
        let mean = mean_stages(views.iter().map(Vec::as_slice));
        assert_eq!((ms_of(&mean, "a"), ms_of(&mean, "b")), (4.0 / 3.0, 1.0));
        let rounds = [(0.0, stage(9.0)), (0.0, Vec::new()), (0.0, stage(4.0))];
        assert_eq!(typical(&rounds), stage(4.0));
    }
}
