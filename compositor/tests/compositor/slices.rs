//! Samples that are uploaded in slices, with other work in between.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use crate::common;

use std::sync::Arc;

use argus_compositor::{CompositorSettings, GpuCompositor};
use argus_scene::{Camera, Compositor as _, RenderError, Sample, SampleSet, Search, ViewJob};
use common::*;
use glam::DVec3;

/// Samples of the garden, and a view that all of them are in.
fn garden() -> (SampleSet, ViewJob) {
    let eyes = [(-8.0, 6.0, -8.0), (8.0, 6.0, -8.0), (8.0, 6.0, 8.0), (-8.0, 6.0, 8.0)];
    let cameras = eyes.map(|(x, y, z)| perspective(DVec3::new(x, y, z), DVec3::ZERO, 60.0, 100, 75));
    let set = sample_set(&Analytic { f0: 0.04, ..Analytic::garden() }, &cameras, true, 1);
    let view = job(&set, Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO), [30, 20], Search::Splat);
    (set, view)
}

/// A compositor that ends a slice at the first step after which it may.
fn impatient() -> GpuCompositor {
    let settings = CompositorSettings { slice_ms: 0.0, ..CompositorSettings::default() };
    GpuCompositor::with_settings(gpu(), settings).unwrap()
}

fn one(set: &SampleSet, sample: &Arc<Sample>) -> SampleSet {
    SampleSet { info: set.info.clone(), samples: vec![sample.clone()] }
}

fn composed(compositor: &mut GpuCompositor, view: &ViewJob) -> Vec<u8> {
    let frame = compose_one(compositor, view).unwrap();
    frame.images.iter().flat_map(|(_, image)| image.to_vec()).collect()
}

#[test]
fn a_sample_uploaded_in_slices_gives_the_frames_of_one_uploaded_at_once() {
    let (set, view) = garden();
    let expected = composed(&mut compositor(&set), &view);
    let mut compositor = impatient();
    let mut slices = 0;
    while !compositor.hold_slice(&set).unwrap() {
        slices += 1;
        assert!(slices < 1000, "a slice does nothing");
    }
    assert!(slices > 3, "{slices} slices");
    assert_eq!(composed(&mut compositor, &view), expected);
    assert!(compositor.hold_slice(&set).unwrap(), "what is held needs no slice");
}

#[test]
fn views_are_composed_and_other_samples_held_between_slices() {
    let (set, view) = garden();
    let mut compositor =
        compositor_with(&set, CompositorSettings { slice_ms: 0.0, ..CompositorSettings::default() });
    let expected = composed(&mut compositor, &view);
    let copy = |index, of: usize| Arc::new(Sample { id: id(index), ..(*set.samples[of]).clone() });
    // Two come in at a time, so that the pool grows under both, and the view's own are taken up anew in between.
    for i in 0..12 {
        let pair = [copy(100 + 2 * i, 1), copy(101 + 2 * i, 2)].map(|sample| one(&set, &sample));
        let mut held = [false; 2];
        for _ in 0..1000 {
            for (set, held) in pair.iter().zip(&mut held) {
                *held = *held || compositor.hold_slice(set).unwrap();
            }
            if held == [true; 2] {
                break;
            }
            assert_eq!(composed(&mut compositor, &view), expected, "with {i} pairs more");
        }
        assert_eq!(held, [true; 2]);
        let own = Arc::new((*set.samples[i as usize % 4]).clone());
        compositor.hold(&one(&set, &own)).unwrap();
        assert_eq!(composed(&mut compositor, &view), expected, "with {i} pairs more");
    }
    assert_eq!(compositor.held(), 4 + 24);
}

#[test]
fn a_view_that_needs_a_sample_at_once_gets_the_rest_of_it_done() {
    let (set, view) = garden();
    let expected = composed(&mut compositor(&set), &view);
    let mut compositor = impatient();
    assert!(!compositor.hold_slice(&set).unwrap());
    assert!(matches!(compose_one(&mut compositor, &view), Err(RenderError::MissingSample(_))));
    compositor.hold(&set).unwrap();
    assert_eq!(composed(&mut compositor, &view), expected);
}

#[test]
fn an_upload_that_is_abandoned_half_way_leaves_nothing() {
    let (set, view) = garden();
    let expected = composed(&mut compositor(&set), &view);
    let other = || Arc::new(Sample { id: id(50), ..(*set.samples[0]).clone() });
    let (mut needed, mut whole, sample) = (1, impatient(), other());
    while !whole.hold_slice(&one(&set, &sample)).unwrap() {
        needed += 1;
    }
    for is_released in [true, false] {
        // Memory for four samples and no more.
        let max_sample_bytes = 100 * 75 * 27 * 4;
        let settings =
            CompositorSettings { slice_ms: 0.0, max_sample_bytes, ..CompositorSettings::default() };
        let mut compositor = GpuCompositor::with_settings(gpu(), settings).unwrap();
        let sample = other();
        for _ in 1..needed {
            assert!(!compositor.hold_slice(&one(&set, &sample)).unwrap());
        }
        if is_released {
            compositor.release(&[sample.id]);
        }
        // Else nobody has it any more.
        drop(sample);
        assert_eq!(compositor.held(), 0);
        compositor.hold(&set).unwrap();
        assert_eq!((compositor.held(), composed(&mut compositor, &view)), (4, expected.clone()));
    }
}

#[test]
fn preparing_pipelines_changes_no_frame() {
    let (set, view) = garden();
    let expected = composed(&mut compositor(&set), &view);
    let mut compositor = compositor(&set);
    let mut pauses = 0;
    compositor.ready(&view, &mut || pauses += 1).unwrap();
    assert!(pauses > 10, "{pauses} pauses");
    assert_eq!(composed(&mut compositor, &view), expected);
    let unknown = job(&SampleSet { samples: Vec::new(), ..set }, view.camera, [30, 20], Search::Splat);
    assert!(compositor.ready(&unknown, &mut || {}).is_err());
}
