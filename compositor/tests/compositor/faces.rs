//! Plans that use some faces of their samples.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::sync::Arc;

use argus_scene::{
    Camera, Compositor as _, FaceMask, Frame, Plan, PlaneData, RenderError, Sample, SampleSet, Search,
    ViewJob,
};
use glam::DVec3;

use crate::common::*;

const FACE: u32 = 64;

fn mask(bits: u32) -> FaceMask {
    FaceMask::new(bits, "faces").unwrap()
}

/// The sample as it is where only these faces were rendered.
fn with_faces(sample: &Sample, faces: FaceMask) -> Sample {
    let mut sample = Sample { faces, ..sample.clone() };
    for plane in &mut sample.planes {
        let PlaneData::Host(bytes) = &plane.data else { panic!("on the host") };
        let (mut bytes, texel) = (bytes.to_vec(), plane.format.texel_bytes());
        for (i, bytes) in bytes.chunks_exact_mut(texel).enumerate() {
            let [x, y] = [i as u32 % plane.size[0], i as u32 / plane.size[0]].map(|at| (at / FACE) as usize);
            if !faces.has(y * 3 + x) {
                bytes.fill(0);
            }
        }
        plane.data = PlaneData::Host(bytes.into());
    }
    sample
}

/// The view with a plan that uses these faces of the first sample.
fn using(job: &ViewJob, faces: FaceMask) -> ViewJob {
    let mut job = job.clone();
    let Plan::Warp(warp) = &mut job.plan else { panic!("a warp") };
    warp.faces = [(0, faces)].into_iter().collect();
    job
}

fn wide(eye: DVec3, towards: DVec3) -> Camera {
    Camera { fov_deg: 100.0, ..Camera::look_at(eye, eye + towards) }
}

/// Everything of a frame that a plan decides.
fn bytes_of(frame: Frame) -> impl PartialEq {
    (frame.images, frame.unresolved_fraction.to_bits())
}

#[test]
fn faces_outside_the_mask_are_unseen_and_never_sky() {
    let shell = Analytic::shell(5.0);
    let set = sample_set(&shell, &[cube(DVec3::ZERO, FACE)], false, 1);
    let front =
        SampleSet { samples: vec![Arc::new(with_faces(&set.samples[0], FaceMask::only(0)))], ..set.clone() };
    let mut compositor = compositor(&front);
    for search in Search::ALL {
        let at = |towards| {
            using(&job(&set, wide(DVec3::new(0.1, 0.05, -0.1), towards), [80, 60], search), mask(1))
        };
        let mut judged = |towards| {
            let view = at(towards);
            let frame = compose_one(&mut compositor, &view).unwrap();
            judge(&shell, &view, &frame, 0.05)
        };
        let ahead = judged(DVec3::X);
        assert!((0.1..0.9).contains(&ahead.unresolved), "{search:?}: a part lies in other faces: {ahead:?}");
        assert!(ahead.bad_range < 0.01 && ahead.sky == 0.0, "{search:?} {ahead:?}");
        for towards in [DVec3::NEG_X, DVec3::new(-1.0, 1.0, 1.0)] {
            let behind = judged(towards);
            assert_eq!((behind.unresolved, behind.sky), (1.0, 0.0), "{search:?} {towards}");
        }
    }
}

#[test]
fn the_sky_in_a_face_of_the_mask_is_sky() {
    let garden = Analytic::garden();
    let eye = DVec3::new(0.0, 4.0, 0.0);
    let set = sample_set(&garden, &[cube(eye, FACE)], false, 1);
    let above = FaceMask::only(2);
    let top = SampleSet { samples: vec![Arc::new(with_faces(&set.samples[0], above))], ..set.clone() };
    let mut compositor = compositor(&top);
    for search in Search::ALL {
        let up = Camera { up: DVec3::X, fov_deg: 40.0, ..Camera::look_at(eye, eye + DVec3::Y) };
        let view = using(&job(&set, up, [40, 30], search), above);
        let frame = compose_one(&mut compositor, &view).unwrap();
        let judged = judge(&garden, &view, &frame, 0.05);
        assert_eq!((judged.sky, judged.unresolved), (1.0, 0.0), "{search:?}");
    }
}

#[test]
fn what_one_sample_does_not_see_another_fills() {
    let shell = Analytic::shell(5.0);
    let set = sample_set(&shell, &[cube(DVec3::ZERO, FACE), cube(DVec3::splat(0.4), FACE)], false, 1);
    let first = Arc::new(with_faces(&set.samples[0], FaceMask::only(0)));
    let held = SampleSet { samples: vec![first, set.samples[1].clone()], ..set.clone() };
    let mut compositor = compositor(&held);
    for search in Search::ALL {
        for towards in [DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::NEG_Z] {
            let view = using(&job(&set, wide(DVec3::splat(0.1), towards), [80, 60], search), mask(1));
            let frame = compose_one(&mut compositor, &view).unwrap();
            let judged = judge(&shell, &view, &frame, 0.05);
            assert!(
                judged.unresolved <= 0.002 && judged.bad_range <= 0.02,
                "{search:?} {towards} {judged:?}"
            );
        }
    }
}

#[test]
fn a_sample_that_has_more_faces_gives_the_same_frame() {
    let garden = Analytic::garden();
    let at = DVec3::new(0.3, 3.0, 0.2);
    let set = sample_set(&garden, &[cube(at, FACE)], false, 1);
    let used = mask(0b10_1001);
    let partial = SampleSet { samples: vec![Arc::new(with_faces(&set.samples[0], used))], ..set.clone() };
    let (mut whole, mut partial) = (compositor(&set), compositor(&partial));
    for search in Search::ALL {
        for towards in [DVec3::new(1.0, -0.5, -0.8), DVec3::new(-1.0, -0.1, 0.3)] {
            let view = using(&job(&set, wide(at + 0.3, towards), [80, 60], search), used);
            let [a, b] = [&mut whole, &mut partial].map(|held| bytes_of(compose_one(held, &view).unwrap()));
            assert!(a == b, "{search:?} {towards}");
        }
    }
}

#[test]
fn a_view_along_an_edge_or_a_corner_needs_only_the_faces_around_it() {
    let garden = Analytic::garden();
    let at = DVec3::new(0.3, 3.0, 0.2);
    let set = sample_set(&garden, &[cube(at, FACE)], false, 1);
    let mut compositor = compositor(&set);
    for towards in [DVec3::new(1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, -1.0), DVec3::new(-1.0, -1.0, 1.0)] {
        let used = FaceMask::around(&set.samples[0].camera, towards);
        assert_eq!(used.bits().count_ones() as f64, towards.length_squared(), "faces at an edge or a corner");
        for search in Search::ALL {
            let narrow = Camera { fov_deg: 4.0, ..Camera::look_at(at, at + towards) };
            let view = job(&set, narrow, [80, 60], search);
            let all = compose_one(&mut compositor, &view).unwrap();
            let some = compose_one(&mut compositor, &using(&view, used)).unwrap();
            assert!(bytes_of(all) == bytes_of(some), "{search:?} {towards}");
        }
    }
}

#[test]
fn a_plan_that_uses_faces_which_the_sample_lacks_is_refused() {
    let shell = Analytic::shell(5.0);
    let set = sample_set(&shell, &[cube(DVec3::ZERO, FACE)], false, 1);
    let front = Arc::new(with_faces(&set.samples[0], mask(0b11)));
    let mut compositor = compositor(&SampleSet { samples: vec![front], ..set.clone() });
    let view = job(&set, wide(DVec3::ZERO, DVec3::X), [20, 15], Search::Splat);
    for faces in [FaceMask::ALL, mask(0b101)] {
        let refused = compose_one(&mut compositor, &using(&view, faces)).map(drop);
        assert!(matches!(refused, Err(RenderError::MissingSample(missing)) if missing == id(0)));
    }
    let Err(RenderError::Invalid(refused)) = compose_one(&mut compositor, &using(&view, FaceMask::NONE))
    else {
        panic!("a mask of no face must be refused");
    };
    assert_eq!(refused.field, "plan.faces");
    // Once it is extended, the plan can be followed.
    compositor.hold(&set).unwrap();
    assert!(compose_one(&mut compositor, &view).is_ok());
}
