//! Direct light of the reference, against answers that are known on paper.
use crate::common;

use argus_scene::light_sampling::{cosine_direction, disc_point, r2};
use argus_scene::reference::DirectLight;
use argus_scene::{
    AlphaMode, Instance, Light, LightEffects, Lighting, Material, Mesh, Scene, Sky, TextureRef,
};
use common::{furnace, patch, scene, sphere, sun, texture, textured, tracer, white};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, Vec4};

const ALL: DirectLight = DirectLight { effects: LightEffects::ALL, rays: 64 };

/// The radiance that arrives at `eye` from a point.
fn seen(scene: Scene, light: DirectLight, eye: DVec3, at: DVec3) -> Vec3 {
    let tracer = tracer(scene).with_direct_light(light);
    tracer.radiance_along(eye, (at - eye).normalize(), DVec3::ZERO, DVec3::ZERO)
}

/// A floor of 2 × 2 m in y = 0 and a patch of `side` m in y = `height` above it, both looking up.
fn floor_and_roof(height: f64, side: f64, lighting: Lighting, roof: Material) -> Scene {
    let mut scene = scene(vec![patch(1), patch(1)], vec![white(), roof], lighting);
    let flat = DMat3::from_quat(DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2));
    scene.instances[0].world_from_mesh = DAffine3 { matrix3: flat, translation: DVec3::ZERO };
    scene.instances[1].world_from_mesh =
        DAffine3 { matrix3: flat * (side * 0.5), translation: DVec3::Y * height };
    scene
}

/// Eye between floor and roof.
const EYE: DVec3 = DVec3::new(0.9, 0.4, 0.0);

#[test]
fn a_roof_casts_a_shadow_with_a_penumbra_as_wide_as_its_light_demands() {
    let lit_by = |angular_radius: f64| {
        let Light::Directional { direction, irradiance, .. } = sun(DVec3::NEG_Y).lights[0] else {
            unreachable!()
        };
        let light = Light::Directional { direction, irradiance, angular_radius };
        Lighting { lights: vec![light], ..sun(DVec3::NEG_Y) }
    };
    let at = |x: f64, radius: f64| {
        seen(floor_and_roof(0.5, 1.0, lit_by(radius), white()), ALL, EYE, DVec3::new(x, 0.0, 0.0)).x
    };
    // The roof ends at x = 0.5. A disc of 0.1 rad darkens 5 cm on both sides of its edge.
    for radius in [0.0, 0.1] {
        assert_eq!(at(0.0, radius), 0.0);
        assert!((at(0.7, radius) - 1.0).abs() < 1e-5);
    }
    assert_eq!((at(0.499, 0.0), at(0.501, 0.0).round()), (0.0, 1.0));
    assert!((at(0.5, 0.1) - 0.5).abs() < 0.05, "half of the disc is seen from below the edge");
    assert!(at(0.48, 0.1) > 0.1 && at(0.52, 0.1) < 0.9 && at(0.44, 0.1) == 0.0);
    let hard = DirectLight { effects: LightEffects { soft_shadows: false, ..LightEffects::ALL }, rays: 64 };
    let scene = floor_and_roof(0.5, 1.0, lit_by(0.1), white());
    assert_eq!(seen(scene, hard, EYE, DVec3::new(0.48, 0.0, 0.0)).x, 0.0);
}

#[test]
fn an_open_floor_under_an_even_sky_has_radiance_one_and_a_closed_box_none() {
    let floor = scene(vec![patch(1)], vec![white()], furnace());
    let direction = DVec3::new(0.2, 0.1, 2.0);
    assert!((seen(floor, ALL, direction, DVec3::ZERO) - Vec3::ONE).abs().max_element() < 1e-5);
    // A single-sided ball, seen from inside of it through its back: it blocks light all the same.
    let ball = scene(vec![sphere(16)], vec![white()], furnace());
    assert_eq!(seen(ball, ALL, DVec3::ZERO, DVec3::X), Vec3::ZERO);
}

#[test]
fn a_patch_above_blocks_its_form_factor_of_an_even_sky() {
    let scene = floor_and_roof(0.5, 1.0, furnace(), white());
    let light = DirectLight { rays: 400, ..ALL };
    let lit = seen(scene, light, EYE, DVec3::ZERO).x;
    // Form factor of a square of side 2a at a height h above its middle: 4/π · a/√(a²+h²) · atan(a/√(a²+h²)), a = h.
    let x = 0.5f64.sqrt();
    let factor = 4.0 / std::f64::consts::PI * x * x.atan();
    assert!((f64::from(lit) - (1.0 - factor)).abs() < 0.01, "{lit} {factor}");
}

#[test]
fn an_emitting_square_lights_by_its_form_factor_at_every_scale_and_place() {
    for (scale, offset) in [(1.0, 0.0), (1e-3, 0.0), (1.0, 1e6), (1e3, 1e6)] {
        let emits = Material { emissive: Vec3::new(2.0, 1.0, 0.5), base_color: Vec4::W, ..white() };
        let mut scene = floor_and_roof(0.5, 1.0, sun(DVec3::NEG_Y), emits);
        scene.lighting.lights.clear();
        let shift = DVec3::new(offset, -offset, offset);
        for instance in &mut scene.instances {
            instance.world_from_mesh.matrix3 *= scale;
            instance.world_from_mesh.translation = instance.world_from_mesh.translation * scale + shift;
        }
        let lit = seen(scene, DirectLight { rays: 400, ..ALL }, EYE * scale + shift, shift);
        let x = 0.5f64.sqrt();
        let factor = 4.0 / std::f64::consts::PI * x * x.atan();
        let wanted = Vec3::new(2.0, 1.0, 0.5) * factor as f32;
        assert!((lit / wanted - Vec3::ONE).abs().max_element() < 0.02, "{lit} {wanted} at {scale}, {offset}");
    }
}

#[test]
fn a_single_sided_emitter_lights_what_it_faces_alone() {
    let emits = Material { emissive: Vec3::ONE, double_sided: false, base_color: Vec4::W, ..white() };
    let mut scene = floor_and_roof(0.5, 1.0, sun(DVec3::NEG_Y), emits);
    scene.lighting.lights.clear();
    assert_eq!(seen(scene.clone(), ALL, EYE, DVec3::ZERO), Vec3::ZERO, "it looks up");
    let turned = DMat3::from_quat(DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2)) * 0.5;
    scene.instances[1].world_from_mesh.matrix3 = turned;
    assert!(seen(scene.clone(), ALL, EYE, DVec3::ZERO).x > 0.3);
    scene.instances[1].world_from_mesh.matrix3 = turned * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    assert!(seen(scene, ALL, EYE, DVec3::ZERO).x > 0.3, "mirroring does not turn a triangle round");
}

#[test]
fn a_cut_out_casts_the_shadow_of_its_alpha() {
    let leaf =
        Material { alpha: AlphaMode::Mask(0.5), base_color_texture: Some(TextureRef::new(0)), ..white() };
    let mut scene = floor_and_roof(0.5, 1.0, sun(DVec3::NEG_Y), leaf);
    // The left half is open.
    scene.textures = vec![texture(16, |x, _| [255, 255, 255, if x < 8 { 0 } else { 255 }])];
    let at = |x: f64| seen(scene.clone(), ALL, EYE, DVec3::new(x, 0.0, 0.1)).x;
    assert!((at(-0.25) - 1.0).abs() < 1e-5);
    assert_eq!(at(0.25), 0.0);
}

#[test]
fn a_coarse_ball_is_lit_up_to_its_terminator_and_has_no_acne() {
    // 24 × 12 quads. Without a lift, triangles at the terminator are black in part.
    let ball = scene(vec![sphere(12)], vec![white()], sun(DVec3::NEG_X));
    let tracer = tracer(ball);
    let lit = |tracer: &argus_scene::reference::Tracer, angle: f64| {
        let out = DVec3::new(angle.cos(), 0.1, angle.sin()).normalize();
        tracer.radiance_along(out * 3.0, -out, DVec3::ZERO, DVec3::ZERO).x
    };
    let angles: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.0078 - 0.01).collect();
    let open: Vec<f32> = angles.iter().map(|&angle| lit(&tracer, angle)).collect();
    let tracer = tracer.with_direct_light(ALL);
    for (&angle, open) in angles.iter().zip(open) {
        let shadowed = lit(&tracer, angle);
        assert!((shadowed - open).abs() < 0.03, "{angle}: {shadowed} instead of {open}");
    }
}

#[test]
fn walls_of_two_centimetres_leak_no_light_into_a_dark_room() {
    let mut scene = scene(Vec::<Mesh>::new(), vec![white()], sun(DVec3::new(-1.0, -1.0, 0.3).normalize()));
    scene.lighting.sky = Sky::DAYLIGHT;
    // Six plates of 2 cm around a room of 4 m.
    let mut plate = sphere(2);
    plate.positions.clear();
    for i in 0..8 {
        plate.positions.push(Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32) * 2.0 - 1.0);
    }
    plate.normals.clear();
    plate.indices = vec![
        0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4, 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3,
        7, 5,
    ];
    scene.meshes.push(plate);
    let offset = DVec3::new(1e6, 0.0, -1e6);
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut half = DVec3::splat(2.02);
            half[axis] = 0.01;
            let mut place = offset;
            place[axis] += sign * 2.01;
            scene.instances.push(Instance {
                mesh: 0,
                node: None,
                world_from_mesh: DAffine3 { matrix3: DMat3::from_diagonal(half), translation: place },
            });
        }
    }
    let tracer = tracer(scene).with_direct_light(DirectLight { rays: 16, ..ALL });
    for i in 0..200 {
        let out = cosine_direction(DVec3::Y, disc_point(r2(i)));
        for direction in [out, -out] {
            assert_eq!(tracer.radiance_along(offset, direction, DVec3::ZERO, DVec3::ZERO), Vec3::ZERO);
        }
    }
}

#[test]
fn degenerate_lights_and_places_give_finite_radiance() {
    let at =
        |position: DVec3, radius: f64| Light::Point { position, intensity: Vec3::ONE, range: None, radius };
    for light in [at(DVec3::ZERO, 0.0), at(DVec3::ZERO, 2.0), at(DVec3::Z * 1e-12, 0.1), at(DVec3::NAN, 0.1)]
    {
        let lighting = Lighting { lights: vec![light], sky: Sky::DAYLIGHT, exposure: 1.0 };
        let mut scene = scene(vec![patch(2)], vec![textured(white())], lighting);
        scene.textures = vec![texture(4, |_, _| [255; 4])];
        let radiance = seen(scene, ALL, DVec3::new(0.3, 0.2, 1.0), DVec3::ZERO);
        if !matches!(light, Light::Point { position, .. } if position.is_nan()) {
            assert!(radiance.is_finite(), "{light:?}: {radiance}");
        }
    }
}
