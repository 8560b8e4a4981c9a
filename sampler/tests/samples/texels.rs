//! What a texel of a sample holds: one surface, each triangle of which is shaded once.

use std::sync::Arc;

use argus_sampler::SamplerSettings;
use argus_scene::{
    Light, Material, PlaneKind, Sample, SampleJob, SampleSetInfo, Scene, Sky, Texture, TextureRef, Visibility,
};
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};

use crate::common::*;

/// Exact ranges, so that bytes may be compared with a truth.
fn settings(sub_samples: u32) -> SamplerSettings {
    SamplerSettings { sub_samples, range_bits: 23, ..SamplerSettings::default() }
}

/// What shows the same colour from everywhere.
fn glowing(color: Vec3) -> Material {
    Material { base_color: Vec4::W, emissive: color, roughness: 1.0, ..Material::default() }
}

fn dark(materials: Vec<Material>) -> Scene {
    let mut scene = empty_scene();
    scene.lighting.lights.clear();
    scene.lighting.sky = Sky::BLACK;
    scene.materials = materials;
    scene
}

fn taken(scene: &Arc<Scene>, sub_samples: u32, job: &SampleJob) -> Sample {
    sample(&mut sampler_with(scene, settings(sub_samples)), job)
}

#[test]
fn a_texel_on_an_edge_holds_one_of_the_surfaces_and_never_a_mixture() {
    let [red, green] = [Vec3::X, Vec3::Y];
    let mut scene = dark(vec![glowing(red), glowing(green)]);
    place(&mut scene, quad(Vec3::NEG_Z * 6.0, Vec3::X * 3.0, Vec3::Y * 3.0, 1.0, 0), DAffine3::IDENTITY);
    let near = DAffine3::from_translation(DVec3::new(0.3, -0.2, -3.0));
    place(&mut scene, ball(1, 24), near);
    let scene = Arc::new(scene);
    let job = job_around_origin(&scene, 48);
    for sub_samples in [1, 4, 16] {
        let radiance = radiance_of(&taken(&scene, sub_samples, &job));
        let count = |color: Vec3| radiance.iter().filter(|&&r| r == color).count();
        let [reds, greens, blacks] = [count(red), count(green), count(Vec3::ZERO)];
        assert!(reds > 100 && greens > 100, "{reds} and {greens}");
        assert_eq!(reds + greens + blacks, radiance.len(), "{sub_samples} sub-samples");
    }
}

/// A wall with a pattern of checks, lit by a lamp.
fn patterned(texels: u32, tiles: f32) -> Arc<Scene> {
    let mut scene = dark(vec![Material {
        base_color: Vec4::ONE,
        base_color_texture: Some(TextureRef::new(0)),
        ..Material::default()
    }]);
    let texel = |i: u32| if (i % texels + i / texels).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] };
    scene.textures.push(Texture {
        name: "checks".to_owned(),
        width: texels,
        height: texels,
        rgba: (0..texels * texels).flat_map(texel).collect::<Vec<u8>>().into(),
        srgb: false,
        wrap: [argus_scene::material::Wrap::Repeat; 2],
        filter: argus_scene::material::Filter::Linear,
    });
    scene.lighting.lights.push(Light::Point {
        position: DVec3::new(1.0, 2.0, -1.0),
        intensity: Vec3::splat(20.0),
        range: None,
        radius: 0.0,
    });
    let wall = quad(Vec3::new(0.2, 0.1, -4.0), Vec3::X * 40.0, Vec3::new(0.0, 40.0, 8.0), tiles, 0);
    place(&mut scene, wall, DAffine3::IDENTITY);
    Arc::new(scene)
}

#[test]
fn a_texel_that_one_triangle_fills_is_the_same_with_four_and_with_sixteen_sub_samples() {
    let scene = patterned(64, 5.0);
    let job = job_around_origin(&scene, 64);
    let [four, sixteen] = [4, 16].map(|sub_samples| {
        let sample = taken(&scene, sub_samples, &job);
        [PlaneKind::Radiance, PlaneKind::InverseRange].map(|kind| host_bytes(&sample, kind))
    });
    for (a, b) in four.iter().zip(&sixteen) {
        let apart = a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0).filter(|(a, b)| a != b).count();
        // All but those along the square's edges and its diagonal.
        assert!(apart * 50 <= a.len() / 4, "{apart} of {}", a.len() / 4);
    }
}

#[test]
fn a_texture_finer_than_texels_is_averaged_over_each_of_them() {
    // Some six checks to a texel straight ahead.
    let scene = patterned(64, 48.0);
    let grey = {
        let mut plain = (*scene).clone();
        plain.materials[0] = Material { base_color: Vec4::new(0.5, 0.5, 0.5, 1.0), ..Material::default() };
        Arc::new(plain)
    };
    let job = job_around_origin(&scene, 32);
    for sub_samples in [1, 4] {
        let [found, truth] = [&scene, &grey].map(|scene| radiance_of(&taken(scene, sub_samples, &job)));
        for (found, truth) in found.iter().zip(&truth) {
            let off = (*found - *truth).abs().max_element();
            assert!(off <= 0.03 * truth.max_element() + 1e-6, "{found} where {truth} is right");
        }
    }
}

#[test]
fn a_texel_has_the_range_of_its_central_ray() {
    let floor = quad(Vec3::ZERO, Vec3::X * 50.0, Vec3::NEG_Z * 50.0, 1.0, 0);
    let mut scene = dark(vec![Material::default()]);
    place(&mut scene, floor, DAffine3::from_translation(DVec3::new(0.0, -1.7, 0.0)));
    let scene = Arc::new(scene);
    let sample = taken(&scene, 4, &job_around_origin(&scene, 64));
    let inverse = floats(&host_bytes(&sample, PlaneKind::InverseRange));
    let mut seen = 0;
    for face in sample.camera.faces() {
        let world_from_view = face.view_from_world.transpose();
        for y in 0..64 {
            for x in 0..64 {
                let ndc = Vec2::new(x as f32 + 0.5, y as f32 + 0.5).as_dvec2() / 32.0 - 1.0;
                let view = DVec3::new(ndc.x * face.tan_half_fov.x, -ndc.y * face.tan_half_fov.y, -1.0);
                let direction = (world_from_view * view).normalize();
                let range = -1.7 / direction.y;
                let stored = inverse[((face.offset[1] + y) * 3 * 64 + face.offset[0] + x) as usize];
                // Within the floor by more than the texels that cross its edge.
                if direction.y < 0.0 && (direction * range).abs().max_element() < 40.0 {
                    seen += 1;
                    assert!((f64::from(stored) * range - 1.0).abs() < 1e-4, "{stored} and {}", 1.0 / range);
                }
            }
        }
    }
    assert!(seen > 6000, "{seen}");
}

#[test]
fn samples_of_two_visibility_backends_differ_only_along_edges() {
    let scene = Arc::new(argus_scene::procedural::terrain(20_000));
    let rig = corner_rig(scene.bounds(), [128, 96]);
    let [raster, cpu] = [Visibility::Raster, Visibility::Cpu].map(|visibility| {
        let job = sample_job(&scene, rig, 1, true);
        let info = SampleSetInfo { visibility, ..(*job.info).clone() };
        taken(&scene, 4, &SampleJob { info: Arc::new(info), ..job })
    });
    for plane in &raster.planes {
        let [a, b] = [&raster, &cpu].map(|sample| host_bytes(sample, plane.kind));
        let apart = a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0).filter(|(a, b)| a != b).count();
        assert!(apart * 100 <= 3 * a.len() / 4, "{:?}: {apart} of {} words", plane.kind, a.len() / 4);
    }
}
