//! What a role is put through before views wait for it, and what views then cost there.
//!
//! Drivers make a program's machine code where it is first used, and the software driver takes a second and more for all
//! that a frame needs. So a role renders small views, whose result is thrown away. Rendered again, at
//! two sizes, they say what a view costs before the first one is asked for: the planner never has to guess.

use std::sync::Arc;
use std::time::Instant;

use argus_scene::{
    Camera, Cancel, Compositor, Output, Outputs, Plan, RenderError, SampleId, SampleJob, SampleSet,
    SampleSetInfo, Sampler, Scene, Version, ViewJob, Visibility, Warp,
};

use crate::core::quality::Cost;

/// Pixels of the views by which costs are measured: from small to usual.
const SIZES: [[u32; 2]; 2] = [[64, 48], [320, 240]];

/// Times that each view is rendered after its programs were made; the fastest counts, since other processes take their
/// turns on the same cores.
const ROUNDS: usize = 3;

/// A view that takes longer than this, milliseconds, is measured once: others wait meanwhile.
const SLOW_MS: f64 = 200.0;

/// Texels on a side of the samples by which the cost of reconstructing is measured.
pub(super) const SIDES: [u32; 2] = [96, 192];

/// Samples that views are reconstructed from, to see what that costs: as many as a view usually has.
const SAMPLES: usize = 4;

/// No set has so many versions.
const LAST_VERSION: u64 = u64::MAX;

/// Renders views from triangles, and measures what they cost.
///
/// # Errors
/// Those of rendering.
pub(super) fn sampler(
    sampler: &mut dyn Sampler,
    scene: &Scene,
    info: &Arc<SampleSetInfo>,
) -> Result<Option<Cost>, RenderError> {
    let camera = scene.default_camera();
    let plan = Plan::Direct { samples_per_pixel: 1 };
    let visibility = sampler.usual_visibility();
    let render = |size| {
        let view = view(info, camera, size, plan.clone(), visibility);
        sampler.render_views(&[view], &Cancel::default()).into_iter().try_for_each(|frame| frame.map(drop))
    };
    measured(render, &mut || {})
}

/// The small samples of the scene that views are reconstructed from, to see what that costs.
///
/// Rendering and taking up samples of the usual size takes seconds. So these are small, of two sizes, and what their texels add
/// to the cost is carried on to the usual size. They are of the scene itself: silhouettes, glossy surfaces and what hides
/// behind others decide what a view from samples costs.
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
    let version = Version { number: LAST_VERSION, ..info.version };
    let small = SampleSetInfo { rig, visibility, version, ..info.as_ref().clone() };
    SampleJob::new(Arc::new(small), ids, false)
}

/// Reconstructs views from such samples, one set a size, and measures what views cost from samples of the usual size.
/// `between` is called between slices of the work.
///
/// # Errors
/// Those of rendering.
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
        // A view whose way the planner chose is judged by its ranges.
        let outputs = Outputs::COLOR.with(Output::Range);
        let view = |size| ViewJob { outputs, ..view(info, camera, size, plan.clone(), info.visibility) };
        let ready = compositor.ready(&view(SIZES[0]), between);
        let compose = |size| {
            let frames = compositor.compose(&[view(size)], &Cancel::default());
            frames.into_iter().try_for_each(|frame| frame.map(drop))
        };
        let measured = ready.and_then(|()| measured(compose, between));
        compositor.release(&ids);
        times.push((set.info.rig.sample_texels() as f64, measured?));
    }
    let [(few, Some(small)), (many, Some(large))] = times[..] else { return Ok(None) };
    let texels = info.rig.sample_texels() as f64;
    let a_texel = ((large.fixed_ms - small.fixed_ms) / (many - few)).max(0.0);
    Ok(Some(Cost { fixed_ms: large.fixed_ms + a_texel * (texels - many).max(0.0), ..large }))
}

/// What rendering a view costs, by size; the first time, which makes programs, does not count, and neither does what is done
/// `between`.
fn measured(
    mut render: impl FnMut([u32; 2]) -> Result<(), RenderError>,
    between: &mut dyn FnMut(),
) -> Result<Option<Cost>, RenderError> {
    render(SIZES[0])?;
    between();
    let mut times = Vec::new();
    for size in SIZES {
        let mut fastest = f64::INFINITY;
        for _ in 0..ROUNDS {
            let began = Instant::now();
            render(size)?;
            fastest = fastest.min(began.elapsed().as_secs_f64() * 1e3);
            between();
            if fastest > SLOW_MS {
                break;
            }
        }
        times.push((u64::from(size[0]) * u64::from(size[1]), fastest));
    }
    Ok(Cost::fit(times.into_iter()))
}

fn view(
    info: &SampleSetInfo,
    camera: Camera,
    [width, height]: [u32; 2],
    plan: Plan,
    visibility: Visibility,
) -> ViewJob {
    let (epoch, time_secs) = (info.version.state.epoch, info.time_secs());
    // Reflection maps are made for the first view that needs them: they cost as much as samples.
    let (outputs, reflections, history) = (Outputs::COLOR, None, None);
    ViewJob { camera, width, height, outputs, plan, epoch, time_secs, visibility, reflections, history }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn what_is_done_between_two_slices_is_no_part_of_the_cost() {
        let mut pauses = 0;
        let render = |_| {
            std::thread::sleep(Duration::from_millis(2));
            Ok(())
        };
        let mut between = || {
            pauses += 1;
            std::thread::sleep(Duration::from_millis(200));
        };
        let cost = measured(render, &mut between).unwrap().unwrap();
        assert!(cost.ms(320 * 240) < 100.0, "{cost:?}");
        assert_eq!(pauses, 1 + SIZES.len() * ROUNDS);
        let failing = |_| Err(RenderError::Internal("as told".to_owned()));
        assert!(measured(failing, &mut || {}).is_err());
    }
}
