//! Blended surfaces against colours that are blended by hand, and against the reference.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use argus_sampler::SamplerSettings;
use argus_scene::material::{Filter, Wrap};
use argus_scene::transparency::MOST_LAYERS;
use argus_scene::{
    AlphaMode, Camera, Cancel, Light, LightEffects, Material, Output, Outputs, PixelJob, PlaneKind, Sampler,
    Scene, SceneState, Sky, Texture, TextureRef, ViewJob, Visibility,
};
use glam::{DAffine3, DVec3, Vec3, Vec4};

use crate::common::{
    direct, empty_scene, flip, host_bytes, image_of, job_around_origin, place, quad, radiance_of, range_of,
    reference, sample, sampler, sampler_with, view_job,
};

const SIZE: [u32; 2] = [96, 64];

/// Shows this radiance, whatever the light.
fn glowing(radiance: Vec3) -> Material {
    Material { base_color: Vec4::W, emissive: radiance, ..Material::default() }
}

fn blended(radiance: Vec3, alpha: f32) -> Material {
    Material { base_color: Vec4::new(0.0, 0.0, 0.0, alpha), alpha: AlphaMode::Blend, ..glowing(radiance) }
}

const WALL: [Vec3; 2] = [Vec3::new(0.9, 0.2, 0.1), Vec3::new(0.05, 0.3, 0.6)];
const PANE: Vec3 = Vec3::new(0.2, 0.9, 0.4);

/// A chequered wall of glowing squares 4 m ahead, whose colours `seen` changes.
fn wall(seen: impl Fn(Vec3) -> Vec3) -> Scene {
    let mut scene = empty_scene();
    scene.lighting.exposure = 1.0;
    scene.materials = WALL.map(|color| glowing(seen(color))).to_vec();
    for i in 0..64 {
        let center = Vec3::new((i % 8) as f32 - 3.5, (i / 8) as f32 - 3.5, -4.0);
        place(
            &mut scene,
            quad(center, Vec3::X * 0.5, Vec3::Y * 0.5, 1.0, (i + i / 8) % 2),
            DAffine3::IDENTITY,
        );
    }
    scene
}

/// Adds a pane that fills the view at this distance.
fn add_pane(scene: &mut Scene, distance: f32, material: Material) {
    scene.materials.push(material);
    let index = scene.materials.len() as u32 - 1;
    let half = distance * 0.6;
    place(
        scene,
        quad(Vec3::NEG_Z * distance, Vec3::X * half, Vec3::Y * half, 1.0, index),
        DAffine3::IDENTITY,
    );
}

pub(crate) fn camera() -> Camera {
    Camera { fov_deg: 40.0, ..Camera::look_at(DVec3::ZERO, DVec3::NEG_Z) }
}

fn view(samples_per_pixel: u32, visibility: Visibility) -> ViewJob {
    ViewJob { visibility, ..view_job(camera(), SIZE, samples_per_pixel) }
}

/// Largest difference of two images' bytes.
fn difference(a: &image::RgbImage, b: &image::RgbImage) -> u8 {
    a.iter().zip(b.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

#[test]
fn panes_equal_colours_that_are_blended_by_hand() {
    let cases: [&[f32]; 8] =
        [&[0.0], &[0.25], &[0.5], &[0.75], &[1.0], &[0.3, 0.4], &[0.2, 0.7, 0.5], &[0.4, 1.0, 0.5]];
    for alphas in cases {
        // The nearest pane is the last.
        let twin = Arc::new(wall(|color| alphas.iter().fold(color, |color, &alpha| color.lerp(PANE, alpha))));
        let mut scene = wall(|color| color);
        for (i, &alpha) in alphas.iter().enumerate() {
            add_pane(&mut scene, 3.0 - i as f32, blended(PANE, alpha));
        }
        let (mut ours, mut theirs) = (sampler(&Arc::new(scene)), sampler(&twin));
        for visibility in Visibility::ALL {
            for spp in [1, 4] {
                let ours = image_of(&direct(&mut ours, &view(spp, visibility)));
                let truth = image_of(&direct(&mut theirs, &view(spp, visibility)));
                let off = difference(&ours, &truth);
                // Colours of squares' edges are mixed of other sub-samples by other backends.
                assert!(off <= 1, "{alphas:?} {visibility:?} {spp}: {off} bytes");
                assert!(flip("pane", &ours, &truth) <= 0.005, "{alphas:?} {visibility:?} {spp}");
            }
        }
    }
}

#[test]
fn range_and_ids_are_of_the_first_surface_at_which_half_is_hidden() {
    let cases: [(&[f32], f32); 7] = [
        (&[0.0], 4.0),
        (&[0.49], 4.0),
        (&[0.5], 3.0),
        (&[1.0], 3.0),
        (&[0.3, 0.3], 3.0),
        (&[0.9, 0.3], 3.0),
        (&[0.3, 0.6], 2.0),
    ];
    for (alphas, depth) in cases {
        let mut scene = wall(|color| color);
        for (i, &alpha) in alphas.iter().enumerate() {
            add_pane(&mut scene, 3.0 - i as f32, blended(PANE, alpha));
        }
        let mut sampler = sampler(&Arc::new(scene));
        let ids = Visibility::ALL.map(|way| sampler.identify(&camera(), SIZE, 1, way).unwrap().0);
        let shown = 64 + (3.0 - depth) as u32 + 1;
        for ids in &ids {
            let is_shown =
                |ids: &[u32; 2]| if depth == 4.0 { (1..=64).contains(&ids[0]) } else { ids[0] == shown };
            assert!(ids.iter().all(is_shown), "{alphas:?}");
        }
        let frame = direct(&mut sampler, &view(4, Visibility::Raster));
        let middle = range_of(&frame)[(SIZE[1] / 2 * SIZE[0] + SIZE[0] / 2) as usize];
        assert!((middle - depth).abs() < 0.01, "{alphas:?}: {middle}");
    }
}

/// Panes before one another, before the sky, seen at a low angle, with a texture of alpha, with vertex colours, a decal on a
/// wall, a closed box, and more of them in a row than are blended.
pub(crate) fn panes() -> Arc<Scene> {
    let mut scene = empty_scene();
    scene.lighting.lights.clear();
    let ramp: Vec<u8> = (0..64u8).flat_map(|i| [220, 180, 90, i * 4]).collect();
    scene.textures.push(Texture {
        name: "ramp".to_owned(),
        width: 64,
        height: 1,
        rgba: ramp.into(),
        srgb: true,
        wrap: [Wrap::Clamp; 2],
        filter: Filter::Linear,
    });
    let glass = |color: Vec3, alpha: f32| Material {
        base_color: color.extend(alpha),
        alpha: AlphaMode::Blend,
        ..Material::default()
    };
    let textured = Material { base_color_texture: Some(TextureRef::new(0)), ..glass(Vec3::ONE, 1.0) };
    scene.materials = vec![
        Material { base_color: Vec4::new(0.7, 0.6, 0.5, 1.0), ..Material::default() },
        glass(Vec3::new(0.9, 0.1, 0.1), 0.4),
        glass(Vec3::new(0.1, 0.2, 0.9), 0.6),
        textured,
        glass(Vec3::new(0.2, 0.7, 0.3), 0.15),
        Material { double_sided: false, ..glass(Vec3::new(0.8, 0.8, 0.1), 0.5) },
    ];
    let at = |x: f64, y: f64, z: f64| DAffine3::from_translation(DVec3::new(x, y, z));
    let upright = |size: f32, material| quad(Vec3::ZERO, Vec3::X * size, Vec3::Y * size, 1.0, material);
    // The wall ends within the view.
    place(&mut scene, quad(Vec3::ZERO, Vec3::X * 3.0, Vec3::Y * 1.2, 1.0, 0), at(0.0, -0.6, -6.0));
    place(&mut scene, upright(0.9, 1), at(-1.2, 0.1, -5.0));
    place(&mut scene, upright(0.8, 2), at(-0.7, 0.3, -4.5));
    place(&mut scene, upright(0.7, 3), at(0.9, 0.2, -5.0));
    place(&mut scene, upright(0.3, 1), at(0.0, -1.0, -6.0));
    place(&mut scene, quad(Vec3::ZERO, Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1.0, 4), at(0.0, -0.12, -4.0));
    let mut faded = upright(0.5, 2);
    faded.colors = (0..4).map(|i| Vec4::new(1.0, 1.0, 1.0, i as f32 / 3.0)).collect();
    place(&mut scene, faded, at(1.9, -0.9, -5.0));
    place(
        &mut scene,
        crate::common::ball(5, 6),
        DAffine3::from_scale_rotation_translation(
            DVec3::splat(0.4),
            glam::DQuat::IDENTITY,
            DVec3::new(0.1, 1.0, -5.0),
        ),
    );
    for i in 0..MOST_LAYERS + 4 {
        place(&mut scene, upright(0.25, 4), at(1.8, 0.9, -3.0 - 0.1 * i as f64));
    }
    Arc::new(scene)
}

#[test]
fn views_equal_the_reference_by_every_backend() {
    let scene = panes();
    let camera = Camera { fov_deg: 50.0, ..Camera::look_at(DVec3::ZERO, DVec3::NEG_Z) };
    let size = [192, 128];
    let truth = reference(&scene, &camera, size, 4);
    let (image, range) = (truth.display(scene.lighting.exposure), &truth.range);
    let mut sampler = sampler(&scene);
    let mut frames = Vec::new();
    for visibility in Visibility::ALL {
        let job = ViewJob { visibility, ..view_job(camera, size, 4) };
        let frame = direct(&mut sampler, &job);
        let off = flip("panes", &image_of(&frame), &image);
        println!("{visibility:?}: FLIP {off:.5}");
        assert!(off < 0.002, "{visibility:?}: FLIP {off}");
        let ranges = range_of(&frame);
        let apart =
            ranges.iter().zip(range).filter(|(a, b)| *a != *b && (**a - **b).abs() > 1e-4 * **b).count();
        assert!(apart < ranges.len() / 100, "{visibility:?}: {apart} ranges");
        frames.push(frame);
    }
    // A second sampler, in another order, gives the same bytes.
    let mut other = crate::common::sampler(&scene);
    for (visibility, frame) in Visibility::ALL.into_iter().zip(frames).rev() {
        let again = direct(&mut other, &ViewJob { visibility, ..view_job(camera, size, 4) });
        assert!(
            again.images[Output::Color] == frame.images[Output::Color]
                && again.images[Output::Range] == frame.images[Output::Range],
            "{visibility:?}"
        );
    }
}

#[test]
fn lists_of_pixels_hold_what_views_hold() {
    let scene = panes();
    let mut sampler = sampler(&scene);
    let camera = Camera { fov_deg: 50.0, ..Camera::look_at(DVec3::ZERO, DVec3::NEG_Z) };
    let view = ViewJob { visibility: Visibility::Cpu, ..view_job(camera, [192, 128], 4) };
    let whole = direct(&mut sampler, &view);
    let pixels: Vec<u32> = (0..192 * 128).step_by(7).collect();
    let job = PixelJob {
        camera,
        width: 192,
        height: 128,
        samples_per_pixel: 4,
        pixels: pixels.clone(),
        state: SceneState::default(),
        time_secs: 0.0,
        reflections: None,
    };
    let list = sampler.render_pixels(&[job], &Cancel::new()).remove(0).unwrap();
    for (i, &pixel) in pixels.iter().enumerate() {
        for (name, listed, all, bytes) in [
            ("color", &list.color, whole.images[Output::Color].as_ref(), 3),
            ("range", &list.range, whole.images[Output::Range].as_ref(), 4),
        ] {
            let at = pixel as usize * bytes;
            assert_eq!(listed[i * bytes..][..bytes], all.unwrap()[at..at + bytes], "{name} of {pixel}");
        }
    }
}

#[test]
fn borders_of_tiles_and_triangles_do_not_show() {
    let twin = Arc::new(wall(|color| color.lerp(PANE, 0.6)));
    let mut scene = wall(|color| color);
    add_pane(&mut scene, 2.0, blended(PANE, 0.6));
    // Three tiles. The pane's diagonal runs through them.
    let narrow = Camera { fov_deg: 2.0, ..camera() };
    let job = ViewJob { visibility: Visibility::Cpu, ..view_job(narrow, [600, 24], 64) };
    let ours = image_of(&direct(&mut sampler(&Arc::new(scene)), &job));
    let truth = image_of(&direct(&mut sampler(&twin), &job));
    assert!(difference(&ours, &truth) <= 1, "{}", difference(&ours, &truth));
}

#[test]
fn samples_hold_the_blend_at_the_range_of_the_surface_that_is_shown() {
    for (alpha, distance) in [(0.25, 4.0), (0.75, 2.0)] {
        let mut scene = wall(|_| WALL[0]);
        add_pane(&mut scene, 2.0, blended(PANE, alpha));
        let job = job_around_origin(&scene, 64);
        let sample = sample(&mut sampler(&Arc::new(scene)), &job);
        let faces = sample.camera.faces();
        let ahead = faces.iter().position(|face| face.view_from_world.row(2).z > 0.9).unwrap();
        let [left, top] = faces[ahead].offset;
        let [width, _] = sample.camera.size();
        let at = ((top + 32) * width + left + 32) as usize;
        let radiance = radiance_of(&sample)[at];
        let expected = WALL[0].lerp(PANE, alpha);
        assert!((radiance - expected).abs().max_element() < 0.005, "{alpha}: {radiance} {expected}");
        let range = 1.0 / crate::common::floats(&host_bytes(&sample, PlaneKind::InverseRange))[at];
        assert!((range - distance).abs() < 0.01, "{alpha}: {range}");
    }
}

#[test]
fn a_half_transparent_pane_casts_half_a_shadow() {
    let shadowed = |alpha: Option<f32>| {
        let mut scene = empty_scene();
        let down = DVec3::new(0.0, -1.0, -0.001).normalize();
        let sun = Light::Directional { direction: down, irradiance: Vec3::splat(2.0), angular_radius: 0.0 };
        (scene.lighting.lights, scene.lighting.sky) = (vec![sun], Sky::BLACK);
        let ground = quad(Vec3::NEG_Y, Vec3::X * 5.0, Vec3::NEG_Z * 5.0, 1.0, 0);
        place(&mut scene, ground, DAffine3::from_translation(DVec3::NEG_Z * 4.0));
        if let Some(alpha) = alpha {
            scene.materials.push(blended(Vec3::ZERO, alpha));
            let pane = quad(Vec3::Y * 2.0, Vec3::X, Vec3::NEG_Z, 1.0, 1);
            place(&mut scene, pane, DAffine3::from_translation(DVec3::NEG_Z * 4.0));
        }
        let scene = Arc::new(scene);
        let effects = LightEffects { shadows: true, sky_visibility: true, ..LightEffects::NONE };
        let mut sampler = sampler_with(&scene, SamplerSettings { effects, ..SamplerSettings::default() });
        let camera = Camera { fov_deg: 30.0, ..Camera::look_at(DVec3::ZERO, DVec3::new(0.0, -1.0, -4.0)) };
        let frame = direct(&mut sampler, &view_job(camera, [32, 32], 1));
        let byte = image_of(&frame).get_pixel(16, 16).0[0];
        argus_scene::tone::linear_from_srgb(f32::from(byte) / 255.0)
    };
    let open = shadowed(None);
    for alpha in [0.25, 0.5, 0.75, 1.0] {
        let seen = shadowed(Some(alpha)) / open;
        assert!((seen - (1.0 - alpha)).abs() < 0.01, "{alpha}: {seen}");
    }
}

#[test]
fn colour_and_range_together_equal_each_alone() {
    let mut scene = wall(|color| color);
    add_pane(&mut scene, 2.0, blended(PANE, 0.7));
    let mut sampler = sampler(&Arc::new(scene));
    let camera = Camera { fov_deg: 100.0, ..Camera::look_at(DVec3::ZERO, DVec3::NEG_Z) };
    let both = view_job(camera, SIZE, 1);
    let color = ViewJob { outputs: Outputs::COLOR, ..both.clone() };
    let range = ViewJob { outputs: Outputs::only(Output::Range), ..both.clone() };
    let [both, color, range] = [both, color, range].map(|job| direct(&mut sampler, &job));
    assert!(
        both.images[Output::Color] == color.images[Output::Color]
            && both.images[Output::Range] == range.images[Output::Range]
    );
    assert!(range_of(&both).iter().any(|range| *range < 3.0), "the pane is seen");
    assert!(range_of(&both).contains(&f32::INFINITY), "the sky is seen");
}
