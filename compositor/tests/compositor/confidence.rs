//! How sure a frame is of its pixels, and how many each way served.

use crate::common;

use argus_scene::{
    Camera, Cancel, Compositor as _, Output, Plan, SampleCamera, SampleSet, Search, ViewJob, Warp,
};
use common::*;
use glam::DVec3;

fn corners() -> Vec<SampleCamera> {
    [(-8.0, -8.0), (8.0, -8.0), (-8.0, 8.0), (8.0, 8.0)]
        .map(|(x, z)| perspective(DVec3::new(x, 9.0, z), DVec3::ZERO, 75.0, 200, 150))
        .to_vec()
}

fn sure(set: &SampleSet, search: Search) -> ViewJob {
    let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
    let job = job(set, camera, [101, 75], search);
    ViewJob { outputs: EVERYTHING.with(Output::Confidence), ..job }
}

fn with(view: &ViewJob, change: impl Fn(&mut Warp)) -> ViewJob {
    let mut view = view.clone();
    let Plan::Warp(warp) = &mut view.plan else { panic!("a warp") };
    change(warp);
    view
}

#[test]
fn confidence_is_zero_where_no_sample_saw_a_pixel_and_nowhere_else() {
    let garden = Analytic::garden();
    let set = sample_set(&garden, &corners(), false, 1);
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        for supersampling in [1, 2] {
            // Two samples, so that something is hidden.
            let view = with(&sure(&set, search), |warp| {
                warp.supersampling = supersampling;
                warp.samples.truncate(2);
            });
            let frame = compose_one(&mut compositor, &view).unwrap();
            let (mask, confidence) = (
                frame.images[Output::Mask].as_ref().unwrap(),
                frame.images[Output::Confidence].as_ref().unwrap(),
            );
            assert_eq!(confidence.len(), 101 * 75);
            for (mask, confidence) in mask.iter().zip(confidence) {
                assert_eq!(*mask == 255, *confidence == 0);
            }
            let plain = ViewJob { outputs: EVERYTHING, ..view };
            let plain = compose_one(&mut compositor, &plain).unwrap();
            assert!(plain.images[Output::Confidence].is_none());
            assert!(
                (&plain.images[Output::Color], &plain.images[Output::Range], &plain.images[Output::Source])
                    == (
                        &frame.images[Output::Color],
                        &frame.images[Output::Range],
                        &frame.images[Output::Source]
                    ),
                "{search:?}: asking for confidence shows"
            );
        }
    }
}

#[test]
fn a_second_sample_with_the_same_surface_sets_the_highest_bit() {
    let garden = Analytic::garden();
    let set = sample_set(&garden, &corners(), false, 1);
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        let surfaces = |frame: &argus_scene::Frame| -> Vec<u8> {
            let pixels = frame.images[Output::Confidence]
                .as_ref()
                .unwrap()
                .iter()
                .zip(frame.images[Output::Source].as_ref().unwrap());
            pixels.filter(|(_, source)| **source > 0).map(|(confidence, _)| *confidence).collect()
        };
        let alone = with(&sure(&set, search), |warp| warp.samples.truncate(1));
        let alone = surfaces(&compose_one(&mut compositor, &alone).unwrap());
        assert!(
            alone.len() > 1000 && alone.iter().all(|c| c & 128 == 0),
            "{search:?}: one sample agrees with itself"
        );
        let all = surfaces(&compose_one(&mut compositor, &sure(&set, search)).unwrap());
        let seconded = all.iter().filter(|c| *c & 128 != 0).count();
        assert!(seconded * 10 > all.len() * 9, "{search:?}: {seconded} of {} are seconded", all.len());
    }
}

#[test]
fn the_low_bits_fall_with_the_difference_between_the_depth_and_the_samples_own() {
    let garden = Analytic::garden();
    let cameras = corners();
    let set = sample_set(&garden, &cameras, false, 1);
    let mut compositor = compositor(&set);
    let mean = |frame: &argus_scene::Frame| {
        let pixels = frame.images[Output::Confidence]
            .as_ref()
            .unwrap()
            .iter()
            .zip(frame.images[Output::Source].as_ref().unwrap());
        let surfaces: Vec<f64> =
            pixels.filter(|(_, source)| **source == 1).map(|(c, _)| f64::from(c & 127)).collect();
        surfaces.iter().sum::<f64>() / surfaces.len() as f64
    };
    // From the sample's own place the depth is its own; from elsewhere cells and texels do not coincide.
    let SampleCamera::Perspective { camera, width, height } = cameras[0] else { panic!() };
    let own = ViewJob { camera, width, height, ..sure(&set, Search::Splat) };
    let own = with(&own, |warp| warp.samples.truncate(1));
    let own = mean(&compose_one(&mut compositor, &own).unwrap());
    let far = with(&sure(&set, Search::Splat), |warp| warp.samples.truncate(1));
    let far = mean(&compose_one(&mut compositor, &far).unwrap());
    println!("{own} {far}");
    assert!(own > 126.0 && far < own - 2.0 && far > 64.0, "{own} {far}");
}

#[test]
fn the_counts_of_served_pixels_add_up_to_all_pixels() {
    let garden = Analytic::garden();
    let set = sample_set(&garden, &corners(), false, 1);
    let mut compositor = compositor(&set);
    let mut views = Vec::new();
    for search in Search::ALL {
        for (supersampling, samples) in [(1, 4), (3, 4), (1, 1), (1, 2)] {
            views.push(with(&sure(&set, search), |warp| {
                warp.supersampling = supersampling;
                warp.samples.truncate(samples);
            }));
        }
    }
    let frames = compositor.compose(&views, &Cancel::new());
    for (view, frame) in views.iter().zip(frames) {
        let frame = frame.unwrap();
        let served = frame.served;
        println!("{served:?}");
        assert_eq!(served.warped + served.other_sample + served.traced + served.unresolved, 101 * 75);
        let mask = frame.images[Output::Mask].clone().unwrap();
        assert_eq!(served.unresolved, mask.iter().filter(|m| **m == 255).count() as u64);
        assert_eq!(served.traced, 0);
        let Plan::Warp(warp) = &view.plan else { panic!("a warp") };
        if warp.search == Search::Splat && warp.samples.len() == 4 {
            assert!(served.other_sample > 0, "two samples leave their depth, the others fill in");
        }
        if warp.samples.len() == 1 {
            assert_eq!(served.other_sample, 0);
        }
    }
}
