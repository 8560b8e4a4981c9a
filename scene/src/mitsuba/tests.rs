//! Exports of small scenes are read back.

use std::collections::BTreeSet;

use glam::{DAffine3, DVec3, Vec2, Vec4};

use super::*;
use crate::material::{AlphaMode, Filter, Wrap};
use crate::{Light, Lighting, Sky, Texture, TextureRef};

/// A unit square in the plane z = 0 that faces +z.
fn square(material: u32) -> Mesh {
    let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    Mesh {
        positions: corners.map(|c| c.extend(0.0)).to_vec(),
        normals: vec![Vec3::Z; 4],
        uvs: corners.to_vec(),
        indices: vec![0, 1, 2, 0, 2, 3],
        material,
        ..Mesh::default()
    }
}

fn scene(materials: Vec<Material>, textures: Vec<Texture>) -> Scene {
    let meshes: Vec<Mesh> = (0..materials.len() as u32).map(square).collect();
    let instance = |mesh: u32| Instance {
        mesh,
        node: None,
        world_from_mesh: DAffine3::from_translation(DVec3::X * 2.0 * f64::from(mesh)),
    };
    Scene {
        name: "squares".to_owned(),
        instances: (0..meshes.len() as u32).map(instance).collect(),
        meshes,
        materials,
        textures,
        ..Scene::default()
    }
}

fn settings() -> Settings {
    Settings {
        camera: Camera::look_at(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO),
        size: [32, 24],
        time_secs: 0.0,
        sky: SkyLight::Seen,
    }
}

/// Exports a scene and returns what was written, the XML's text, and the folder.
fn export(scene: &Scene) -> (Exported, String, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let exported = write(scene, &settings(), folder.path()).unwrap();
    let text = fs::read_to_string(folder.path().join("scene.xml")).unwrap();
    (exported, text, folder)
}

/// The values of an attribute, in order.
fn values<'a>(text: &'a str, attribute: &str) -> Vec<&'a str> {
    let key = format!(" {attribute}=\"");
    text.split(&key).skip(1).filter_map(|rest| rest.split('"').next()).collect()
}

/// Values of the attribute `value` of elements with this name.
fn values_of<'a>(text: &'a str, name: &str) -> Vec<&'a str> {
    let key = format!(" name=\"{name}\" value=\"");
    text.split(&key).skip(1).filter_map(|rest| rest.split('"').next()).collect()
}

/// Checks that elements are closed in order, that every file exists and that every reference has its BSDF.
fn check(text: &str, folder: &Path) {
    let mut open = Vec::new();
    for line in text.lines().map(str::trim) {
        if let Some(tag) = line.strip_prefix("</") {
            assert_eq!(open.pop(), tag.strip_suffix('>'), "{text}");
        } else if !line.ends_with("/>") {
            open.push(line.trim_matches(['<', '>']).split(' ').next().unwrap());
        }
    }
    assert!(open.is_empty(), "{text}");
    for file in values_of(text, "filename") {
        assert!(folder.join(file).is_file(), "{file} is missing");
    }
    let bsdfs: BTreeSet<&str> =
        text.lines().filter(|l| l.contains("<bsdf")).flat_map(|l| values(l, "id")).collect();
    let references: BTreeSet<&str> =
        text.lines().filter(|l| l.contains("<ref ")).flat_map(|l| values(l, "id")).collect();
    assert_eq!(bsdfs, references);
}

/// Vertices, triangles and the bytes after a PLY file's header.
fn ply(path: &Path) -> (usize, usize, Vec<u8>) {
    let bytes = fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let count = |element: &str| -> usize {
        let line = header.lines().find_map(|l| l.strip_prefix(&format!("element {element} ")));
        line.unwrap().parse().unwrap()
    };
    (count("vertex"), count("face"), bytes[end..].to_vec())
}

#[test]
fn an_exported_scene_has_its_triangles_and_every_file_that_it_names() {
    let scene =
        scene(vec![Material::default(), Material { roughness: 0.3, ..Material::default() }], Vec::new());
    let (exported, text, folder) = export(&scene);
    check(&text, folder.path());
    assert_eq!((exported.shapes, exported.triangles, exported.materials), (2, 4, 2));
    assert_eq!(exported.emitters, 2, "sun and sky");
    assert_eq!(values(&text, "type").iter().filter(|t| **t == "diffuse").count(), 1);
    assert_eq!(values(&text, "type").iter().filter(|t| **t == "principled").count(), 1);
    assert_eq!(values_of(&text, "fov"), ["45"]);

    let (vertices, triangles, body) = ply(&folder.path().join("shape-1.ply"));
    assert_eq!((vertices, triangles), (4, 2));
    assert_eq!(body.len(), 4 * 8 * 4 + 2 * 13);
    let x = |vertex: usize| f32::from_le_bytes(body[vertex * 32..][..4].try_into().unwrap());
    assert_eq!([x(0), x(1)], [2.0, 3.0], "positions are in world space");
}

#[cfg(feature = "procedural")]
#[test]
fn a_generated_scene_is_exported_whole() {
    let scene = crate::procedural::mirrors(6);
    let (exported, text, folder) = export(&scene);
    check(&text, folder.path());
    assert_eq!(exported.triangles, scene.triangles());
    assert_eq!(values(&text, "type").iter().filter(|t| **t == "point").count(), 2);
    assert_eq!(values(&text, "type").iter().filter(|t| **t == "constant").count(), 1, "its sky is uniform");
}

#[test]
fn emitters_shine_from_the_sides_that_are_seen() {
    let lamp = Material { emissive: Vec3::splat(3.0), ..Material::default() };
    let single = Material { double_sided: false, ..lamp.clone() };
    let (exported, text, folder) = export(&scene(vec![lamp, single], Vec::new()));
    check(&text, folder.path());
    assert_eq!(exported.shapes, 3, "the double-sided one has two layers");
    // With the disc of the sun.
    assert_eq!(values(&text, "type").iter().filter(|t| **t == "area").count(), 4);
    assert_eq!(values(&text, "type").iter().filter(|t| **t == "twosided").count(), 1);
    let corners = |name: &str| {
        let (vertices, _, body) = ply(&folder.path().join(name));
        let first = &body[vertices * 32 + 1..][..12];
        first.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect::<Vec<_>>()
    };
    assert_eq!(corners("shape-0.ply"), [0, 1, 2]);
    assert_eq!(corners("shape-0-back.ply"), [0, 2, 1]);
}

#[test]
fn textures_are_linear_and_have_their_factor_and_cut_outs_are_zero_or_one() {
    let texture = Texture {
        name: String::new(),
        width: 2,
        height: 1,
        rgba: [188, 188, 188, 255, 255, 255, 255, 0].to_vec().into(),
        srgb: true,
        wrap: [Wrap::Repeat, Wrap::Repeat],
        filter: Filter::Linear,
    };
    let material = Material {
        base_color: Vec4::new(0.5, 1.0, 1.0, 1.0),
        base_color_texture: Some(TextureRef { offset: Vec2::new(0.25, 0.0), ..TextureRef::new(0) }),
        alpha: AlphaMode::Mask(0.5),
        ..Material::default()
    };
    let (exported, text, folder) = export(&scene(vec![material], vec![texture]));
    check(&text, folder.path());
    assert_eq!(exported.bitmaps, 2);
    let color = image::open(folder.path().join("material-0-color.png")).unwrap().into_rgb16();
    let [red, green, _] = color.get_pixel(0, 0).0.map(|value| f32::from(value) / 65535.0);
    assert!((green - 0.5029).abs() < 1e-3 && (red - 0.5 * green).abs() < 1e-4, "{red} {green}");
    let opacity = image::open(folder.path().join("material-0-opacity.png")).unwrap().into_luma8();
    assert_eq!(opacity.dimensions(), (8, 4));
    assert!(opacity.pixels().all(|p| p.0[0] == 0 || p.0[0] == 255));
    assert_eq!(opacity.pixels().filter(|p| p.0[0] == 255).count(), 16);
    assert!(values(&text, "value").contains(&"1 0 0 0.25 0 1 0 0 0 0 1 0 0 0 0 1"), "{text}");
}

#[test]
fn the_front_of_a_mirrored_instance_stays_the_meshs_front() {
    let mut scene = scene(vec![Material::default()], Vec::new());
    scene.instances[0].world_from_mesh = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let triangles = Triangles::of(&scene.meshes[0], &scene.instances[0], DVec3::ZERO, |_| true);
    let [a, b, c] = triangles.corners[0].map(|i| triangles.positions[i as usize]);
    assert!((b - a).cross(c - a).z > 0.0);
    assert_eq!(triangles.normals[0], Vec3::Z);
}

#[test]
fn a_scene_far_from_zero_is_moved_to_the_eye() {
    let mut scene = scene(vec![Material::default()], Vec::new());
    let far = DVec3::new(1e6, 0.0, -1e6);
    scene.instances[0].world_from_mesh = DAffine3::from_translation(far);
    let camera = Camera::look_at(far + DVec3::Z * 5.0, far);
    let folder = tempfile::tempdir().unwrap();
    write(&scene, &Settings { camera, ..settings() }, folder.path()).unwrap();
    let text = fs::read_to_string(folder.path().join("scene.xml")).unwrap();
    assert!(text.contains("origin=\"0, 0, 0\" target=\"0, 0, -5\""), "{text}");
    let (_, _, body) = ply(&folder.path().join("shape-0.ply"));
    assert_eq!(f32::from_le_bytes(body[8..12].try_into().unwrap()), -5.0);
}

#[test]
fn the_panoramas_first_row_is_up_and_a_quarter_turn_from_minus_z_is_plus_x() {
    let size = [64, 1025];
    assert!(lights::direction_of(size, 0, 0).y > 0.999);
    let level = lights::direction_of(size, 0, 512);
    assert!(level.z < -0.99 && level.y.abs() < 1e-9);
    assert!(lights::direction_of(size, 16, 512).x > 0.99);
}

#[test]
fn lights_of_all_kinds_are_written() {
    let mut scene = scene(vec![Material::default()], Vec::new());
    let position = DVec3::new(0.0, 2.0, 0.0);
    let spot = Light::Spot {
        position,
        direction: DVec3::NEG_Y,
        intensity: Vec3::ONE,
        range: Some(5.0),
        inner_cone: 0.2,
        outer_cone: 0.5,
        radius: 0.0,
    };
    scene.lighting = Lighting { lights: vec![Light::sun(), spot], sky: Sky::BLACK, exposure: 1.0 };
    let (exported, text, folder) = export(&scene);
    check(&text, folder.path());
    assert_eq!(exported.emitters, 2);
    let types = values(&text, "type");
    assert!(types.contains(&"spot") && types.contains(&"spot") && !types.contains(&"envmap"));
    assert!(exported.differences.iter().any(|line| line.contains("range")), "{:?}", exported.differences);
}

#[test]
fn a_matt_scene_has_no_gloss_and_keeps_the_albedo_of_a_part_metal() {
    let metal = Material { metallic: 0.25, roughness: 0.2, transmission: 0.5, ..Material::default() };
    let material = matt(scene(vec![metal], Vec::new())).materials.remove(0);
    assert!(!material.is_glossy() && material.transmission == 0.0);
    assert!((material.base_color.x - 0.8 * 0.75).abs() < 1e-6);
}
