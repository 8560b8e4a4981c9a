//! The reference tracer's images of scenes whose radiance is known exactly.
use crate::common;

use argus_scene::metrics::compare;
use argus_scene::reference::{ReferenceImage, Tracer, cache};
use argus_scene::{AlphaMode, Camera, Instance, Lighting, Material, Mesh, Scene, Sky, TextureRef};
use common::{furnace, patch, scene, sphere, sun, texture, textured, tracer, white};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3, Vec4};

/// A camera at (0, 0, `distance`) whose image the patch of [`patch`] fills.
fn front(distance: f64) -> Camera {
    Camera::look_at(DVec3::new(0.0, 0.0, distance), DVec3::ZERO)
}

fn render(scene: Scene, camera: &Camera, samples: u32) -> ReferenceImage {
    tracer(scene).render(camera, 32, 24, samples, |_| {})
}

fn mean(image: &ReferenceImage) -> Vec3 {
    image.radiance.iter().sum::<Vec3>() / image.radiance.len() as f32
}

#[test]
fn in_a_furnace_radiance_is_one_everywhere() {
    // White surfaces, white vertex colours, white textures, mirrored, turned and stretched instances: all must vanish
    // into the white sky.
    let mesh = Mesh { colors: vec![Vec4::ONE; patch(4).positions.len()], ..patch(4) };
    let mut scene = scene(vec![sphere(12), mesh], vec![white(), textured(white())], furnace());
    scene.textures = vec![texture(16, |_, _| [255; 4])];
    let turn = DMat3::from_quat(DQuat::from_rotation_x(1.0));
    for (mesh, linear) in [
        (0, DMat3::from_diagonal(DVec3::new(-1.0, 0.3, 2.0))),
        (1, turn * DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0))),
        (1, DMat3::from_diagonal(DVec3::splat(3.0))),
    ] {
        let world_from_mesh = DAffine3 { matrix3: linear, translation: DVec3::new(0.5, 0.2, -1.0) };
        scene.instances.push(Instance { mesh, node: None, world_from_mesh });
    }
    let image = render(scene.clone(), &front(6.0), 4);
    assert!(image.range.iter().any(|r| r.is_finite()) && image.range.iter().any(|r| r.is_infinite()));
    for radiance in &image.radiance {
        assert!((*radiance - Vec3::ONE).abs().max_element() < 1e-5, "{radiance}");
    }
    // A surface that absorbs a hundredth is found.
    scene.materials[0].base_color = Vec4::new(0.99, 0.99, 0.99, 1.0);
    assert!(render(scene, &front(6.0), 4).radiance.iter().any(|r| r.x < 0.995));
}

#[test]
fn a_lit_plane_follows_the_cosine_and_its_back_is_lit_from_behind() {
    for degrees in [0.0_f64, 30.0, 60.0, 89.0] {
        let angle = degrees.to_radians();
        let lighting = sun(DVec3::new(angle.sin(), 0.0, -angle.cos()));
        let tracer = tracer(scene(vec![patch(1)], vec![white()], lighting));
        let look = |z: f64| {
            tracer.radiance_along(DVec3::new(0.1, 0.2, z), DVec3::new(0.0, 0.0, -z), DVec3::ZERO, DVec3::ZERO)
        };
        assert!((look(1.0).x - angle.cos() as f32).abs() < 1e-5, "{degrees}°");
        assert_eq!(look(-1.0), Vec3::ZERO, "the back faces away from the sun");
    }
}

#[test]
fn single_sided_surfaces_are_open_from_behind_even_if_mirrored() {
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    for world_from_mesh in [DAffine3::IDENTITY, mirror] {
        let single = Material { double_sided: false, ..white() };
        let mut scene = scene(vec![patch(2)], vec![single], furnace());
        scene.instances[0].world_from_mesh = world_from_mesh;
        let tracer = Tracer::new(scene.into());
        assert!(tracer.trace(DVec3::new(0.1, 0.3, 2.0), DVec3::NEG_Z).is_some());
        assert!(tracer.trace(DVec3::new(0.1, 0.3, -2.0), DVec3::Z).is_none());
    }
}

#[test]
fn range_is_along_the_central_ray_for_any_number_of_samples() {
    let camera = Camera { fov_deg: 70.0, ..front(0.5) };
    for samples in [1, 2, 4, 9] {
        let image = render(scene(vec![patch(3)], vec![white()], furnace()), &camera, samples);
        for (i, range) in (0u32..).zip(&image.range) {
            let pixel = glam::DVec2::new(f64::from(i % 32) + 0.5, f64::from(i / 32) + 0.5);
            let direction = camera.direction(pixel, 32, 24);
            assert!((f64::from(*range) / (0.5 / -direction.z) - 1.0).abs() < 1e-7, "pixel {i}");
        }
    }
}

#[test]
fn a_pixel_at_an_edge_shows_the_covered_share() {
    // A black patch before a white sky; its edge at x = 0 runs through the middle of a pixel's column.
    let mut scene = scene(vec![patch(1)], vec![Material { base_color: Vec4::W, ..white() }], furnace());
    scene.instances[0].world_from_mesh =
        DAffine3 { matrix3: DMat3::from_diagonal(DVec3::splat(9.0)), translation: DVec3::X * 9.0 };
    let tracer = tracer(scene);
    let row = |samples| tracer.render(&front(2.0), 5, 5, samples, |_| {}).radiance[10..15].to_vec();
    for (samples, covered) in [(4, 0.5), (16, 0.5), (64, 0.5)] {
        let values: Vec<f32> = row(samples).iter().map(|r| r.x).collect();
        assert_eq!(values, [1.0, 1.0, 1.0 - covered, 0.0, 0.0], "{samples} samples");
    }
}

fn cutout_scene() -> Scene {
    // Every other column of texels is open.
    let leaf = texture(16, |x, _| if x.is_multiple_of(2) { [255; 4] } else { [255, 255, 255, 0] });
    let material = Material { alpha: AlphaMode::Mask(0.5), ..textured(white()) };
    let black = Lighting { sky: Sky::BLACK, ..sun(DVec3::NEG_Z) };
    Scene { textures: vec![leaf], ..scene(vec![patch(2)], vec![material], black) }
}

#[test]
fn a_cutouts_coverage_is_the_same_at_any_distance() {
    // Level 0 decides at any distance: half of it is open, even where a mip level would be 0.5 everywhere.
    for distance in [1.2_f64, 3.0, 20.0, 400.0] {
        let fov_deg = 2.0 * (0.9_f64 / distance).atan().to_degrees();
        let image = tracer(cutout_scene()).render(&Camera { fov_deg, ..front(distance) }, 24, 24, 64, |_| {});
        let covered = mean(&image).x;
        assert!((covered - 0.5).abs() < 0.03, "{distance} m: {covered}");
    }
    let opaque = Material { alpha: AlphaMode::Opaque, ..cutout_scene().materials[0].clone() };
    let image = render(Scene { materials: vec![opaque], ..cutout_scene() }, &front(1.2), 4);
    assert!((mean(&image).x - 1.0).abs() < 1e-4);
}

#[test]
fn what_is_behind_a_cutout_shows_through_it() {
    let mut scene = cutout_scene();
    scene.meshes.push(Mesh { material: 1, ..patch(1) });
    scene.materials.push(Material { emissive: Vec3::X * 3.0, base_color: Vec4::W, ..white() });
    let world_from_mesh = DAffine3::from_translation(DVec3::NEG_Z);
    scene.instances.push(Instance { mesh: 1, node: None, world_from_mesh });
    let tracer = Tracer::new(scene.into());
    // Texel centres of the first (solid) and second (open) column.
    for (texel, instance) in [(0.5, 0), (1.5, 1)] {
        let x = texel / 16.0 * 2.0 - 1.0;
        assert_eq!(tracer.trace(DVec3::new(x, 0.0, 1.0), DVec3::NEG_Z).unwrap().instance, instance);
    }
}

#[test]
fn a_texture_seen_from_afar_is_its_mean_with_one_sample() {
    let checker = texture(64, |x, y| if (x + y).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] });
    let board = |material| Scene {
        textures: vec![checker.clone()],
        ..scene(vec![patch(1)], vec![material], furnace())
    };
    // One ray per pixel, about forty texels per pixel: every ray must return the mean.
    let tracer = tracer(board(textured(white())));
    let image = tracer.render(&Camera { fov_deg: 5.0, ..front(20.0) }, 2, 2, 1, |_| {});
    for radiance in &image.radiance {
        assert!((radiance.x - 0.5).abs() < 0.01, "{radiance}");
    }
    // Without a footprint the same ray reads level 0, where texel centres are black or white.
    let texel_centre = DVec3::new(0.5 / 32.0, 0.5 / 32.0, 20.0);
    let sharp = tracer.radiance_along(texel_centre, DVec3::NEG_Z, DVec3::ZERO, DVec3::ZERO).x;
    assert!(!(0.01..=0.99).contains(&sharp), "{sharp}");
}

#[test]
fn detail_fades_continuously_with_distance() {
    let stripes = texture(64, |x, _| [((x * 90) % 256) as u8; 4]);
    let board =
        Scene { textures: vec![stripes], ..scene(vec![patch(1)], vec![textured(white())], furnace()) };
    let tracer = tracer(board);
    let spacing = 0.01;
    let at = |distance: f64| {
        let origin = DVec3::new(0.237, 0.1, distance);
        tracer.radiance_along(origin, DVec3::NEG_Z, DVec3::X * spacing, DVec3::NEG_Y * spacing).x
    };
    let mut before = at(1.0);
    for step in 1..2000 {
        let now = at(1.0 * 1.004_f64.powi(step));
        assert!((now - before).abs() < 0.02, "a jump at {} m", 1.004_f64.powi(step));
        before = now;
    }
}

#[test]
fn missing_degenerate_and_extreme_attributes_give_a_finite_colour() {
    let checker = texture(8, |x, y| if (x + y).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] });
    let rich = Material {
        metallic_roughness_texture: Some(TextureRef::new(0)),
        normal_texture: Some(TextureRef::new(0)),
        emissive_texture: Some(TextureRef::new(7)),
        emissive: Vec3::splat(0.1),
        metallic: 0.5,
        roughness: 0.0,
        ..textured(white())
    };
    let points = patch(2).positions.len();
    let meshes = [
        Mesh { uvs: Vec::new(), ..patch(2) },
        Mesh { uvs: vec![Vec2::splat(0.3); points], ..patch(2) },
        Mesh { uvs: vec![Vec2::NAN; points], ..patch(2) },
        Mesh { uvs: vec![Vec2::splat(1e30); points], ..patch(2) },
        Mesh { normals: vec![Vec3::ZERO; points], ..patch(2) },
        Mesh { normals: Vec::new(), tangents: Vec::new(), ..patch(2) },
        Mesh { tangents: vec![Vec4::ZERO; points], ..patch(2) },
        Mesh { normals: vec![Vec3::NAN; points], ..patch(2) },
    ];
    for (i, mesh) in meshes.into_iter().enumerate() {
        let scene = Scene {
            textures: vec![checker.clone()],
            ..scene(vec![mesh], vec![rich.clone()], Lighting::default())
        };
        let image = render(scene, &front(2.5), 4);
        assert!(image.radiance.iter().all(|r| r.is_finite() && r.min_element() >= 0.0), "mesh {i}");
    }
}

#[test]
fn a_normal_map_tilts_the_normal_and_its_mirror_image_tilts_it_the_other_way() {
    // Tangent space (1, 0, 1)/√2: the surface looks 45° towards +x of the texture.
    let tilted = argus_scene::Texture { srgb: false, ..texture(2, |_, _| [218, 128, 218, 255]) };
    let material = Material { normal_texture: Some(TextureRef::new(0)), ..white() };
    let mut scene = scene(vec![patch(1)], vec![material], furnace());
    scene.textures = vec![tilted];
    for (scale, expected) in [(DVec3::ONE, Vec3::X), (DVec3::new(-1.0, 1.0, 1.0), Vec3::NEG_X)] {
        scene.instances[0].world_from_mesh = DAffine3::from_scale(scale);
        let tracer = Tracer::new(scene.clone().into());
        for side in [1.0, -1.0] {
            let (origin, direction) = (DVec3::new(0.1, 0.1, side), DVec3::new(0.0, 0.0, -side));
            let hit = tracer.trace(origin, direction).unwrap();
            let surface = tracer.surface(&hit, direction, DVec3::ZERO, DVec3::ZERO);
            let expected = (expected + Vec3::Z).normalize() * side as f32;
            assert!((surface.normal - expected).length() < 0.02, "{} {expected}", surface.normal);
        }
    }
}

#[test]
fn reflectance_follows_the_metallic_roughness_model() {
    let copper = Vec4::new(0.9, 0.5, 0.3, 1.0);
    let surface = |material| {
        let tracer = tracer(scene(vec![patch(1)], vec![material], furnace()));
        let hit = tracer.trace(DVec3::new(0.1, 0.1, 1.0), DVec3::NEG_Z).unwrap();
        tracer.surface(&hit, DVec3::NEG_Z, DVec3::ZERO, DVec3::ZERO)
    };
    let metal = surface(Material { base_color: copper, metallic: 1.0, roughness: 0.3, ..white() });
    assert_eq!((metal.albedo, metal.f0), (Vec3::ZERO, copper.truncate()));
    let plastic = surface(Material { base_color: copper, roughness: 0.3, ..white() });
    assert_eq!(plastic.albedo, copper.truncate());
    assert!((plastic.f0 - Vec3::splat(0.04)).length() < 1e-6);
    assert_eq!(surface(Material { base_color: copper, ..white() }).f0, Vec3::ZERO, "matt");
}

#[test]
fn a_scene_a_million_metres_away_looks_the_same() {
    let stripes = texture(32, |x, y| [(x * 8) as u8, (y * 8) as u8, 90, 255]);
    let build = |offset: DVec3| {
        let mut scene =
            scene(vec![sphere(24), patch(4)], vec![white(), textured(white())], Lighting::default());
        scene.textures = vec![stripes.clone()];
        for instance in &mut scene.instances {
            instance.world_from_mesh.translation += offset;
        }
        scene
    };
    let offset = DVec3::new(1e6, -1e6, 1e6);
    let camera = Camera::look_at(DVec3::new(2.0, 1.5, 3.0), DVec3::ZERO);
    let far = Camera { eye: camera.eye + offset, target: camera.target + offset, ..camera };
    let (here, there) = (render(build(DVec3::ZERO), &camera, 4), render(build(offset), &far, 4));
    for (a, b) in here.radiance.iter().zip(&there.radiance) {
        assert!((*a - *b).abs().max_element() < 1e-4, "{a} {b}");
    }
    for (a, b) in here.range.iter().zip(&there.range) {
        assert!(a == b || (a / b - 1.0).abs() < 1e-6, "{a} {b}");
    }
}

#[test]
fn images_are_the_same_for_any_number_of_threads() {
    let build = || scene(vec![sphere(20), patch(4)], vec![white()], Lighting::default());
    let image = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render(build(), &front(4.0), 4))
    };
    assert_eq!(image(1), image(3));
}

#[test]
fn progress_ends_at_one_and_odd_sizes_are_rendered() {
    let tracer = tracer(scene(vec![patch(1)], vec![white()], furnace()));
    let latest = std::sync::Mutex::new(0.0_f64);
    let image = tracer.render(&front(2.0), 7, 3, 1, |done| {
        let mut latest = latest.lock().unwrap();
        *latest = latest.max(done);
    });
    assert_eq!((*latest.lock().unwrap(), image.radiance.len(), image.range.len()), (1.0, 21, 21));
    assert_eq!(image.display(1.0).dimensions(), (7, 3));
    assert_eq!(tracer.render(&front(2.0), 0, 3, 4, |_| {}).display(1.0).dimensions(), (0, 3));
    assert_eq!(tracer.render(&front(2.0), 1, 1, 0, |_| {}).radiance.len(), 1);
}

#[test]
fn more_samples_approach_the_truth() {
    let build = || scene(vec![sphere(24)], vec![white()], Lighting::default());
    let camera = front(3.0);
    let shown = |samples| tracer(build()).render(&camera, 96, 72, samples, |_| {}).display(1.0);
    let truth = shown(256);
    let flip = |samples| compare(&truth, &shown(samples)).unwrap().flip_mean;
    let (one, four, sixteen) = (flip(1), flip(4), flip(16));
    assert!(sixteen < 0.6 * four && four < 0.6 * one && one > 0.0, "{one} {four} {sixteen}");
}

#[test]
fn a_cached_image_is_reused_only_for_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let tracer = tracer(scene(vec![patch(2)], vec![white()], furnace()));
    let render = |tracer: &Tracer, samples| {
        cache::render(Some(folder.path()), tracer, &front(2.0), [8, 6], samples, |_| {})
    };
    let files = || std::fs::read_dir(folder.path()).unwrap().map(|f| f.unwrap().path()).collect::<Vec<_>>();
    let first = render(&tracer, 4);
    assert_eq!(files().len(), 1);
    assert_eq!(render(&tracer, 4), first);
    assert_eq!(render(&tracer, 3), first, "three samples are rendered as four");
    assert_eq!(files().len(), 1);
    // A damaged file is rendered again.
    std::fs::write(&files()[0], b"no image").unwrap();
    assert_eq!(render(&tracer, 4), first);
    assert!(std::fs::metadata(&files()[0]).unwrap().len() > 100);
    // Every input of the image changes the name.
    render(&tracer, 16);
    let mut darker = (**tracer.scene()).clone();
    darker.materials[0].base_color.x = 0.5;
    let darker = Tracer::new(darker.into());
    assert_ne!(render(&darker, 4), first);
    let mut moved = (**tracer.scene()).clone();
    moved.meshes[0].positions[0].z += 0.1;
    render(&Tracer::new(moved.into()), 4);
    assert_eq!(files().len(), 4);
    // A folder that cannot be made costs only time.
    let blocked = files()[0].join("below a file");
    assert_eq!(cache::render(Some(&blocked), &tracer, &front(2.0), [8, 6], 4, |_| {}), first);
}

/// Two panes of these alphas before a white sky, the nearest last, and the radiance of each.
fn panes(alphas: &[f32]) -> Scene {
    let glass = |i: usize, alpha: f32| Material {
        base_color: Vec4::new(0.0, 0.0, 0.0, alpha),
        emissive: Vec3::splat(0.25 + 0.5 * i as f32),
        alpha: AlphaMode::Blend,
        ..Material::default()
    };
    let materials: Vec<Material> = alphas.iter().enumerate().map(|(i, &alpha)| glass(i, alpha)).collect();
    let mesh = |i: u32| Mesh { material: i, ..patch(1) };
    let mut scene = scene((0..alphas.len() as u32).map(mesh).collect(), materials, furnace());
    for (i, instance) in scene.instances.iter_mut().enumerate() {
        instance.world_from_mesh = DAffine3::from_translation(DVec3::Z * (0.1 * i as f64));
    }
    scene
}

#[test]
fn transparent_surfaces_blend_with_what_is_behind_and_the_first_half_is_shown() {
    let cases: [(&[f32], f64); 7] = [
        (&[0.0], f64::INFINITY),
        (&[0.3], f64::INFINITY),
        (&[0.5], 1.0),
        (&[1.0], 1.0),
        (&[0.3, 0.4], 1.0),
        (&[0.2, 0.2], f64::INFINITY),
        (&[1.0, 0.6], 0.9),
    ];
    for (alphas, range) in cases {
        let tracer = tracer(panes(alphas));
        let (eye, ahead) = (DVec3::new(0.13, 0.07, 1.0), DVec3::NEG_Z);
        let seen = tracer.radiance_along(eye, ahead, DVec3::ZERO, DVec3::ZERO);
        let expected = alphas
            .iter()
            .enumerate()
            .fold(1.0, |behind, (i, &alpha)| (0.25 + 0.5 * i as f32) * alpha + behind * (1.0 - alpha));
        assert!((seen.x - expected).abs() < 1e-5, "{alphas:?}: {seen} {expected}");
        let shown = tracer.trace(eye, ahead).map_or(f64::INFINITY, |hit| hit.range);
        assert!(shown == range || (shown - range).abs() < 1e-9, "{alphas:?}: {shown}");
    }
}
