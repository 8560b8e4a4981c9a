//! Views from frames: computed on the processor, by the method of the device's programs, from frames of any sizes.

use crate::common;

use std::sync::Arc;

use argus_compositor::{CompositorSettings, GpuCompositor, SearchBackend};
use argus_scene::tone::display_from_radiance;
use argus_scene::{
    Camera, Cancel, Compositor as _, Frame, FrameSource, Images, Output, Plan, Provenance, SampleId,
    SampleSet, SampleSetInfo, SceneHash, SceneState, Search, Specification, Version, ViewJob, Warp,
};
use common::*;
use glam::{DVec2, DVec3};

/// What a direct frame of the garden shows.
fn frame(garden: &Analytic, source: &FrameSource) -> Frame {
    let (mut color, mut range) = (Vec::new(), Vec::new());
    for pixel in 0..source.width * source.height {
        let at = DVec2::new(f64::from(pixel % source.width) + 0.5, f64::from(pixel / source.width) + 0.5);
        let direction = source.camera.direction(at, source.width, source.height);
        color.extend(display_from_radiance(
            garden.radiance(source.camera.eye, direction),
            garden.lighting.exposure,
        ));
        let metres = garden.see(source.camera.eye, direction).map_or(f32::INFINITY, |(t, _)| t as f32);
        range.extend(metres.to_le_bytes());
    }
    let mut provenance = Provenance::of_plan(SceneHash([7; 32]), SceneState::default(), source.plan());
    let exposure = garden.lighting.exposure;
    provenance.specification = Some(Specification { exposure, ..Specification::default() });
    let images = Images::from([(Output::Color, color.into()), (Output::Range, range.into())]);
    Frame { images, ..Frame::without_images(source.width, source.height, provenance) }
}

fn eye(x: f64) -> Camera {
    Camera::look_at(DVec3::new(x, 4.0, -9.0), DVec3::new(0.0, 1.0, 0.0))
}

/// A frame of this size, whose image plane is wider by as much as the size is than 100×75.
fn source(x: f64, width: u32, height: u32) -> FrameSource {
    let usual = eye(x);
    let wider = f64::from(height) / 75.0;
    let fov_deg = 2.0 * (wider * (usual.fov_deg.to_radians() / 2.0).tan()).atan().to_degrees();
    FrameSource {
        camera: Camera { fov_deg, ..usual },
        width,
        height,
        samples_per_pixel: 1,
        band_rows: 0,
        light: None,
    }
}

/// The set of some frames.
fn frames(sources: &[FrameSource]) -> SampleSet {
    let garden = Analytic::garden();
    let plain = sample_set(&garden, &[], false, 1);
    let version = Version { number: SampleId::FRAMES, ..plain.info.version };
    let info = Arc::new(SampleSetInfo { version, ..(*plain.info).clone() });
    let sample = |source: &FrameSource| {
        Arc::new(source.sample(&frame(&garden, source)).expect("it has colour and range"))
    };
    SampleSet { info, samples: sources.iter().map(sample).collect() }
}

fn view(set: &SampleSet, x: f64) -> ViewJob {
    ViewJob { outputs: EVERYTHING, ..job(set, eye(x), [100, 75], Search::Splat) }
}

fn with(set: &SampleSet, search_backend: SearchBackend) -> GpuCompositor {
    compositor_with(set, CompositorSettings { search_backend, ..CompositorSettings::default() })
}

/// Mean difference of two colours, of 255.
fn difference(a: &Frame, b: &Frame) -> f64 {
    let [a, b] = [a, b].map(|frame| frame.images[Output::Color].clone().expect("colour was asked for"));
    let sum: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    sum / a.len() as f64
}

fn truth(x: f64) -> Frame {
    frame(&Analytic::garden(), &source(x, 100, 75))
}

#[test]
fn the_processor_finds_what_the_programs_of_the_device_find() {
    let set = frames(&[source(-0.3, 125, 94), source(0.3, 125, 94)]);
    let (mut host, mut device) = (with(&set, SearchBackend::Auto), with(&set, SearchBackend::Fragment));
    for (x, supersampling) in [(0.0, 1), (0.1, 1), (-0.25, 1), (0.05, 2)] {
        let mut view = ViewJob { outputs: EVERYTHING.with(Output::Confidence), ..view(&set, x) };
        let Plan::Warp(warp) = &mut view.plan else { panic!("a warp") };
        *warp = Warp { supersampling, ..warp.clone() };
        let [a, b] = [&mut host, &mut device].map(|by| compose_one(by, &view).unwrap());
        assert!(difference(&a, &b) < 0.5, "{x}: colours differ by {}", difference(&a, &b));
        let differ = |output: Output, most: usize| {
            let [a, b] = [&a, &b].map(|frame| frame.images[output].clone().unwrap());
            let count = a.iter().zip(&b).filter(|(a, b)| a.abs_diff(**b) > 2).count();
            assert!(count * 100 <= most * a.len(), "{x}: {count} bytes of {output:?} differ");
        };
        differ(Output::Mask, 1);
        differ(Output::Source, 2);
        differ(Output::Confidence, 3);
        assert!(difference(&a, &truth(x)) < 3.0, "{x}: off by {}", difference(&a, &truth(x)));
        assert!(a.served.unresolved < 100, "{x}: {:?}", a.served);
    }
}

#[test]
fn frames_of_several_sizes_serve_one_view_on_every_device() {
    let set = frames(&[source(-0.2, 100, 75), source(0.1, 125, 94), source(0.4, 157, 118)]);
    let view = view(&set, 0.0);
    let [a, b] = [SearchBackend::Auto, SearchBackend::Compute]
        .map(|backend| compose_one(&mut with(&set, backend), &view).unwrap());
    assert_eq!(a.images[Output::Color], b.images[Output::Color]);
    assert_eq!(a.images[Output::Range], b.images[Output::Range]);
    assert!(difference(&a, &truth(0.0)) < 3.0, "off by {}", difference(&a, &truth(0.0)));
    let used = a.images[Output::Source].clone().unwrap();
    assert!((1..=3).all(|source| used.contains(&source)), "each of three frames serves some pixels");
}

#[test]
fn a_view_has_equal_bytes_whatever_else_is_in_its_batch() {
    let set = frames(&[source(-0.2, 100, 75), source(0.1, 125, 94), source(0.4, 157, 118)]);
    let mut compositor = with(&set, SearchBackend::Auto);
    let views: Vec<ViewJob> = (0..5u32)
        .map(|i| ViewJob { width: 90 + 7 * i, height: 61 + i, ..view(&set, -0.1 + 0.07 * f64::from(i)) })
        .collect();
    let together = compositor.compose(&views, &Cancel::new());
    for (view, together) in views.iter().zip(together) {
        let (alone, together) = (compose_one(&mut compositor, view).unwrap(), together.unwrap());
        assert_eq!(alone.images, together.images);
        assert_eq!(alone.served, together.served);
    }
}

#[test]
fn every_other_search_serves_frames_too_and_changes_no_byte_of_a_splat() {
    let set = frames(&[source(-0.3, 125, 94), source(0.3, 125, 94)]);
    let mut compositor = with(&set, SearchBackend::Auto);
    let splatted = view(&set, 0.0);
    let before = compose_one(&mut compositor, &splatted).unwrap();
    for search in Search::ALL.into_iter().filter(|search| *search != Search::Splat) {
        let other = ViewJob { outputs: EVERYTHING, ..job(&set, eye(0.0), [100, 75], search) };
        let found = compose_one(&mut compositor, &other).unwrap();
        assert!(
            difference(&found, &truth(0.0)) < 6.0,
            "{search:?}: off by {}",
            difference(&found, &truth(0.0))
        );
    }
    assert_eq!(compose_one(&mut compositor, &splatted).unwrap().images, before.images);
}

#[test]
fn a_dense_frame_is_read_at_the_level_of_the_view() {
    let dense = FrameSource { width: 800, height: 600, ..source(0.0, 100, 75) };
    let set = frames(&[dense]);
    let [host, device] = [SearchBackend::Auto, SearchBackend::Fragment]
        .map(|backend| compose_one(&mut with(&set, backend), &view(&set, 0.05)).unwrap());
    assert!(difference(&host, &device) < 0.7, "colours differ by {}", difference(&host, &device));
}
