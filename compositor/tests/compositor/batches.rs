//! What else is in a batch, and how it is worked off, never shows.

use crate::common;

use argus_compositor::{BareFetch, CompositorSettings, GpuCompositor};
use argus_scene::{
    Camera, Cancel, Compositor as _, Frame, Images, Output, Outputs, Plan, PlaneData, PlaneKind, RenderError,
    Sample, SampleCamera, SampleSet, Search, ViewJob, Warp,
};
use bytes::Bytes;
use common::*;
use glam::DVec3;
use std::sync::Arc;

fn garden_set(glossy: bool) -> SampleSet {
    let mut garden = Analytic::garden();
    garden.f0 = if glossy { 0.5 } else { 0.0 };
    let cameras = [(-8.0, -8.0), (8.0, -8.0), (-8.0, 8.0), (8.0, 8.0)]
        .map(|(x, z)| perspective(DVec3::new(x, 9.0, z), DVec3::ZERO, 75.0, 100, 75));
    sample_set(&garden, &cameras, glossy, 1)
}

/// Sixty-four views that share neither size, plan nor outputs.
fn motley(set: &SampleSet) -> Vec<ViewJob> {
    (0..64u32)
        .map(|i| {
            let angle = f64::from(i) * 0.7;
            let eye = DVec3::new(angle.cos() * 9.0, 3.0 + f64::from(i % 7), angle.sin() * 9.0);
            let size = [20 + i * 3 % 61, 10 + i * 7 % 53];
            let search = Search::ALL[i as usize % Search::ALL.len()];
            let mut view = job(set, Camera::look_at(eye, DVec3::ZERO), size, search);
            if let Plan::Warp(Warp { steps, supersampling, samples, .. }) = &mut view.plan {
                *steps = 16 + i;
                *supersampling = 1 + u32::from(i % 6 == 2) + u32::from(i % 12 == 2);
                samples.truncate(1 + i as usize % 4);
            }
            view.outputs = match i % 3 {
                0 => EVERYTHING,
                1 => Outputs::COLOR,
                _ => EVERYTHING.without(Output::Color),
            };
            view
        })
        .collect()
}

/// A frame without what it cost.
fn bytes_of(frame: &Frame) -> (Images, f64) {
    (frame.images.clone(), frame.unresolved_fraction)
}

#[test]
fn a_view_alone_and_in_a_batch_of_64_is_equal_byte_for_byte() {
    for glossy in [false, true] {
        let set = garden_set(glossy);
        let mut compositor = compositor(&set);
        let jobs = motley(&set);
        let batch = compositor.compose(&jobs, &Cancel::new());
        assert_eq!(batch.len(), 64);
        let mut reversed: Vec<ViewJob> = jobs.clone();
        reversed.reverse();
        let reversed = compositor.compose(&reversed, &Cancel::new());
        for (i, (job, frame)) in jobs.iter().zip(&batch).enumerate() {
            let frame = frame.as_ref().unwrap();
            let alone = compose_one(&mut compositor, job).unwrap();
            assert_eq!(bytes_of(frame), bytes_of(&alone), "view {i} shows what else was in its batch");
            let turned = reversed[63 - i].as_ref().unwrap();
            assert_eq!(bytes_of(frame), bytes_of(turned), "view {i} shows its place in the batch");
            assert_eq!((frame.width, frame.height), (job.width, job.height));
        }
    }
}

#[test]
fn a_large_view_in_pieces_is_the_same_as_in_one() {
    let set = garden_set(false);
    let mut whole = compositor(&set);
    let pieces = CompositorSettings { piece_side: 40, chunk_pixels: 5000, ..CompositorSettings::default() };
    let mut parts = compositor_with(&set, pieces);
    for search in Search::ALL {
        for supersampling in [1, 3] {
            let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
            let mut view = job(&set, camera, [203, 97], search);
            if let Plan::Warp(warp) = &mut view.plan {
                warp.supersampling = supersampling;
            }
            let (a, b) = (compose_one(&mut whole, &view).unwrap(), compose_one(&mut parts, &view).unwrap());
            assert!(bytes_of(&a) == bytes_of(&b), "{search:?} ×{supersampling} shows its pieces");
        }
    }
}

#[test]
fn a_bare_fetch_answers_every_view_with_an_image() {
    let set = garden_set(false);
    let mut compositor = compositor(&set);
    let mut bare_fetch = BareFetch::default();
    let jobs = motley(&set);
    let frames = bare_fetch.compose(&mut compositor, &jobs, &Cancel::new());
    for (job, frame) in jobs.iter().zip(&frames) {
        let frame = frame.as_ref().unwrap();
        assert_eq!((frame.width, frame.height), (job.width, job.height));
        if let Some(color) = &frame.images[Output::Color] {
            // The garden fills half of each sample: the fetch is of a picture, not of one colour.
            assert!(color.chunks_exact(3).any(|pixel| pixel != &color[..3]));
        }
    }
    let refused = ViewJob { plan: Plan::direct(1), ..jobs[0].clone() };
    assert!(bare_fetch.compose(&mut compositor, &[refused], &Cancel::new())[0].is_err());
}

#[test]
fn the_largest_view_is_answered_in_bounded_memory() {
    let set = garden_set(false);
    let mut compositor = compositor(&set);
    let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
    let view = ViewJob { outputs: Outputs::COLOR, ..job(&set, camera, [8192, 2048], Search::Splat) };
    let frame = compose_one(&mut compositor, &view).unwrap();
    assert_eq!(frame.images[Output::Color].clone().unwrap().len(), 8192 * 2048 * 3);
    // Its pixels are far finer than the samples' texels, and edges are known to a texel.
    assert!(frame.unresolved_fraction < 0.6, "{}", frame.unresolved_fraction);
}

#[test]
fn a_missing_sample_fails_its_view_alone() {
    let set = garden_set(false);
    let mut compositor = compositor(&set);
    let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
    let good = job(&set, camera, [30, 20], Search::Splat);
    let mut bad = good.clone();
    bad.plan = Plan::Warp(Warp { samples: vec![id(0), id(9)], ..Warp::default() });
    let frames = compositor.compose(&[good.clone(), bad, good.clone()], &Cancel::new());
    assert!(matches!(frames[1], Err(RenderError::MissingSample(missing)) if missing == id(9)));
    assert_eq!(bytes_of(frames[0].as_ref().unwrap()), bytes_of(frames[2].as_ref().unwrap()));
    compositor.release(&[id(0)]);
    assert!(matches!(compose_one(&mut compositor, &good), Err(RenderError::MissingSample(_))));
    compositor.hold(&set).unwrap();
    let again = compose_one(&mut compositor, &good).unwrap();
    assert_eq!(bytes_of(frames[0].as_ref().unwrap()), bytes_of(&again));
}

#[test]
fn plans_that_no_compositor_can_follow_are_refused_by_field() {
    let set = garden_set(false);
    let mut compositor = compositor(&set);
    let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
    let good = job(&set, camera, [30, 20], Search::Splat);
    let mut field = |plan: Plan| match compose_one(&mut compositor, &ViewJob { plan, ..good.clone() }) {
        Err(RenderError::Invalid(invalid)) => invalid.field,
        other => panic!("{other:?}"),
    };
    let warp = |steps, supersampling, samples| {
        Plan::Warp(Warp { search: Search::Linear, steps, supersampling, samples, ..Warp::default() })
    };
    assert_eq!(field(Plan::direct(1)), "plan");
    assert_eq!(field(warp(64, 1, vec![])), "plan.samples");
    assert_eq!(field(warp(64, 1, vec![id(0); 9])), "plan.samples");
    assert_eq!(field(warp(64, 0, vec![id(0)])), "plan.supersampling");
    assert_eq!(field(warp(0, 1, vec![id(0)])), "plan.steps");
}

#[test]
fn samples_of_different_sets_do_not_mix_in_one_view() {
    let set = garden_set(false);
    let mut compositor = compositor(&set);
    let mut other = garden_set(false);
    other.info = Arc::new(argus_scene::SampleSetInfo {
        version: argus_scene::Version::of_epoch(0, 4),
        ..(*other.info).clone()
    });
    other.samples.truncate(1);
    compositor.hold(&other).unwrap();
    let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
    let view = job(&set, camera, [30, 20], Search::Splat);
    assert!(matches!(compose_one(&mut compositor, &view), Err(RenderError::Invalid(_))));
    // The rest of them, and it is one set again.
    let rest = SampleSet { info: Arc::clone(&other.info), samples: set.samples.clone() };
    compositor.hold(&rest).unwrap();
    let frame = compose_one(&mut compositor, &view).unwrap();
    assert_eq!(frame.provenance.state.epoch, 4);
    assert_eq!(frame.provenance.scene, set.info.scene);
    assert_eq!(frame.provenance.plan, view.plan);
    assert_eq!(frame.provenance.device, compositor.device());
}

/// The sample with one plane's bytes changed.
fn with_plane(sample: &Sample, kind: PlaneKind, change: impl Fn(&mut Vec<u8>)) -> Arc<Sample> {
    let mut sample = sample.clone();
    for plane in sample.planes.iter_mut().filter(|p| p.kind == kind) {
        let PlaneData::Host(bytes) = &plane.data else { panic!() };
        let mut bytes = bytes.to_vec();
        change(&mut bytes);
        plane.data = PlaneData::Host(Bytes::from(bytes));
    }
    Arc::new(sample)
}

#[test]
fn ranges_that_are_no_numbers_leave_holes_and_nothing_else() {
    let mut set = garden_set(false);
    let poison = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, f32::MAX, 1e-45];
    for sample in &mut set.samples {
        *sample = with_plane(sample, PlaneKind::InverseRange, |bytes| {
            for (i, texel) in bytes.chunks_exact_mut(4).enumerate().filter(|(i, _)| i % 37 == 0) {
                texel.copy_from_slice(&poison[i / 37 % poison.len()].to_le_bytes());
            }
        });
    }
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        let view = job(&set, Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO), [100, 75], search);
        let frame = compose_one(&mut compositor, &view).unwrap();
        let judged = judge(&Analytic::garden(), &view, &frame, 0.05);
        println!("{search:?} {judged:?}");
        assert!(judged.color < 12.0, "{search:?} {judged:?}");
    }
}

#[test]
fn malformed_samples_are_refused_and_change_nothing() {
    let set = garden_set(true);
    let mut compositor = compositor(&set);
    let view = job(&set, Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO), [30, 20], Search::Splat);
    let before = compose_one(&mut compositor, &view).unwrap();
    let refuse = |compositor: &mut GpuCompositor, change: &dyn Fn(&mut Sample)| {
        let mut sample = (*set.samples[1]).clone();
        change(&mut sample);
        let samples = vec![Arc::clone(&set.samples[0]), Arc::new(sample)];
        let refused = compositor.hold(&SampleSet { info: Arc::clone(&set.info), samples });
        assert!(matches!(refused, Err(RenderError::Invalid(_))), "{refused:?}");
    };
    refuse(&mut compositor, &|s| drop(s.planes.remove(0)));
    refuse(&mut compositor, &|s| drop(s.planes.remove(1)));
    refuse(&mut compositor, &|s| drop(s.planes.remove(3)));
    refuse(&mut compositor, &|s| s.planes[0].size = [99, 75]);
    refuse(&mut compositor, &|s| s.planes[0].format = argus_scene::PlaneFormat::R32Float);
    refuse(&mut compositor, &|s| s.planes[1].data = PlaneData::Host(Bytes::from_static(&[0; 16])));
    refuse(&mut compositor, &|s| s.planes.push(s.planes[0].clone()));
    refuse(&mut compositor, &|s| {
        let SampleCamera::Perspective { camera, .. } = &mut s.camera else { panic!() };
        camera.eye.x = f64::NAN;
    });
    assert_eq!(compositor.held(), 4);
    assert_eq!(bytes_of(&before), bytes_of(&compose_one(&mut compositor, &view).unwrap()));
}

#[test]
fn more_samples_than_memory_are_refused() {
    let set = garden_set(false);
    let settings =
        CompositorSettings { max_sample_bytes: 100 * 75 * 15 * 3, ..CompositorSettings::default() };
    let mut compositor = GpuCompositor::with_settings(gpu(), settings).unwrap();
    assert!(matches!(compositor.hold(&set), Err(RenderError::OutOfMemory(_))));
    assert_eq!(compositor.held(), 0);
    let three = SampleSet { info: Arc::clone(&set.info), samples: set.samples[..3].to_vec() };
    compositor.hold(&three).unwrap();
    // Replacing needs no more.
    compositor.hold(&three).unwrap();
    assert_eq!(compositor.held(), 3);
}

#[test]
fn pools_grow_and_shrink_and_keep_what_they_hold() {
    let set = garden_set(false);
    let mut compositor = compositor(&set);
    let view = job(&set, Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO), [30, 20], Search::Splat);
    let before = compose_one(&mut compositor, &view).unwrap();
    let extra: Vec<Arc<Sample>> =
        (10..30).map(|i| Arc::new(Sample { id: id(i), ..(*set.samples[2]).clone() })).collect();
    let ids: Vec<_> = extra.iter().map(|s| s.id).collect();
    compositor.hold(&SampleSet { info: Arc::clone(&set.info), samples: extra }).unwrap();
    assert_eq!(bytes_of(&before), bytes_of(&compose_one(&mut compositor, &view).unwrap()));
    compositor.release(&ids);
    assert_eq!(bytes_of(&before), bytes_of(&compose_one(&mut compositor, &view).unwrap()));
    compositor.release(&[id(0), id(1), id(2), id(3)]);
    assert_eq!(compositor.held(), 0);
    compositor.hold(&set).unwrap();
    assert_eq!(bytes_of(&before), bytes_of(&compose_one(&mut compositor, &view).unwrap()));
}

#[test]
fn views_are_the_same_while_a_pool_grows_a_few_layers_at_a_time() {
    let set = garden_set(false);
    let mut compositor = compositor(&set);
    let view = job(&set, Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO), [30, 20], Search::Splat);
    let before = bytes_of(&compose_one(&mut compositor, &view).unwrap());
    let one = |sample| SampleSet { info: Arc::clone(&set.info), samples: vec![Arc::new(sample)] };
    // From 4 layers to 8, 16, 32 and on the way to 64, whatever of it is done when the view's own samples come anew, the
    // third as another one for a while.
    for i in 0..30 {
        compositor.hold(&one(Sample { id: id(10 + i), ..(*set.samples[2]).clone() })).unwrap();
        let own = &set.samples[i as usize % 4];
        compositor.hold(&one((**own).clone())).unwrap();
        assert_eq!(before, bytes_of(&compose_one(&mut compositor, &view).unwrap()), "with {i} more");
        let other = Sample { id: id(2), ..(*set.samples[3]).clone() };
        compositor.hold(&one(other)).unwrap();
        assert_ne!(before, bytes_of(&compose_one(&mut compositor, &view).unwrap()), "with {i} more");
        compositor.hold(&one((*set.samples[2]).clone())).unwrap();
        assert_eq!(before, bytes_of(&compose_one(&mut compositor, &view).unwrap()), "with {i} more");
    }
}

#[test]
fn the_pass_plan_says_which_passes_run_and_why() {
    let on = |glossy: bool, search| {
        let set = garden_set(glossy);
        let compositor = compositor(&set);
        let view = job(&set, Camera::look_at(DVec3::ONE, DVec3::ZERO), [30, 20], search);
        let rows = compositor.plan(&view).unwrap();
        assert!(rows.iter().all(|row| !row.why.is_empty()));
        rows.into_iter().filter(|row| row.on).map(|row| row.name).collect::<Vec<_>>()
    };
    assert!(on(true, Search::Splat).contains(&"specular"));
    assert!(!on(false, Search::Splat).contains(&"specular"));
    assert!(on(false, Search::Linear).contains(&"search views"));
    assert!(!on(false, Search::Linear).contains(&"splat samples"));
    assert!(on(false, Search::Seeded).contains(&"splat samples"));
    assert!(on(false, Search::Pyramid).contains(&"make pyramid"));
    assert!(!on(false, Search::Linear).contains(&"make pyramid"));
}
