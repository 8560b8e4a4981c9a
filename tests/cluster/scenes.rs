//! Real scenes in a real cluster, from the collection in `ARGUS_SCENES`.

use std::process::{Command, Stdio};

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, json, real_folder, real_scene, run, stderr};

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
        let arguments = [&place, more, &["--json", "--out", out]].concat();
        json(&arguments)
    };
    let warped = view(&path("warped.png"), &["--search", "splat"]);
    assert!(warped["unresolved_fraction"].as_f64().unwrap() < 0.05, "{warped:#}");
    assert!(warped["samples"].as_array().is_some_and(|samples| !samples.is_empty()), "{warped:#}");
    let direct = view(&path("direct.png"), &["--direct"]);
    assert_eq!(direct["unresolved_fraction"], 0.0);
    view(&path("range.exr"), &["--output", "range"]);

    let comparison = json(&["compare", &path("warped.png"), &path("direct.png"), "--json"]);
    assert!(comparison["flip_mean"].as_f64().unwrap() < 0.2, "{comparison:#}");

    // Inside a building, surfaces are near, and most pixels are not sky.
    let range = exr::prelude::read_first_flat_layer_from_file(path("range.exr")).unwrap();
    let [channel] = &range.layer_data.channel_data.list[..] else { panic!("one channel: {range:?}") };
    assert_eq!(channel.name.to_string(), "Z");
    let near = channel.sample_data.values_as_f32().filter(|metres| (0.0..50.0).contains(metres)).count();
    assert!(near * 10 > 200 * 150 * 9, "{near}");

    let mut wire = Wire::connect(&coordinator.url).await;
    let camera = wire.describe().await.cameras[0].camera;
    wire.render((&small_view(camera)).into()).await.unwrap();
}

#[test]
fn sponza_is_described() {
    let Some(file) = real_scene("sponza/sponza.glb") else { return };
    let scene = json(&["scene", file.to_str().unwrap(), "--json"]);
    assert!(scene["triangles"].as_u64().unwrap() > 250_000, "{scene:#}");
    assert!(scene["effects"].as_array().unwrap().iter().any(|effect| effect == "alpha-cutout"), "{scene:#}");
}

/// Loads every deliberately broken file by the command: a scene, or an error of one line that names the file.
#[test]
fn every_broken_file_gives_a_scene_or_an_error_of_one_line() {
    for (folder, refused_at_least) in [("nasty_gltf", 20), ("nasty_obj", 0)] {
        let Some(folder) = real_folder(folder) else { return };
        let (mut opened, mut refused) = (0, 0);
        for entry in walkdir::WalkDir::new(folder).sort_by_file_name() {
            let path = entry.unwrap().into_path();
            if !path.extension().is_some_and(|e| e == "gltf" || e == "glb" || e == "obj") {
                continue;
            }
            let output = run(&["scene", path.to_str().unwrap(), "--json"]);
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

/// Test output is captured, and shown only for failures.
#[test]
fn a_test_skipped_for_want_of_scenes_says_so_although_it_passes() {
    let mut tests = Command::new(std::env::current_exe().unwrap());
    tests
        .args(["--exact", "scenes::every_broken_file_gives_a_scene_or_an_error_of_one_line"])
        .stdin(Stdio::null());
    let without = tests.env_remove("ARGUS_SCENES").env_remove("ARGUS_REQUIRE_SCENES").output().unwrap();
    assert!(without.status.success(), "{}", stderr(&without));
    assert!(stderr(&without).contains("SKIPPED: ARGUS_SCENES is not set"), "{}", stderr(&without));
    let required = tests.env("ARGUS_REQUIRE_SCENES", "1").output().unwrap();
    assert!(!required.status.success(), "{}", stderr(&required));
}
