//! Fields of all but materials, and extensions of them.

use serde_json::{Value, json};

use super::Outcome::{NotApplicable, Refused, Shown, Warned};
use super::{Row, material, merge, none, wrong};

#[test]
fn every_field_of_geometry_and_hierarchy_is_shown_or_warned_of() {
    let primitive = |change: Value| json!({"meshes": [{"primitives": [change]}]});
    let attribute = |name: &str, accessor: u32| primitive(json!({"attributes": {name: accessor}}));
    let accessor = |change: Value| json!({"accessors": [change]});
    let node = |change: Value| json!({"nodes": [change]});
    let camera = |change: Value| json!({"cameras": [change]});
    let light = |change: Value| json!({"extensions": {"KHR_lights_punctual": {"lights": [change]}}});
    let sparse = json!({"count": 1, "indices": {"bufferView": 1, "byteOffset": 2, "componentType": 5123}, "values": {"bufferView": 4, "byteOffset": 12}});
    let bumpy = || material(json!({"normalTexture": {"index": 1}}));
    let mut with_normals = bumpy();
    merge(&mut with_normals, &attribute("NORMAL", 4));
    let rows: Vec<Row> = vec![
        (
            "asset.copyright",
            NotApplicable,
            none(),
            json!({"asset": {"copyright": "a", "generator": "b", "extras": 1}}),
        ),
        ("asset.version", Refused("glTF 3.0"), none(), json!({"asset": {"version": "3.0"}})),
        ("asset.minVersion", Refused("glTF 2.1"), none(), json!({"asset": {"minVersion": "2.1"}})),
        (
            "extensionsRequired",
            Refused("ABC_unknown"),
            none(),
            json!({"extensionsRequired": ["ABC_unknown"]}),
        ),
        ("extensionsUsed", Warned("ABC_unknown"), none(), json!({"extensionsUsed": ["ABC_unknown"]})),
        ("scene", Shown, json!({"scenes": [{}, {"nodes": [0]}]}), json!({"scene": 1})),
        ("scene.name", NotApplicable, none(), json!({"scenes": [{"name": "a"}]})),
        ("accessor.bufferView", Shown, attribute("NORMAL", 4), attribute("POSITION", 4)),
        ("accessor.byteOffset", Shown, none(), json!({"accessors": [{}, {"byteOffset": 2, "count": 3}]})),
        ("accessor.count", Shown, none(), json!({"accessors": [{}, {"count": 3}]})),
        (
            "accessor.max",
            NotApplicable,
            none(),
            accessor(json!({"max": [9, 9, 9], "min": [-9, -9, -9], "name": "a"})),
        ),
        ("accessor.sparse", Shown, none(), accessor(json!({"sparse": sparse}))),
        (
            "accessor.normalized",
            NotApplicable,
            attribute("COLOR_0", 6),
            json!({"accessors": [{}, {}, {}, {}, {}, {}, {"normalized": false}]}),
        ),
        (
            "bufferView.target",
            NotApplicable,
            none(),
            json!({"bufferViews": [{"target": 34962, "name": "a"}]}),
        ),
        (
            "bufferView.byteStride",
            Shown,
            none(),
            json!({"bufferViews": [{"byteStride": 12}], "accessors": [{"byteOffset": 0}, {"count": 3}]}),
        ),
        ("buffer.name", NotApplicable, none(), json!({"buffers": [{"name": "a"}]})),
        (
            "image.mimeType",
            NotApplicable,
            none(),
            json!({"images": [{"mimeType": "image/png", "name": "a"}]}),
        ),
        ("texture.source", Shown, none(), json!({"textures": [{"source": 1}]})),
        ("texture.name", NotApplicable, none(), json!({"textures": [{"name": "a"}]})),
        ("mesh.name", NotApplicable, none(), json!({"meshes": [{"name": "a"}]})),
        (
            "primitive.indices",
            Shown,
            json!({"accessors": [{}, {}, {}, {}, {}, {}, {}, {}, {}, {}, {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}]}),
            primitive(json!({"indices": 10})),
        ),
        ("primitive.material", Shown, none(), primitive(json!({"material": null}))),
        ("primitive.mode: strip", Shown, none(), primitive(json!({"mode": 5}))),
        ("primitive.mode: fan", Shown, none(), primitive(json!({"mode": 6}))),
        (
            "primitive.mode: points",
            Warned("not drawn"),
            json!({"nodes": [{}, {}, {}, {"mesh": 1}], "scenes": [{"nodes": [0, 1, 2, 3]}], "meshes": [{}, {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]}),
            json!({"meshes": [{}, {"primitives": [{"mode": 0}]}]}),
        ),
        ("NORMAL", Shown, none(), attribute("NORMAL", 4)),
        ("TANGENT", Shown, with_normals, attribute("TANGENT", 5)),
        ("TEXCOORD_0", Shown, none(), attribute("TEXCOORD_0", 3)),
        (
            "TEXCOORD_7",
            Shown,
            attribute("TEXCOORD_7", 3),
            material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"texCoord": 7}}})),
        ),
        (
            "TEXCOORD_0 that is missing",
            Warned("lacks texture coordinates"),
            none(),
            primitive(json!({"attributes": {"TEXCOORD_0": null}})),
        ),
        ("COLOR_0", Shown, none(), attribute("COLOR_0", 6)),
        ("COLOR_0 without alpha", Shown, attribute("COLOR_0", 6), attribute("COLOR_0", 7)),
        ("COLOR_1", NotApplicable, none(), attribute("COLOR_1", 6)),
        ("application attribute", NotApplicable, none(), attribute("_HEAT", 6)),
        ("node.name", NotApplicable, none(), node(json!({"name": "a"}))),
        ("node.camera", Shown, none(), json!({"nodes": [{}, {"camera": null}]})),
        (
            "node.children",
            Shown,
            none(),
            json!({"nodes": [{}, {}, {}, {"children": [4]}, {"mesh": 0, "scale": [2, 2, 2]}], "scenes": [{"nodes": [0, 1, 2, 3]}]}),
        ),
        ("node.mesh", Shown, none(), json!({"nodes": [{}, {"mesh": 0}]})),
        (
            "node.matrix",
            Shown,
            none(),
            node(json!({"matrix": [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]})),
        ),
        ("node.translation", Shown, none(), node(json!({"translation": [1, 0, 0]}))),
        ("node.rotation", Shown, none(), node(json!({"rotation": [1, 0, 0, 0]}))),
        ("node.scale", Shown, none(), node(json!({"scale": [1, 2, 1]}))),
        ("camera.name", Shown, none(), camera(json!({"name": "door"}))),
        ("camera.perspective.yfov", Shown, none(), camera(json!({"perspective": {"yfov": 0.5}}))),
        (
            "camera.perspective.aspectRatio",
            NotApplicable,
            none(),
            camera(json!({"perspective": {"aspectRatio": 2, "zfar": 9, "znear": 1}})),
        ),
        (
            "camera.orthographic",
            Warned("orthographic"),
            none(),
            camera(
                json!({"type": "orthographic", "perspective": null, "orthographic": {"xmag": 1, "ymag": 1, "zfar": 9, "znear": 0}}),
            ),
        ),
        ("light.color", Shown, none(), light(json!({"color": [1, 0, 0]}))),
        ("light.intensity", Shown, none(), light(json!({"intensity": 9}))),
        ("light.range", Shown, none(), light(json!({"range": 9}))),
        ("light.type", Shown, none(), light(json!({"type": "directional"}))),
        (
            "light.spot",
            Shown,
            light(json!({"type": "spot", "spot": {}})),
            light(json!({"spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}})),
        ),
        ("light.name", NotApplicable, none(), light(json!({"name": "a"}))),
    ];
    assert_eq!(wrong(rows), Vec::<String>::new());
}

#[test]
fn extensions_that_change_a_picture_are_warned_of_and_data_beside_it_is_not() {
    let used = |name: &'static str, outcome| (name, outcome, none(), json!({"extensionsUsed": [name]}));
    let lost = [
        "EXT_lights_ies",
        "EXT_lights_image_based",
        "EXT_mesh_gpu_instancing",
        "KHR_animation_pointer",
        "KHR_gaussian_splatting",
        "KHR_node_visibility",
    ];
    let beside = [
        "EXT_instance_features",
        "EXT_mesh_features",
        "EXT_mesh_manifold",
        "EXT_structural_metadata",
        "KHR_audio_emitter",
        "KHR_interactivity",
        "KHR_materials_variants",
        "KHR_node_hoverability",
        "KHR_node_selectability",
        "KHR_xmp_json_ld",
        "MSFT_lod",
    ];
    let rows = lost.map(|name| used(name, Warned(name))).into_iter();
    let rows = rows.chain(beside.map(|name| used(name, NotApplicable)));
    assert_eq!(wrong(rows.collect()), Vec::<String>::new());
}
