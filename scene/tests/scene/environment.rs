//! Environment maps: their files, and their light by the reference.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong
use crate::common;

use std::io::Cursor;

use argus_scene::load::{decode_environment, load_environment};
use argus_scene::reference::DirectLight;
use argus_scene::shading::sky_radiance;
use argus_scene::{Environment, Light, LightEffects, Lighting, Scene, Sky};
use common::{furnace, patch, scene, sun, tracer, white};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use image::{DynamicImage, ImageBuffer, ImageFormat, Rgb, Rgb32FImage};

fn image_of(width: u32, height: u32, texel: impl Fn(u32, u32) -> [f32; 3]) -> Rgb32FImage {
    ImageBuffer::from_fn(width, height, |x, y| Rgb(texel(x, y)))
}

fn file(image: Rgb32FImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    DynamicImage::ImageRgb32F(image).write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn map_of(width: u32, texel: impl Fn(u32, u32) -> f32) -> Environment {
    let texels = (0..width * width / 2).map(|i| Vec3::splat(texel(i % width, i / width))).collect();
    Environment::new(width, width / 2, texels).unwrap()
}

#[test]
fn radiance_and_openexr_files_are_the_same_map() {
    // Whole shares of 256, which both formats hold exactly.
    let image = || image_of(8, 4, |x, y| [x as f32 / 8.0 + 0.125, y as f32 / 4.0 + 0.25, 1.0]);
    let maps = [ImageFormat::Hdr, ImageFormat::OpenExr].map(|format| {
        let map = decode_environment("noon", &file(image(), format)).unwrap().map;
        (map.size(), map.hash())
    });
    assert_eq!(maps[0].0, [8, 4]);
    assert_eq!(maps[0], maps[1]);
}

#[test]
fn files_that_are_no_environment_map_are_refused_with_their_name_and_the_reason() {
    let one = [1.0; 3];
    let exr = |image| file(image, ImageFormat::OpenExr);
    let whole = exr(image_of(16, 8, |_, _| one));
    let png = {
        let mut bytes = Cursor::new(Vec::new());
        DynamicImage::new_rgb8(4, 2).write_to(&mut bytes, ImageFormat::Png).unwrap();
        bytes.into_inner()
    };
    for (bytes, reason) in [
        (Vec::new(), "empty"),
        (b"nonsense".to_vec(), "is no environment map"),
        (png, "is no environment map"),
        (exr(image_of(4, 4, |_, _| one)), "4×4 texels: a map of all directions is twice as wide as high"),
        (file(image_of(4, 3, |_, _| one), ImageFormat::Hdr), "twice as wide as high"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16384 +X 32768\n".to_vec(), "at most 8192×4096"),
    ] {
        let error = decode_environment("maps/noon.hdr", &bytes).unwrap_err();
        assert_eq!(error.file, "maps/noon.hdr");
        assert!(error.reason.contains(reason), "{error}");
        assert!(!error.to_string().contains('\n'));
    }
    for length in [8, 100, whole.len() / 2, whole.len() - 1] {
        decode_environment("cut.exr", &whole[..length]).unwrap_err();
    }
    assert_eq!(load_environment("no/such.exr").unwrap_err().file, "no/such.exr");
    let folder = tempfile::tempdir().unwrap();
    assert!(load_environment(folder.path()).unwrap_err().reason.contains("not a file"));
}

#[test]
fn texels_that_no_radiance_can_have_are_clamped_and_counted() {
    let with = |bad: f32| {
        let image = image_of(4, 2, |x, y| if (x, y) == (3, 1) { [1.0, bad, 1.0] } else { [1.0; 3] });
        decode_environment("sky.exr", &file(image, ImageFormat::OpenExr)).unwrap()
    };
    assert!(with(0.5).warnings.is_empty());
    let black = with(0.0).map.hash();
    for (bad, instead) in [(f32::NAN, 0.0), (-0.5, 0.0), (f32::NEG_INFINITY, 0.0), (f32::INFINITY, 65504.0)] {
        let environment = with(bad);
        assert_eq!(environment.warnings.len(), 1, "{bad}");
        assert!(environment.warnings[0].starts_with("1 of 8 texels are negative, NaN or infinite"), "{bad}");
        assert_eq!(environment.map.hash() == black, instead == 0.0, "{bad}");
        assert_eq!(
            environment,
            Environment { warnings: environment.warnings.clone(), ..with(instead) },
            "{bad}"
        );
        let scene =
            scene(vec![patch(1)], vec![white()], Lighting::default()).with_environment(environment, b"");
        assert!(scene.warnings.len() == 1 && scene.warnings[0].starts_with("environment map: 1 of 8"));
    }
}

/// A Radiance file of 4 × 2 texels of radiance 1, 0.5 and 0.25, with lines in its header.
fn radiance(lines: &str) -> Vec<u8> {
    let mut bytes = format!("#?RADIANCE\n{lines}FORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n").into_bytes();
    (0..8).for_each(|_| bytes.extend([128, 64, 32, 129]));
    bytes
}

#[test]
fn every_line_of_a_radiance_header_is_applied_or_warned_of_or_changes_nothing() {
    let map_of = |lines: &str| decode_environment("sky.hdr", &radiance(lines)).unwrap();
    let color = |lines: &str| argus_scene::rgb9e5::decode(map_of(lines).map.texels()[0]);
    let plain = Vec3::new(1.0, 0.5, 0.25);
    // What the value is divided by, or the start of the warning.
    for (lines, divisor, warning) in [
        ("", Vec3::ONE, ""),
        ("EXPOSURE=2\n", Vec3::splat(2.0), ""),
        ("EXPOSURE= 2.0\nEXPOSURE=4\n", Vec3::splat(8.0), ""),
        ("COLORCORR=1 2 4\n", Vec3::new(1.0, 2.0, 4.0), ""),
        ("EXPOSURE=0\n", Vec3::ONE, "EXPOSURE=0 is no factor"),
        ("EXPOSURE=bright\n", Vec3::ONE, "EXPOSURE=bright is no factor"),
        ("PRIMARIES=0.64 0.33 0.30 0.60 0.15 0.06 0.3127 0.3290\n", Vec3::ONE, ""),
        (
            "PRIMARIES=0.73 0.27 0.27 0.72 0.15 0.05 0.31 0.33\n",
            Vec3::ONE,
            "its primaries are not those of Rec. 709",
        ),
        ("GAMMA=1\n", Vec3::ONE, ""),
        ("GAMMA=2.2\n", Vec3::ONE, "GAMMA=2.2"),
        ("PIXASPECT=1.0\n", Vec3::ONE, ""),
        ("PIXASPECT=2\n", Vec3::ONE, "PIXASPECT=2"),
        ("SOFTWARE=by hand\nVIEW= -vta\nCAPDATE= 2020:01:01\n# a comment\nmkillum -ab 1\n", Vec3::ONE, ""),
    ] {
        assert_eq!(color(lines) * divisor, plain, "{lines}");
        let warnings = map_of(lines).warnings;
        assert_eq!(warnings.len(), usize::from(!warning.is_empty()), "{lines}: {warnings:?}");
        assert!(warnings.iter().all(|line| line.starts_with(warning)), "{lines}: {warnings:?}");
    }
}

/// An OpenEXR file of one layer with channels of these names, each of the value after it, in blocks.
fn openexr(channels: &[(&str, f32)], blocks: exr::prelude::Blocks, half: bool) -> Vec<u8> {
    use exr::prelude::*;
    let samples = |value: f32| match half {
        true => FlatSamples::F16(vec![f16::from_f32(value); 8]),
        false => FlatSamples::F32(vec![value; 8]),
    };
    let list = channels.iter().map(|(name, value)| AnyChannel::new(*name, samples(*value))).collect();
    let encoding = Encoding { blocks, line_order: LineOrder::Increasing, ..Encoding::FAST_LOSSLESS };
    let layer = Layer::new((4, 2), LayerAttributes::default(), encoding, AnyChannels::sort(list));
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

#[test]
fn openexr_files_of_every_layout_are_read() {
    use exr::prelude::{Blocks, Vec2};
    let grey = Vec3::splat(0.5);
    for (channels, expected) in [
        (&[("Y", 0.5)][..], grey),
        (&[("sky.Y", 0.5)], grey),
        (&[("Z", 0.5)], grey),
        (&[("R", 1.0), ("G", 0.5), ("B", 0.25)], Vec3::new(1.0, 0.5, 0.25)),
        (&[("R", 1.0), ("G", 0.5), ("B", 0.25), ("A", 0.0), ("Y", 9.0)], Vec3::new(1.0, 0.5, 0.25)),
        (&[("view.sky.R", 1.0), ("view.sky.G", 0.5), ("view.sky.B", 0.25)], Vec3::new(1.0, 0.5, 0.25)),
    ] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(2, 2))] {
            for half in [false, true] {
                let environment = decode_environment("sky.exr", &openexr(channels, blocks, half)).unwrap();
                let texels = environment.map.texels();
                assert!(environment.warnings.is_empty(), "{:?}", environment.warnings);
                assert!(
                    texels.iter().all(|t| argus_scene::rgb9e5::decode(*t) == expected),
                    "{channels:?} {blocks:?}"
                );
            }
        }
    }
    let depths = openexr(&[("Z", 1.0), ("N", 1.0)], Blocks::ScanLines, false);
    assert!(
        decode_environment("sky.exr", &depths).unwrap_err().reason.contains("neither red, green and blue")
    );
}

#[test]
fn openexr_files_that_claim_large_blocks_get_no_memory() {
    use exr::prelude::{Blocks, Vec2};
    for (blocks, attribute, of_width, width) in [
        (Blocks::Tiles(Vec2(4, 2)), "tiles\0tiledesc\0", 0, 60_000_u32),
        (Blocks::ScanLines, "dataWindow\0box2i\0", 8, 100_000_000),
    ] {
        let mut bytes = openexr(&[("R", 1.0), ("G", 0.5), ("B", 0.25)], blocks, false);
        // The attribute's value comes after its length of four bytes.
        let name = bytes.windows(attribute.len()).position(|at| at == attribute.as_bytes()).unwrap();
        let at = name + attribute.len() + 4;
        bytes[at + of_width..][..4].copy_from_slice(&width.to_le_bytes());
        if attribute.starts_with("tiles") {
            bytes[at + 4..][..4].copy_from_slice(&width.to_le_bytes());
        }
        let refused = decode_environment("sky.exr", &bytes).unwrap_err().reason;
        assert!(refused.contains("cannot be held by"), "{blocks:?}: {refused}");
    }
}

#[test]
fn an_environment_replaces_the_sky_and_the_default_sun_and_changes_the_hash() {
    let map = || map_of(8, |x, _| x as f32 * 0.125);
    let bare = scene(vec![patch(1)], vec![white()], Lighting::default());
    let placed = bare.clone().with_environment(map(), b"a file");
    assert!(placed.lighting.lights.is_empty(), "the sun stood in for a light");
    assert_eq!(placed.lighting.sky.map, Some(map().map));
    assert_ne!(placed.hash, bare.hash);
    assert_eq!(placed.hash, bare.hash.in_environment(b"a file"));
    assert_ne!(placed.hash, bare.clone().with_environment(map(), b"another").hash);
    let lit = scene(vec![patch(1)], vec![white()], sun(DVec3::NEG_Y));
    assert_eq!(lit.clone().with_environment(map(), b"a file").lighting.lights, lit.lighting.lights);
}

const ALL: DirectLight = DirectLight { effects: LightEffects::ALL, rays: 64 };

/// A floor of 2 × 2 m in y = 0 and a square of a metre half a metre above it.
fn roofed(environment: Environment) -> Scene {
    let mut scene = scene(vec![patch(1), patch(1)], vec![white()], furnace());
    let flat = DMat3::from_quat(DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2));
    scene.instances[0].world_from_mesh = DAffine3 { matrix3: flat, translation: DVec3::ZERO };
    scene.instances[1].world_from_mesh = DAffine3 { matrix3: flat * 0.5, translation: DVec3::Y * 0.5 };
    scene.with_environment(environment, b"")
}

fn floor_at(scene: &Scene, light: DirectLight, x: f64) -> Vec3 {
    let eye = DVec3::new(0.9, 0.4, 0.0);
    let tracer = tracer(scene.clone()).with_direct_light(light);
    let to = DVec3::new(x, 0.0, 0.05) - eye;
    tracer.radiance_along(eye, to.normalize(), DVec3::ZERO, DVec3::ZERO)
}

#[test]
fn a_map_of_one_colour_lights_as_a_sky_of_one_colour() {
    let mapped = roofed(map_of(64, |_, _| 1.0));
    let sky = Scene { lighting: furnace(), ..mapped.clone() };
    for x in [0.0, 0.4, 0.8] {
        for effects in [LightEffects::NONE, LightEffects::ALL] {
            let light = DirectLight { effects, rays: 64 };
            let [mapped, sky] = [&mapped, &sky].map(|scene| floor_at(scene, light.clone(), x));
            assert!((mapped - sky).abs().max_element() < 1e-3, "{effects}: {mapped} {sky}");
        }
    }
}

#[test]
fn a_sun_of_one_texel_casts_a_shadow_without_noise() {
    // In the zenith's row of a map whose rest is black: all of its light but a sliver is a light's.
    let environment = map_of(256, |x, y| if (x, y) == (7, 0) { 1e6 } else { 0.0 });
    let Light::Directional { direction, irradiance, angular_radius } = environment.lights[0] else {
        panic!("{:?}", environment.lights)
    };
    assert!(direction.y < -0.999 && angular_radius < 0.01);
    let scene = roofed(environment);
    let lit = floor_at(&scene, ALL, 0.8);
    let expected = irradiance * (-direction.y as f32) / std::f32::consts::PI;
    assert!((lit / expected - Vec3::ONE).abs().max_element() < 1e-3, "{lit} {expected}");
    assert!(floor_at(&scene, ALL, 0.0).max_element() < 1e-4 * lit.x);
}

#[test]
fn the_background_is_the_map_and_shows_its_sun_as_white() {
    let environment = map_of(64, |x, y| if (x, y) == (20, 10) { 1e5 } else { 0.25 + x as f32 / 128.0 });
    assert_eq!(environment.lights.len(), 1);
    let scene = roofed(environment);
    let sky: &Sky = &scene.lighting.sky;
    let Light::Directional { direction, .. } = scene.lighting.lights[0] else { unreachable!() };
    let tracer = tracer(scene.clone());
    for d in [-direction, DVec3::Y, DVec3::NEG_Z, DVec3::X, DVec3::new(-0.3, 0.4, 0.2).normalize()] {
        let seen = tracer.radiance_along(DVec3::new(0.0, 50.0, 0.0), d, DVec3::ZERO, DVec3::ZERO);
        assert_eq!(seen, sky_radiance(sky, d.as_vec3()));
    }
    assert!(sky_radiance(sky, -direction.as_vec3()).min_element() >= 1.0);
}
