//! Light cells of degenerate scenes and cameras: each is stable, and each is right where the answer is known.

use std::sync::Arc;
use std::time::Instant;

use argus_sampler::{CellSettings, GpuSampler, Indirect, PathSettings, SamplerSettings};
use argus_scene::{
    Camera, LightEffects, Lighting, Material, Mesh, Output, Plan, Sampler as _, Scene, Sky, SurfaceLight,
    ViewJob,
};
use glam::{DAffine3, DVec3, Vec3, Vec4};

use crate::common::*;
use crate::rooms::*;

const SIZE: [u32; 2] = [96, 72];

fn with_cells(scene: &Arc<Scene>) -> GpuSampler {
    let paths = PathSettings { level: 6, ..PathSettings::default() };
    let indirect = Indirect::Cells(CellSettings { paths, ..CellSettings::default() });
    let effects = indirect.effects_with(LightEffects { shadows: true, ..LightEffects::NONE });
    sampler_with(scene, SamplerSettings { sub_samples: 1, effects, indirect, ..SamplerSettings::default() })
}

const BY_CELLS: SurfaceLight = SurfaceLight::Cells { rays: 64, reflected: true };

fn color(sampler: &mut GpuSampler, camera: Camera, light: SurfaceLight) -> Vec<u8> {
    let view = view_job(camera, SIZE, 1);
    let view = ViewJob { plan: Plan::direct(1).with_light(Some(light)), ..view };
    direct(sampler, &view).images[Output::Color].clone().expect("the job asks for colour").to_vec()
}

fn mean_of(bytes: &[u8]) -> f64 {
    bytes.iter().map(|&b| f64::from(b)).sum::<f64>() / bytes.len() as f64
}

/// Mean difference of two images, of 255.
fn off(one: &[u8], other: &[u8]) -> f64 {
    one.iter().zip(other).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / one.len() as f64
}

/// Light by cells and by rays, which must be about the same in the mean.
fn assert_alike(scene: &Arc<Scene>, camera: Camera, most: f64, what: &str) {
    let mut sampler = with_cells(scene);
    let cells = color(&mut sampler, camera, BY_CELLS);
    let rays = color(&mut sampler, camera, SurfaceLight::Rays);
    println!("{what}: mean {:.2} by cells, {:.2} by rays, of 255", mean_of(&cells), mean_of(&rays));
    assert!((mean_of(&cells) - mean_of(&rays)).abs() < most, "{what}: means differ");
    assert!(color(&mut with_cells(scene), camera, BY_CELLS) == cells, "{what}: bytes differ");
}

/// A scene about a point, scaled; lights keep what they bring to surfaces.
fn scaled(scene: &Scene, by: f64) -> Arc<Scene> {
    let mut scene = scene.clone();
    for instance in &mut scene.instances {
        instance.world_from_mesh = DAffine3::from_scale(DVec3::splat(by)) * instance.world_from_mesh;
    }
    for light in &mut scene.lighting.lights {
        if let argus_scene::Light::Point { position, intensity, .. } = light {
            (*position, *intensity) = (*position * by, *intensity * (by * by) as f32);
        }
    }
    Arc::new(scene)
}

fn open_sky(radiance: f32) -> Sky {
    let all = Vec3::splat(radiance);
    Sky { zenith: all, horizon: all, ground: all, map: None, reach: None }
}

#[test]
fn a_room_of_millimetres_is_lit_like_one_of_metres() {
    let (room, camera) = (box_of_cornell(DVec3::ZERO), view_of_room(DVec3::ZERO));
    let wanted = color(&mut with_cells(&room), camera, BY_CELLS);
    for by in [1e-3, 1e3] {
        let small = Camera { eye: camera.eye * by, target: camera.target * by, ..camera };
        let found = color(&mut with_cells(&scaled(&room, by)), small, BY_CELLS);
        let off = off(&found, &wanted);
        println!("scaled by {by}: off by {off:.3} of 255");
        // Rays of cells start elsewhere by rounding alone.
        assert!(off < 1.5, "scaled by {by}: off by {off} of 255");
    }
}

#[test]
fn leaves_that_face_many_ways_are_lit_like_by_rays() {
    let mut scene = empty_scene();
    scene.materials = vec![Material { double_sided: true, ..grey(0.6) }];
    let mut leaves = Mesh::default();
    for i in 0..4000u32 {
        let number =
            |k: u32| (f64::from(i) * 0.754_877_666 * f64::from(k + 1) + 0.31 * f64::from(k)).fract() as f32;
        let at = Vec3::new(number(0), number(1), number(2)) * 2.0 - 1.0;
        let across = Vec3::new(number(3), number(4), number(5)) - 0.5;
        let along = across.any_orthonormal_vector();
        let first = leaves.positions.len() as u32;
        leaves.positions.extend([at, at + across * 0.08, at + along * 0.05]);
        leaves.indices.extend([first, first + 1, first + 2]);
    }
    place(&mut scene, leaves, DAffine3::IDENTITY);
    place(&mut scene, quad(Vec3::NEG_Y, Vec3::X * 3.0, Vec3::NEG_Z * 3.0, 1.0, 0), DAffine3::IDENTITY);
    scene.lighting = Lighting { lights: Vec::new(), sky: open_sky(1.0), exposure: 1.0 };
    let camera = Camera::look_at(DVec3::new(0.3, 0.6, 3.5), DVec3::ZERO);
    assert_alike(&Arc::new(scene), camera, 4.0, "leaves");
}

#[test]
fn cells_of_a_mesh_of_a_million_triangles_are_filled_in_bounded_time() {
    // A ball of 708 rings has 1,002,528 triangles. Cells of the far view hold thousands of them.
    let mut scene = empty_scene();
    scene.materials = vec![grey(0.6)];
    place(&mut scene, ball(0, 708), DAffine3::IDENTITY);
    assert!(scene.meshes[0].triangles() > 1_000_000);
    scene.lighting = Lighting { lights: Vec::new(), sky: open_sky(1.0), exposure: 1.0 };
    let scene = Arc::new(scene);
    let mut sampler = with_cells(&scene);
    for distance in [3.0, 30.0] {
        let camera = Camera::look_at(DVec3::new(0.2, 0.4, distance), DVec3::ZERO);
        let begin = Instant::now();
        let cells = color(&mut sampler, camera, SurfaceLight::Cells { rays: 16, reflected: true });
        let rays = color(&mut sampler, camera, SurfaceLight::Rays);
        println!(
            "from {distance} m: {:.1} s, mean {:.2} and {:.2}",
            begin.elapsed().as_secs_f64(),
            mean_of(&cells),
            mean_of(&rays)
        );
        assert!((mean_of(&cells) - mean_of(&rays)).abs() < 4.0, "from {distance} m");
    }
    // Evenly lit from all around and convex: all of its cells see all of the sky.
    let report = sampler.light_cells().unwrap();
    assert!(report.cells > 0 && report.fill_ms / (report.filled as f64) < 20.0, "{report:?}");
}

#[test]
fn cameras_inside_geometry_are_lit_like_by_rays() {
    let (room, mut scene) = (box_of_cornell(DVec3::ZERO), empty_scene());
    // Inside of the block, whose walls are seen from behind, and within a wall.
    for eye in [DVec3::new(0.4, -1.3, -0.5), DVec3::new(0.0, -2.0, 0.0), DVec3::new(0.0, 0.0, -2.0)] {
        let camera = Camera { fov_deg: 90.0, ..Camera::look_at(eye, eye + DVec3::new(0.3, 0.2, 1.0)) };
        assert_alike(&room, camera, 4.0, "inside");
    }
    // In a closed body nothing arrives.
    scene.materials = vec![Material { double_sided: true, ..grey(0.6) }];
    place(&mut scene, ball(0, 24), DAffine3::IDENTITY);
    scene.lighting = Lighting { lights: Vec::new(), sky: open_sky(1.0), exposure: 1.0 };
    let dark = color(&mut with_cells(&Arc::new(scene)), Camera::look_at(DVec3::ZERO, DVec3::X), BY_CELLS);
    assert!(mean_of(&dark) < 1.0, "{} of 255 in a closed ball", mean_of(&dark));
}

#[test]
fn surfaces_that_reflect_nothing_are_black_and_bring_nothing_to_others() {
    let mut scene = (*box_of_cornell(DVec3::ZERO)).clone();
    for material in &mut scene.materials {
        material.base_color = Vec4::new(0.0, 0.0, 0.0, 1.0);
    }
    let mut sampler = with_cells(&Arc::new(scene.clone()));
    assert!(color(&mut sampler, view_of_room(DVec3::ZERO), BY_CELLS).iter().all(|byte| *byte == 0));
    // A white panel among black walls has the light of the lamp alone.
    scene.materials.push(grey(0.7));
    let white = scene.materials.len() as u32 - 1;
    place(&mut scene, quad(Vec3::NEG_Z * 1.9, Vec3::X, Vec3::Y, 1.0, white), DAffine3::IDENTITY);
    let scene = Arc::new(scene);
    let by_cells = color(&mut with_cells(&scene), view_of_room(DVec3::ZERO), BY_CELLS);
    let effects = LightEffects { shadows: true, ..LightEffects::NONE };
    let mut direct_only =
        sampler_with(&scene, SamplerSettings { sub_samples: 1, effects, ..SamplerSettings::default() });
    let alone = direct(&mut direct_only, &view_job(view_of_room(DVec3::ZERO), SIZE, 1)).images[Output::Color]
        .clone()
        .unwrap();
    assert!(mean_of(&alone) > 1.0 && off(&by_cells, &alone) < 0.5, "off by {}", off(&by_cells, &alone));
}

#[test]
fn under_a_black_sky_without_lights_all_is_black() {
    let mut scene = (*box_of_cornell(DVec3::ZERO)).clone();
    scene.lighting = Lighting { lights: Vec::new(), sky: Sky::BLACK, exposure: 1.0 };
    let mut sampler = with_cells(&Arc::new(scene));
    assert!(color(&mut sampler, view_of_room(DVec3::ZERO), BY_CELLS).iter().all(|byte| *byte == 0));
    // Outside, where rays reach the sky.
    let outside = Camera::look_at(DVec3::new(5.0, 4.0, 9.0), DVec3::ZERO);
    assert!(color(&mut sampler, outside, BY_CELLS).iter().all(|byte| *byte == 0));
}
