//! Textures and materials.

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
fn ignored_extensions_and_occlusion_textures_are_warned_of_once_each() {
    let bytes = png();
    let mut document = textured(json!({"uri": "wood.png"}));
    document["extensionsUsed"] =
        json!(["KHR_materials_clearcoat", "KHR_materials_ior", "KHR_materials_clearcoat"]);
    document["materials"][0]["occlusionTexture"] = json!({"index": 0});
    let scene = load_with(&document, &[("wood.png", &bytes)]).unwrap();
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    assert!(scene.warnings[0].contains("KHR_materials_clearcoat"), "{:?}", scene.warnings);
    assert!(scene.warnings[1].contains("occlusion"), "{:?}", scene.warnings);
}
