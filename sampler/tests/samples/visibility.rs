//! All ways to see triangles see the same, but along edges; and lists of pixels hold what views hold.
#![allow(clippy::unwrap_used)]

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use argus_sampler::{GpuSampler, SamplerSettings};
use argus_scene::material::{AlphaMode, Filter, Wrap};
use argus_scene::{
    Camera, Cancel, LightEffects, Material, Output, PixelJob, Rig, RigSettings, SampleJob, SampleSetInfo,
    Sampler, Scene, SceneState, Texture, TextureRef, ViewJob, Visibility, procedural,
};
use glam::{DAffine3, DQuat, DVec3, Vec3};

use crate::common;
use crate::common::{direct, empty_scene, quad, sampler_with, view_job};

const SIZE: [u32; 2] = [320, 240];

fn real_scene(path: &str) -> Option<Arc<Scene>> {
    let Some(folder) = std::env::var_os("ARGUS_SCENES") else {
        assert!(std::env::var_os("ARGUS_REQUIRE_SCENES").is_none(), "ARGUS_SCENES is not set");
        // What print macros say in a test that passes is shown to nobody.
        let _ = writeln!(std::io::stderr(), "SKIPPED, LOUDLY: ARGUS_SCENES is not set");
        return None;
    };
    Some(Arc::new(argus_scene::open(&Path::new(&folder).join(path).to_string_lossy()).unwrap()))
}

/// Largest share of sub-samples whose ids differ between the rasteriser and packets, on the CPU and in compute.
fn differing(sampler: &mut GpuSampler, camera: &Camera, side: u32) -> f64 {
    let [raster, cpu, trace] = [Visibility::Raster, Visibility::Cpu, Visibility::Trace]
        .map(|way| sampler.identify(camera, SIZE, side, way).unwrap().0);
    assert!(raster.iter().any(|ids| ids[0] != 0), "something is seen");
    let share = |a: &[[u32; 2]], b: &[[u32; 2]]| {
        a.iter().zip(b).filter(|(a, b)| a != b).count() as f64 / a.len() as f64
    };
    println!("cpu and trace differ by {:.6}", share(&cpu, &trace));
    share(&raster, &cpu).max(share(&raster, &trace))
}

/// Share of sub-samples where one way finds a surface and the other finds none.
fn covered_apart(sampler: &mut GpuSampler, camera: &Camera, size: [u32; 2], ways: [Visibility; 2]) -> f64 {
    let [a, b] = ways.map(|way| sampler.identify(camera, size, 1, way).unwrap().0);
    a.iter().zip(&b).filter(|(a, b)| (a[0] == 0) != (b[0] == 0)).count() as f64 / a.len() as f64
}

fn cameras(scene: &Scene) -> Vec<Camera> {
    let named: Vec<Camera> = scene.cameras.iter().map(|named| named.camera).take(3).collect();
    if named.is_empty() { vec![scene.default_camera()] } else { named }
}

#[test]
fn a_sample_rendered_in_slices_has_the_same_bytes() {
    let scene = Arc::new(procedural::terrain(5000));
    let mut sampler = sampler_with(&scene, SamplerSettings::default());
    let mut other = sampler_with(&scene, SamplerSettings::default());
    let rig = Rig::for_scene(&scene, &RigSettings::default()).unwrap();
    for (way, parts) in [(Visibility::Cpu, 5..20), (Visibility::Raster, 1..2)] {
        let whole = common::sample_job(&scene, rig, 1, true);
        let info = SampleSetInfo { visibility: way, ..(*whole.info).clone() };
        let whole = SampleJob { info: Arc::new(info), ..whole };
        let at_once = common::sample(&mut sampler, &whole);
        let (mut gave_way, mut shares) = (0, 0.0);
        // Whoever gets the turn uses the same device.
        let ahead = sampler.render_samples_in_slices(&whole, &Cancel::new(), &mut |_, done| {
            gave_way += 1;
            assert!(done > shares && done <= 1.0, "{way:?}: {done} after {shares}");
            shares = done;
            common::sample(&mut other, &common::sample_job(&scene, rig, 2, false));
        });
        let [Ok(ahead)] = &ahead[..] else { panic!("renders") };
        assert!(parts.contains(&gave_way), "{way:?}: {gave_way} parts");
        assert_eq!(ahead.planes.len(), at_once.planes.len());
        for (a, b) in ahead.planes.iter().zip(&at_once.planes) {
            assert!(common::host_bytes(ahead, a.kind) == common::host_bytes(&at_once, b.kind), "{way:?}");
        }
    }
}

#[test]
fn packets_see_terrain_as_the_rasteriser_does() {
    let scene = Arc::new(procedural::terrain(100_000));
    let mut sampler = sampler_with(&scene, SamplerSettings::default());
    for camera in cameras(&scene) {
        let share = differing(&mut sampler, &camera, 1);
        println!("terrain: {share:.5}");
        assert!(share < 0.01, "{share}");
    }
}

#[test]
fn packets_see_sponza_as_the_rasteriser_does() {
    let Some(scene) = real_scene("sponza/sponza.glb") else { return };
    let mut sampler = sampler_with(&scene, SamplerSettings::default());
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
        filter: Filter::Linear,
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
        let mut sampler = sampler_with(&scene, SamplerSettings::default());
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
    for other in [Visibility::Cpu, Visibility::Trace] {
        equal_ids_give_equal_bytes(&scene, &camera, &job, other);
    }
}

fn equal_ids_give_equal_bytes(scene: &Arc<Scene>, camera: &Camera, job: &ViewJob, other: Visibility) {
    let [a, b] = [Visibility::Raster, other].map(|way| {
        let mut sampler = sampler_with(scene, SamplerSettings::default());
        let ids = sampler.identify(camera, SIZE, 1, way).unwrap().0;
        (ids, direct(&mut sampler, &ViewJob { visibility: way, ..job.clone() }))
    });
    let colors = [&a.1, &b.1].map(|frame| frame.images[Output::Color].clone().unwrap());
    let mut equal = 0;
    for (pixel, (one, other)) in a.0.iter().zip(&b.0).enumerate() {
        if one == other {
            let bytes = 3 * pixel..3 * pixel + 3;
            assert_eq!(colors[0][bytes.clone()], colors[1][bytes]);
            equal += 1;
        }
    }
    assert!(equal as f64 > 0.99 * a.0.len() as f64);
    assert_ne!(a.1.provenance.specification, b.1.provenance.specification, "a pin tells them apart");
}

#[test]
fn a_list_of_pixels_holds_what_the_traced_view_holds_byte_for_byte() {
    let terrain = Arc::new(procedural::terrain(20_000));
    let odd = odd_scene(DVec3::ZERO);
    for (scene, camera) in
        [(&terrain, terrain.default_camera()), (&odd, Camera::look_at(DVec3::ZERO, DVec3::NEG_Z))]
    {
        let mut sampler = sampler_with(scene, SamplerSettings::default());
        for samples in [1, 4] {
            let view = ViewJob { visibility: Visibility::Cpu, ..view_job(camera, SIZE, samples) };
            let frame = direct(&mut sampler, &view);
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
                state: SceneState::default(),
                time_secs: 0.0,
                reflections: None,
            };
            let found = sampler.render_pixels(&[job], &Cancel::new()).remove(0).unwrap();
            for (i, &pixel) in pixels.iter().enumerate() {
                let p = pixel as usize;
                let (color, range) = (
                    frame.images[Output::Color].as_ref().unwrap(),
                    frame.images[Output::Range].as_ref().unwrap(),
                );
                assert_eq!(found.color[3 * i..3 * i + 3], color[3 * p..3 * p + 3], "colour of {pixel}");
                assert_eq!(found.range[4 * i..4 * i + 4], range[4 * p..4 * p + 4], "range of {pixel}");
            }
        }
    }
}

#[test]
fn lists_of_several_views_have_the_bytes_that_each_has_alone() {
    let scene = Arc::new(procedural::terrain(20_000));
    let usual = scene.default_camera();
    for effects in [LightEffects::NONE, LightEffects::ALL] {
        let mut sampler = sampler_with(&scene, SamplerSettings { effects, ..SamplerSettings::default() });
        let job = |i: u32| PixelJob {
            camera: Camera { eye: usual.eye + DVec3::X * f64::from(i), ..usual },
            width: SIZE[0] + i,
            height: SIZE[1],
            pixels: (i..SIZE[0] * SIZE[1]).step_by(40 + 90 * i as usize).collect(),
            samples_per_pixel: if i == 2 { 4 } else { 1 },
            state: SceneState::default(),
            time_secs: 0.0,
            reflections: None,
        };
        let jobs: Vec<PixelJob> = (0..5).map(job).collect();
        let together = sampler.render_pixels(&jobs, &Cancel::new());
        for (job, together) in jobs.iter().zip(together) {
            let alone = sampler.render_pixels(std::slice::from_ref(job), &Cancel::new()).remove(0).unwrap();
            let together = together.unwrap();
            assert!(alone.color == together.color && alone.range == together.range, "{} wide", job.width);
        }
    }
}

#[test]
fn no_pixels_cost_nothing_and_a_pixel_beyond_the_view_is_refused() {
    let scene = odd_scene(DVec3::ZERO);
    let mut sampler = sampler_with(&scene, SamplerSettings::default());
    let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
    let job = |pixels: Vec<u32>| PixelJob {
        camera,
        width: SIZE[0],
        height: SIZE[1],
        pixels,
        samples_per_pixel: 1,
        state: SceneState::default(),
        time_secs: 0.0,
        reflections: None,
    };
    let jobs = [job(Vec::new()), job(vec![SIZE[0] * SIZE[1]])];
    let mut results = sampler.render_pixels(&jobs, &Cancel::new());
    let beyond = results.remove(1).unwrap_err();
    assert!(beyond.to_string().contains("pixels"), "{beyond}");
    assert!(results.remove(0).unwrap().color.is_empty());
}

#[test]
fn backends_are_measured_where_there_is_a_choice_and_frames_name_theirs() {
    let scene = Arc::new(procedural::terrain(20_000));
    let mut sampler = sampler_with(&scene, SamplerSettings::default());
    let rig = Rig::for_scene(&scene, &RigSettings::default()).unwrap();
    let info = &common::sample_job(&scene, rig, 0, true).info;
    let costs = sampler.measure_backends(info).unwrap();
    assert!(costs.iter().any(|(way, _)| *way == Visibility::Cpu));
    assert!(costs.len() == 1 || costs.iter().all(|(_, ms)| *ms > 0.0), "{costs:?}");
    for visibility in Visibility::ALL {
        let job = ViewJob { visibility, ..view_job(scene.default_camera(), SIZE, 1) };
        let provenance = direct(&mut sampler, &job).provenance;
        assert_eq!(provenance.specification.unwrap().visibility, visibility);
        assert_eq!(provenance.device, sampler.device());
    }
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
    let mut sampler = sampler_with(&scene, SamplerSettings::default());
    let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
    for way in [Visibility::Cpu, Visibility::Trace] {
        let (ids, _) = sampler.identify(&camera, SIZE, 1, way).unwrap();
        assert!(ids.iter().all(|ids| ids[0] == 0 || ids[1] < 2), "only the quad's two triangles");
    }
    assert!(differing(&mut sampler, &camera, 1) < 0.01);
}

#[test]
fn tracers_agree_and_no_ray_slips_between_triangles_smaller_than_a_pixel() {
    // Forty triangles to a pixel and more, where a packet that meets too many would be ended by the software driver;
    // along edges the rasteriser that steps in then may differ from the packets on the CPU.
    let scene = Arc::new(procedural::terrain(300_000));
    let mut sampler = sampler_with(&scene, SamplerSettings::default());
    let camera = scene.default_camera();
    for size in [[97, 71], [320, 240]] {
        let [cpu, trace] = [Visibility::Cpu, Visibility::Trace]
            .map(|way| sampler.identify(&camera, size, 1, way).unwrap().0);
        let apart = cpu.iter().zip(&trace).filter(|(a, b)| a != b).count() as f64 / cpu.len() as f64;
        let holes = covered_apart(&mut sampler, &camera, size, [Visibility::Cpu, Visibility::Trace]);
        println!("{size:?}: ids apart {apart:.6}, covered apart {holes:.6}");
        assert!(apart <= 1e-2, "{apart}");
        assert!(holes <= 5e-4, "{holes}");
    }
}

#[test]
fn a_scene_of_nothing_is_traced_as_sky() {
    let scene = Arc::new(empty_scene());
    let mut sampler = sampler_with(&scene, SamplerSettings::default());
    let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
    let (ids, _) = sampler.identify(&camera, [33, 17], 2, Visibility::Trace).unwrap();
    assert!(ids.len() == 66 * 34 && ids.iter().all(|ids| ids[0] == 0));
}

#[test]
fn a_thousand_copies_are_traced_as_they_are_drawn() {
    let mut scene = empty_scene();
    scene.meshes.push(common::ball(0, 20));
    for i in 0..1000u32 {
        let at = DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), -f64::from(i / 100) - 4.0) * 2.5;
        let world_from_mesh =
            DAffine3::from_rotation_x(f64::from(i)) * DAffine3::from_scale(DVec3::splat(0.9));
        let world_from_mesh = DAffine3::from_translation(at) * world_from_mesh;
        scene.instances.push(argus_scene::Instance { mesh: 0, node: None, world_from_mesh });
    }
    let scene = Arc::new(scene);
    let mut sampler = sampler_with(&scene, SamplerSettings::default());
    let camera = Camera::look_at(DVec3::new(11.0, 11.0, 12.0), DVec3::new(11.0, 11.0, -10.0));
    let share = differing(&mut sampler, &camera, 1);
    println!("copies: {share:.5}");
    assert!(share < 0.01, "{share}");
}
