//! Rooms whose light goes from wall to wall, and the truth about them.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::sync::Arc;

use argus_sampler::GpuSampler;
use argus_scene::reference::{Indirect as Paths, ReferenceImage, Tracer};
use argus_scene::{
    Camera, Cancel, Light, Lighting, Material, PixelJob, Sampler as _, Scene, SceneState, Sky,
};
use glam::{DAffine3, DVec3, Vec3, Vec4};

use crate::common::*;

/// A closed box of half size two about `center`, every wall of which has that material.
pub(crate) fn add_room(scene: &mut Scene, center: DVec3, materials: [u32; 6]) {
    let axes = [
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::NEG_X, Vec3::Z, Vec3::Y),
        (Vec3::Y, Vec3::Z, Vec3::X),
        (Vec3::NEG_Y, Vec3::X, Vec3::Z),
        (Vec3::Z, Vec3::X, Vec3::Y),
        (Vec3::NEG_Z, Vec3::Y, Vec3::X),
    ];
    for ((n, x, y), material) in axes.into_iter().zip(materials) {
        place(scene, quad(n * -2.0, x * 2.0, y * 2.0, 1.0, material), DAffine3::from_translation(center));
    }
}

pub(crate) fn grey(albedo: f32) -> Material {
    Material { base_color: Vec4::new(albedo, albedo, albedo, 1.0), ..Material::default() }
}

pub(crate) fn lit_by(lights: Vec<Light>) -> Lighting {
    Lighting { lights, sky: Sky::BLACK, exposure: 1.0 }
}

/// A room whose walls shine and reflect half of what they receive.
pub(crate) fn furnace() -> Arc<Scene> {
    let mut scene = empty_scene();
    scene.materials = vec![Material { emissive: Vec3::splat(0.1), ..grey(0.5) }];
    scene.lighting = lit_by(Vec::new());
    add_room(&mut scene, DVec3::ZERO, [0; 6]);
    Arc::new(scene)
}

/// A room with a red and a green wall, a block in it and a light under the ceiling.
pub(crate) fn box_of_cornell(center: DVec3) -> Arc<Scene> {
    let mut scene = empty_scene();
    let color = |c: Vec3| Material { base_color: c.extend(1.0), ..Material::default() };
    scene.materials = vec![grey(0.7), color(Vec3::new(0.7, 0.1, 0.1)), color(Vec3::new(0.1, 0.6, 0.1))];
    add_room(&mut scene, center, [1, 2, 0, 0, 0, 0]);
    let block = DAffine3::from_translation(center + DVec3::new(0.4, -1.3, -0.5))
        * DAffine3::from_rotation_y(0.4)
        * DAffine3::from_scale(DVec3::new(0.3, 0.35, 0.3));
    for mesh in {
        let mut block_scene = empty_scene();
        block_scene.materials = vec![grey(0.7)];
        add_room(&mut block_scene, DVec3::ZERO, [0; 6]);
        block_scene.meshes
    } {
        place(&mut scene, mesh, block);
    }
    let intensity = Vec3::splat(4.0);
    scene.lighting = lit_by(vec![Light::Point {
        position: center + DVec3::new(0.0, 1.0, 0.2),
        intensity,
        range: None,
        radius: 0.0,
    }]);
    Arc::new(scene)
}

pub(crate) fn view_of_room(center: DVec3) -> Camera {
    Camera { fov_deg: 70.0, ..Camera::look_at(center + DVec3::new(0.1, 0.0, 1.9), center) }
}

pub(crate) fn path_traced(
    scene: &Arc<Scene>,
    camera: &Camera,
    size: [u32; 2],
    bounces: u32,
) -> ReferenceImage {
    let paths = Some(Paths { paths: 64, bounces });
    Tracer::new(Arc::clone(scene)).render_with(camera, size, 4, paths, |_| {})
}

/// By how much pixels of a room differ when they are asked for as a list, in the mean, of 255.
pub(crate) fn off_in_a_list(sampler: &mut GpuSampler, samples_per_pixel: u32) -> f64 {
    let (camera, [width, height]) = (view_of_room(DVec3::ZERO), [64u32, 48]);
    let whole = image_of(&direct(sampler, &view_job(camera, [width, height], samples_per_pixel)));
    let pixels: Vec<u32> = (0..width * height).step_by(7).collect();
    let job = PixelJob {
        camera,
        width,
        height,
        pixels: pixels.clone(),
        samples_per_pixel,
        state: SceneState::default(),
        time_secs: 0.0,
        reflections: None,
    };
    let found = sampler.render_pixels(&[job], &Cancel::new()).remove(0).expect("renders");
    let off = |(i, &pixel): (usize, &u32)| {
        let wanted = whole.get_pixel(pixel % width, pixel / width).0;
        (0..3).map(|c| f64::from(found.color[3 * i + c].abs_diff(wanted[c]))).sum::<f64>() / 3.0
    };
    pixels.iter().enumerate().map(off).sum::<f64>() / pixels.len() as f64
}
