//! All ways to see triangles see the same, but along edges; and lists of pixels hold what views hold.
#![allow(clippy::unwrap_used)]

mod common;

use std::path::Path;
use std::sync::Arc;

use argus_sampler::{GpuSampler, SamplerKnobs, Visibility};
use argus_scene::material::{AlphaMode, Wrap};
use argus_scene::{Camera, Cancel, Material, PixelJob, Sampler, Scene, Texture, TextureRef, procedural};
use common::{direct, empty_scene, gpu, quad, sampler_with, view_job};
use glam::{DAffine3, DQuat, DVec3, Vec3};

const SIZE: [u32; 2] = [320, 240];

fn by(visibility: Visibility) -> SamplerKnobs {
    SamplerKnobs { visibility, ..SamplerKnobs::default() }
}

fn real_scene(path: &str) -> Option<Arc<Scene>> {
    let Some(folder) = std::env::var_os("ARGUS_SCENES") else {
        assert!(std::env::var_os("ARGUS_REQUIRE_SCENES").is_none(), "ARGUS_SCENES is not set");
        println!("skipped: ARGUS_SCENES is not set");
        return None;
    };
    Some(Arc::new(argus_scene::open(&Path::new(&folder).join(path).to_string_lossy()).unwrap()))
}

/// Share of sub-samples whose ids differ between the rasteriser and packets.
fn differing(sampler: &mut GpuSampler, camera: &Camera, side: u32) -> f64 {
    let (raster, _) = sampler.identify(camera, SIZE, side, Visibility::Raster).unwrap();
    let (cpu, _) = sampler.identify(camera, SIZE, side, Visibility::Cpu).unwrap();
    assert!(raster.iter().any(|ids| ids[0] != 0), "something is seen");
    raster.iter().zip(&cpu).filter(|(a, b)| a != b).count() as f64 / raster.len() as f64
}

fn cameras(scene: &Scene) -> Vec<Camera> {
    let named: Vec<Camera> = scene.cameras.iter().map(|named| named.camera).take(3).collect();
    if named.is_empty() { vec![scene.default_camera()] } else { named }
}

#[test]
fn packets_see_terrain_as_the_rasteriser_does() {
    let scene = Arc::new(procedural::terrain(100_000));
    let mut sampler = sampler_with(&scene, SamplerKnobs::default());
    for camera in cameras(&scene) {
        let share = differing(&mut sampler, &camera, 1);
        println!("terrain: {share:.5}");
        assert!(share < 0.01, "{share}");
    }
}

#[test]
fn packets_see_sponza_as_the_rasteriser_does() {
    let Some(scene) = real_scene("sponza/sponza.glb") else { return };
    let mut sampler = sampler_with(&scene, SamplerKnobs::default());
    let inside =
        Camera { fov_deg: 70.0, ..Camera::look_at(DVec3::new(-11.0, 3.0, 0.0), DVec3::new(0.0, 4.0, 0.0)) };
    for camera in cameras(&scene).into_iter().chain([inside]) {
        for side in [1, 2] {
            let share = differing(&mut sampler, &camera, side);
            println!("sponza: {share:.5}");
            assert!(share < 0.01, "{share}");
        }
    }
}

/// Cut-outs, mirrored and scaled copies, one-sided and two-sided, near the world's zero or far from it.
fn odd_scene(at: DVec3) -> Arc<Scene> {
    let mut scene = empty_scene();
    let side = 64u32;
    let holes = (0..side * side).flat_map(|i| {
        let (x, y) = (i % side, i / side);
        [200, 120, 40, if (x / 8 + y / 8) % 2 == 0 { 255 } else { 20 }]
    });
    scene.textures.push(Texture {
        name: "holes".to_owned(),
        width: side,
        height: side,
        rgba: holes.collect::<Vec<u8>>().into(),
        srgb: true,
        wrap: [Wrap::Repeat; 2],
    });
    let cutout = Material {
        alpha: AlphaMode::Mask(0.5),
        base_color_texture: Some(TextureRef::new(0)),
        double_sided: true,
        ..Material::default()
    };
    scene.materials = vec![Material::default(), cutout];
    scene.meshes.push(quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0, 0));
    scene.meshes.push(quad(Vec3::ZERO, Vec3::X, Vec3::Y, 2.0, 1));
    for i in 0..40 {
        let angle = f64::from(i) * 0.37;
        let turn = DQuat::from_rotation_y(angle) * DQuat::from_rotation_x(0.3 * f64::from(i % 5));
        let scale =
            DVec3::new(if i % 3 == 0 { -1.0 } else { 1.0 }, 1.0, 1.0) * (0.5 + 0.1 * f64::from(i % 7));
        let place = at + DVec3::new(f64::from(i % 8) * 2.0 - 7.0, f64::from(i / 8) * 2.0 - 4.0, -12.0);
        let transform = DAffine3::from_scale_rotation_translation(scale, turn, place);
        scene.instances.push(argus_scene::Instance {
            mesh: u32::from(i % 2 == 0),
            node: None,
            world_from_mesh: transform,
        });
    }
    Arc::new(scene)
}

#[test]
fn cut_outs_mirrored_copies_and_a_million_metres_make_no_difference() {
    for at in [DVec3::ZERO, DVec3::splat(1e6)] {
        let scene = odd_scene(at);
        let mut sampler = sampler_with(&scene, SamplerKnobs::default());
        let camera = Camera::look_at(at, at + DVec3::NEG_Z);
        let share = differing(&mut sampler, &camera, 2);
        println!("odd scene at {at}: {share:.5}");
        assert!(share < 0.01, "{share} at {at}");
    }
}

#[test]
fn equal_ids_give_equal_bytes_and_differing_ones_are_rare() {
    let scene = odd_scene(DVec3::ZERO);
    let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
    let job = view_job(camera, SIZE, 1);
    let [a, b] = [Visibility::Raster, Visibility::Cpu].map(|way| {
        let mut sampler = sampler_with(&scene, by(way));
        let ids = sampler.identify(&camera, SIZE, 1, way).unwrap().0;
        (ids, direct(&mut sampler, &job))
    });
    let colors = [&a.1, &b.1].map(|frame| frame.color.clone().unwrap());
    let mut equal = 0;
    for (pixel, (one, other)) in a.0.iter().zip(&b.0).enumerate() {
        if one == other {
            let bytes = 3 * pixel..3 * pixel + 3;
            assert_eq!(colors[0][bytes.clone()], colors[1][bytes]);
            equal += 1;
        }
    }
    assert!(equal as f64 > 0.99 * a.0.len() as f64);
    assert_ne!(a.1.provenance.device, b.1.provenance.device, "a pin tells them apart");
}

#[test]
fn a_list_of_pixels_holds_what_the_traced_view_holds_byte_for_byte() {
    let terrain = Arc::new(procedural::terrain(20_000));
    let odd = odd_scene(DVec3::ZERO);
    for (scene, camera) in
        [(&terrain, terrain.default_camera()), (&odd, Camera::look_at(DVec3::ZERO, DVec3::NEG_Z))]
    {
        let mut sampler = sampler_with(scene, by(Visibility::Cpu));
        for samples in [1, 4] {
            let frame = direct(&mut sampler, &view_job(camera, SIZE, samples));
            // Scattered, in no order, and a run of neighbours.
            let mut pixels: Vec<u32> = (0..SIZE[0] * SIZE[1]).step_by(97).chain(4000..4400).collect();
            pixels.sort_unstable();
            pixels.dedup();
            let job = PixelJob {
                camera,
                width: SIZE[0],
                height: SIZE[1],
                pixels: pixels.clone(),
                samples_per_pixel: samples,
                epoch: 0,
                time_secs: 0.0,
            };
            let found = sampler.render_pixels(&[job], &Cancel::new()).remove(0).unwrap();
            for (i, &pixel) in pixels.iter().enumerate() {
                let p = pixel as usize;
                let (color, range) = (frame.color.as_ref().unwrap(), frame.range.as_ref().unwrap());
                assert_eq!(found.color[3 * i..3 * i + 3], color[3 * p..3 * p + 3], "colour of {pixel}");
                assert_eq!(found.range[4 * i..4 * i + 4], range[4 * p..4 * p + 4], "range of {pixel}");
            }
        }
    }
}

#[test]
fn no_pixels_cost_nothing_and_a_pixel_beyond_the_view_is_refused() {
    let scene = odd_scene(DVec3::ZERO);
    let mut sampler = sampler_with(&scene, SamplerKnobs::default());
    let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
    let job = |pixels: Vec<u32>| PixelJob {
        camera,
        width: SIZE[0],
        height: SIZE[1],
        pixels,
        samples_per_pixel: 1,
        epoch: 0,
        time_secs: 0.0,
    };
    let jobs = [job(Vec::new()), job(vec![SIZE[0] * SIZE[1]])];
    let mut results = sampler.render_pixels(&jobs, &Cancel::new());
    let beyond = results.remove(1).unwrap_err();
    assert!(beyond.to_string().contains("pixels"), "{beyond}");
    assert!(results.remove(0).unwrap().color.is_empty());
}

#[test]
fn the_measured_choice_is_one_of_the_ways_and_is_told() {
    let scene = Arc::new(procedural::terrain(20_000));
    let mut sampler = GpuSampler::with_knobs(gpu(), Arc::clone(&scene), by(Visibility::Auto)).unwrap();
    let row =
        |sampler: &GpuSampler| sampler.plan().into_iter().find(|row| row.name == "rasterise").unwrap().why;
    assert!(row(&sampler).contains("direct views by auto"), "{}", row(&sampler));
    direct(&mut sampler, &view_job(scene.default_camera(), SIZE, 1));
    assert!(row(&sampler).contains("measured: raster"), "{}", row(&sampler));
    assert!(row(&sampler).contains("samples by auto"), "{}", row(&sampler));
}

#[test]
fn a_triangle_without_area_or_with_a_corner_nowhere_is_never_hit() {
    let mut scene = empty_scene();
    let mut mesh = quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0, 0);
    let n = mesh.positions.len() as u32;
    mesh.positions.extend([Vec3::new(0.0, 0.0, 0.5), Vec3::splat(f32::NAN)]);
    mesh.normals.extend([Vec3::Z; 2]);
    mesh.indices.extend([n, n, n, 0, n, n + 1, 0, 1, 1]);
    scene.meshes.push(mesh);
    scene.instances.push(argus_scene::Instance {
        mesh: 0,
        node: None,
        world_from_mesh: DAffine3::from_translation(DVec3::new(0.0, 0.0, -3.0)),
    });
    let scene = Arc::new(scene);
    let mut sampler = sampler_with(&scene, SamplerKnobs::default());
    let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
    let (ids, _) = sampler.identify(&camera, SIZE, 1, Visibility::Cpu).unwrap();
    assert!(ids.iter().all(|ids| ids[0] == 0 || ids[1] < 2), "only the quad's two triangles");
    assert!(differing(&mut sampler, &camera, 1) < 0.01);
}
