//! Normals, ids and radiance of direct views, against the reference.

use std::sync::Arc;

use argus_scene::reference::Tracer;
use argus_scene::tone::display_from_radiance;
use argus_scene::{
    Camera, Detail, Frame, Output, Outputs, Plan, Scene, SceneState, ViewJob, Visibility, derived,
};
use glam::{DVec2, DVec3, Vec3};

use crate::against_reference::real_scene;
use crate::common::*;
use crate::{moving, small_scene};

const SIZE: [u32; 2] = [160, 120];

/// The greatest angle between a normal and the reference's, degrees.
const MOST_DEGREES: f64 = 0.5;

fn integers(frame: &Frame, output: Output) -> Vec<i32> {
    let bytes = frame.images[output].as_ref().expect("it was asked for");
    bytes.as_chunks::<4>().0.iter().map(|&bytes| i32::from_le_bytes(bytes)).collect()
}

fn vectors(frame: &Frame, output: Output) -> Vec<Vec3> {
    let numbers = floats(frame.images[output].as_ref().expect("it was asked for"));
    numbers.as_chunks::<3>().0.iter().map(|&xyz| Vec3::from_array(xyz)).collect()
}

fn centre(i: usize) -> DVec2 {
    DVec2::new((i as u32 % SIZE[0]).into(), (i as u32 / SIZE[0]).into()) + 0.5
}

/// A pixel's instance and material, and its normal.
type Shown = (i32, i32, Vec3);

/// What the reference sees at each pixel's centre. Normal maps are left out.
fn truth(scene: &Arc<Scene>, camera: &Camera, time_secs: f64) -> Vec<Shown> {
    let mut plain = Scene::clone(scene);
    plain.materials.iter_mut().for_each(|material| material.normal_texture = None);
    let tracer = Tracer::new(Arc::new(plain)).at(time_secs);
    let pixel = |i: usize| {
        let direction = camera.direction(centre(i), SIZE[0], SIZE[1]);
        let Some(hit) = tracer.trace(camera.eye, direction) else { return (-1, -1, Vec3::ZERO) };
        let material = scene.meshes[scene.instances[hit.instance as usize].mesh as usize].material;
        let normal = tracer.surface(&hit, direction, direction, direction).normal;
        (hit.instance as i32, material as i32, normal)
    };
    (0..(SIZE[0] * SIZE[1]) as usize).map(pixel).collect()
}

/// Checks ids and normals of a view. Pixels at an edge, where the reference's neighbours show something else, may be the other side's.
fn is_as_the_reference_has_it(scene: &Arc<Scene>, camera: Camera, visibility: Visibility, time: (u64, f64)) {
    let (epoch, time_secs) = time;
    let job = ViewJob {
        outputs: Outputs::GEOMETRY,
        visibility,
        state: SceneState::of_epoch(epoch),
        time_secs,
        ..view_job(camera, SIZE, 4)
    };
    let frame = direct(&mut sampler(scene), &job);
    let (instances, materials) = (integers(&frame, Output::Instance), integers(&frame, Output::Material));
    let normals = vectors(&frame, Output::Normal);
    let truth = truth(scene, &camera, time_secs);
    let width = SIZE[0] as usize;
    let (mut inner, mut wrong, mut turned) = (0, Vec::new(), Vec::new());
    for (i, (instance, material, normal)) in truth.iter().enumerate() {
        let around = [i.wrapping_sub(width), i.wrapping_sub(1), i + 1, i + width];
        let same = |j: &usize| truth.get(*j).is_none_or(|other| (other.0, other.1) == (*instance, *material));
        let is_edge = !around.iter().all(same);
        let right = (instances[i], materials[i]) == (*instance, *material);
        if !right {
            if !is_edge {
                wrong.push(i);
            }
            continue;
        }
        inner += usize::from(*instance >= 0);
        if *instance < 0 {
            assert_eq!(normals[i], Vec3::ZERO);
            continue;
        }
        assert!((normals[i].length() - 1.0).abs() < 1e-5, "pixel {i}: {}", normals[i]);
        let degrees = f64::from(normals[i].dot(*normal).clamp(-1.0, 1.0)).acos().to_degrees();
        // At a crease the neighbouring triangle may be met.
        if degrees > MOST_DEGREES {
            turned.push((i, degrees));
        }
    }
    println!("{visibility:?}: {inner} pixels, {} wrong, {} turned", wrong.len(), turned.len());
    assert!(inner > width, "{inner} pixels show a surface");
    assert!(wrong.is_empty(), "{visibility:?}: ids of {wrong:?}");
    assert!(turned.len() * 500 < inner, "{visibility:?}: normals of {turned:?}");
}

#[test]
fn ids_and_normals_of_every_kind_of_surface_are_those_of_the_reference() {
    let scene = Arc::new(small_scene::scene());
    for visibility in Visibility::ALL {
        is_as_the_reference_has_it(&scene, small_scene::camera(), visibility, (0, 0.0));
    }
}

#[test]
fn ids_and_normals_follow_what_moves_and_what_deforms() {
    for scene in [moving::scene(), moving::scene_that_deforms()] {
        let scene = Arc::new(scene);
        for epoch in [0, 6] {
            let time = (epoch, epoch as f64 * moving::EPOCH_SECS);
            is_as_the_reference_has_it(&scene, moving::camera(), Visibility::Raster, time);
        }
    }
}

#[test]
fn ids_and_normals_of_sponza_are_those_of_the_reference() {
    let Some(scene) = real_scene("sponza/sponza.glb") else { return };
    let camera = Camera::look_at(DVec3::new(-11.0, 3.0, 0.0), DVec3::new(0.0, 4.0, 0.0));
    is_as_the_reference_has_it(&scene, camera, Visibility::Cpu, (0, 0.0));
}

#[test]
fn radiance_is_what_colour_shows_and_what_the_reference_has() {
    let scene = Arc::new(small_scene::scene());
    let camera = small_scene::camera();
    let mut sampler = sampler(&scene);
    for samples in [1, 16] {
        let outputs = Outputs::SHADED.with(Output::Range);
        let frame = direct(&mut sampler, &ViewJob { outputs, ..view_job(camera, SIZE, samples) });
        let plain = direct(&mut sampler, &view_job(camera, SIZE, samples));
        for output in [Output::Color, Output::Range] {
            assert!(frame.images[output] == plain.images[output], "{output:?} depends on radiance");
        }
        let colors = frame.images[Output::Color].as_ref().unwrap().as_chunks::<3>().0;
        let radiance = vectors(&frame, Output::Radiance);
        for (color, radiance) in colors.iter().zip(&radiance) {
            let shown = display_from_radiance(*radiance, scene.lighting.exposure);
            assert!(color.iter().zip(shown).all(|(a, b)| a.abs_diff(b) <= 1), "{radiance}: {color:?}");
        }
        if samples == 16 {
            let truth = reference(&scene, &camera, SIZE, samples).radiance;
            let apart: f32 = radiance.iter().zip(&truth).map(|(a, b)| (*a - *b).abs().element_sum()).sum();
            let all: f32 = truth.iter().map(|radiance| radiance.element_sum()).sum();
            println!("radiance: off by {:.5} of the mean", apart / all);
            assert!(apart < 0.02 * all, "{apart} of {all}");
        }
    }
}

#[test]
fn radiance_of_less_detail_is_enlarged_as_colour_is() {
    let scene = Arc::new(small_scene::scene());
    let plan = Plan::Direct { samples_per_pixel: 1, detail: Detail::Half, light: None };
    let outputs = Outputs::SHADED.union(Outputs::GEOMETRY);
    let job = ViewJob { outputs, plan, ..view_job(small_scene::camera(), SIZE, 1) };
    let frame = direct(&mut sampler(&scene), &job);
    let whole = direct(&mut sampler(&scene), &ViewJob { plan: Plan::direct(1), ..job });
    assert_eq!(frame.images[Output::Normal], whole.images[Output::Normal], "geometry has all pixels");
    let [a, b] = [&frame, &whole].map(|frame| vectors(frame, Output::Radiance));
    let mean = |all: &[Vec3]| all.iter().sum::<Vec3>() / all.len() as f32;
    assert_eq!(a.len(), b.len());
    assert!((mean(&a) / mean(&b) - 1.0).abs().max_element() < 0.03, "{} {}", mean(&a), mean(&b));
}

#[test]
fn depth_is_that_of_the_reference_and_flow_is_that_of_depth_and_pose() {
    let scene = Arc::new(small_scene::scene());
    let camera = small_scene::camera();
    let to = Camera { eye: camera.eye + DVec3::new(0.3, -0.1, 0.2), fov_deg: 50.0, ..camera };
    let asked = Outputs::only(Output::Depth).with(Output::Flow);
    let job = ViewJob { outputs: derived::rendered(asked), ..view_job(camera, SIZE, 1) };
    let mut frame = direct(&mut sampler(&scene), &job);
    derived::complete(&mut frame, asked, (&camera, None), Some(&to));
    let depths = floats(frame.images[Output::Depth].as_ref().unwrap());
    let flow = floats(frame.images[Output::Flow].as_ref().unwrap());
    let tracer = Tracer::new(scene);
    let axis = (camera.target - camera.eye).normalize();
    let (half, to_view) = (to.tan_half_fov(SIZE[0], SIZE[1]), to.view_from_world());
    let size = DVec2::new(SIZE[0].into(), SIZE[1].into());
    let (mut elsewhere, mut apart) = (0, 0f64);
    for (i, (depth, flow)) in depths.iter().zip(flow.as_chunks::<2>().0).enumerate() {
        let direction = camera.direction(centre(i), SIZE[0], SIZE[1]);
        let along = direction.dot(axis);
        let truth = tracer.trace(camera.eye, direction).map_or(f64::INFINITY, |hit| hit.range * along);
        let same = f64::from(*depth) == truth || (f64::from(*depth) / truth - 1.0).abs() < 1e-5;
        elsewhere += usize::from(!same);
        if !depth.is_finite() {
            continue;
        }
        // By depth and pose, as a client would.
        let point = camera.eye + direction * (f64::from(*depth) / along);
        let seen = to_view * (point - to.eye);
        let ndc = DVec2::new(seen.x, -seen.y) / (-seen.z * half);
        let moved = (ndc + 1.0) * 0.5 * size - centre(i);
        apart = apart.max((moved - DVec2::new(flow[0].into(), flow[1].into())).length());
    }
    println!("{elsewhere} depths elsewhere, flow off by {apart:.6} pixels at most");
    assert!(elsewhere <= depths.len() / 200, "{elsewhere} pixels");
    assert!(apart < 0.01, "{apart} pixels");
}
