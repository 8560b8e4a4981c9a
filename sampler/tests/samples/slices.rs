//! Direct views in slices, between which other views are rendered.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::sync::Arc;

use argus_sampler::{GpuSampler, SamplerSettings};
use argus_scene::procedural::{DEFAULT_ROOMS_WALL_MM, rooms, terrain};
use argus_scene::{
    Cancel, CellSettings, Frame, Indirect, LightEffects, Plan, Sampler, Scene, SurfaceLight, ViewJob, metrics,
};

use crate::cells::fill;
use crate::common::{direct, image_of, sampler_with, view_job};

const SIZE: [u32; 2] = [100, 76];

fn lit(scene: &Arc<Scene>, indirect: Indirect) -> GpuSampler {
    sampler_with(
        scene,
        SamplerSettings { effects: LightEffects::ALL, indirect, ..SamplerSettings::default() },
    )
}

/// The view in slices, with the number of pauses. Another view is rendered in each.
fn sliced(sampler: &mut GpuSampler, job: &ViewJob) -> (Frame, usize) {
    let mut pauses = 0;
    let other = view_job(job.camera, [40, 30], 1);
    let frame = sampler.render_view_in_slices(job, &Cancel::new(), &mut |sampler, done| {
        assert!((0.0..1.0).contains(&done), "{done}");
        pauses += 1;
        sampler.render_views(std::slice::from_ref(&other), &Cancel::new()).remove(0).unwrap();
    });
    (frame.unwrap(), pauses)
}

fn repeats(sampler: &mut GpuSampler, job: &ViewJob) -> (Frame, usize) {
    let (frame, pauses) = sliced(sampler, job);
    let pinned = ViewJob { plan: frame.provenance.plan.clone(), ..job.clone() };
    let again = direct(sampler, &pinned);
    assert_eq!(again.images, frame.images);
    assert_eq!(again.provenance.plan, frame.provenance.plan);
    (frame, pauses)
}

#[test]
fn a_view_in_slices_has_the_bytes_of_its_pinned_render() {
    let cells = Indirect::Cells(CellSettings::default());
    for (scene, indirect) in
        [(terrain(3000), Indirect::Off), (terrain(3000), cells), (rooms(DEFAULT_ROOMS_WALL_MM), cells)]
            .map(|(s, i)| (Arc::new(s), i))
    {
        let mut sampler = lit(&scene, indirect);
        for samples_per_pixel in [1, 4] {
            let job = ViewJob { band_rows: 8, ..view_job(scene.default_camera(), SIZE, samples_per_pixel) };
            let (frame, pauses) = repeats(&mut sampler, &job);
            assert!(pauses > 0, "{indirect:?}: slices end between bands");
            let whole = ViewJob { band_rows: 0, ..job.clone() };
            let whole = direct(&mut sampler, &ViewJob { plan: frame.provenance.plan.clone(), ..whole });
            let reference = image_of(&direct(&mut sampler, &view_job(job.camera, SIZE, 16)));
            let error = |frame: &Frame| metrics::flip_mean(&reference, &image_of(frame)).unwrap();
            let (banded, whole) = (error(&frame), error(&whole));
            assert!(banded < whole + 0.003, "bands take little quality: {banded} {whole}");
        }
    }
}

#[test]
fn a_view_in_slices_fills_no_cells_and_takes_those_that_are_there() {
    let scene = Arc::new(rooms(DEFAULT_ROOMS_WALL_MM));
    let mut sampler = lit(&scene, Indirect::Cells(CellSettings::default()));
    let job = ViewJob { band_rows: 8, ..view_job(scene.default_camera(), SIZE, 1) };
    let filled = |sampler: &GpuSampler| sampler.light_cells().map_or(0, |cells| cells.filled);
    let frame = sampler.render_view_in_slices(&job, &Cancel::new(), &mut |_, _| {}).unwrap();
    assert_eq!(frame.provenance.plan.light(), Some(SurfaceLight::Rays));
    assert_eq!(filled(&sampler), 0);
    for _ in 0..2 {
        fill(&mut sampler);
        sampler.render_view_in_slices(&job, &Cancel::new(), &mut |_, _| {}).unwrap();
    }
    let (frame, _) = repeats(&mut sampler, &job);
    let light = frame.provenance.plan.light();
    assert!(matches!(light, Some(SurfaceLight::Cells { .. })), "{light:?}");
}

#[test]
fn a_view_without_bands_has_one_slice() {
    let scene = Arc::new(terrain(3000));
    let mut sampler = lit(&scene, Indirect::Off);
    let job = view_job(scene.default_camera(), SIZE, 1);
    let (frame, pauses) = sliced(&mut sampler, &job);
    assert_eq!((frame.images, pauses), (direct(&mut sampler, &job).images, 0));
    assert_eq!(frame.provenance.plan, Plan::direct(1));
}
