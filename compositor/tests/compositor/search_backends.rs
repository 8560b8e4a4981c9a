//! The fragment and compute programs of each search write equal bytes, and autotuning finds the faster.

use crate::common;

use argus_compositor::{CompositorSettings, SearchBackend};
use argus_scene::{Camera, Cancel, Compositor as _, Output, Plan, SampleSet, Search, ViewJob, Warp};
use common::*;
use glam::DVec3;

fn pinholes(glossy: bool) -> SampleSet {
    let mut garden = Analytic::garden();
    garden.f0 = if glossy { 0.5 } else { 0.0 };
    let cameras = [(-8.0, -8.0), (8.0, -8.0), (-8.0, 8.0), (8.0, 8.0)]
        .map(|(x, z)| perspective(DVec3::new(x, 9.0, z), DVec3::ZERO, 75.0, 100, 75));
    sample_set(&garden, &cameras, glossy, 1)
}

fn cubes(glossy: bool) -> SampleSet {
    let mut garden = Analytic::garden();
    garden.f0 = if glossy { 0.5 } else { 0.0 };
    let cameras = [DVec3::new(-6.0, 6.5, -8.0), DVec3::new(-5.0, 7.5, -10.0)].map(|center| cube(center, 64));
    sample_set(&garden, &cameras, glossy, 1)
}

/// Views of odd sizes, alone and with sub-pixels, from a place that does not see everything.
fn views(set: &SampleSet, search: Search) -> Vec<ViewJob> {
    let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
    let sizes = [([1, 1], 1), ([97, 61], 1), ([33, 7], 2), ([20, 31], 3), ([129, 1], 1)];
    sizes
        .map(|(size, supersampling)| {
            let mut view = job(set, camera, size, search);
            let Plan::Warp(warp) = &mut view.plan else { panic!("a warp") };
            *warp = Warp { supersampling, ..warp.clone() };
            // Every other with confidence, so that targets of both kinds are written.
            let outputs = if size[0] % 3 == 1 { EVERYTHING.with(Output::Confidence) } else { EVERYTHING };
            ViewJob { outputs, ..view }
        })
        .to_vec()
}

#[test]
fn the_fragment_and_compute_programs_of_every_search_write_equal_bytes() {
    for set in [pinholes(false), pinholes(true), cubes(false), cubes(true)] {
        let settings =
            |search_backend| CompositorSettings { search_backend, ..CompositorSettings::default() };
        let mut fragment = compositor_with(&set, settings(SearchBackend::Fragment));
        let mut compute = compositor_with(&set, settings(SearchBackend::Compute));
        for search in Search::ALL {
            let views = views(&set, search);
            let a = fragment.compose(&views, &Cancel::new());
            let b = compute.compose(&views, &Cancel::new());
            for ((a, b), view) in a.iter().zip(&b).zip(&views) {
                let (a, b) = (a.as_ref().unwrap(), b.as_ref().unwrap());
                let what = format!("{search:?} {}×{}", view.width, view.height);
                assert!(a.images[Output::Color] == b.images[Output::Color], "{what}: colour differs");
                assert!(a.images[Output::Range] == b.images[Output::Range], "{what}: range differs");
                assert!(a.images[Output::Mask] == b.images[Output::Mask], "{what}: mask differs");
                assert!(a.images[Output::Source] == b.images[Output::Source], "{what}: source differs");
                assert!(
                    a.images[Output::Confidence] == b.images[Output::Confidence],
                    "{what}: confidence differs"
                );
                assert_eq!(a.served, b.served, "{what}");
            }
        }
    }
}

#[test]
fn the_faster_program_is_chosen_on_real_batches_and_frames_stay_equal() {
    let set = pinholes(false);
    let mut compositor = compositor(&set);
    let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
    let view = job(&set, camera, [200, 150], Search::Splat);
    let mut colors = Vec::new();
    for _ in 0..8 {
        assert_eq!(compositor.search_backend(Search::Splat), None);
        colors.push(compose_one(&mut compositor, &view).unwrap().images[Output::Color].clone());
    }
    assert!(colors.iter().all(|color| *color == colors[0]));
    assert!(matches!(
        compositor.search_backend(Search::Splat),
        Some(SearchBackend::Fragment | SearchBackend::Compute)
    ));
    assert_eq!(compositor.search_backend(Search::Linear), None, "each search is tried for itself");
}
