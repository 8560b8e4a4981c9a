//! Textures and materials.
#![allow(clippy::type_complexity)] // rows of a table

use argus_scene::{AlphaMode, Material};
use glam::{Vec3, Vec4};
use serde_json::{Value, json};

use super::{load, load_with, refused, square};

fn png() -> Vec<u8> {
    let mut bytes = Vec::new();
    let image = image::RgbaImage::from_pixel(2, 2, image::Rgba([200, 100, 50, 255]));
    image.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).expect("PNG in memory");
    bytes
}

/// A square whose material uses one texture for every channel.
fn textured(image: Value) -> Value {
    let mut document = square();
    document["images"] = json!([image]);
    document["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648}]);
    document["textures"] = json!([{"source": 0, "sampler": 0}]);
    document["materials"] = json!([{
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}},
        "normalTexture": {"index": 0},
    }]);
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    document
}

#[test]
fn textures_are_decoded_with_their_wrap_modes_and_get_tangents() {
    let bytes = png();
    let scene =
        load_with(&textured(json!({"uri": "wood%20grain.png"})), &[("wood grain.png", &bytes)]).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    // Colour and data decode the same image differently.
    assert_eq!(scene.textures.len(), 2);
    assert_eq!(scene.textures[0].rgba[..4], [200, 100, 50, 255]);
    use argus_scene::material::Wrap;
    assert_eq!(scene.textures[0].wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert!(scene.meshes[0].tangents.iter().all(|t| (*t - Vec4::new(1., 0., 0., 1.)).length() < 1e-5));
}

#[test]
fn a_bad_texture_is_dropped_with_a_warning() {
    let whole = png();
    let cases: [(Value, &[u8]); 5] = [
        (json!({"uri": "x.png"}), &whole[..40]),
        (json!({"uri": "missing.png"}), &whole),
        (json!({"uri": "x.png"}), b"not an image"),
        (json!({"uri": "../y.png"}), &whole),
        (json!({"bufferView": 77, "mimeType": "image/png"}), &whole),
    ];
    for (image, bytes) in cases {
        let scene = load_with(&textured(image.clone()), &[("x.png", bytes)]).unwrap();
        assert_eq!((scene.triangles(), scene.textures.len()), (2, 0), "{image}");
        assert_eq!(scene.materials[0].base_color_texture, None);
        assert_eq!(scene.warnings.len(), 1, "{image}: {:?}", scene.warnings);
    }
}

#[test]
fn materials_keep_their_extensions() {
    let mut document = textured(json!({"uri": "x.png"}));
    document["materials"][0] = json!({
        "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true, "emissiveFactor": [1, 0.5, 0],
        "pbrMetallicRoughness": {"metallicFactor": 0.25, "roughnessFactor": 0.5, "baseColorTexture": {
            "index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0], "scale": [2, 3], "rotation": 1}}}},
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": 10},
            "KHR_materials_ior": {"ior": 1.33},
            "KHR_materials_transmission": {"transmissionFactor": 0.75},
        },
    });
    let scene = load_with(&document, &[("x.png", &png())]).unwrap();
    let material = &scene.materials[0];
    assert_eq!(material.alpha, AlphaMode::Mask(0.25));
    assert_eq!(material.emissive, Vec3::new(10.0, 5.0, 0.0));
    assert_eq!((material.ior, material.transmission, material.double_sided), (1.33, 0.75, true));
    let texture = material.base_color_texture.unwrap();
    assert_eq!((texture.offset.x, texture.scale.y, texture.rotation), (0.5, 3.0, 1.0));
    document["materials"][0] = json!({"alphaMode": "BLEND", "extensions": {"KHR_materials_unlit": {}}});
    let scene = load(&document).unwrap();
    let Material { alpha, emissive, unlit, backdrop, .. } = scene.materials[0];
    assert_eq!((alpha, emissive, unlit, backdrop), (AlphaMode::Blend, Vec3::ZERO, true, false));
    assert_eq!(scene.warnings, [""; 0], "it is shown");
    document["extensionsRequired"] = json!(["XMPL_not_known"]);
    assert!(refused(&document).contains("XMPL_not_known"));
}

#[test]
fn a_lost_texture_makes_no_surface_glow_be_metal_or_be_glass() {
    let mut document = square();
    document["images"] = json!([{"uri": "x.png"}]);
    document["textures"] = json!([{"source": 0}, {"source": 9}]);
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    // A file that is missing, an image that does not exist, a texture that does not exist, coordinates that are missing.
    let whole = png();
    let cases: [(Value, &[(&str, &[u8])]); 4] = [
        (json!({"index": 0}), &[]),
        (json!({"index": 1}), &[]),
        (json!({"index": 7}), &[]),
        (json!({"index": 0, "texCoord": 4}), &[("x.png", &whole)]),
    ];
    for (texture, files) in cases {
        document["materials"] = json!([{
            "name": "lamp", "emissiveFactor": [1, 1, 1], "emissiveTexture": texture,
            "pbrMetallicRoughness": {"metallicRoughnessTexture": texture, "baseColorTexture": texture,
                "baseColorFactor": [0.5, 0.25, 1, 1]},
            "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1, "transmissionTexture": texture}},
        }]);
        let scene = load_with(&document, files).unwrap();
        let material = &scene.materials[scene.meshes[0].material as usize];
        let found = (material.emissive, material.metallic, material.transmission, material.roughness);
        assert_eq!(found, (Vec3::ZERO, 0.0, 0.0, 1.0), "{texture}");
        assert_eq!(material.base_color, Vec4::new(0.5, 0.25, 1.0, 1.0));
        assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
        for words in ["material \"lamp\" is shown", "plain colour", "without metal", "without glow", "opaque"]
        {
            assert!(scene.warnings[0].contains(words), "{words}: {:?}", scene.warnings);
        }
    }
}

#[test]
fn specular_and_gloss_become_a_dielectric_of_that_reflectance() {
    let mut document = textured(json!({"uri": "x.png"}));
    document["materials"][0] = json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [1, 0.5, 0, 1], "specularFactor": [0.5, 0.25, 0.1], "glossinessFactor": 0.75}}});
    let close = |a: Vec3, b: [f32; 3]| assert!((a - Vec3::from(b)).length() < 1e-5, "{a}");
    let scene = load_with(&document, &[("x.png", &png())]).unwrap();
    let material = &scene.materials[0];
    close(material.dielectric_f0(), [0.5, 0.25, 0.1]);
    close(material.base_color.truncate(), [0.5, 0.25, 0.0]);
    assert_eq!((material.metallic, material.roughness), (0.0, 0.25));

    // The texture of the test is opaque: gloss is the factor everywhere.
    document["materials"][0]["extensions"]["KHR_materials_pbrSpecularGlossiness"]["specularGlossinessTexture"] =
        json!({"index": 0});
    let scene = load_with(&document, &[("x.png", &png())]).unwrap();
    let material = &scene.materials[0];
    let texel = |reference: Option<argus_scene::TextureRef>| {
        let texture = &scene.textures[reference.unwrap().texture as usize];
        (texture.srgb, texture.rgba[..4].to_vec())
    };
    assert_eq!(texel(material.specular_color_texture), (true, vec![200, 100, 50, 255]));
    assert_eq!(texel(material.metallic_roughness_texture), (false, vec![0, 64, 0, 255]));
    assert_eq!((material.roughness, material.metallic), (1.0, 0.0));
    close(material.base_color.truncate(), [1.0, 0.5, 0.0]);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn what_many_materials_lack_is_one_warning_that_names_some() {
    let mut document = square();
    let coat = |i: usize| json!({"name": format!("paint {i}"), "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1}}});
    document["materials"] = (0..6).map(coat).collect();
    let primitive = document["meshes"][0]["primitives"][0].clone();
    let with = |i: usize| {
        let mut primitive = primitive.clone();
        primitive["material"] = json!(i);
        primitive
    };
    // The last one is not drawn.
    document["meshes"][0]["primitives"] = (0..5).map(with).collect();
    let scene = load(&document).unwrap();
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    assert!(
        scene.warnings[0].starts_with("materials \"paint 0\", \"paint 1\", \"paint 2\" and 2 more are shown")
    );
}

#[test]
fn ignored_extensions_are_warned_of_once_each() {
    let mut document = square();
    document["extensionsUsed"] = json!(["ABC_unknown", "KHR_materials_clearcoat", "ABC_unknown"]);
    let scene = load(&document).unwrap();
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    assert!(scene.warnings[0].contains("ABC_unknown"), "{:?}", scene.warnings);
}
