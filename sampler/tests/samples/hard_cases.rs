//! Degenerate scenes, cameras and orders: each is stable, and each is right where the answer is known.

use std::sync::Arc;

use argus_sampler::SamplerSettings;
use argus_scene::material::{Filter, Wrap};
use argus_scene::shading::sky_radiance;
use argus_scene::tone::display_from_radiance;
use argus_scene::{
    Camera, Cancel, Light, Material, Mesh, Output, Plan, PlaneKind, RenderError, Sampler, Scene, SceneHash,
    Texture, TextureRef, Warp,
};
use glam::{DAffine3, DVec2, DVec3, Vec2, Vec3, Vec4};

use crate::common::*;

const SIZE: [u32; 2] = [64, 48];

fn look(eye: DVec3, target: DVec3) -> Camera {
    Camera::look_at(eye, target)
}

fn quad_scene(material: Material, mesh: Mesh, transform: DAffine3) -> Arc<Scene> {
    let mut scene = empty_scene();
    scene.materials = vec![material];
    place(&mut scene, mesh, transform);
    Arc::new(scene)
}

/// How many pixels show a surface.
fn covered(scene: &Arc<Scene>, camera: Camera) -> usize {
    let frame = direct(&mut sampler(scene), &view_job(camera, SIZE, 1));
    range_of(&frame).iter().filter(|r| r.is_finite()).count()
}

/// Pixels whose ranges are not the reference's.
fn ranges_apart(scene: &Arc<Scene>, camera: Camera) -> usize {
    let frame = direct(&mut sampler(scene), &view_job(camera, SIZE, 1));
    let truth = reference(scene, &camera, SIZE, 1).range;
    let apart = |(a, b): &(f32, f32)| !(a == b || (a / b - 1.0).abs() < 2e-5);
    let pairs = range_of(&frame).into_iter().zip(truth);
    pairs.inspect(|(a, _)| assert!(!a.is_nan())).filter(apart).count()
}

#[test]
fn a_scene_without_a_triangle_is_sky() {
    let scene = Arc::new(empty_scene());
    let camera = look(DVec3::ZERO, DVec3::new(1.0, 0.2, 0.0));
    let mut sampler = sampler(&scene);
    let frame = direct(&mut sampler, &view_job(camera, SIZE, 1));
    assert!(range_of(&frame).iter().all(|&r| r == f32::INFINITY));
    let image = image_of(&frame);
    for (x, y) in [(0, 0), (63, 47), (32, 24)] {
        let d = camera.direction(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5), SIZE[0], SIZE[1]);
        let sky =
            display_from_radiance(sky_radiance(&scene.lighting.sky, d.as_vec3()), scene.lighting.exposure);
        let shown = image.get_pixel(x, y).0;
        assert!((0..3).all(|c| shown[c].abs_diff(sky[c]) <= 1), "{shown:?} {sky:?}");
    }
    let rig = omni_rig(DVec3::ZERO, 16);
    let omni = sample(&mut sampler, &sample_job(&scene, rig, rig.nearest(&camera, 1)[0], true));
    assert!(host_bytes(&omni, PlaneKind::InverseRange).iter().all(|&b| b == 0));
    assert!(radiance_of(&omni).iter().all(|r| r.min_element() > 0.0));
    assert!(omni.plane(PlaneKind::Normal).is_none(), "nothing is glossy");
}

#[test]
fn one_triangle_covers_what_it_should() {
    let triangle = Mesh {
        positions: vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    };
    let scene = quad_scene(Material::default(), triangle, DAffine3::IDENTITY);
    assert_eq!(ranges_apart(&scene, look(DVec3::Z * 4.0, DVec3::ZERO)), 0);
}

#[test]
fn triangles_without_area_or_with_a_corner_nowhere_are_not_seen() {
    let mut mesh = quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0, 0);
    mesh.positions.extend([Vec3::NAN, Vec3::new(9.0, f32::INFINITY, 0.0), Vec3::new(0.5, 0.5, 0.5)]);
    mesh.normals.extend([Vec3::ZERO; 3]);
    mesh.uvs.extend([Vec2::NAN; 3]);
    mesh.tangents.extend([Vec4::NAN; 3]);
    mesh.indices.extend([0, 1, 4, 5, 1, 2, 6, 6, 6, 0, 2, 0]);
    let scene = quad_scene(Material::default(), mesh, DAffine3::IDENTITY);
    assert_eq!(ranges_apart(&scene, look(DVec3::new(0.3, 0.2, 3.0), DVec3::ZERO)), 0);
    let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    let scene = quad_scene(Material::default(), quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0, 0), flat);
    assert_eq!(covered(&scene, look(DVec3::Z * 3.0, DVec3::ZERO)), 0, "a transform without inverse");
}

#[test]
fn a_back_face_is_seen_only_where_the_material_is_double_sided_mirrored_or_not() {
    let eyes = [DVec3::Z * 3.0, DVec3::Z * -3.0];
    for mirrored in [false, true] {
        let transform = DAffine3::from_scale(DVec3::new(if mirrored { -1.0 } else { 1.0 }, 1.0, 1.0));
        for double_sided in [false, true] {
            let material = Material { double_sided, ..Material::default() };
            let scene = quad_scene(material, quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0, 0), transform);
            let seen = eyes.map(|eye| covered(&scene, look(eye, DVec3::ZERO)) > 0);
            let truth = eyes.map(|eye| {
                reference(&scene, &look(eye, DVec3::ZERO), SIZE, 1).range.iter().any(|r| r.is_finite())
            });
            assert_eq!(seen, truth, "mirrored {mirrored}, double-sided {double_sided}");
            assert_eq!(seen, [true, double_sided]);
        }
    }
}

#[test]
fn a_floor_that_crosses_the_near_plane_is_clipped_right() {
    let floor = quad(Vec3::ZERO, Vec3::X * 1000.0, Vec3::NEG_Z * 1000.0, 1.0, 0);
    let scene = quad_scene(Material::default(), floor, DAffine3::IDENTITY);
    for height in [1.7, 0.02, 1e-3] {
        let eye = DVec3::new(0.3, height, 0.1);
        for target in [DVec3::new(5.0, height, -3.0), DVec3::new(0.31, 0.0, 0.1), DVec3::new(1.0, 0.0, 0.4)] {
            let apart = ranges_apart(&scene, look(eye, target));
            // Near the horizon a direction rounded to f32 meets the floor elsewhere, by more than the tolerance.
            assert!(apart <= 2 * SIZE[0] as usize, "height {height}: {apart}");
        }
    }
}

#[test]
fn a_camera_inside_a_closed_body_sees_its_inside() {
    let scene = quad_scene(Material::default(), ball(0, 12), DAffine3::from_scale(DVec3::splat(0.01)));
    let camera = look(DVec3::new(0.002, 0.001, 0.0), DVec3::new(0.5, 0.1, -1.0));
    assert_eq!(covered(&scene, camera), (SIZE[0] * SIZE[1]) as usize);
    assert!(ranges_apart(&scene, camera) < 8);
}

#[test]
fn a_surface_seen_edge_on_stays_finite() {
    let scene = quad_scene(
        Material { roughness: 0.0, metallic: 1.0, ..Material::default() },
        quad(Vec3::ZERO, Vec3::X * 10.0, Vec3::NEG_Z * 10.0, 1.0, 0),
        DAffine3::IDENTITY,
    );
    for height in [0.0, 1e-9, 1e-5, 1e-3] {
        let camera = look(DVec3::new(0.0, height, 5.0), DVec3::new(0.0, height, 0.0));
        let frame = direct(&mut sampler(&scene), &view_job(camera, SIZE, 4));
        assert!(range_of(&frame).iter().all(|r| !r.is_nan() && *r > 0.0), "height {height}");
        let rig = omni_rig(camera.eye, 24);
        let order = sample_job(&scene, rig, rig.nearest(&camera, 1)[0], true);
        let omni = sample(&mut sampler(&scene), &order);
        assert!(
            floats(&host_bytes(&omni, PlaneKind::InverseRange)).iter().all(|i| i.is_finite() && *i >= 0.0)
        );
        assert!(radiance_of(&omni).iter().all(|r| r.is_finite()));
    }
}

#[test]
fn faces_of_an_omni_sample_show_what_direct_views_in_their_directions_show() {
    let mut scene = empty_scene();
    for (i, axis) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
        let across = Vec3::from_array(std::array::from_fn(|k| axis[(k + 1) % 3]));
        for sign in [1.0, -1.0] {
            let mesh = quad(axis * sign * (2.0 + i as f32), across, axis.cross(across), 1.0, 0);
            place(&mut scene, mesh, DAffine3::IDENTITY);
        }
    }
    scene.lighting.lights.push(Light::Point {
        position: DVec3::ONE,
        intensity: Vec3::ONE,
        range: None,
        radius: 0.0,
    });
    let scene = Arc::new(scene);
    let mut sampler = sampler_with(&scene, SamplerSettings { sub_samples: 1, ..SamplerSettings::default() });
    const FACE: u32 = 48;
    let rig = omni_rig(DVec3::new(0.1, -0.2, 0.3), FACE);
    let here = look(DVec3::new(0.1, -0.2, 0.3), DVec3::X);
    let order = sample_job(&scene, rig, rig.nearest(&here, 1)[0], true);
    let omni = sample(&mut sampler, &order);
    let (radiance, inverse) = (radiance_of(&omni), floats(&host_bytes(&omni, PlaneKind::InverseRange)));
    for face in omni.camera.faces() {
        let axes = face.view_from_world.transpose();
        let eye = omni.camera.center();
        let fov_deg = 2.0 * face.tan_half_fov.y.atan().to_degrees();
        let camera = Camera { up: axes.y_axis, fov_deg, ..look(eye, eye - axes.z_axis) };
        let frame = direct(&mut sampler, &view_job(camera, [FACE; 2], 1));
        let (image, range) = (image_of(&frame), range_of(&frame));
        assert!(range.iter().any(|r| r.is_finite()), "each face sees its square");
        for y in 0..FACE {
            for x in 0..FACE {
                let at = ((face.offset[1] + y) * 3 * FACE + face.offset[0] + x) as usize;
                let held = display_from_radiance(radiance[at], scene.lighting.exposure);
                let shown = image.get_pixel(x, y).0;
                assert!((0..3).all(|c| held[c].abs_diff(shown[c]) <= 1), "{x},{y}: {held:?} {shown:?}");
                let truth = 1.0 / range[(y * FACE + x) as usize];
                assert!((inverse[at] - truth).abs() <= 1e-5 * truth, "{x},{y}");
            }
        }
    }
}

#[test]
fn a_view_larger_than_a_tile_has_no_seams() {
    let floor = quad(Vec3::ZERO, Vec3::X * 9.0, Vec3::NEG_Z * 9.0, 1.0, 0);
    let scene = quad_scene(Material::default(), floor, DAffine3::IDENTITY);
    let camera = look(DVec3::new(1.0, 2.0, 8.0), DVec3::ZERO);
    // 4 × 600 sub-samples in a row: two tiles.
    let size = [601, 45];
    let mut sampler = sampler(&scene);
    let fine = direct(&mut sampler, &view_job(camera, size, 16));
    let truth = reference(&scene, &camera, size, 16);
    let flip = flip("tiled", &image_of(&fine), &truth.display(scene.lighting.exposure));
    assert!(flip <= 0.01, "FLIP {flip}");
    assert_eq!(fine.images[Output::Color].as_ref().unwrap().len(), 601 * 45 * 3);
    assert_eq!(range_of(&fine).len(), 601 * 45);
}

#[test]
fn hundreds_of_textures_of_any_shape_are_looked_up_right() {
    let mut scene = empty_scene();
    scene.materials.clear();
    let wraps = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];
    for i in 0..300u32 {
        let (width, height) = (1 + i * 7 % 61, 1 + i * 13 % 47);
        let channel = |i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8;
        let texel = |t: u32| [channel(t), channel(t + 1), channel(t + 2), 255];
        scene.textures.push(Texture {
            name: String::new(),
            width,
            height,
            rgba: (0..width * height).flat_map(|t| texel(t / 5 + i)).collect::<Vec<u8>>().into(),
            srgb: i % 3 != 0,
            wrap: [wraps[i as usize % 3], wraps[(i as usize / 3) % 3]],
            filter: Filter::Linear,
        });
        let base_color_texture = Some(TextureRef { offset: Vec2::new(-0.7, 0.4), ..TextureRef::new(i) });
        scene.materials.push(Material { base_color: Vec4::ONE, base_color_texture, ..Material::default() });
        let at = Vec3::new((i % 20) as f32, (i / 20) as f32, 0.0) * 2.2;
        place(&mut scene, quad(at, Vec3::X, Vec3::Y, 2.5, i), DAffine3::IDENTITY);
    }
    let scene = Arc::new(scene);
    let camera = look(DVec3::new(21.0, 15.0, 45.0), DVec3::new(21.0, 15.4, 0.0));
    let size = [320, 240];
    let frame = direct(&mut sampler(&scene), &view_job(camera, size, 4));
    let truth = reference(&scene, &camera, size, 4);
    let flip = flip("textures", &image_of(&frame), &truth.display(scene.lighting.exposure));
    assert!(flip <= 0.01, "FLIP {flip}");
}

#[test]
fn instances_of_one_mesh_share_draws_and_are_all_seen() {
    let mut scene = empty_scene();
    place(&mut scene, ball(0, 6), DAffine3::from_scale(DVec3::splat(0.4)));
    for i in 1..900u32 {
        let at = DVec3::new(f64::from(i % 30), f64::from(i / 30), 0.0);
        let mut instance = scene.instances[0];
        instance.world_from_mesh = DAffine3::from_translation(at) * DAffine3::from_scale(DVec3::splat(0.4));
        scene.instances.push(instance);
    }
    let scene = Arc::new(scene);
    let camera = look(DVec3::new(14.5, 14.5, 42.0), DVec3::new(14.5, 14.5, 0.0));
    assert!(ranges_apart(&scene, camera) < 40, "silhouettes may differ by a pixel here and there");
    let inside = look(DVec3::new(3.2, 4.1, 1.0), DVec3::new(9.0, 9.0, 0.0));
    assert!(ranges_apart(&scene, inside) < 20);
}

#[test]
fn orders_that_cannot_be_honoured_say_which_field_is_at_fault() {
    let scene = Arc::new(empty_scene());
    let mut sampler = sampler(&scene);
    let camera = look(DVec3::ZERO, DVec3::X);
    let warp = Plan::Warp(Warp::default());
    for (plan, field) in [
        (warp, "plan"),
        (Plan::direct(2), "plan.samples_per_pixel"),
        (Plan::direct(0), "plan.samples_per_pixel"),
        (Plan::direct(81), "plan.samples_per_pixel"),
    ] {
        let job = argus_scene::ViewJob { plan, ..view_job(camera, SIZE, 1) };
        match sampler.render_views(&[job], &Cancel::new()).remove(0) {
            Err(RenderError::Invalid(invalid)) => assert_eq!(invalid.field, field),
            other => panic!("{other:?}"),
        }
    }
    let rig = omni_rig(DVec3::ZERO, 16);
    let order = sample_job(&scene, rig, rig.nearest(&camera, 1)[0], true);
    let mut foreign = order.clone();
    let mut info = (*foreign.info).clone();
    info.scene = SceneHash([9; 32]);
    foreign.info = Arc::new(info);
    match sampler.render_samples(&foreign, &Cancel::new()).remove(0) {
        Err(RenderError::Invalid(invalid)) => assert_eq!(invalid.field, "sample.scene"),
        other => panic!("{other:?}"),
    }
    let nobody = Cancel::new();
    nobody.cancel();
    assert!(matches!(sampler.render_samples(&order, &nobody)[..], [Err(RenderError::Cancelled)]));
    let views = [view_job(camera, SIZE, 1), view_job(camera, SIZE, 1)];
    assert!(sampler.render_views(&views, &nobody).iter().all(|r| matches!(r, Err(RenderError::Cancelled))));
    for (settings, field) in [
        (SamplerSettings { sub_samples: 3, ..SamplerSettings::default() }, "sub_samples"),
        (SamplerSettings { range_bits: 7, ..SamplerSettings::default() }, "sampler.range_bits"),
    ] {
        match argus_sampler::GpuSampler::with_settings(gpu(), Arc::clone(&scene), settings) {
            Err(RenderError::Invalid(invalid)) => assert_eq!(invalid.field, field),
            other => panic!("{:?}", other.err()),
        }
    }
}

#[test]
fn only_what_the_scene_calls_for_is_on() {
    let on = |scene: &Arc<Scene>| -> Vec<&'static str> {
        sampler(scene).plan().into_iter().filter(|pass| pass.on).map(|pass| pass.name).collect()
    };
    let empty = on(&Arc::new(empty_scene()));
    for absent in ["visibility", "test alpha", "textures", "emit"] {
        assert!(!empty.contains(&absent), "{absent}");
    }
    let glossy = Material { roughness: 0.2, ..Material::default() };
    let scene = quad_scene(glossy, quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1.0, 0), DAffine3::IDENTITY);
    let glossy = on(&scene);
    assert!(glossy.contains(&"normal and specular planes") && glossy.contains(&"visibility"));
    assert!(!glossy.contains(&"shade sample") && !glossy.contains(&"test alpha"));
}
