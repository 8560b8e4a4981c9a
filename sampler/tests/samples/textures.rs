//! Textures of materials on the device against the reference: nearest texels, second texture coordinates, transmission and
//! specular textures.

use std::sync::Arc;

use argus_sampler::SamplerSettings;
use argus_scene::material::{Filter, Wrap};
use argus_scene::reference::{DirectLight, Tracer};
use argus_scene::{
    AlphaMode, Camera, Light, LightEffects, Lighting, Material, ProbeSource, Scene, Sky, Texture, TextureRef,
    ViewJob, Visibility,
};
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};
use image::Rgb;

use crate::common::*;
use crate::reflecting::{judged_with, probes_from};

const SIZE: [u32; 2] = [160, 120];

fn texture(side: u32, filter: Filter, srgb: bool, texel: impl Fn(u32, u32) -> [u8; 4]) -> Texture {
    let rgba: Vec<u8> = (0..side * side).flat_map(|i| texel(i % side, i / side)).collect();
    let wrap = [Wrap::Repeat, Wrap::Mirror];
    Texture { name: String::new(), width: side, height: side, rgba: rgba.into(), srgb, wrap, filter }
}

/// Texture 0 has few large texels in colours and holes, 1 is the same in linear numbers.
fn scene_of(material: Material, filter: Filter) -> Scene {
    let mut scene = empty_scene();
    let texel = |x: u32, y: u32| [(60 * x) as u8, (250 - 60 * y) as u8, 128, (85 * ((x + 2 * y) % 4)) as u8];
    scene.textures = vec![texture(4, filter, true, texel), texture(4, filter, false, texel)];
    scene.lighting.lights.push(Light::Point {
        position: DVec3::new(1.0, 1.0, 2.0),
        intensity: Vec3::splat(4.0),
        range: None,
        radius: 0.0,
    });
    scene.materials =
        vec![material, Material { base_color: Vec4::new(0.9, 0.2, 0.1, 1.0), ..Material::default() }];
    let mut wall = quad(Vec3::ZERO, Vec3::X * 1.4, Vec3::Y, 1.3, 0);
    // Turned and stretched against the first set.
    wall.uvs2 = wall.uvs.iter().map(|uv| Vec2::new(1.9 * uv.y - 0.3, 0.4 - 0.7 * uv.x)).collect();
    place(&mut scene, wall, DAffine3::IDENTITY);
    place(&mut scene, quad(Vec3::NEG_Z, Vec3::X * 3.0, Vec3::Y * 3.0, 1.0, 1), DAffine3::IDENTITY);
    scene
}

fn camera() -> Camera {
    Camera { fov_deg: 45.0, ..Camera::look_at(DVec3::new(0.7, 0.5, 2.6), DVec3::ZERO) }
}

fn texture_by(texture: u32, uv_set: u8) -> Option<TextureRef> {
    Some(TextureRef { uv_set, scale: Vec2::new(0.9, 1.1), rotation: 0.2, ..TextureRef::new(texture) })
}

/// Materials by what their textures multiply, from a set of texture coordinates.
fn materials(uv_set: u8) -> [(&'static str, Material); 6] {
    let white = Material { base_color: Vec4::ONE, ..Material::default() };
    let smooth = Material { roughness: 0.3, base_color: Vec4::new(0.05, 0.05, 0.05, 1.0), ..white.clone() };
    let (color, number) = (texture_by(0, uv_set), texture_by(1, uv_set));
    [
        ("colour", Material { base_color_texture: color, ..white.clone() }),
        ("holes", Material { base_color_texture: color, alpha: AlphaMode::Mask(0.4), ..white.clone() }),
        ("glow", Material { emissive: Vec3::splat(0.5), emissive_texture: color, ..white.clone() }),
        ("bumps", Material { normal_texture: number, ..white }),
        (
            "strength",
            Material { specular_texture: number, specular_color: Vec3::new(9.0, 4.0, 2.0), ..smooth.clone() },
        ),
        ("tint", Material { specular_color: Vec3::splat(20.0), specular_color_texture: color, ..smooth }),
    ]
}

#[test]
fn textures_of_either_set_and_filter_are_as_the_reference_has_them() {
    for filter in [Filter::Linear, Filter::Nearest] {
        for uv_set in [0, 1] {
            for (what, material) in materials(uv_set) {
                let scene = Arc::new(scene_of(material, filter));
                let frame = direct(&mut sampler(&scene), &view_job(camera(), SIZE, 16));
                let truth = reference(&scene, &camera(), SIZE, 16).display(scene.lighting.exposure);
                let image = image_of(&frame);
                flip(&format!("{what}-{filter:?}-{uv_set}"), &image, &truth);
                // FLIP counts rounding by a level of 255 in dark, saturated colours.
                let off = |a: &Rgb<u8>, b: &Rgb<u8>| (0..3).any(|i| a.0[i].abs_diff(b.0[i]) > 2);
                let wrong = image.pixels().zip(truth.pixels()).filter(|(a, b)| off(a, b)).count();
                assert!(
                    wrong * 200 <= image.pixels().len(),
                    "{what}, {filter:?}, set {uv_set}: {wrong} pixels"
                );
            }
        }
    }
}

#[test]
fn every_visibility_backend_tests_alpha_by_the_second_texture_coordinates() {
    let material =
        Material { alpha: AlphaMode::Mask(0.4), base_color_texture: texture_by(0, 1), ..Material::default() };
    for filter in [Filter::Linear, Filter::Nearest] {
        let scene = Arc::new(scene_of(material.clone(), filter));
        let truth = reference(&scene, &camera(), SIZE, 4).display(scene.lighting.exposure);
        for visibility in [Visibility::Raster, Visibility::Trace, Visibility::Cpu] {
            let mut sampler = sampler_with(&scene, SamplerSettings::default());
            let frame = direct(&mut sampler, &ViewJob { visibility, ..view_job(camera(), SIZE, 4) });
            let flip = flip(&format!("{visibility:?}-{filter:?}"), &image_of(&frame), &truth);
            assert!(flip <= 0.01, "{visibility:?}, {filter:?}: FLIP {flip}");
        }
    }
}

/// A pane that is glass where its texture is red.
fn pane(uv_set: u8) -> Material {
    let transmission_texture = Some(TextureRef { uv_set, ..TextureRef::new(1) });
    let base_color = Vec4::new(0.9, 0.8, 0.2, 1.0);
    Material { transmission: 1.0, transmission_texture, roughness: 0.1, base_color, ..Material::default() }
}

#[test]
fn a_pane_is_glass_where_its_transmission_texture_says_so() {
    for uv_set in [0, 1] {
        let scene = Arc::new(scene_of(pane(uv_set), Filter::Nearest));
        let probes = probes_from(&scene, ProbeSource::Rays);
        let (flip, opaque, _) = judged_with(&format!("pane-{uv_set}"), probes, &scene, camera(), 0.0);
        assert!(flip < 0.02 && opaque > 3.0 * flip, "set {uv_set}: FLIP {flip}, {opaque} without refraction");
    }
}

#[test]
fn light_falls_through_the_clear_parts_of_a_pane() {
    let mut scene = scene_of(pane(1), Filter::Nearest);
    let sun =
        Light::Directional { direction: DVec3::NEG_Z, irradiance: Vec3::splat(3.0), angular_radius: 0.0 };
    scene.lighting = Lighting { lights: vec![sun], sky: Sky::BLACK, exposure: 1.0 };
    scene.instances[0].world_from_mesh = DAffine3::from_translation(DVec3::Z * 4.0);
    let scene = Arc::new(scene);
    let effects = LightEffects { shadows: true, ..LightEffects::NONE };
    let mut sampler = sampler_with(&scene, SamplerSettings { effects, ..SamplerSettings::default() });
    let image = image_of(&direct(&mut sampler, &view_job(camera(), SIZE, 4)));
    let tracer = Tracer::new(Arc::clone(&scene)).with_direct_light(DirectLight { effects, rays: 1 });
    let truth = tracer.render(&camera(), SIZE[0], SIZE[1], 4, |_| {}).display(1.0);
    let lit = truth.pixels().filter(|pixel| pixel.0[0] > 100).count() as f64 / truth.pixels().len() as f64;
    assert!((0.2..0.8).contains(&lit), "{lit} of the wall is lit");
    let flip = flip("pane-shadow", &image, &truth);
    assert!(flip < 0.01, "FLIP {flip}");
}
