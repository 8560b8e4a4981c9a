//! A search that begins where an earlier frame had its surfaces: where that is of use, what it shows, and when it is left.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use crate::common;

use std::sync::Arc;

use argus_compositor::{CompositorSettings, GpuCompositor};
use argus_scene::{
    Camera, Cancel, Compositor as _, Frame, History, Images, Output, Outputs, Plan, SampleCamera, SampleSet,
    Search, ViewJob,
};
use common::*;
use glam::{DQuat, DVec3};

const SIZE: [u32; 2] = [120, 90];

fn cameras(about: DVec3) -> [SampleCamera; 4] {
    [(-8.0, -8.0), (8.0, -8.0), (-8.0, 8.0), (8.0, 8.0)]
        .map(|(x, z)| perspective(about + DVec3::new(x, 9.0, z), about, 75.0, 200, 150))
}

fn garden_set() -> SampleSet {
    sample_set(&Analytic::garden(), &cameras(DVec3::ZERO), false, 1)
}

fn here() -> Camera {
    Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO)
}

/// The camera after a turn and a step aside.
fn moved(camera: Camera, turn_deg: f64, aside: f64) -> Camera {
    let axis = DQuat::from_rotation_y(turn_deg.to_radians()) * (camera.target - camera.eye);
    let eye = camera.eye + axis.cross(camera.up).normalize() * aside;
    Camera { eye, target: eye + axis, ..camera }
}

fn seeded(set: &SampleSet, camera: Camera) -> ViewJob {
    job(set, camera, SIZE, Search::Seeded)
}

fn history_of(compositor: &mut GpuCompositor, job: &ViewJob) -> Arc<History> {
    let frame = compose_one(compositor, job).unwrap();
    Arc::new(History::of(&frame, &job.camera, job.history.as_deref()).unwrap())
}

fn from(history: &Arc<History>, job: ViewJob) -> ViewJob {
    ViewJob { history: Some(history.clone()), ..job }
}

fn bytes_of(frame: &Frame) -> Images {
    frame.images.clone()
}

/// The view is what it would be without the history, and says so.
#[track_caller]
fn assert_of_no_use(compositor: &mut GpuCompositor, history: &Arc<History>, job: ViewJob) {
    let without = compose_one(compositor, &job).unwrap();
    let with = compose_one(compositor, &from(history, job)).unwrap();
    assert!(!with.provenance.history);
    assert_eq!(with.provenance, without.provenance);
    assert!(bytes_of(&with) == bytes_of(&without), "a history that is not used shows");
}

#[test]
fn a_view_reprojected_from_the_previous_frame_shows_what_samples_show() {
    let (garden, set) = (Analytic::garden(), garden_set());
    let mut compositor = compositor(&set);
    let before = history_of(&mut compositor, &seeded(&set, here()));
    for (turn_deg, aside) in [(0.0, 0.0), (1.0, 0.0), (0.0, 0.1), (-4.0, 0.3)] {
        let view = seeded(&set, moved(here(), turn_deg, aside));
        let fresh = compose_one(&mut compositor, &view).unwrap();
        let begun = compose_one(&mut compositor, &from(&before, view.clone())).unwrap();
        assert!(begun.provenance.history && !fresh.provenance.history);
        let (fresh, begun) = (judge(&garden, &view, &fresh, 0.03), judge(&garden, &view, &begun, 0.03));
        println!("{turn_deg}° {aside} m: {fresh:?} {begun:?}");
        // Silhouettes may fall to either side.
        assert!(begun.bad_range <= fresh.bad_range + 0.01, "{begun:?}, from samples {fresh:?}");
        assert!(begun.color <= fresh.color + 0.3, "{begun:?}, from samples {fresh:?}");
        assert!(begun.unresolved <= fresh.unresolved + 0.005, "{begun:?}, from samples {fresh:?}");
    }
}

#[test]
fn reprojected_frames_restart_from_samples_regularly_and_do_not_drift() {
    let (garden, set) = (Analytic::garden(), garden_set());
    let max_reprojections = 5;
    let mut compositor =
        compositor_with(&set, CompositorSettings { max_reprojections, ..CompositorSettings::default() });
    let mut last: Option<Arc<History>> = None;
    for i in 0..30 {
        let fresh = seeded(&set, moved(here(), f64::from(i), 0.05 * f64::from(i)));
        let view = ViewJob { history: last.clone(), ..fresh.clone() };
        let frame = compose_one(&mut compositor, &view).unwrap();
        assert_eq!(frame.provenance.history, i % (max_reprojections + 1) > 0, "frame {i}");
        let fresh = judge(&garden, &fresh, &compose_one(&mut compositor, &fresh).unwrap(), 0.03);
        let begun = judge(&garden, &view, &frame, 0.03);
        assert!(
            begun.bad_range <= fresh.bad_range + 0.01 && begun.color <= fresh.color + 0.3,
            "{i}: {begun:?}"
        );
        last = History::of(&frame, &view.camera, last.as_deref()).map(Arc::new);
    }
}

#[test]
fn searches_other_than_the_seeded_one_ignore_the_history() {
    let set = garden_set();
    let mut compositor = compositor(&set);
    let before = history_of(&mut compositor, &seeded(&set, here()));
    for search in Search::ALL.into_iter().filter(|&search| search != Search::Seeded) {
        assert_of_no_use(&mut compositor, &before, job(&set, here(), SIZE, search));
    }
}

#[test]
fn a_frame_that_looked_elsewhere_is_not_reprojected() {
    let set = garden_set();
    let mut compositor = compositor(&set);
    let before = history_of(&mut compositor, &seeded(&set, here()));
    let turned = |deg| moved(here(), deg, 0.0);
    let Camera { eye, target, .. } = here();
    let opposite = Camera { target: 2.0 * eye - target, ..here() };
    // All that the frame showed is behind this eye.
    let past = Camera { eye: target * 2.0 - eye, target: target * 3.0 - 2.0 * eye, ..here() };
    for camera in [turned(40.0), turned(-90.0), opposite, past] {
        assert_of_no_use(&mut compositor, &before, seeded(&set, camera));
    }
}

#[test]
fn a_frame_of_sky_alone_is_not_reprojected() {
    let set = garden_set();
    let mut compositor = compositor(&set);
    let up =
        Camera { up: DVec3::X, ..Camera::look_at(DVec3::new(0.0, 9.0, 0.0), DVec3::new(0.0, 20.0, 0.0)) };
    let before = history_of(&mut compositor, &seeded(&set, up));
    assert!(before.words().iter().all(|&word| word == 0), "the view looks up");
    assert_of_no_use(&mut compositor, &before, seeded(&set, up));
    assert_of_no_use(&mut compositor, &before, seeded(&set, here()));
}

#[test]
fn a_frame_of_one_pixel_is_not_reprojected() {
    let set = garden_set();
    let mut compositor = compositor(&set);
    for size in [[1, 1], [1, 60], [4, 4]] {
        let before = history_of(&mut compositor, &job(&set, here(), size, Search::Seeded));
        assert_of_no_use(&mut compositor, &before, seeded(&set, here()));
    }
}

#[test]
fn invalid_ranges_in_a_history_leave_finite_frames() {
    let set = garden_set();
    let mut compositor = compositor(&set);
    let view = seeded(&set, here());
    let mut frame = compose_one(&mut compositor, &view).unwrap();
    let strange = [f32::NAN, -1.0, f32::MAX, 1e-30, f32::MIN_POSITIVE, 1e-45, f32::NEG_INFINITY, 3.0];
    let pixels = (SIZE[0] * SIZE[1]) as usize;
    frame.images[Output::Range] =
        Some((0..pixels).flat_map(|i| strange[i * 7 % strange.len()].to_le_bytes()).collect());
    frame.images[Output::Source] = Some((0..pixels).map(|i| (i * 31 % 256) as u8).collect());
    let before = Arc::new(History::of(&frame, &here(), None).unwrap());
    let begun = compose_one(&mut compositor, &from(&before, view.clone())).unwrap();
    assert!(begun.provenance.history);
    // Checks each pixel for what no frame may hold.
    judge(&Analytic::garden(), &view, &begun, 0.03);
}

#[test]
fn a_history_of_another_size_field_of_view_or_supersampling_is_reprojected() {
    let (garden, set) = (Analytic::garden(), garden_set());
    let mut compositor = compositor(&set);
    let before = history_of(&mut compositor, &seeded(&set, here()));
    for (fov_deg, size, side) in
        [(30.0, SIZE, 1), (45.0, [60, 45], 1), (45.0, [200, 150], 1), (40.0, SIZE, 3)]
    {
        let mut view = job(&set, Camera { fov_deg, ..here() }, size, Search::Seeded);
        if let Plan::Warp(warp) = &mut view.plan {
            warp.supersampling = side;
        }
        let fresh = judge(&garden, &view, &compose_one(&mut compositor, &view).unwrap(), 0.03);
        let begun = compose_one(&mut compositor, &from(&before, view.clone())).unwrap();
        assert!(begun.provenance.history, "{fov_deg}° {size:?} ×{side}");
        let begun = judge(&garden, &view, &begun, 0.03);
        println!("{fov_deg}° {size:?} ×{side}: {fresh:?} {begun:?}");
        assert!(begun.bad_range <= fresh.bad_range + 0.01 && begun.color <= fresh.color + 0.4, "{begun:?}");
    }
    let wide = seeded(&set, Camera { fov_deg: 90.0, ..here() });
    assert_of_no_use(&mut compositor, &before, wide);
}

#[test]
fn history_pixels_of_released_samples_count_for_the_first_sample_of_the_plan() {
    let (garden, set) = (Analytic::garden(), garden_set());
    let mut compositor = compositor(&set);
    let mut view = seeded(&set, here());
    let samples = |view: &mut ViewJob, range: std::ops::Range<usize>| {
        if let Plan::Warp(warp) = &mut view.plan {
            warp.samples = warp.samples[range].to_vec();
        }
    };
    samples(&mut view, 0..2);
    let before = history_of(&mut compositor, &view);
    let mut view = seeded(&set, here());
    samples(&mut view, 2..4);
    let fresh = judge(&garden, &view, &compose_one(&mut compositor, &view).unwrap(), 0.03);
    let begun = compose_one(&mut compositor, &from(&before, view.clone())).unwrap();
    assert!(begun.provenance.history);
    let begun = judge(&garden, &view, &begun, 0.03);
    assert!(begun.bad_range <= fresh.bad_range + 0.02, "{begun:?}, from samples {fresh:?}");
}

#[test]
fn a_history_at_a_million_metres_is_as_good_as_one_at_zero() {
    let far = DVec3::new(1e6, -1e6, 1e6);
    let frame_at = |about: DVec3| {
        let set = sample_set(&Analytic::garden().at(about), &cameras(about), false, 1);
        let mut compositor = compositor(&set);
        let at = |camera: Camera| Camera { eye: camera.eye + about, target: camera.target + about, ..camera };
        let before = history_of(&mut compositor, &seeded(&set, at(here())));
        let view = from(&before, seeded(&set, at(moved(here(), 2.0, 0.2))));
        compose_one(&mut compositor, &view).unwrap()
    };
    let (near, away) = (frame_at(DVec3::ZERO), frame_at(far));
    assert!(near.provenance.history && away.provenance.history);
    let (a, b) = (near.images[Output::Color].clone().unwrap(), away.images[Output::Color].clone().unwrap());
    let differ = a.iter().zip(b.iter()).filter(|(a, b)| a.abs_diff(**b) > 2).count();
    assert!(differ * 100 < a.len(), "{differ} of {} bytes differ", a.len());
}

#[test]
fn batches_and_pieces_do_not_change_a_reprojected_frame() {
    let set = garden_set();
    let mut whole = compositor(&set);
    let before = history_of(&mut whole, &seeded(&set, here()));
    let wide = job(&set, moved(here(), 1.0, 0.1), [203, 151], Search::Seeded);
    let views = [
        from(&before, seeded(&set, moved(here(), 1.0, 0.0))),
        seeded(&set, here()),
        from(&before, wide.clone()),
        job(&set, here(), SIZE, Search::Splat),
        from(&before, ViewJob { outputs: Outputs::COLOR, ..seeded(&set, moved(here(), 0.0, 0.2)) }),
    ];
    let batch = whole.compose(&views, &Cancel::new());
    for (view, frame) in views.iter().zip(&batch) {
        let (frame, alone) = (frame.as_ref().unwrap(), compose_one(&mut whole, view).unwrap());
        assert_eq!(frame.provenance.history, view.history.is_some());
        assert!(bytes_of(frame) == bytes_of(&alone), "a view shows its batch");
    }
    let pieces = CompositorSettings { piece_side: 40, chunk_pixels: 5000, ..CompositorSettings::default() };
    let mut parts = compositor_with(&set, pieces);
    let view = from(&before, wide);
    let (a, b) = (compose_one(&mut whole, &view).unwrap(), compose_one(&mut parts, &view).unwrap());
    assert!(bytes_of(&a) == bytes_of(&b), "a view shows its pieces");
}

#[test]
fn the_pass_plan_says_whether_a_search_starts_from_samples_or_a_frame() {
    let set = garden_set();
    let mut compositor = compositor(&set);
    let before = history_of(&mut compositor, &seeded(&set, here()));
    let row = |name: &str, job: &ViewJob| {
        let rows = compositor.plan(job).unwrap();
        rows.into_iter().find(|row| row.name == name).unwrap()
    };
    let plain = seeded(&set, here());
    let reprojection = from(&before, plain.clone());
    let elsewhere = from(&before, seeded(&set, moved(here(), 30.0, 0.0)));
    assert!(row("reproject frames", &reprojection).on && !row("splat samples", &reprojection).on);
    for (job, why) in [
        (&plain, "no earlier frame is at hand"),
        (&elsewhere, "the earlier frame shows too little of what the view does"),
        (&job(&set, here(), SIZE, Search::Linear), "the search begins nowhere"),
    ] {
        let found = row("reproject frames", job);
        assert!(!found.on && found.why == why, "{found:?}");
    }
    assert!(row("splat samples", &elsewhere).on);
}
