use std::sync::Arc;

use argus_scene::scene::NamedCamera;
use argus_scene::{
    AddedLight, Camera, Instance, Light as SceneLight, LightChoice, LightEffects, Material, Mesh, Sky,
};
use glam::{DAffine3, Vec4};

use super::*;

fn light(scene: &Scene, effects: LightEffects, indirect: bool) -> f64 {
    PacketSight::new(&Arc::new(scene.clone())).metered(Metering { effects, indirect }).unwrap()
}

#[test]
fn rays_find_about_the_light_that_shading_adds_to_an_open_scene() {
    let scene = argus_scene::procedural::terrain(20_000);
    let whole = light(&scene, LightEffects::NONE, false);
    for effects in ["shadows", "sky-visibility", "shadows,sky-visibility"] {
        let share = light(&scene, effects.parse().unwrap(), false) / whole;
        assert!((0.5..1.1).contains(&share), "{effects}: {share}");
    }
}

#[test]
fn walls_keep_light_out_and_reflect_it() {
    let scene = argus_scene::procedural::rooms(20);
    let direct = light(&scene, LightEffects::ALL, false);
    let all = light(&scene, LightEffects::ALL, true);
    assert!(direct < 0.9 * all, "{direct} {all}");
}

#[test]
fn a_scene_without_light_or_surfaces_is_not_metered() {
    let mut scene = argus_scene::procedural::terrain(2_000);
    let metering = Metering { effects: LightEffects::ALL, indirect: true };
    let metered = |scene: &Scene| PacketSight::new(&Arc::new(scene.clone())).metered(metering);
    scene.lighting = Lighting { lights: Vec::new(), sky: argus_scene::Sky::BLACK, exposure: 1.0 };
    assert_eq!(metered(&scene), None);
    scene.instances.clear();
    assert_eq!(metered(&scene), None);
}

#[test]
fn light_is_the_same_at_a_million_metres() {
    let scene = argus_scene::procedural::rooms(20);
    let mut far = scene.clone();
    let by = DVec3::new(1e6, -2e6, 3e6);
    for instance in &mut far.instances {
        instance.world_from_mesh.translation += by;
    }
    for light in &mut far.lighting.lights {
        if let SceneLight::Point { position, .. } | SceneLight::Spot { position, .. } = light {
            *position += by;
        }
    }
    for named in &mut far.cameras {
        named.camera.eye += by;
        named.camera.target += by;
    }
    let [near, far] = [&scene, &far].map(|scene| light(scene, LightEffects::ALL, true));
    assert!((near / far - 1.0).abs() < 0.02, "{near} {far}");
}

const ALL: Metering = Metering { effects: LightEffects::ALL, indirect: true };

/// A box of quads with these sides, which show their fronts outward, or inward.
fn cuboid(center: DVec3, size: DVec3, inward: bool) -> Mesh {
    let mut mesh = Mesh { origin: center, ..Mesh::default() };
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let mut normal = Vec3::ZERO;
            normal[axis] = sign;
            let (u, v) = (Vec3::AXES[(axis + 1) % 3] * sign, Vec3::AXES[(axis + 2) % 3]);
            let first = mesh.positions.len() as u32;
            for [x, y] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
                mesh.positions.push((normal + u * x + v * y) * 0.5 * size.as_vec3());
                mesh.normals.push(if inward { -normal } else { normal });
            }
            let corners = if inward { [0, 2, 1, 0, 3, 2] } else { [0, 1, 2, 0, 2, 3] };
            mesh.indices.extend(corners.map(|corner| first + corner));
        }
    }
    mesh
}

fn grey() -> Material {
    Material { base_color: Vec4::new(0.5, 0.5, 0.5, 1.0), ..Material::default() }
}

/// A file without light: these meshes, each with its material.
fn file(parts: Vec<(Mesh, Material)>) -> Scene {
    let (meshes, materials): (Vec<Mesh>, Vec<Material>) = parts.into_iter().unzip();
    let meshes: Vec<Mesh> = (0..).zip(meshes).map(|(material, mesh)| Mesh { material, ..mesh }).collect();
    let place = |mesh| Instance { mesh, node: None, world_from_mesh: DAffine3::IDENTITY };
    Scene { instances: (0..meshes.len() as u32).map(place).collect(), meshes, materials, ..Scene::default() }
}

/// Boxes on a floor.
fn exhibits() -> Scene {
    let at =
        |x: f64, z: f64, side: f64| (cuboid(DVec3::new(x, 0.5 * side, z), DVec3::splat(side), false), grey());
    let floor = cuboid(DVec3::new(0.0, -0.05, 0.0), DVec3::new(12.0, 0.1, 12.0), false);
    file(vec![(floor, grey()), at(0.0, 0.0, 1.6), at(2.5, 1.0, 1.0), at(-2.0, 2.0, 0.7)])
}

/// A room with a column and a table, seen from inside.
fn room(double_sided: bool) -> Scene {
    let walls = Material { double_sided, ..grey() };
    let column = cuboid(DVec3::new(2.0, 1.5, 1.0), DVec3::new(0.4, 3.0, 0.4), false);
    let table = cuboid(DVec3::new(-1.5, 0.8, -1.0), DVec3::new(2.0, 0.1, 1.0), false);
    let shell = cuboid(DVec3::new(0.0, 1.5, 0.0), DVec3::new(8.0, 3.0, 6.0), true);
    let outer = cuboid(DVec3::new(0.0, 1.5, 0.0), DVec3::new(8.4, 3.4, 6.4), false);
    file(vec![(shell, walls.clone()), (outer, walls), (column, grey()), (table, grey())])
}

/// A small box that emits.
fn lamp(center: DVec3, side: f64, radiance: f32) -> (Mesh, Material) {
    (cuboid(center, DVec3::splat(side), false), Material { emissive: Vec3::splat(radiance), ..grey() })
}

fn with(mut scene: Scene, part: (Mesh, Material)) -> Scene {
    let (mesh, material) = part;
    let index = scene.meshes.len() as u32;
    // As loaders do for files with lamps.
    if material.emissive.max_element() > 1.0 {
        scene.lighting = Lighting { lights: Vec::new(), sky: Sky::BLACK, exposure: 1.0 };
    }
    scene.meshes.push(Mesh { material: scene.materials.len() as u32, ..mesh });
    scene.materials.push(material);
    scene.instances.push(Instance { mesh: index, node: None, world_from_mesh: DAffine3::IDENTITY });
    scene
}

fn resolved(scene: &Scene) -> ResolvedLight {
    PacketSight::new(&Arc::new(scene.clone())).resolve_light(LightRequest::Auto, ALL)
}

/// Stops between the exposures of a scene and its twin, which must have the same light.
fn stops_between(scene: &Scene, twin: &Scene) -> f64 {
    let [scene, twin] = [scene, twin].map(resolved);
    assert_eq!(scene.choice.added, twin.choice.added, "{scene:?} {twin:?}");
    (scene.metered.unwrap() / twin.metered.unwrap()).log2().abs()
}

fn scaled(scene: &Scene, factor: f64) -> Scene {
    let mut scaled = scene.clone();
    for instance in &mut scaled.instances {
        instance.world_from_mesh = DAffine3::from_scale(DVec3::splat(factor)) * instance.world_from_mesh;
    }
    scaled
}

fn turned(scene: &Scene) -> Scene {
    let mut turned = scene.clone();
    for mesh in &mut turned.meshes {
        mesh.indices.as_chunks_mut::<3>().0.iter_mut().for_each(|corners| corners.swap(1, 2));
        mesh.normals.iter_mut().for_each(|normal| *normal = -*normal);
    }
    turned
}

#[test]
fn what_changes_little_of_a_scene_changes_little_of_its_exposure() {
    let twin = exhibits();
    let stray = |distance: f64| {
        let mut mesh = cuboid(DVec3::X * distance, DVec3::splat(0.5), false);
        mesh.indices.truncate(3);
        with(exhibits(), (mesh, grey()))
    };
    let mut with_dark_lamp = exhibits();
    with_dark_lamp.lighting = Lighting {
        lights: vec![SceneLight::Point {
            position: DVec3::Y * 3.0,
            intensity: Vec3::ZERO,
            range: None,
            radius: 0.0,
        }],
        sky: Sky::BLACK,
        exposure: 1.0,
    };
    let dome = Material { unlit: true, backdrop: true, ..Material::default() };
    let domed = with(exhibits(), (cuboid(DVec3::ZERO, DVec3::splat(40.0), true), dome));
    for (name, scene) in [
        ("status LED", with(exhibits(), lamp(DVec3::new(0.82, 1.2, 0.3), 0.03, 3.0))),
        ("light of intensity 0", with_dark_lamp),
        ("stray triangle at 1 km", stray(1e3)),
        ("stray triangle at 10 km", stray(1e4)),
        ("sky dome", domed),
        ("turned winding", turned(&twin)),
        ("millimetres", scaled(&twin, 1e3)),
        ("kilometres", scaled(&twin, 1e-3)),
    ] {
        let stops = stops_between(&scene, &twin);
        assert!(stops < 0.05, "{name}: {stops}");
        assert_eq!(resolved(&scene).choice.added, AddedLight::Sky, "{name}");
    }
}

#[test]
fn closed_rooms_have_the_light_of_interiors_in_any_unit() {
    for double_sided in [false, true] {
        for unit in [1e-3, 1.0, 1e3] {
            let found = resolved(&scaled(&room(double_sided), unit));
            let reach = found.choice.reach().expect(&found.reason) / unit;
            assert!((0.1..0.9).contains(&reach), "{double_sided}, {unit}: {reach}");
            assert!(found.metered.is_some());
        }
    }
}

#[test]
fn a_lamp_that_lights_a_room_is_enough_and_a_hidden_one_is_not() {
    let lit = resolved(&with(room(true), lamp(DVec3::new(0.0, 2.7, 0.0), 0.4, 20.0)));
    assert_eq!(lit.choice.added, AddedLight::None, "{}", lit.reason);
    let hidden = resolved(&with(room(true), lamp(DVec3::new(-1.5, 0.3, -1.0), 0.1, 20.0)));
    assert!(matches!(hidden.choice.added, AddedLight::Interior(_)), "{}", hidden.reason);
}

#[test]
fn lights_of_any_strength_give_the_same_exposure_and_radiances_that_samples_store() {
    let of = |radiance: f32| resolved(&with(room(true), lamp(DVec3::new(0.0, 2.7, 0.0), 0.4, radiance)));
    let usual = of(20.0);
    for factor in [1e-6f32, 1e6] {
        let found = of(20.0 * factor);
        let shown = (found.choice.own_stops as f32).exp2() * factor;
        let stops = (found.metered.unwrap() / usual.metered.unwrap() / f64::from(shown)).log2();
        assert!(stops.abs() < 0.01, "{factor}: {stops}");
        assert!((-10.0..10.0).contains(&found.metered.unwrap().log2()), "{factor}");
    }
}

#[test]
fn strong_lamps_that_light_little_are_weakened_beside_the_sky() {
    let strong = resolved(&with(exhibits(), lamp(DVec3::new(0.9, 1.2, 0.3), 0.1, 1e6)));
    assert_eq!(strong.choice.added, AddedLight::Sky, "{}", strong.reason);
    assert!(strong.choice.own_stops < -5, "{:?}", strong.choice);
}

#[test]
fn what_is_asked_for_is_taken() {
    let scene = Arc::new(exhibits());
    let sight = PacketSight::new(&scene);
    let of = |request| sight.resolve_light(request, ALL).choice.added;
    assert_eq!(of(LightRequest::File), AddedLight::None);
    assert_eq!(of(LightRequest::Sky), AddedLight::Sky);
    assert!(matches!(of(LightRequest::Interior), AddedLight::Interior(_)));
}

#[test]
fn a_scene_without_surfaces_or_with_unlit_ones_keeps_its_light() {
    let unlit = Material { unlit: true, ..Material::default() };
    let card = file(vec![(cuboid(DVec3::ZERO, DVec3::ONE, false), unlit)]);
    for scene in [file(Vec::new()), card] {
        let found = resolved(&scene);
        assert_eq!((found.choice, found.metered), (LightChoice::SKY, None), "{}", found.reason);
    }
}

#[test]
fn the_cameras_of_a_file_are_its_viewers() {
    // A lamp behind a wall, and a camera that sees none of its light.
    let mut scene = with(room(true), lamp(DVec3::new(0.0, 2.7, 0.0), 0.4, 20.0));
    let camera = Camera::look_at(DVec3::new(20.0, 8.0, 12.0), DVec3::ZERO);
    scene.cameras.push(NamedCamera { name: String::new(), camera });
    assert_eq!(resolved(&scene).choice.added, AddedLight::Sky);
}
