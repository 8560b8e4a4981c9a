//! Real scenes in a real cluster, from the collection in `ARGUS_SCENES`.

use std::io::Cursor;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use image::ImageFormat;
use serde_json::{Value, json};

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, argus, json as run_json, real_folder, real_scene, stderr};

/// A viewpoint in Sponza's nave, looking along it.
const EYE: &str = "-11,3,0";
const TARGET: &str = "0,4,0";

#[tokio::test(flavor = "multi_thread")]
async fn sponza_is_served_over_grpc_and_looks_like_its_direct_view() {
    let Some(file) = real_scene("sponza/sponza.glb") else { return };
    let coordinator = Coordinator::start(file.to_str().unwrap(), &[]);
    let _workers = coordinator.workers(2);
    coordinator.wait_for_workers(2);
    coordinator.wait_for_full_light();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();

    let view = |out: &str, more: &[&str]| {
        let place =
            ["view", "--server", &coordinator.url, "--eye", EYE, "--target", TARGET, "--size", "200x150"];
        // Other tests share the cores: what renders samples is measured late, and they take long.
        let arguments = [&place, more, &["--timeout", "240", "--json", "--out", out]].concat();
        run_json(&arguments)
    };
    let warped = view(&path("warped.png"), &["--search", "splat"]);
    assert!(warped["unresolved_fraction"].as_f64().unwrap() < 0.05, "{warped:#}");
    assert!(warped["samples"].as_array().is_some_and(|samples| !samples.is_empty()), "{warped:#}");
    let direct = view(&path("direct.png"), &["--direct"]);
    assert_eq!(direct["unresolved_fraction"], 0.0);
    view(&path("range.exr"), &["--output", "range"]);

    let comparison = run_json(&["compare", &path("warped.png"), &path("direct.png"), "--json"]);
    assert!(comparison["flip_mean"].as_f64().unwrap() < 0.2, "{comparison:#}");

    // Inside a building, surfaces are near, and most pixels are not sky.
    let range = exr::prelude::read_first_flat_layer_from_file(path("range.exr")).unwrap();
    let [channel] = &range.layer_data.channel_data.list[..] else { panic!("one channel: {range:?}") };
    assert_eq!(channel.name.to_string(), "range");
    let near = channel.sample_data.values_as_f32().filter(|metres| (0.0..50.0).contains(metres)).count();
    assert!(near * 10 > 200 * 150 * 9, "{near}");

    let mut wire = Wire::connect(&coordinator.url).await;
    let camera = wire.describe().await.cameras[0].camera;
    wire.render((&small_view(camera)).into()).await.unwrap();
}

#[test]
fn sponza_is_described() {
    let Some(file) = real_scene("sponza/sponza.glb") else { return };
    let scene = run_json(&["scene", file.to_str().unwrap(), "--json"]);
    assert!(scene["triangles"].as_u64().unwrap() > 250_000, "{scene:#}");
    assert!(scene["effects"].as_array().unwrap().iter().any(|effect| effect == "alpha-cutout"), "{scene:#}");
}

/// KiB of private memory that can be written, and seconds of a processor, that reading a hostile file may take.
const MOST_KIB: u64 = 1 << 20;
const MOST_SECS: u64 = 10;

/// Describes a scene within these bounds. A process that needs more memory is ended by its allocator, one that needs more time
/// by the system: neither exits with 0 or 1.
fn described(file: &Path) -> Output {
    let program = argus(&["scene", file.to_str().unwrap(), "--json"]);
    let limits = format!("ulimit -d {MOST_KIB}; ulimit -t {MOST_SECS}; exec \"$0\" \"$@\"");
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(limits).arg(program.get_program()).args(program.get_args());
    shell.stdin(Stdio::null()).output().unwrap()
}

/// Loads every deliberately broken file by the command: a scene, or an error of one line that names the file.
#[test]
fn every_broken_file_gives_a_scene_or_an_error_of_one_line_in_little_time_and_memory() {
    for (folder, refused_at_least) in [("nasty_gltf", 20), ("nasty_obj", 0)] {
        let Some(folder) = real_folder(folder) else { return };
        let (mut opened, mut refused) = (0, 0);
        for entry in walkdir::WalkDir::new(folder).sort_by_file_name() {
            let path = entry.unwrap().into_path();
            if !path.extension().is_some_and(|e| e == "gltf" || e == "glb" || e == "obj") {
                continue;
            }
            let output = described(&path);
            let message = stderr(&output);
            match output.status.code() {
                Some(0) => opened += 1,
                Some(1) => {
                    refused += 1;
                    assert_eq!(message.lines().count(), 1, "{}: {message}", path.display());
                    let name = path.file_name().unwrap().to_str().unwrap();
                    assert!(message.contains(name), "{} is not named: {message}", path.display());
                }
                other => panic!("{}: {other:?}: {message}", path.display()),
            }
        }
        assert!(opened > 20 && refused >= refused_at_least, "{opened} opened, {refused} refused");
    }
}

/// A glTF file of triangles whose materials each have a texture of this image.
fn textured(image: &[u8], count: usize) -> Value {
    let uri = |kind: &str, bytes: &[u8]| format!("data:{kind};base64,{}", BASE64_STANDARD.encode(bytes));
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let corners: Vec<u8> = corners.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    let each = |of: &dyn Fn(usize) -> Value| (0..count).map(of).collect::<Vec<Value>>();
    json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": each(&|number| number.into()) }], "scene": 0,
        "nodes": each(&|number| json!({ "mesh": number })),
        "meshes": each(&|number| json!({ "primitives": [
            { "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": number }] })),
        "materials": each(&|number| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": number } } })),
        "textures": each(&|number| json!({ "source": number })),
        // Each with a name of its own: equal ones would be one image.
        "images": each(&|number| json!({ "name": number.to_string(), "uri": uri("image/png", image) })),
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 36 }, { "buffer": 0, "byteOffset": 0, "byteLength": 24 }],
        "buffers": [{ "byteLength": 36, "uri": uri("application/octet-stream", &corners) }],
    })
}

/// Each format's decoder gets an image that takes far more memory than its file, or claims to.
#[test]
fn images_that_are_far_larger_than_their_files_take_little_time_and_memory() {
    let folder = tempfile::tempdir().unwrap();
    let even = |side: u32, format: ImageFormat| {
        let mut bytes = Vec::new();
        image::GrayImage::from_pixel(side, side, image::Luma([90]))
            .write_to(&mut Cursor::new(&mut bytes), format)
            .unwrap();
        bytes
    };
    // KTX2 of no format: 16384² texels of BasisLZ, level 0 at byte 104.
    let mut ktx2 = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    for word in [0u32, 1, 16384, 16384, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 104, 0, 40, 0, 0, 0] {
        ktx2.extend(word.to_le_bytes());
    }
    ktx2.extend([0; 40]);
    let mut gif = b"GIF89a\xff\xff\xff\xff\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0\xff\xff\xff\xff\0\x02".to_vec();
    gif.extend(b"\x02\x4c\x01\0;");
    for (name, image, count) in [
        ("many", even(4096, ImageFormat::Png), 40),
        ("jpeg", even(16384, ImageFormat::Jpeg), 1),
        ("ktx2", ktx2, 3),
        ("gif", gif, 3),
    ] {
        let file = folder.path().join(format!("{name}.gltf"));
        std::fs::write(&file, textured(&image, count).to_string()).unwrap();
        let output = described(&file);
        assert_eq!(output.status.code(), Some(0), "{name}: {}", stderr(&output));
        let scene: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(scene["warnings"].as_array().is_some_and(|lines| !lines.is_empty()), "{name}: {scene:#}");
    }
}

/// Test output is captured, and shown only for failures.
#[test]
fn a_test_skipped_for_want_of_scenes_says_so_although_it_passes() {
    let mut tests = Command::new(std::env::current_exe().unwrap());
    tests
        .args([
            "--exact",
            "scenes::every_broken_file_gives_a_scene_or_an_error_of_one_line_in_little_time_and_memory",
        ])
        .stdin(Stdio::null());
    let without = tests.env_remove("ARGUS_SCENES").env_remove("ARGUS_REQUIRE_SCENES").output().unwrap();
    assert!(without.status.success(), "{}", stderr(&without));
    assert!(stderr(&without).contains("SKIPPED: ARGUS_SCENES is not set"), "{}", stderr(&without));
    let required = tests.env("ARGUS_REQUIRE_SCENES", "1").output().unwrap();
    assert!(!required.status.success(), "{}", stderr(&required));
}
