//! Light cells are even: no blotches on a wall that a window lights, and points that look the same from one step to the next.

use std::sync::Arc;

use argus_sampler::{CellSettings, GpuSampler, Indirect, PathSettings, SamplerSettings};
use argus_scene::reference::{DirectLight, Indirect as Paths, Tracer};
use argus_scene::{Camera, LightEffects, Lighting, Output, Outputs, Scene, Sky, SurfaceLight, ViewJob};
use glam::{DAffine3, DVec2, DVec3, Vec3};

use crate::cells::{cells, job};
use crate::common::*;
use crate::rooms::*;

/// Pixels of a block's edge.
const BLOCK: usize = 16;

/// Fewer reflections than by default, because the reference traces each.
fn settings() -> CellSettings {
    let paths = PathSettings { bounces: 5, ..PathSettings::default() };
    CellSettings { paths, ..CellSettings::default() }
}

fn sampler(scene: &Arc<Scene>) -> GpuSampler {
    let indirect = Indirect::Cells(settings());
    let effects = indirect.effects_with(LightEffects::NONE);
    sampler_with(scene, SamplerSettings { sub_samples: 1, effects, indirect, ..SamplerSettings::default() })
}

/// A grey room of four metres under an even sky. Its front wall has a window of 1.2 m in the middle.
fn room_with_a_window() -> Arc<Scene> {
    const HALF: f32 = 0.6;
    let mut scene = empty_scene();
    scene.materials = vec![grey(0.7)];
    add_room(&mut scene, DVec3::ZERO, [0; 6]);
    // The wall towards +z, and four parts in its place.
    let front = scene
        .meshes
        .iter()
        .position(|mesh| mesh.positions.iter().all(|at| (mesh.origin.z as f32 + at.z - 2.0).abs() < 1e-3));
    let front = front.expect("a room has a front wall") as u32;
    scene.instances.retain(|instance| instance.mesh != front);
    let (rim, middle) = ((2.0 - HALF) * 0.5, (2.0 + HALF) * 0.5);
    for (at, x, y) in [
        (Vec3::new(0.0, middle, 2.0), 2.0, rim),
        (Vec3::new(0.0, -middle, 2.0), 2.0, rim),
        (Vec3::new(middle, 0.0, 2.0), rim, HALF),
        (Vec3::new(-middle, 0.0, 2.0), rim, HALF),
    ] {
        // Like the wall that it replaces, it faces inwards.
        place(&mut scene, quad(at, Vec3::Y * y, Vec3::X * x, 1.0, 0), DAffine3::IDENTITY);
    }
    let one = Vec3::ONE;
    let sky = Sky { zenith: one, horizon: one, ground: one, map: None, reach: None };
    scene.lighting = Lighting { lights: Vec::new(), sky, exposure: 1.0 };
    Arc::new(scene)
}

/// A part of the wall across from the window, as large in pixels as in a view of 640×480 that shows all of it.
fn wall() -> Camera {
    Camera { fov_deg: 4.0, ..Camera::look_at(DVec3::new(0.0, 0.1, 0.5), DVec3::new(0.0, 0.0, -2.0)) }
}

/// Luminance of radiance.
fn brightness(radiance: Vec3) -> f64 {
    f64::from(radiance.dot(Vec3::new(0.2126, 0.7152, 0.0722)))
}

fn radiance(
    sampler: &mut GpuSampler,
    camera: Camera,
    size: [u32; 2],
    light: Option<SurfaceLight>,
) -> Vec<f64> {
    let job = ViewJob { outputs: Outputs::only(Output::Radiance), ..job(camera, size, light) };
    let image = direct(sampler, &job).images[Output::Radiance].clone().expect("is asked for");
    let numbers: Vec<f32> = image.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    numbers.as_chunks::<3>().0.iter().map(|rgb| brightness((*rgb).into())).collect()
}

/// The mean over blocks of the standard deviation of the logarithm.
fn unevenness(image: &[f64], width: usize) -> f64 {
    let block = |column: usize, row: usize| {
        let rows = image.chunks(width).skip(row * BLOCK).take(BLOCK);
        let logs: Vec<f64> =
            rows.flat_map(|row| &row[column * BLOCK..(column + 1) * BLOCK]).map(|value| value.ln()).collect();
        let mean = logs.iter().sum::<f64>() / logs.len() as f64;
        (logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>() / logs.len() as f64).sqrt()
    };
    let (columns, rows) = (width / BLOCK, image.len() / width / BLOCK);
    (0..columns * rows).map(|at| block(at % columns, at / columns)).sum::<f64>() / (columns * rows) as f64
}

#[test]
fn a_wall_that_a_window_lights_has_no_blotches() {
    let (scene, size) = (room_with_a_window(), [32, 32]);
    let effects = Indirect::Cells(settings()).effects_with(LightEffects::NONE);
    let tracer = Tracer::new(Arc::clone(&scene)).with_direct_light(DirectLight { effects, rays: 256 });
    let paths = Paths { paths: 8192, bounces: settings().paths.bounces };
    let truth = tracer.render_with(&wall(), size, 1, Some(paths), |_| {});
    let truth: Vec<f64> = truth.radiance.iter().map(|radiance| brightness(*radiance)).collect();
    let mut sampler = sampler(&scene);
    let width = size[0] as usize;
    let of_truth = unevenness(&truth, width);
    let mean = |image: &[f64]| image.iter().sum::<f64>() / image.len() as f64;
    // Of the first 16 rays a cell has none or one that finds the window. From 64 on neighbours have the same directions, so that what
    // is left of their error is even: it is an error of the mean.
    for (light, most) in [(cells(16), 6.0), (cells(64), 1.5), (cells(256), 1.5)] {
        let image = radiance(&mut sampler, wall(), size, light);
        let (found, off) = (unevenness(&image, width), mean(&image) / mean(&truth));
        println!("{light:?}: uneven by {found:.4}, the reference by {of_truth:.4}; mean {off:.3} of it");
        assert!(found <= most * of_truth, "{light:?}: {found} against {of_truth}");
        assert!((off - 1.0).abs() < 0.15, "{light:?}: mean {off}");
    }
}

#[test]
fn a_point_hardly_changes_from_one_step_to_the_next() {
    let scene = box_of_cornell(DVec3::ZERO);
    let (size, mut sampler) = ([320, 240], sampler(&scene));
    let first = view_of_room(DVec3::ZERO);
    let side = first.view_from_world().transpose().x_axis * 0.05;
    let second = Camera { eye: first.eye + side, target: first.target + side, ..first };
    let [before, after] = [first, second].map(|camera| radiance(&mut sampler, camera, size, cells(64)));
    // Where the second view shows the points of the first, as long as nothing is in the way.
    let ranges = |sampler: &mut GpuSampler, camera| {
        let job = ViewJob { outputs: Outputs::only(Output::Range), ..job(camera, size, cells(64)) };
        let image = direct(sampler, &job).images[Output::Range].clone().expect("is asked for");
        image
            .as_chunks::<4>()
            .0
            .iter()
            .map(|bytes| f64::from(f32::from_le_bytes(*bytes)))
            .collect::<Vec<f64>>()
    };
    let [near, far] = [first, second].map(|camera| ranges(&mut sampler, camera));
    let (rays, view_from_world, plane) =
        (first.rays(size[0], size[1]), second.view_from_world(), second.plane(size[0], size[1]));
    let full = DVec2::new(size[0].into(), size[1].into());
    let mut changes = Vec::new();
    for (at, range) in near.iter().enumerate().filter(|(_, range)| range.is_finite()) {
        let pixel = DVec2::new((at as u32 % size[0]).into(), (at as u32 / size[0]).into()) + 0.5;
        let Some(direction) = rays.direction(pixel) else { continue };
        let away = first.eye + direction * *range - second.eye;
        let seen = view_from_world * away;
        let there = (DVec2::new(seen.x, -seen.y) / -seen.z / plane.half + 1.0) * 0.5 * full;
        if there.cmplt(DVec2::ZERO).any() || there.cmpge(full).any() {
            continue;
        }
        let there = there.y as usize * size[0] as usize + there.x as usize;
        // What the second view shows there may be something else, or an edge within the pixel.
        if (far[there] / away.length() - 1.0).abs() < 2e-3 {
            changes.push((after[there] / before[at] - 1.0).abs());
        }
    }
    changes.sort_by(f64::total_cmp);
    let (median, large) =
        (changes[changes.len() / 2], changes.iter().filter(|change| **change > 0.1).count() as f64);
    let large = large / changes.len() as f64;
    println!("{} points: median change {median:.4}, {large:.4} of them by more than a tenth", changes.len());
    assert!(changes.len() > 30_000 && median <= 0.02 && large <= 0.05, "{median}, {large}");
}
