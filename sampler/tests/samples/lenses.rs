//! Views by intrinsics, distorted, of fisheyes and equirectangular, against pinholes and the reference.

use std::sync::Arc;

use argus_scene::{Camera, Distortion, Frame, Intrinsics, Lens, Material, Plan, Scene, ViewJob, Visibility};
use glam::{DAffine3, DVec2, DVec3};

use crate::common::*;
use crate::{small_scene, transparency};

const SIZE: [u32; 2] = [128, 96];

fn camera() -> Camera {
    Camera { fov_deg: 50.0, ..Camera::look_at(DVec3::new(0.5, 2.4, 6.5), DVec3::new(0.0, 0.8, 0.0)) }
}

fn with(lens: Lens) -> Camera {
    Camera { lens: Some(lens), ..camera() }
}

fn intrinsics(focal: DVec2, center: DVec2, distortion: Distortion) -> Camera {
    with(Lens::Intrinsics(Intrinsics { focal, center, distortion }))
}

fn by(visibility: Visibility, camera: Camera, size: [u32; 2], samples_per_pixel: u32) -> ViewJob {
    ViewJob { visibility, ..view_job(camera, size, samples_per_pixel) }
}

/// Cameras of every kind.
fn lenses() -> Vec<(&'static str, Camera)> {
    let middle = DVec2::new(64.0, 48.0);
    let wide = [-0.32, 0.11, 1e-3, -2e-3, -0.01, 0.02, 0.0, 0.0];
    vec![
        ("off-centre", intrinsics(DVec2::new(150.0, 110.0), DVec2::new(20.5, 80.25), Distortion::None)),
        (
            "principal point outside",
            intrinsics(DVec2::splat(120.0), DVec2::new(-90.0, 40.0), Distortion::None),
        ),
        ("distorted", intrinsics(DVec2::new(90.0, 95.0), middle, Distortion::Rational(wide))),
        ("fisheye", intrinsics(DVec2::splat(32.0), middle, Distortion::Fisheye([0.02, -0.003, 1e-3, 0.0]))),
        ("equirectangular", with(Lens::Equirectangular)),
    ]
}

/// How many bytes differ by more than one.
fn colours_apart(a: &Frame, b: &Frame) -> usize {
    let (a, b) = (image_of(a), image_of(b));
    a.iter().zip(b.iter()).filter(|(a, b)| a.abs_diff(**b) > 1).count()
}

/// How many ranges differ by more than a share of 10⁻⁵.
fn ranges_apart(a: &[f32], b: &[f32]) -> usize {
    let apart = |(a, b): &(&f32, &f32)| !(a == b || (**a / **b - 1.0).abs() < 1e-5);
    a.iter().zip(b).inspect(|(a, _)| assert!(!a.is_nan())).filter(apart).count()
}

#[test]
fn intrinsics_of_square_pixels_about_the_middle_are_a_field_of_view_to_the_bit() {
    let scene = Arc::new(small_scene::scene());
    let mut sampler = sampler(&scene);
    let by_angle = Camera { fov_deg: 90.0, ..camera() };
    let by_focal = intrinsics(DVec2::splat(48.0), DVec2::new(64.0, 48.0), Distortion::None);
    for visibility in Visibility::ALL {
        let [a, b] = [by_angle, by_focal].map(|c| direct(&mut sampler, &by(visibility, c, SIZE, 4)));
        assert!(a.images == b.images, "{visibility:?}");
    }
}

#[test]
fn an_off_centre_view_is_a_crop_of_a_larger_one_by_every_backend() {
    let scene = Arc::new(small_scene::scene());
    let mut sampler = sampler(&scene);
    let focal = DVec2::splat(140.0);
    let whole = intrinsics(focal, DVec2::new(96.0, 64.0), Distortion::None);
    let ([left, top], [width, height]) = ([101, 23], [64, 56]);
    let part = intrinsics(focal, DVec2::new(96.0 - 101.0, 64.0 - 23.0), Distortion::None);
    for visibility in Visibility::ALL {
        let whole = direct(&mut sampler, &by(visibility, whole, [192, 128], 1));
        let part = direct(&mut sampler, &by(visibility, part, [width, height], 1));
        let (image, ranges) = (image_of(&whole), range_of(&whole));
        let crop = image::imageops::crop_imm(&image, left, top, width, height).to_image();
        let off = crop.iter().zip(image_of(&part).iter()).filter(|(a, b)| a.abs_diff(**b) > 1).count();
        let at = |i: u32| ((top + i / width) * 192 + left + i % width) as usize;
        let cropped: Vec<f32> = (0..width * height).map(|i| ranges[at(i)]).collect();
        let apart = ranges_apart(&cropped, &range_of(&part));
        println!("{visibility:?}: {off} bytes, {apart} ranges of {}", width * height);
        // Rays differ in their last bits, so edges may fall to either side.
        assert!(off < 3 * 12 && apart < 12, "{visibility:?}: {off} bytes, {apart} ranges");
    }
}

#[test]
fn every_lens_is_as_the_reference_has_it() {
    let scene = Arc::new(small_scene::scene());
    let mut sampler = sampler(&scene);
    for (name, camera) in lenses() {
        let frame = direct(&mut sampler, &view_job(camera, SIZE, 16));
        let truth = reference(&scene, &camera, SIZE, 16);
        let shown = truth.display(scene.lighting.exposure);
        let flip = flip(&format!("lens-{name}"), &image_of(&frame), &shown);
        let apart = ranges_apart(&range_of(&frame), &reference(&scene, &camera, SIZE, 1).range);
        println!("{name}: FLIP {flip:.5}, {apart} ranges apart {:?}", frame.stages);
        assert!(flip <= 0.01, "{name}: FLIP {flip}");
        assert!(apart <= 12, "{name}: {apart} ranges are not the reference's");
    }
}

#[test]
fn a_million_metres_away_every_lens_shows_the_same() {
    let far = DVec3::new(1e6, -1e6, 1e6);
    let here = small_scene::scene();
    let there = small_scene::moved(&here, far);
    let (here, there) = (Arc::new(here), Arc::new(there));
    let (mut near, mut away) = (sampler(&here), sampler(&there));
    for (name, camera) in lenses() {
        let moved = Camera { eye: camera.eye + far, target: camera.target + far, ..camera };
        let a = direct(&mut near, &view_job(camera, SIZE, 1));
        let b = direct(&mut away, &view_job(moved, SIZE, 1));
        let off = colours_apart(&a, &b);
        println!("{name}: {off} bytes");
        assert!(off < 3 * 60, "{name}: {off}");
    }
}

/// Depth along the axis of a view by intrinsics, by the f64 tracer's ray through K⁻¹ (u, v, 1).
#[test]
fn depths_of_intrinsics_are_those_of_rays_through_their_inverse() {
    let scene = Arc::new(small_scene::scene());
    let mut sampler = sampler(&scene);
    let tracer = argus_scene::reference::Tracer::new(Arc::clone(&scene));
    let (focal, center) = (DVec2::new(150.0, 110.0), DVec2::new(20.5, 80.25));
    let camera = intrinsics(focal, center, Distortion::None);
    let axes = camera.view_from_world().transpose();
    for visibility in Visibility::ALL {
        let ranges = range_of(&direct(&mut sampler, &by(visibility, camera, SIZE, 1)));
        let (mut seen, mut apart) = (0, 0);
        for (i, range) in ranges.iter().enumerate() {
            let at = DVec2::new((i % 128) as f64 + 0.5, (i / 128) as f64 + 0.5);
            let in_opencv = ((at - center) / focal).extend(1.0);
            let ray = axes * DVec3::new(in_opencv.x, -in_opencv.y, -in_opencv.z);
            let depth = f64::from(*range) / ray.length();
            let expected = tracer.trace(camera.eye, ray.normalize()).map(|hit| hit.range / ray.length());
            match expected {
                Some(expected) => {
                    seen += 1;
                    apart += usize::from((depth / expected - 1.0).abs() > 1e-5);
                }
                None => apart += usize::from(range.is_finite()),
            }
        }
        println!("{visibility:?}: {apart} of {seen} depths are apart");
        assert!(seen > 3000 && apart <= 12, "{visibility:?}: {apart} of {seen}");
    }
}

/// A wide plane of the points whose product with a normal is 4.
fn plane(normal: DVec3) -> Arc<Scene> {
    let mut scene = empty_scene();
    scene.materials = vec![Material { double_sided: true, ..Material::default() }];
    let center = (normal * 4.0 / normal.length_squared()).as_vec3();
    let (x, y) = normal.normalize().as_vec3().any_orthonormal_pair();
    place(&mut scene, quad(center, x * 400.0, y * 400.0, 1.0, 0), DAffine3::IDENTITY);
    Arc::new(scene)
}

/// Ranges of three planes say which direction a pixel looks in. By the model's own formula it belongs there.
#[test]
fn what_a_pixel_sees_is_shown_there_by_the_forward_projection() {
    let (focal, center) = (DVec2::new(60.0, 64.0), DVec2::new(62.3, 49.7));
    let models = [
        Distortion::None,
        Distortion::Rational([-0.25, 0.06, 2e-3, -1e-3, -5e-3, 0.0, 0.0, 0.0]),
        Distortion::Rational([0.9, 0.2, 3e-4, -2e-4, 0.01, 1.3, 0.45, 0.04]),
        Distortion::Fisheye([0.03, -0.01, 2e-3, -1e-4]),
    ];
    let normals = [DVec3::NEG_Z, DVec3::new(0.5, 0.0, -1.0), DVec3::new(0.0, 0.5, -1.0)];
    let mut samplers = normals.map(|normal| sampler(&plane(normal)));
    for distortion in models {
        let lens = Some(Lens::Intrinsics(Intrinsics { focal, center, distortion }));
        let camera = Camera { lens, ..Camera::look_at(DVec3::ZERO, DVec3::NEG_Z) };
        let ranges =
            samplers.each_mut().map(|sampler| range_of(&direct(sampler, &view_job(camera, SIZE, 1))));
        let (mut seen, mut farthest) = (0, 0.0f64);
        for (i, first) in ranges[0].iter().enumerate() {
            let along = [*first, ranges[1][i], ranges[2][i]].map(|range| 4.0 / f64::from(range));
            if along.contains(&0.0) {
                continue;
            }
            let z = -along[0];
            let direction = DVec3::new(2.0 * (along[1] + z), 2.0 * (along[2] + z), z);
            assert!((direction.length() - 1.0).abs() < 1e-4, "{distortion:?} {i}: {direction}");
            let shown = distortion.project(DVec3::new(direction.x, -direction.y, -direction.z)).unwrap();
            let expected = DVec2::new((i % 128) as f64 + 0.5, (i / 128) as f64 + 0.5);
            farthest = farthest.max((shown * focal + center).distance(expected));
            seen += 1;
        }
        println!("{distortion:?}: {seen} pixels, at most {farthest:.6} pixels off");
        assert!(seen > 8000 && farthest < 0.01, "{distortion:?}: {seen} pixels, {farthest} off");
    }
}

#[test]
fn an_equirectangular_view_agrees_with_six_pinholes() {
    let scene = Arc::new(small_scene::scene());
    let mut sampler = sampler(&scene);
    let eye = DVec3::new(0.4, 1.3, 0.8);
    let level = |ahead: DVec3, up: DVec3| Camera { up, fov_deg: 90.0, ..Camera::look_at(eye, eye + ahead) };
    let round = Camera { lens: Some(Lens::Equirectangular), ..level(DVec3::NEG_Z, DVec3::Y) };
    let (size, side) = ([128, 64], 512);
    let ranges = range_of(&direct(&mut sampler, &view_job(round, size, 1)));
    let mut agreed = 0;
    let sides = [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z].map(|ahead| level(ahead, DVec3::Y));
    let ends = [DVec3::Y, DVec3::NEG_Y].map(|ahead| level(ahead, DVec3::Z));
    let mut looked = 0;
    for face in sides.into_iter().chain(ends) {
        let shown = range_of(&direct(&mut sampler, &view_job(face, [side, side], 1)));
        for (i, range) in (0u32..).zip(&ranges) {
            let at = DVec2::new(f64::from(i % 128) + 0.5, f64::from(i / 128) + 0.5);
            let (longitude, latitude) =
                ((at.x / 128.0 - 0.5) * std::f64::consts::TAU, (0.5 - at.y / 64.0) * std::f64::consts::PI);
            let (around, ahead) = longitude.sin_cos();
            let direction = DVec3::new(around * latitude.cos(), latitude.sin(), -ahead * latitude.cos());
            let p = face.view_from_world() * direction;
            let place = DVec2::new(p.x, -p.y) / -p.z;
            if p.z >= 0.0 || place.abs().max_element() > 0.999 {
                continue;
            }
            let [x, y] = ((place + 1.0) * 0.5 * f64::from(side)).to_array().map(|at| at as u32);
            let there = shown[(y * side + x) as usize];
            looked += 1;
            agreed += usize::from(*range == there || (range / there - 1.0).abs() < 0.03);
        }
    }
    println!("{agreed} of {looked}");
    assert!(looked > 8000 && agreed as f64 > 0.97 * looked as f64, "{agreed} of {looked}");
}

/// Shading, light, reflections and transparent layers do not depend on whether rays are listed.
#[test]
fn a_lens_of_next_to_no_distortion_shows_what_the_pinhole_does() {
    let nothing = Distortion::Rational([1e-13, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    for (name, scene) in [("small", Arc::new(small_scene::scene())), ("panes", transparency::panes())] {
        let mut sampler = sampler(&scene);
        let camera = if name == "panes" { transparency::camera() } else { camera() };
        let focal = DVec2::splat(48.0 / (0.5 * camera.fov_deg.to_radians()).tan());
        let center = DVec2::new(64.0, 48.0);
        let lens = Some(Lens::Intrinsics(Intrinsics { focal, center, distortion: nothing }));
        for samples_per_pixel in [1, 4] {
            let plain = direct(&mut sampler, &by(Visibility::Cpu, camera, SIZE, samples_per_pixel));
            let listed = direct(&mut sampler, &view_job(Camera { lens, ..camera }, SIZE, samples_per_pixel));
            let (off, apart) =
                (colours_apart(&plain, &listed), ranges_apart(&range_of(&plain), &range_of(&listed)));
            println!("{name}, {samples_per_pixel} samples: {off} bytes, {apart} ranges");
            // Rays differ in their last bits, so edges may fall to either side: measured, 12 pixels.
            assert!(off < 3 * 40 && apart < 12, "{name}: {off} bytes, {apart} ranges");
            let specification = listed.provenance.specification.unwrap();
            assert_eq!(specification.visibility, Visibility::Cpu);
            assert_eq!(listed.provenance.plan, Plan::direct(samples_per_pixel));
        }
    }
}

#[test]
fn a_pixel_without_a_ray_is_black_and_infinitely_far() {
    let scene = Arc::new(small_scene::scene());
    let barrel = Distortion::Rational([-0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let camera = intrinsics(DVec2::splat(60.0), DVec2::new(64.0, 48.0), barrel);
    let frame = direct(&mut sampler(&scene), &view_job(camera, SIZE, 4));
    let (image, ranges) = (image_of(&frame), range_of(&frame));
    // The image of r (1 − 0.3 r²) ends at 0.70 · 60 pixels from the middle.
    let end = (1.0f64 / 0.9).sqrt() * (1.0 - 0.3 / 0.9) * 60.0;
    for (i, range) in (0u32..).zip(ranges) {
        let (x, y) = (i % 128, i / 128);
        let away = DVec2::new(f64::from(x) + 0.5 - 64.0, f64::from(y) + 0.5 - 48.0).length();
        if away > end + 1.0 {
            assert_eq!((image.get_pixel(x, y).0, range), ([0; 3], f32::INFINITY), "{x} {y}");
        }
    }
    assert_ne!(image.get_pixel(64, 48).0, [0; 3]);
}
