//! Warms up a role before views wait for it, and measures the cost of its views.
//!
//! A driver compiles a program at its first use; the software driver needs a second or more for the programs of a
//! frame. So a role first renders a small view and discards it. It then renders views at two sizes, whose times give
//! the cost of a view. Views that wait when a worker starts are answered between these, and the service is ready for
//! load once the cost is known, so the planner has to guess for those first views alone.

use std::sync::Arc;
use std::time::Instant;

use argus_scene::{
    Camera, Cancel, Compositor, Detail, Frame, LightEffects, LightLevel, Output, Outputs, PixelJob, Plan,
    ProbeSource, ReflectionProbeSet, Reflections, RenderError, SampleId, SampleJob, SampleSet, SampleSetInfo,
    Sampler, Scene, SceneState, Version, ViewJob, Visibility, Warp,
};

use crate::core::quality::Cost;

/// Sizes of the measured views, pixels: small and typical.
pub(super) const SIZES: [[u32; 2]; 2] = [[64, 48], [320, 240]];

/// Replaces the typical size where its view would take longer than [`SLOW_MS`], by the time of the small one.
const SIZE_WHERE_SLOW: [u32; 2] = [160, 120];

/// A view that is rendered to measure what effects cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EffectTrial {
    /// With all effects of direct light, at the small size. It says whether a larger view is quick, and counts if not.
    Begin,
    /// With all effects of direct light.
    All,
    /// With the set's effects, in the best light.
    Own,
}

/// Number of measurements of each view. The fastest counts, since other processes use the same cores.
const ROUNDS: usize = 3;

/// Milliseconds after which a view is not measured again, since clients wait meanwhile.
const SLOW_MS: f64 = 200.0;

/// Texels per side of the samples that views are measured from.
pub(super) const SIDES: [u32; 2] = [96, 192];

/// Number of samples that views are measured from, as many as a view usually has.
const SAMPLES: usize = 4;

/// Version number of the measured samples, which no set reaches.
const LAST_VERSION: u64 = u64::MAX;

/// Renders a small view from triangles and a list of its pixels, which compiles their programs and builds what they trace. So the
/// first view whose holes are traced waits for nothing else.
///
/// # Errors
/// The error of rendering.
pub(super) fn sampler(
    sampler: &mut dyn Sampler,
    scene: &Scene,
    info: &SampleSetInfo,
) -> Result<(), RenderError> {
    let (camera, [width, height]) = (scene.default_camera(), SIZES[0]);
    direct_view(sampler, camera, info, (SIZES[0], Detail::Full))?;
    let ViewJob { state, time_secs, reflections, .. } =
        view(info, camera, SIZES[0], Plan::direct(1), sampler.usual_visibility());
    let pixels = (0..width * height).step_by(PIXELS_APART).collect();
    let samples_per_pixel = 1;
    let job = PixelJob { camera, width, height, pixels, samples_per_pixel, state, time_secs, reflections };
    sampler.render_pixels(&[job], &Cancel::default()).into_iter().try_for_each(|pixels| pixels.map(drop))
}

/// Pixels from one to the next of the list that is traced before views wait.
const PIXELS_APART: usize = 16;

/// Measures the cost of views from triangles in some detail, by the pixels that are rendered, of a sampler whose programs are
/// compiled. `seen` gets each frame. Calls `between` between views.
///
/// # Errors
/// The error of rendering.
pub(super) fn direct_cost(
    sampler: &mut dyn Sampler,
    scene: &Scene,
    info: &SampleSetInfo,
    detail: Detail,
    seen: &mut dyn FnMut(&Frame),
    between: &mut dyn FnMut(&mut dyn Sampler),
) -> Result<Option<Cost>, RenderError> {
    // Of a large scene it takes as long as a view.
    let camera = scene.default_camera();
    measured(
        sampler,
        &mut |sampler, size| direct_view(*sampler, camera, info, (size, detail)).map(|frame| seen(&frame)),
        &mut |sampler| {
            between(*sampler);
        },
    )
}

/// Renders a view from triangles.
fn direct_view(
    sampler: &mut dyn Sampler,
    camera: Camera,
    info: &SampleSetInfo,
    (size, detail): ([u32; 2], Detail),
) -> Result<Frame, RenderError> {
    let plan = Plan::Direct { samples_per_pixel: 1, detail, light: None };
    let view = view(info, camera, size, plan, sampler.usual_visibility());
    only_view(sampler, &view)
}

/// Renders one view from triangles.
fn only_view(sampler: &mut dyn Sampler, view: &ViewJob) -> Result<Frame, RenderError> {
    let frames = sampler.render_views(std::slice::from_ref(view), &Cancel::default());
    let none = || RenderError::Internal("a result is missing".to_owned());
    frames.into_iter().next().ok_or_else(none)?
}

/// Whether a view of [`SIZE_WHERE_SLOW`] is quick, where one of the small size took `ms`.
pub(super) fn is_larger_quick(ms: f64) -> bool {
    let pixels = |[width, height]: [u32; 2]| f64::from(width * height);
    ms * pixels(SIZE_WHERE_SLOW) / pixels(SIZES[0]) <= SLOW_MS
}

/// Renders a small view to measure what its effects cost: with all effects of direct light, in that light alone, or with those
/// of the set, in the best `light` that is ready. `None` where the sampler cannot render it.
///
/// # Errors
/// The error of rendering.
pub(super) fn view_of_effects(
    sampler: &mut dyn Sampler,
    scene: &Scene,
    info: &SampleSetInfo,
    trial: EffectTrial,
    light: LightLevel,
) -> Result<Option<Frame>, RenderError> {
    let size = if trial == EffectTrial::Begin { SIZES[0] } else { SIZE_WHERE_SLOW };
    let usual = view(info, scene.default_camera(), size, Plan::direct(1), sampler.usual_visibility());
    let in_light = |light| ViewJob { state: SceneState { light, ..usual.state }, ..usual.clone() };
    match trial {
        EffectTrial::Own => only_view(sampler, &in_light(light)).map(Some),
        EffectTrial::Begin | EffectTrial::All => {
            sampler.render_with(LightEffects::ALL, &in_light(LightLevel::Direct)).transpose()
        }
    }
}

/// The job of small samples that views are measured from.
///
/// Rendering and uploading samples of full size takes seconds. So the samples are small, of two sizes, and the cost
/// per texel is extrapolated to full size. They show the scene itself, because silhouettes, glossy surfaces and
/// occlusion determine the cost of a view from samples. How fine reflections are does not, nor light between surfaces, and both take
/// seconds to render.
pub(super) fn small_samples(
    scene: &Scene,
    info: &Arc<SampleSetInfo>,
    visibility: Visibility,
    side: u32,
) -> SampleJob {
    let rig = info.rig.with_side(side);
    let nearest = rig.nearest(&scene.default_camera(), SAMPLES);
    let id = |camera| SampleId { version: LAST_VERSION, camera };
    let ids = nearest.into_iter().map(id).collect();
    let state = SceneState { light: LightLevel::Direct, ..info.version.state };
    let version = Version { number: LAST_VERSION, state };
    let coarse = |settings| Reflections { side: Reflections::LEAST_SIDE, ..settings };
    let reflections =
        info.reflections.map(|set| ReflectionProbeSet { settings: coarse(set.settings), ..set });
    let small = SampleSetInfo { rig, visibility, version, reflections, ..info.as_ref().clone() };
    SampleJob::new(Arc::new(small), ids, false)
}

/// Reconstructs views from these samples, one set for each size, and extrapolates their cost to samples of full size.
/// Calls `between` between slices of the work.
///
/// # Errors
/// The error of rendering.
pub(super) fn compositor(
    compositor: &mut dyn Compositor,
    scene: &Scene,
    info: &Arc<SampleSetInfo>,
    sets: [SampleSet; 2],
    between: &mut dyn FnMut(),
) -> Result<Option<Cost>, RenderError> {
    let camera = scene.default_camera();
    let mut times = Vec::new();
    for set in sets {
        let ids: Vec<SampleId> = set.samples.iter().map(|sample| sample.id).collect();
        while !compositor.hold_slice(&set)? {
            between();
        }
        between();
        let plan = Plan::Warp(Warp { samples: ids.clone(), ..Warp::default() });
        // The worker checks a planned view by its ranges.
        let outputs = Outputs::COLOR.with(Output::Range);
        let view = |size| ViewJob { outputs, ..view(info, camera, size, plan.clone(), info.visibility) };
        let ready = compositor.ready(&view(SIZES[0]), between);
        let compose = |compositor: &mut dyn Compositor, size| {
            let frames = compositor.compose(&[view(size)], &Cancel::default());
            frames.into_iter().try_for_each(|frame| frame.map(drop))
        };
        let measured = ready.and_then(|()| {
            // The first rendering compiles programs.
            compose(compositor, SIZES[0])?;
            between();
            measured(&mut *compositor, &mut |role, size| compose(*role, size), &mut |_| between())
        });
        compositor.release(&ids);
        times.push((set.info.rig.sample_texels() as f64, measured?));
    }
    let [(few, Some(small)), (many, Some(large))] = times[..] else { return Ok(None) };
    let texels = info.rig.sample_texels() as f64;
    let ms_per_texel = ((large.fixed_ms - small.fixed_ms) / (many - few)).max(0.0);
    Ok(Some(Cost { fixed_ms: large.fixed_ms + ms_per_texel * (texels - many).max(0.0), ..large }))
}

/// The shortest time of a rendering by a role, milliseconds. The time of `between`, which may use the role, does not count.
///
/// # Errors
/// The error of rendering.
pub(super) fn fastest<R>(
    role: &mut R,
    render: &mut dyn FnMut(&mut R) -> Result<(), RenderError>,
    between: &mut dyn FnMut(&mut R),
) -> Result<f64, RenderError> {
    let (mut fastest, since) = (f64::INFINITY, Instant::now());
    for _ in 0..ROUNDS {
        let began = Instant::now();
        render(role)?;
        fastest = fastest.min(began.elapsed().as_secs_f64() * 1e3);
        between(role);
        // Views that waited count, too: they wait for prices.
        if since.elapsed().as_secs_f64() * 1e3 > SLOW_MS {
            break;
        }
    }
    Ok(fastest)
}

/// Renders a view of a size by a role, and discards it.
type Rendering<'a, R> = dyn FnMut(&mut R, [u32; 2]) -> Result<(), RenderError> + 'a;

/// Measures the cost of a role's views by their size. The time of `between`, which may use the role, does not count.
fn measured<R>(
    mut role: R,
    render: &mut Rendering<'_, R>,
    between: &mut dyn FnMut(&mut R),
) -> Result<Option<Cost>, RenderError> {
    let mut times: Vec<(u64, f64)> = Vec::new();
    for size in SIZES {
        let pixels = |size: [u32; 2]| u64::from(size[0]) * u64::from(size[1]);
        let is_slow = |&(few, ms): &(u64, f64)| ms * pixels(size) as f64 / few as f64 > SLOW_MS;
        let size = if times.last().is_some_and(is_slow) { SIZE_WHERE_SLOW } else { size };
        times.push((pixels(size), fastest(&mut role, &mut |role| render(role, size), between)?));
    }
    Ok(Cost::fit(times.into_iter()))
}

pub(super) fn view(
    info: &SampleSetInfo,
    camera: Camera,
    size: [u32; 2],
    plan: Plan,
    visibility: Visibility,
) -> ViewJob {
    let (state, time_secs) = (info.version.state, info.time_secs());
    // Probes and points are made for the first view that needs them, since they cost as much as samples.
    let by_rays = |set: &ReflectionProbeSet| set.settings.source == ProbeSource::Rays;
    let reflections = info.reflections.filter(|set| by_rays(set) && matches!(plan, Plan::Direct { .. }));
    ViewJob { state, time_secs, visibility, reflections, ..ViewJob::new(camera, size, plan) }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn time_between_two_slices_is_not_part_of_the_cost() {
        // Where views that waited take long, each size is measured once.
        for (pause_ms, rounds) in [(40, ROUNDS), (300, 1)] {
            let mut pauses = 0;
            let render = |_: &mut (), _| {
                std::thread::sleep(Duration::from_millis(2));
                Ok(())
            };
            let mut between = |_: &mut ()| {
                pauses += 1;
                std::thread::sleep(Duration::from_millis(pause_ms));
            };
            let cost = measured((), &mut { render }, &mut between).unwrap().unwrap();
            assert!(cost.ms(320 * 240) < 30.0, "{cost:?}");
            assert_eq!(pauses, SIZES.len() * rounds);
        }
        let mut failing = |_: &mut (), _| Err(RenderError::Internal("requested by the test".to_owned()));
        assert!(measured((), &mut failing, &mut |_| {}).is_err());
    }
}
