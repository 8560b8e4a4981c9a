//! Fields of materials, textures and samplers, and their extensions.

use serde_json::{Value, json};

use super::Outcome::{NotApplicable, Shown, Warned};
use super::{Row, material, merge, none, wrong};

/// Puts the object of a texture into a document.
type At = Box<dyn Fn(Value) -> Value>;

fn pbr(change: Value) -> Value {
    material(json!({"pbrMetallicRoughness": change}))
}

fn of_extension(name: &str, change: Value) -> Value {
    material(json!({"extensions": {name: change}}))
}

#[test]
fn every_field_of_a_material_is_shown_or_warned_of() {
    let texture = || json!({"index": 1});
    let second = || json!({"texCoord": 1});
    let moved = || json!({"extensions": {"KHR_texture_transform": {"offset": [0.3, 0.1], "rotation": 0.5, "scale": [2, -3]}}});
    let other_set = || json!({"extensions": {"KHR_texture_transform": {"texCoord": 1}}});
    let mut rows: Vec<Row> = vec![
        ("material.name", NotApplicable, none(), material(json!({"name": "paint"}))),
        ("material.extras", NotApplicable, none(), material(json!({"extras": {"a": 1}}))),
        ("pbr.baseColorFactor", Shown, none(), pbr(json!({"baseColorFactor": [0.5, 1, 1, 1]}))),
        ("pbr.metallicFactor", Shown, none(), pbr(json!({"metallicFactor": 0.5}))),
        ("pbr.roughnessFactor", Shown, none(), pbr(json!({"roughnessFactor": 0.25}))),
        (
            "material.normalTexture.scale",
            Shown,
            material(json!({"normalTexture": texture()})),
            material(json!({"normalTexture": {"scale": 0.5}})),
        ),
        (
            "material.occlusionTexture",
            NotApplicable,
            none(),
            material(json!({"occlusionTexture": {"index": 1, "strength": 0.5, "texCoord": 3}})),
        ),
        ("material.emissiveFactor", Shown, none(), material(json!({"emissiveFactor": [0.5, 0, 0]}))),
        ("material.alphaMode MASK", Shown, none(), material(json!({"alphaMode": "MASK"}))),
        (
            "material.alphaCutoff",
            Shown,
            material(json!({"alphaMode": "MASK"})),
            material(json!({"alphaCutoff": 0.25})),
        ),
        ("material.doubleSided", Shown, none(), material(json!({"doubleSided": true}))),
        (
            "a third set of coordinates",
            Warned("a third set"),
            json!({"meshes": [{"primitives": [{"attributes": {"TEXCOORD_2": 3}}]}], "materials": [{"normalTexture": {"index": 1, "texCoord": 1}}]}),
            material(json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 1, "texCoord": 2}})),
        ),
    ];
    let glowing = || material(json!({"emissiveFactor": [1, 1, 1]}));
    let clear = || of_extension("KHR_materials_transmission", json!({"transmissionFactor": 1}));
    // Each texture, the factor that it needs, and where it stands.
    let textures: Vec<(&str, Value, At)> = vec![
        ("pbr.baseColorTexture", none(), Box::new(|t| pbr(json!({"baseColorTexture": t})))),
        ("pbr.metallicRoughnessTexture", none(), Box::new(|t| pbr(json!({"metallicRoughnessTexture": t})))),
        ("material.normalTexture", none(), Box::new(|t| material(json!({"normalTexture": t})))),
        ("material.emissiveTexture", glowing(), Box::new(|t| material(json!({"emissiveTexture": t})))),
        (
            "transmissionTexture",
            clear(),
            Box::new(|t| of_extension("KHR_materials_transmission", json!({"transmissionTexture": t}))),
        ),
        (
            "specularTexture",
            none(),
            Box::new(|t| of_extension("KHR_materials_specular", json!({"specularTexture": t}))),
        ),
        (
            "specularColorTexture",
            none(),
            Box::new(|t| of_extension("KHR_materials_specular", json!({"specularColorTexture": t}))),
        ),
        (
            "diffuseTexture",
            none(),
            Box::new(|t| of_extension("KHR_materials_pbrSpecularGlossiness", json!({"diffuseTexture": t}))),
        ),
        (
            "specularGlossinessTexture",
            none(),
            Box::new(|t| {
                of_extension("KHR_materials_pbrSpecularGlossiness", json!({"specularGlossinessTexture": t}))
            }),
        ),
    ];
    for (field, given, at) in &textures {
        let mut with = given.clone();
        merge(&mut with, &at(texture()));
        rows.push((field, Shown, given.clone(), at(texture())));
        for change in [second(), moved(), other_set()] {
            rows.push((field, Shown, with.clone(), at(change)));
        }
        let mut bent = with.clone();
        merge(&mut bent, &json!({"samplers": [{}, {}], "textures": [{}, {"sampler": 1}]}));
        for change in [json!({"magFilter": 9728}), json!({"wrapS": 33071}), json!({"wrapT": 33648})] {
            rows.push((field, Shown, bent.clone(), json!({"samplers": [{}, change]})));
        }
        rows.push((field, NotApplicable, bent, json!({"samplers": [{}, {"minFilter": 9728, "name": "a"}]})));
    }
    assert_eq!(wrong(rows), Vec::<String>::new());
}

#[test]
fn every_extension_of_materials_is_shown_or_warned_of_where_it_has_an_effect() {
    let clear = || of_extension("KHR_materials_transmission", json!({"transmissionFactor": 1}));
    let thick = || of_extension("KHR_materials_volume", json!({"thicknessFactor": 1}));
    let mut thick_glass = clear();
    merge(&mut thick_glass, &thick());
    let mut rows: Vec<Row> = Vec::new();
    for (name, outcome, change) in [
        ("KHR_materials_ior", Shown, json!({"ior": 1.8})),
        ("KHR_materials_specular", Shown, json!({"specularFactor": 0.5})),
        ("KHR_materials_specular", Shown, json!({"specularColorFactor": [1, 0.5, 0]})),
        ("KHR_materials_transmission", Shown, json!({"transmissionFactor": 1})),
        ("KHR_materials_unlit", Shown, json!({})),
        ("KHR_materials_pbrSpecularGlossiness", Shown, json!({})),
        ("KHR_materials_clearcoat", Warned("second, sharp highlight"), json!({"clearcoatFactor": 1})),
        (
            "KHR_materials_clearcoat",
            NotApplicable,
            json!({"clearcoatRoughnessFactor": 1, "clearcoatTexture": {"index": 0}}),
        ),
        ("KHR_materials_sheen", Warned("sheen"), json!({"sheenColorFactor": [0, 0.5, 0]})),
        ("KHR_materials_sheen", NotApplicable, json!({"sheenRoughnessFactor": 1})),
        (
            "KHR_materials_volume",
            NotApplicable,
            json!({"thicknessFactor": 1, "attenuationDistance": 1, "attenuationColor": [1, 0, 0]}),
        ),
        ("KHR_materials_anisotropy", Warned("anisotropy"), json!({"anisotropyStrength": 0.5})),
        ("KHR_materials_anisotropy", NotApplicable, json!({"anisotropyRotation": 0.5})),
        ("KHR_materials_iridescence", Warned("iridescence"), json!({"iridescenceFactor": 0.5})),
        ("KHR_materials_iridescence", NotApplicable, json!({"iridescenceIor": 1.8})),
        ("KHR_materials_dispersion", NotApplicable, json!({"dispersion": 1})),
        (
            "KHR_materials_diffuse_transmission",
            Warned("diffuse transmission"),
            json!({"diffuseTransmissionFactor": 1}),
        ),
        (
            "KHR_materials_diffuse_transmission",
            NotApplicable,
            json!({"diffuseTransmissionColorFactor": [1, 0, 0]}),
        ),
    ] {
        rows.push((name, outcome, none(), of_extension(name, change.clone())));
        // Nothing is lacking of an unlit surface.
        if matches!(outcome, Warned(_)) {
            rows.push((
                name,
                NotApplicable,
                of_extension("KHR_materials_unlit", json!({})),
                of_extension(name, change),
            ));
        }
    }
    let glossy = |change: Value| of_extension("KHR_materials_pbrSpecularGlossiness", change);
    rows.extend([
        (
            "KHR_materials_emissive_strength",
            Shown,
            material(json!({"emissiveFactor": [1, 1, 1]})),
            of_extension("KHR_materials_emissive_strength", json!({"emissiveStrength": 5})),
        ),
        ("KHR_materials_volume", Warned("volume"), clear(), thick()),
        (
            "KHR_materials_volume of a leaf",
            NotApplicable,
            clear(),
            of_extension("KHR_materials_volume", json!({"attenuationDistance": 1})),
        ),
        (
            "KHR_materials_dispersion",
            Warned("dispersion"),
            thick_glass,
            of_extension("KHR_materials_dispersion", json!({"dispersion": 1})),
        ),
        (
            "specular of glass",
            Warned("plain glass"),
            clear(),
            of_extension("KHR_materials_specular", json!({"specularFactor": 0.5})),
        ),
        (
            "diffuseFactor",
            Shown,
            glossy(json!({"specularFactor": [0, 0, 0]})),
            glossy(json!({"diffuseFactor": [0.5, 1, 1, 1]})),
        ),
        ("specularFactor", Shown, glossy(json!({})), glossy(json!({"specularFactor": [0.2, 0.1, 0.1]}))),
        ("glossinessFactor", Shown, glossy(json!({})), glossy(json!({"glossinessFactor": 0.3}))),
        (
            "glossinessFactor of a texture",
            Shown,
            glossy(json!({"specularGlossinessTexture": {"index": 1}})),
            glossy(json!({"glossinessFactor": 0.3})),
        ),
    ]);
    assert_eq!(wrong(rows), Vec::<String>::new());
}
