//! A small scene that has every kind of surface, against the CPU reference and against itself.

use std::f32::consts::FRAC_PI_3;
use std::sync::Arc;

use argus_sampler::{RadianceFormat, SamplerSettings};
use argus_scene::material::{Filter, Wrap};
use argus_scene::{
    AlphaMode, Camera, Light, Material, Output, PlaneFormat, PlaneKind, SampleCamera, Scene, Texture,
    TextureRef,
};
use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3, Vec4};

use crate::common::*;

fn texture(name: &str, size: [u32; 2], srgb: bool, texel: impl Fn(u32, u32) -> [u8; 4]) -> Texture {
    let rgba: Vec<u8> = (0..size[1])
        .flat_map(|y| (0..size[0]).flat_map(move |x| [x, y]).collect::<Vec<_>>())
        .collect::<Vec<u32>>()
        .as_chunks::<2>()
        .0
        .iter()
        .flat_map(|&[x, y]| texel(x, y))
        .collect();
    Texture {
        name: name.to_owned(),
        width: size[0],
        height: size[1],
        rgba: rgba.into(),
        srgb,
        wrap: [Wrap::Repeat, Wrap::Mirror],
        filter: Filter::Linear,
    }
}

/// Textured floor, cut-out screen, normal-mapped ball, gold ball, glowing mirrored and single-sided quads.
pub(crate) fn scene() -> Scene {
    let mut scene = empty_scene();
    scene.textures = vec![
        texture("checks", [48, 20], true, |x, y| {
            if (x / 6 + y / 5) % 2 == 0 { [220, 60, 40, 255] } else { [240, 240, 200, 255] }
        }),
        texture("holes", [32, 32], true, |x, y| {
            let (dx, dy) = (x as i32 - 16, y as i32 - 16);
            [40, 160, 60, if dx * dx + dy * dy < 100 { 0 } else { 255 }]
        }),
        texture("bumps", [64, 64], false, |x, y| {
            let slope = |i: u32| ((i as f32 * 0.39).sin() * 60.0 + 127.5) as u8;
            [slope(x), slope(y), 230, 255]
        }),
        texture("roughness", [16, 16], false, |x, y| [0, (x * 16) as u8, (y * 8) as u8, 255]),
    ];
    let turned = |texture| TextureRef {
        offset: Vec2::new(0.3, -0.2),
        scale: Vec2::new(2.0, 1.5),
        rotation: FRAC_PI_3,
        ..TextureRef::new(texture)
    };
    let white = Material { base_color: Vec4::ONE, ..Material::default() };
    scene.materials = vec![
        Material { base_color_texture: Some(TextureRef::new(0)), ..white.clone() },
        Material { base_color_texture: Some(turned(1)), alpha: AlphaMode::Mask(0.4), ..white.clone() },
        Material { normal_texture: Some(TextureRef::new(2)), normal_scale: 0.8, ..white.clone() },
        Material {
            base_color: Vec4::new(1.0, 0.8, 0.4, 1.0),
            metallic: 1.0,
            roughness: 0.8,
            metallic_roughness_texture: Some(TextureRef::new(3)),
            ..white.clone()
        },
        Material {
            emissive: Vec3::new(0.1, 0.4, 0.6),
            emissive_texture: Some(TextureRef::new(0)),
            ..white.clone()
        },
        Material { double_sided: false, base_color: Vec4::new(0.3, 0.4, 0.9, 1.0), ..white },
    ];
    scene.lighting.lights.push(Light::Point {
        position: DVec3::new(-1.0, 2.0, 1.5),
        intensity: Vec3::new(2.0, 1.5, 1.0),
        range: Some(9.0),
        radius: 0.0,
    });
    scene.lighting.lights.push(Light::Spot {
        position: DVec3::new(2.0, 3.0, 2.0),
        direction: DVec3::new(-0.4, -0.8, -0.4).normalize(),
        intensity: Vec3::splat(6.0),
        range: None,
        inner_cone: 0.2,
        outer_cone: 0.5,
        radius: 0.0,
    });
    let at = DAffine3::from_translation;
    place(&mut scene, quad(Vec3::ZERO, Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 3.0, 0), DAffine3::IDENTITY);
    place(&mut scene, quad(Vec3::Y, Vec3::X, Vec3::Y, 1.0, 1), at(DVec3::new(-1.5, 0.1, 1.0)));
    place(&mut scene, ball(2, 24), at(DVec3::new(0.6, 1.0, -1.0)));
    let squashed = DAffine3::from_scale_rotation_translation(
        DVec3::new(0.9, 0.5, 0.7),
        DQuat::from_rotation_z(0.4),
        DVec3::new(2.4, 0.8, 0.6),
    );
    place(&mut scene, ball(3, 32), squashed);
    let mirrored = DAffine3::from_scale_rotation_translation(
        DVec3::new(-0.7, 0.7, 0.7),
        DQuat::from_rotation_y(0.3),
        DVec3::new(-0.2, 0.9, 1.6),
    );
    place(&mut scene, quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0, 4), mirrored);
    // A box of single-sided walls, one of them mirrored: only those whose fronts face the eye are seen.
    place(&mut scene, quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0, 5), at(DVec3::new(-3.0, 1.0, -2.0)));
    place(&mut scene, quad(Vec3::ZERO, Vec3::X, Vec3::NEG_Y, 1.0, 5), at(DVec3::new(3.0, 1.0, -3.0)));
    let flipped = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    place(&mut scene, ball(5, 16), at(DVec3::new(-3.0, 1.2, 0.5)) * flipped);
    scene
}

pub(crate) fn camera() -> Camera {
    Camera { fov_deg: 50.0, ..Camera::look_at(DVec3::new(0.5, 2.4, 6.5), DVec3::new(0.0, 0.8, 0.0)) }
}

pub(crate) fn moved(scene: &Scene, by: DVec3) -> Scene {
    let mut scene = scene.clone();
    for instance in &mut scene.instances {
        instance.world_from_mesh.translation += by;
    }
    for light in &mut scene.lighting.lights {
        match light {
            Light::Point { position, .. } | Light::Spot { position, .. } => *position += by,
            Light::Directional { .. } => {}
        }
    }
    scene
}

#[test]
fn every_kind_of_surface_is_as_the_reference_has_it() {
    let scene = Arc::new(scene());
    let size = [240, 180];
    let frame = direct(&mut sampler(&scene), &view_job(camera(), size, 16));
    let truth = reference(&scene, &camera(), size, 16);
    let flip = flip("small", &image_of(&frame), &truth.display(scene.lighting.exposure));
    assert!(flip <= 0.01, "FLIP {flip}");
}

#[test]
fn ranges_are_the_reference_s_to_single_precision() {
    let scene = Arc::new(scene());
    let frame = direct(&mut sampler(&scene), &view_job(camera(), [160, 120], 4));
    let truth = reference(&scene, &camera(), [160, 120], 1).range;
    let mut elsewhere = 0;
    for (ours, truth) in range_of(&frame).into_iter().zip(truth) {
        assert!(!ours.is_nan() && ours > 0.0);
        let same = ours == truth || (ours / truth - 1.0).abs() < 1e-5;
        elsewhere += usize::from(!same);
    }
    // Pixels whose centre lies within the rasteriser's snapping of an edge may show the other side of it.
    assert!(elsewhere <= 160 * 120 / 200, "{elsewhere} pixels");
}

#[test]
fn a_million_metres_away_the_picture_is_the_same() {
    let near = Arc::new(scene());
    let by = DVec3::new(1e6, -2e6, 1.5e6);
    let far = Arc::new(moved(&near, by));
    let job = view_job(camera(), [160, 120], 4);
    let mut moved_job = job.clone();
    moved_job.camera.eye += by;
    moved_job.camera.target += by;
    let here = direct(&mut sampler(&near), &job);
    let there = direct(&mut sampler(&far), &moved_job);
    let flip = flip("far", &image_of(&there), &image_of(&here));
    assert!(flip < 1e-3, "FLIP {flip}");
    let ranges = range_of(&here).into_iter().zip(range_of(&there));
    let apart = ranges.filter(|(a, b)| a != b && !((a / b - 1.0).abs() < 1e-5)).count();
    assert!(apart < 20, "{apart} ranges differ");
}

#[test]
fn the_same_order_gives_the_same_bytes() {
    let scene = Arc::new(scene());
    let mut first = sampler(&scene);
    let job = view_job(camera(), [121, 77], 4);
    let a = direct(&mut first, &job);
    // Another size in between, so that targets are not those of the first time.
    direct(&mut first, &view_job(camera(), [64, 64], 16));
    let b = direct(&mut first, &job);
    let c = direct(&mut sampler(&scene), &job);
    assert!(
        a.images[Output::Color] == b.images[Output::Color]
            && b.images[Output::Color] == c.images[Output::Color]
    );
    assert!(
        a.images[Output::Range] == b.images[Output::Range]
            && b.images[Output::Range] == c.images[Output::Range]
    );
}

#[test]
fn host_planes_equal_device_planes_read_back() {
    let scene = Arc::new(scene());
    let mut sampler = sampler(&scene);
    let rig = corner_rig(scene.bounds(), [101, 67]);
    let host = sample(&mut sampler, &sample_job(&scene, rig, 1, true));
    let device = sample(&mut sampler, &sample_job(&scene, rig, 1, false));
    let kinds: Vec<PlaneKind> = host.planes.iter().map(|p| p.kind).collect();
    assert_eq!(kinds, [PlaneKind::Radiance, PlaneKind::InverseRange, PlaneKind::Normal, PlaneKind::Specular]);
    for (mine, theirs) in host.planes.iter().zip(&device.planes) {
        let back = argus_gpu::plane::to_host(&gpu(), theirs).expect("reads back");
        assert_eq!((mine.kind, mine.format, mine.size), (back.kind, back.format, back.size));
        let (argus_scene::PlaneData::Host(a), argus_scene::PlaneData::Host(b)) = (&mine.data, &back.data)
        else {
            panic!("both are on the host now")
        };
        assert!(a == b, "{:?}", mine.kind);
    }
}

/// The scene without anything that depends on the viewer.
fn matt_scene() -> Scene {
    let mut scene = scene();
    for material in &mut scene.materials {
        (material.metallic, material.roughness, material.metallic_roughness_texture) = (0.0, 1.0, None);
    }
    scene
}

/// Whether no silhouette is near: ranges around a texel differ by little, or all are infinite.
fn is_smooth(range: &[f32], at: usize) -> bool {
    let (x, y) = (at % 120, at / 120);
    let around =
        (y.max(1) - 1..=(y + 1).min(89)).flat_map(|y| (x.max(1) - 1..=(x + 1).min(119)).map(move |x| (x, y)));
    let inverse: Vec<f32> = around.map(|(x, y)| 1.0 / range[y * 120 + x]).collect();
    let most = inverse.iter().copied().fold(0.0, f32::max);
    let least = inverse.iter().copied().fold(f32::INFINITY, f32::min);
    most - least <= 0.02 * most
}

#[test]
fn a_sample_holds_what_a_direct_view_from_its_camera_shows() {
    let scene = Arc::new(matt_scene());
    let rig = corner_rig(scene.bounds(), [120, 90]);
    for spp in [1, 4, 16] {
        let settings = SamplerSettings { sub_samples: spp, ..SamplerSettings::default() };
        let mut sampler = sampler_with(&scene, settings);
        let sample = sample(&mut sampler, &sample_job(&scene, rig, 2, true));
        let SampleCamera::Perspective { camera, .. } = sample.camera else { panic!("corners look one way") };
        let frame = direct(&mut sampler, &view_job(camera, [120, 90], spp));
        let shown = image_of(&frame);
        let truth = reference(&scene, &camera, [120, 90], 1).range;
        let inverse = floats(&host_bytes(&sample, PlaneKind::InverseRange));
        let (mut apart, mut off, mut smooth, mut differences) = (0, 0, 0, 0);
        for (at, (radiance, shown)) in radiance_of(&sample).into_iter().zip(shown.pixels()).enumerate() {
            if spp > 1 && !is_smooth(&truth, at) {
                // A texel on a silhouette holds one surface, a pixel the mean of several.
                continue;
            }
            smooth += 1;
            let held = argus_scene::tone::display_from_radiance(radiance, scene.lighting.exposure);
            let most = (0..3).map(|c| held[c].abs_diff(shown.0[c])).max().unwrap_or(0);
            // Shaded once a texel, a texture is filtered where a pixel averages several fetches.
            apart += usize::from(most > if spp == 1 { 1 } else { 16 });
            differences += usize::from(most);
            let expected = if truth[at].is_finite() { 1.0 / truth[at] } else { 0.0 };
            // A texel of a ball lies on triangles that its central ray does not meet.
            off += usize::from(!((inverse[at] - expected).abs() <= 2e-4 * expected));
        }
        let mean = differences as f64 / smooth as f64;
        println!(
            "{spp}: of {smooth} texels {apart} are shown otherwise, in the mean {mean:.3} bytes; {off} have other ranges"
        );
        assert!(mean < 1.0, "{spp}: {mean}");
        assert!(smooth > 120 * 90 / 2);
        // What is thinner than the reference's rays are apart escapes its ranges.
        let allowed = if spp == 1 { 0 } else { smooth / 200 };
        assert!(apart <= allowed, "{spp}: {apart} texels");
        assert!(off <= smooth / 100, "{spp}: {off} ranges");
    }
}

#[test]
fn what_quantisation_costs_is_what_the_settings_say() {
    let scene = Arc::new(matt_scene());
    let rig = corner_rig(scene.bounds(), [160, 120]);
    let order = sample_job(&scene, rig, 0, true);
    let exact =
        SamplerSettings { radiance: RadianceFormat::HalfFloat, range_bits: 23, ..SamplerSettings::default() };
    let exact = sample(&mut sampler_with(&scene, exact), &order);
    let stored = sample(&mut sampler(&scene), &order);
    assert_eq!(stored.plane(PlaneKind::Radiance).unwrap().format, PlaneFormat::Rgb9e5Ufloat);
    let halves = host_bytes(&exact, PlaneKind::Radiance);
    let halves = halves.as_chunks::<8>().0.iter().map(|texel| {
        let channel = |i: usize| half::f16::from_le_bytes([texel[2 * i], texel[2 * i + 1]]).to_f32();
        Vec3::new(channel(0), channel(1), channel(2))
    });
    let (mut radiance_error, mut range_error) = (0.0f32, 0.0f32);
    for (stored, exact) in radiance_of(&stored).into_iter().zip(halves) {
        let scale = exact.max_element().max(1e-6);
        radiance_error = radiance_error.max((stored - exact).abs().max_element() / scale);
    }
    let ranges = [&stored, &exact].map(|s| floats(&host_bytes(s, PlaneKind::InverseRange)));
    for (stored, exact) in ranges[0].iter().zip(&ranges[1]) {
        assert_eq!(*stored == 0.0, *exact == 0.0, "sky stays sky");
        assert_eq!(stored.to_bits() & 0x7f, 0, "seven of 23 mantissa bits are dropped");
        if *exact > 0.0 {
            range_error = range_error.max((stored / exact - 1.0).abs());
        }
    }
    println!("relative error of radiance {radiance_error:.2e}, of range {range_error:.2e}");
    assert!(radiance_error <= 1.0 / 512.0 + 1.0 / 2048.0);
    assert!(range_error <= 1.0 / 131_072.0 * 1.01);
}

#[test]
fn no_texel_has_a_lobe_between_those_of_two_materials() {
    let mut scene = empty_scene();
    let of = |roughness| Material { roughness, metallic: 0.0, ..Material::default() };
    scene.materials = vec![of(0.1), of(0.9)];
    // Askew, so that many texels lie on both.
    let askew = DAffine3::from_quat(DQuat::from_rotation_y(0.3) * DQuat::from_rotation_x(0.1));
    for (x, material) in [(-3.0, 0), (3.0, 1)] {
        place(&mut scene, quad(Vec3::X * x, Vec3::X * 3.0, Vec3::NEG_Z * 6.0, 1.0, material), askew);
    }
    let scene = Arc::new(scene);
    let rig = corner_rig(scene.bounds(), [101, 67]);
    let sample = sample(&mut sampler(&scene), &sample_job(&scene, rig, 1, true));
    let specular = sample.planes.iter().find(|plane| plane.kind == PlaneKind::Specular).expect("a lobe");
    let argus_scene::PlaneData::Host(bytes) = &specular.data else { panic!("it is on the host") };
    let roughness = bytes.as_chunks::<4>().0.iter().map(|[.., roughness]| *roughness).filter(|&r| r > 0);
    let (smooth, others): (Vec<u8>, Vec<u8>) = roughness.partition(|&r| r.abs_diff(26) <= 1);
    let (rough, between): (Vec<u8>, Vec<u8>) = others.into_iter().partition(|&r| r.abs_diff(230) <= 1);
    assert!(smooth.len() > 50 && rough.len() > 50, "{} and {}", smooth.len(), rough.len());
    assert_eq!(between, [0_u8; 0], "roughness of neither");
}
