//! Views of scenes whose answer is known on paper, by every search.

use crate::common;

use argus_compositor::GpuCompositor;
use argus_scene::{
    Camera, Cancel, Compositor as _, Environment, Intrinsics, Lens, Output, Outputs, Plan, SampleCamera,
    SampleSet, Search, Sky, ViewJob,
};
use common::*;
use glam::{DVec2, DVec3};

pub(crate) fn corners(about: DVec3, size: [u32; 2]) -> Vec<SampleCamera> {
    [(-8.0, -8.0), (8.0, -8.0), (-8.0, 8.0), (8.0, 8.0)]
        .map(|(x, z)| perspective(about + DVec3::new(x, 9.0, z), about, 75.0, size[0], size[1]))
        .to_vec()
}

fn lattice(about: DVec3, spacing: f64, face: u32) -> Vec<SampleCamera> {
    (0..8)
        .map(|i| DVec3::new(f64::from(i & 1), f64::from((i >> 1) & 1), f64::from(i >> 2)) - 0.5)
        .map(|corner| cube(about + corner * spacing, face))
        .collect()
}

/// Bounds on what a view may get wrong. Silhouettes are a few per cent of these images' pixels, and cannot be
/// exact where texels of samples are as large as pixels.
#[track_caller]
fn assert_close(judged: Judged, bad_range: f64, color: f64, unresolved: f64) {
    assert!(judged.bad_range <= bad_range, "range: {judged:?}");
    assert!(judged.color <= color, "colour: {judged:?}");
    assert!(judged.unresolved <= unresolved, "unresolved: {judged:?}");
}

#[test]
fn every_search_shows_the_garden_as_it_is() {
    let garden = Analytic::garden();
    let set = sample_set(&garden, &corners(DVec3::ZERO, [400, 300]), false, 1);
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        let view = job(&set, Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO), [200, 150], search);
        let frame = compose_one(&mut compositor, &view).unwrap();
        let judged = judge(&garden, &view, &frame, 0.03);
        println!("{search:?} {judged:?}");
        assert_close(judged, 0.02, 1.5, 0.01);
        assert!(judged.sky > 0.1, "the horizon is in this view: {judged:?}");
    }
}

#[test]
fn every_search_shows_an_environment_map_behind_the_garden_and_in_its_gloss() {
    let texel = |i: u32| {
        let wave = |k: f32| 0.4 + 0.3 * ((i % 64) as f32 * k).sin();
        glam::Vec3::new(wave(0.1), wave(0.2), 0.9 - (i / 64) as f32 / 64.0)
    };
    let environment = Environment::new(64, 32, (0..64 * 32).map(texel).collect()).unwrap();
    assert!(environment.lights.is_empty());
    let sky = Sky::of_map(environment.map);
    for f0 in [0.0, 0.3] {
        let mut garden = Analytic { f0, ..Analytic::garden() };
        garden.lighting.sky = sky.clone();
        let set = sample_set(&garden, &corners(DVec3::ZERO, [400, 300]), f0 > 0.0, 1);
        let mut compositor = compositor(&set);
        for search in Search::ALL {
            let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::new(0.0, 2.0, 0.0));
            let view = job(&set, camera, [200, 150], search);
            let frame = compose_one(&mut compositor, &view).unwrap();
            let judged = judge(&garden, &view, &frame, 0.03);
            println!("{search:?} {judged:?}");
            assert_close(judged, 0.02, 1.5, 0.01);
            assert!(judged.sky > 0.1, "the horizon is in this view: {judged:?}");
        }
    }
}

#[test]
fn cubes_show_a_shell_all_around_across_seams_of_their_faces() {
    let shell = Analytic::shell(5.0);
    let set = sample_set(&shell, &lattice(DVec3::ZERO, 1.0, 64), false, 1);
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        for target in
            [DVec3::X, DVec3::NEG_X, DVec3::new(1.0, 1.0, 1.0), DVec3::new(0.1, -1.0, 0.1), DVec3::NEG_Z]
        {
            let eye = DVec3::new(0.2, 0.1, -0.15);
            let camera = Camera { fov_deg: 90.0, ..Camera::look_at(eye, eye + target) };
            let view = job(&set, camera, [80, 60], search);
            let frame = compose_one(&mut compositor, &view).unwrap();
            let judged = judge(&shell, &view, &frame, 0.03);
            println!("{search:?} {target} {judged:?}");
            assert_close(judged, 0.01, 1.5, 0.002);
            assert_eq!(judged.sky, 0.0, "a shell has no sky");
        }
    }
}

#[test]
fn off_centre_views_come_from_off_centre_samples() {
    let garden = Analytic::garden();
    let lens = |focal, center| Some(Lens::Intrinsics(Intrinsics::pinhole(focal, center)));
    let aside = corners(DVec3::ZERO, [400, 300]).into_iter().map(|sample| match sample {
        SampleCamera::Perspective { camera, width, height } => {
            let focal = f64::from(height) * 0.5 / camera.tan_half_fov(width, height).y;
            let center = DVec2::new(160.0, 190.0);
            let camera = Camera { lens: lens(DVec2::splat(0.8 * focal), center), ..camera };
            SampleCamera::Perspective { camera, width, height }
        }
        omni @ SampleCamera::Omni { .. } => omni,
    });
    let set = sample_set(&garden, &aside.collect::<Vec<_>>(), false, 1);
    let mut compositor = compositor(&set);
    let usual = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::new(0.0, 2.0, 0.0));
    for search in Search::ALL {
        // Pixels that are not square, and a principal point in a corner.
        let camera = Camera { lens: lens(DVec2::new(210.0, 190.0), DVec2::new(30.0, 110.0)), ..usual };
        let view = job(&set, camera, [200, 150], search);
        let frame = compose_one(&mut compositor, &view).unwrap();
        let judged = judge(&garden, &view, &frame, 0.03);
        println!("{search:?} {judged:?}");
        assert_close(judged, 0.02, 1.5, 0.01);
    }
}

#[test]
fn a_view_from_a_sample_camera_is_that_sample_to_a_colour_step() {
    let garden = Analytic::garden();
    let cameras = corners(DVec3::ZERO, [120, 90]);
    let set = sample_set(&garden, &cameras, false, 1);
    let mut compositor = compositor(&set);
    let SampleCamera::Perspective { camera, width, height } = cameras[0] else { panic!() };
    for search in Search::ALL {
        let view = job(&set, camera, [width, height], search);
        let frame = compose_one(&mut compositor, &view).unwrap();
        let (source, color) =
            (frame.images[Output::Source].as_ref().unwrap(), frame.images[Output::Color].as_ref().unwrap());
        let stored = &set.samples[0].planes[0].data;
        let argus_scene::PlaneData::Host(stored) = stored else { panic!() };
        let mut own = 0;
        for i in 0..(width * height) as usize {
            if source[i] != 1 {
                continue;
            }
            own += 1;
            let linear = radiance_of_rgb9e5(u32::from_le_bytes(stored[4 * i..4 * i + 4].try_into().unwrap()));
            let truth = argus_scene::tone::display_from_radiance(linear, garden.lighting.exposure);
            for c in 0..3 {
                let difference = color[3 * i + c].abs_diff(truth[c]);
                assert!(difference <= 1, "{search:?}: pixel {i} is off by {difference}");
            }
        }
        // Sky has no source, and at grazing angles a neighbour's texel may lie nearer by more than its handicap.
        assert!(own as f64 > 0.4 * f64::from(width * height), "{search:?}: only {own} pixels are its own");
        assert!(frame.unresolved_fraction < 0.001, "{}", frame.unresolved_fraction);
    }
}

#[test]
fn a_scene_at_a_million_metres_looks_like_one_at_zero() {
    let far = DVec3::new(1e6, -1e6, 1e6);
    let (here, there) = (Analytic::garden(), Analytic::garden().at(far));
    let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
    let moved = Camera { eye: camera.eye + far, target: camera.target + far, ..camera };
    for search in Search::ALL {
        let near_set = sample_set(&here, &corners(DVec3::ZERO, [200, 150]), false, 1);
        let away_set = sample_set(&there, &corners(far, [200, 150]), false, 1);
        let (mut near, mut away) = (compositor(&near_set), compositor(&away_set));
        let a = compose_one(&mut near, &job(&near_set, camera, [100, 75], search)).unwrap();
        let b = compose_one(&mut away, &job(&away_set, moved, [100, 75], search)).unwrap();
        let (a, b) = (a.images[Output::Color].clone().unwrap(), b.images[Output::Color].clone().unwrap());
        let differ = a.iter().zip(b.iter()).filter(|(a, b)| a.abs_diff(**b) > 2).count();
        assert!(differ * 100 < a.len(), "{search:?}: {differ} of {} bytes differ", a.len());
    }
}

#[test]
fn every_pose_and_size_is_answered_with_numbers() {
    let garden = Analytic::garden();
    let set = sample_set(&garden, &corners(DVec3::ZERO, [100, 75]), false, 1);
    let mut compositor = compositor(&set);
    let look = Camera::look_at;
    let down = |eye: DVec3| Camera { up: DVec3::X, ..look(eye, eye - DVec3::Y) };
    let cameras = [
        ("inside the rig", look(DVec3::new(0.5, 3.0, 0.5), DVec3::ZERO)),
        ("behind the rig", look(DVec3::new(-30.0, 30.0, -30.0), DVec3::ZERO)),
        ("inside a sphere", look(DVec3::new(0.0, 1.0, 0.1), DVec3::new(3.0, 1.0, 0.0))),
        ("on the ground", look(DVec3::new(5.0, 0.0, 5.0), DVec3::new(0.0, 0.0, 0.0))),
        ("under the ground", look(DVec3::new(5.0, -2.0, 5.0), DVec3::new(0.0, 0.0, 0.0))),
        ("along the ground", look(DVec3::new(-20.0, 0.0, 0.0), DVec3::ZERO)),
        (
            "on a face of the bounds, along it",
            look(DVec3::new(-10.0, 1.0, -10.0), DVec3::new(10.0, 1.0, -10.0)),
        ),
        ("straight down", down(DVec3::new(0.0, 9.0, 0.0))),
        ("straight down from a sample camera", down(DVec3::new(-8.0, 9.0, -8.0))),
        ("away from everything", look(DVec3::new(0.0, 5.0, 30.0), DVec3::new(0.0, 5.0, 60.0))),
        ("up", Camera { up: DVec3::X, ..look(DVec3::new(0.0, 2.5, 0.0), DVec3::new(0.0, 9.0, 0.0)) }),
        ("through a keyhole", Camera { fov_deg: 1.0, ..look(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO) }),
        ("all there is", Camera { fov_deg: 179.0, ..look(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO) }),
        ("from another continent", look(DVec3::new(1e7, 1e6, 0.0), DVec3::ZERO)),
        ("from a millimetre above", look(DVec3::new(0.0, 2.001, 0.0), DVec3::new(0.5, 0.0, 0.0))),
    ];
    for search in Search::ALL {
        for (name, camera) in cameras {
            for size in [[1, 1], [1, 97], [97, 1], [64, 48]] {
                let view = job(&set, camera, size, search);
                let frame = compose_one(&mut compositor, &view).unwrap_or_else(|e| panic!("{name}: {e}"));
                let judged = judge(&garden, &view, &frame, 0.05);
                if size == [64, 48] {
                    println!("{search:?} {name}: {judged:?}");
                }
                assert!(judged.color.is_finite());
                assert!((0.0..=1.0).contains(&frame.unresolved_fraction));
                if name == "away from everything" {
                    assert_eq!(judged.sky, 1.0, "{name}");
                }
            }
        }
    }
}

#[test]
fn a_highlight_is_where_this_viewer_sees_it() {
    let mut glossy = Analytic::garden();
    (glossy.f0, glossy.roughness) = (0.6, 0.25);
    let set = sample_set(&glossy, &corners(DVec3::ZERO, [400, 300]), true, 1);
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        for eye in [DVec3::new(-6.0, 7.0, -9.0), DVec3::new(7.0, 6.0, 8.0)] {
            let view = job(&set, Camera::look_at(eye, DVec3::ZERO), [100, 75], search);
            let frame = compose_one(&mut compositor, &view).unwrap();
            let judged = judge(&glossy, &view, &frame, 0.03);
            println!("{search:?} {eye} {judged:?}");
            assert_close(judged, 0.05, 3.0, 0.02);
            // The same samples without the lobe are far off: the highlight is in the image.
            let matt = Analytic { f0: 0.0, ..glossy.clone() };
            assert!(judge(&matt, &view, &frame, 0.03).color > 8.0, "{search:?}");
        }
    }
}

#[test]
fn sub_pixels_are_averaged_in_linear_radiance() {
    let garden = Analytic::garden();
    let set = sample_set(&garden, &corners(DVec3::ZERO, [400, 300]), false, 1);
    let mut compositor = compositor(&set);
    let camera = Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO);
    for search in Search::ALL {
        let mut view = job(&set, camera, [100, 75], search);
        let coarse = compose_one(&mut compositor, &view).unwrap();
        let Plan::Warp(warp) = &mut view.plan else { panic!() };
        warp.supersampling = 3;
        let fine = compose_one(&mut compositor, &view).unwrap();
        assert_eq!((fine.width, fine.height), (100, 75));
        let (a, b) = (judge(&garden, &view, &coarse, 0.03), judge(&garden, &view, &fine, 0.03));
        println!("{search:?} {a:?} {b:?}");
        // Away from silhouettes a smooth pattern's mean is its middle.
        assert_close(b, 0.03, 2.0, 0.01);
        assert_ne!(coarse.images[Output::Color], fine.images[Output::Color]);
    }
}

/// Ground with stripes that a coarse view cannot resolve.
struct Stripes(Analytic);

impl Subject for Stripes {
    fn see(&self, origin: DVec3, direction: DVec3) -> Option<(f64, argus_scene::shading::Surface)> {
        let (range, mut surface) = self.0.see(origin, direction)?;
        let bright = (surface.position.x * 30.0).sin() > 0.0;
        surface.albedo = glam::Vec3::splat(if bright { 0.9 } else { 0.05 });
        Some((range, surface))
    }

    fn bounds(&self) -> argus_scene::Bounds {
        self.0.bounds()
    }

    fn lighting(&self) -> argus_scene::Lighting {
        self.0.lighting()
    }
}

#[test]
fn a_view_that_is_coarser_than_its_samples_does_not_alias() {
    let stripes = Stripes(Analytic { spheres: Vec::new(), ..Analytic::garden() });
    // Spread of the middle of a view straight down on the ground, bytes.
    let spread = |size: [u32; 2], compositor: &mut GpuCompositor, set: &SampleSet, search: Search| {
        let eye = DVec3::new(0.1, 12.0, 0.1);
        let camera = Camera { up: DVec3::X, ..Camera::look_at(eye, eye - DVec3::Y) };
        let frame = compose_one(compositor, &job(set, camera, size, search)).unwrap();
        let color = frame.images[Output::Color].clone().unwrap();
        let middle: Vec<f64> = (size[1] / 4..3 * size[1] / 4)
            .flat_map(|y| (size[0] / 4..3 * size[0] / 4).map(move |x| (y * size[0] + x) as usize))
            .map(|i| f64::from(color[3 * i]))
            .collect();
        let mean = middle.iter().sum::<f64>() / middle.len() as f64;
        (middle.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / middle.len() as f64).sqrt()
    };
    let center = DVec3::new(0.0, 11.0, 0.0);
    let down = |camera: SampleCamera| match camera {
        SampleCamera::Perspective { camera, width, height } => {
            SampleCamera::Perspective { camera: Camera { up: DVec3::X, ..camera }, width, height }
        }
        omni => omni,
    };
    let pinhole = down(perspective(center, center - DVec3::Y, 75.0, 400, 400));
    for cameras in [vec![pinhole], vec![cube(center, 320)]] {
        let set = sample_set(&stripes, &cameras, false, 1);
        let mut compositor = compositor(&set);
        for search in Search::ALL {
            let fine = spread([400, 400], &mut compositor, &set, search);
            let coarse = spread([40, 40], &mut compositor, &set, search);
            println!("{search:?}: {fine} {coarse}");
            assert!(fine > 50.0, "{search:?}: the stripes are there: {fine}");
            assert!(
                coarse < 0.5 * fine,
                "{search:?}: stripes of a third of a pixel alias: {coarse} of {fine}"
            );
        }
    }
}

#[test]
fn only_what_is_asked_for_is_answered() {
    let garden = Analytic::garden();
    let set = sample_set(&garden, &corners(DVec3::ZERO, [100, 75]), false, 1);
    let mut compositor = compositor(&set);
    let whole = job(&set, Camera::look_at(DVec3::new(-6.0, 7.0, -9.0), DVec3::ZERO), [50, 40], Search::Splat);
    let all = compose_one(&mut compositor, &whole).unwrap();
    let named = [Output::Color, Output::Range, Output::Mask, Output::Source];
    for output in named {
        let job = ViewJob { outputs: Outputs::only(output), ..whole.clone() };
        let frame = compose_one(&mut compositor, &job).unwrap();
        for other in named {
            assert_eq!(frame.images[other], all.images[other].clone().filter(|_| other == output));
        }
        assert_eq!(frame.unresolved_fraction, all.unresolved_fraction);
    }
}

#[test]
fn what_is_behind_an_edge_is_said_to_be_unresolved() {
    // One camera in front of a sphere; the view from the side looks at the ground that the sphere hid.
    let garden = Analytic { spheres: vec![(DVec3::new(0.0, 2.0, 0.0), 1.5)], ..Analytic::garden() };
    let cameras = [perspective(DVec3::new(0.0, 4.0, -8.0), DVec3::new(0.0, 1.0, 0.0), 70.0, 200, 150)];
    let set = sample_set(&garden, &cameras, false, 1);
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        let camera = Camera::look_at(DVec3::new(7.0, 5.0, -3.0), DVec3::new(0.0, 0.0, 3.0));
        let view = job(&set, camera, [100, 75], search);
        let frame = compose_one(&mut compositor, &view).unwrap();
        let judged = judge(&garden, &view, &frame, 0.05);
        println!("{search:?} {judged:?}");
        assert!(judged.unresolved > 0.02 && judged.unresolved < 0.4, "{search:?} {judged:?}");
        assert_eq!(frame.unresolved_fraction, judged.unresolved);
        // Searches that ask no camera what it sees before the surface that they found see through the side of the sphere that
        // no camera saw, to ground that one did; those that follow the ray take all that is behind the surface of every
        // camera for solid.
        let bad = if matches!(search, Search::Linear | Search::Pyramid) { 0.02 } else { 0.12 };
        assert!(judged.bad_range < bad, "{search:?} {judged:?}");
    }
}

#[test]
fn a_wall_is_not_seen_through_from_nearer_than_its_samples() {
    // An arm's length from a ball that one camera saw from afar: its texels lie some ten pixels apart in the view. The other
    // camera saw the ball's far side and the ground there, whose texels are as large as pixels.
    let ball = Analytic { spheres: vec![(DVec3::new(0.0, 3.0, 0.0), 3.0)], ..Analytic::garden() };
    let cameras = [
        perspective(DVec3::new(0.0, 4.0, -16.0), DVec3::new(0.0, 3.0, 0.0), 70.0, 400, 300),
        perspective(DVec3::new(0.0, 9.0, 8.0), DVec3::new(0.0, 2.0, 0.0), 70.0, 400, 300),
    ];
    let set = sample_set(&ball, &cameras, false, 1);
    let mut compositor = compositor(&set);
    for search in Search::ALL {
        let camera = Camera::look_at(DVec3::new(0.2, 3.1, -3.5), DVec3::new(0.0, 3.0, 0.0));
        let view = job(&set, camera, [100, 75], search);
        let frame = compose_one(&mut compositor, &view).unwrap();
        let judged = judge(&ball, &view, &frame, 0.03);
        println!("{search:?} {judged:?}");
        assert_eq!(judged.sky, 0.0, "the ball fills the view");
        assert!(judged.bad_range < 0.02 && judged.unresolved < 0.02, "{search:?} {judged:?}");
    }
}

#[test]
fn a_cancelled_batch_ends_without_frames() {
    let garden = Analytic::garden();
    let set = sample_set(&garden, &corners(DVec3::ZERO, [50, 40]), false, 1);
    let mut compositor = compositor(&set);
    let cancel = Cancel::new();
    cancel.cancel();
    let view = job(&set, Camera::look_at(DVec3::ONE, DVec3::ZERO), [20, 20], Search::Splat);
    let frames = compositor.compose(&[view.clone(), view], &cancel);
    assert!(frames.iter().all(|f| matches!(f, Err(argus_scene::RenderError::Cancelled))));
}
