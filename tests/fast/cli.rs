//! The command line: help, exit codes, JSON, and errors with a remedy.

use std::net::TcpListener;
use std::process::Stdio;

use crate::support::{Process, SMALL, argus, json, run, stderr};

const SUBCOMMANDS: [&str; 15] = [
    "certs",
    "config",
    "dataset",
    "demo",
    "serve",
    "coordinator",
    "worker",
    "view",
    "load",
    "status",
    "move",
    "scene",
    "reference",
    "selftest",
    "compare",
];

/// An unused address: its port was free a moment ago.
fn unused_url() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    format!("http://{}", listener.local_addr().unwrap())
}

#[track_caller]
fn fails_with(arguments: &[&str], code: i32, words: &[&str]) {
    let output = run(arguments);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "argus {arguments:?}: {message}");
    assert!(output.stdout.is_empty(), "argus {arguments:?} wrote to stdout, where only results belong");
    for word in words {
        assert!(message.contains(word), "argus {arguments:?} does not say `{word}`: {message}");
    }
}

/// Checks that a failure is an error of one line with these words.
#[track_caller]
fn fails_in_one_line(arguments: &[&str], code: i32, words: &[&str]) {
    fails_with(arguments, code, words);
    let message = stderr(&run(arguments));
    assert_eq!(message.lines().count(), 1, "argus {arguments:?}: {message}");
}

#[test]
fn every_subcommand_has_help() {
    let overview = run(&["--help"]);
    assert!(overview.status.success());
    let overview = String::from_utf8(overview.stdout).unwrap();
    for subcommand in SUBCOMMANDS {
        assert!(overview.contains(subcommand), "--help does not mention {subcommand}");
        let help = run(&[subcommand, "--help"]);
        assert_eq!(help.status.code(), Some(0), "{subcommand}");
        let text = String::from_utf8(help.stdout).unwrap();
        assert!(text.contains("Example") || text.contains("Commands:"), "{subcommand} --help has no example");
    }
}

#[test]
fn invalid_arguments_end_with_2_before_any_work() {
    fails_with(&["view"], 2, &["--out"]);
    fails_with(&["view", "--eye", "1,2", "--target", "0,0,0", "--out", "x.png"], 2, &["three numbers"]);
    let view = ["view", "--eye", "1,2,3", "--target", "-1,-2,-3", "--out", "x.png"];
    for (wrong, word) in [
        (["--search", "best"], "splat"),
        (["--output", "deepness"], "depth"),
        (["--size", "big"], "640x480"),
        (["--steps", "-1"], "--steps"),
        (["--time", "1"], "--direct"),
        (["--effects", "none"], "--scene"),
    ] {
        fails_with(&[view.as_slice(), &wrong].concat(), 2, &[word]);
    }
    fails_with(&["load", "--clients", "0", "--seconds", "1"], 2, &["--clients"]);
    fails_with(&["load", "--clients", "1", "--seconds", "nan"], 2, &["--seconds"]);
    fails_with(&["serve", "--workers", "0"], 2, &["--workers"]);
    fails_with(&["worker"], 2, &["--coordinator"]);
    for (scenes, word) in [
        (["--scene", "a=terrain", "--scene", "a=rooms"], "two scenes have this name"),
        (["--scene", "my scene=terrain", "--scene", "rooms"], "letters"),
    ] {
        let listening = ["coordinator", "--listen", "127.0.0.1:0"];
        fails_in_one_line(&[listening.as_slice(), &scenes].concat(), 2, &[word]);
    }
    let calibrated = ["coordinator", "--scene", "terrain", "--scene", "rooms", "--model", "x.json"];
    fails_in_one_line(
        &[&calibrated[..], &["--listen", "127.0.0.1:0"]].concat(),
        2,
        &["--model", "one scene"],
    );
    fails_with(&["no-such-command"], 2, &["no-such-command"]);
    fails_in_one_line(&["study", "views", "warp", "--quick"], 2, &["argus-lab study views warp --quick"]);
    assert_eq!(run(&[]).status.code(), Some(2));
}

#[test]
fn an_unreachable_service_is_an_error_of_one_line_with_a_remedy() {
    let url = unused_url();
    for subcommand in [
        ["status"].as_slice(),
        &["load", "--clients", "1", "--seconds", "1"],
        &["view", "--eye", "1,2,3", "--target", "0,0,0", "--out", "never.png"],
    ] {
        fails_in_one_line(&[subcommand, &["--server", &url]].concat(), 1, &["argus serve", &url]);
    }
    // By default a worker keeps trying.
    let at_once = ["worker", "--set", "worker.coordinator_wait_secs=0", "--coordinator", &url];
    fails_with(&at_once, 1, &["argus coordinator", &url]);
    fails_in_one_line(&["status", "--server", "not an address"], 2, &["not an address"]);
}

#[test]
fn a_port_in_use_is_an_error_of_one_line() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    fails_in_one_line(&["coordinator", "--scene", SMALL, "--listen", &address], 1, &[&address, "--listen"]);
}

#[test]
fn a_scene_is_exported_for_mitsuba_and_its_reference_is_linear_radiance() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let camera = ["--eye", "-3.6,1.6,3.6", "--target", "-1,1.1,0.6", "--fov-deg", "65", "--size", "16x12"];
    let export = at("export");
    let exported = json(&[&["scene", "rooms", "--json", "--mitsuba", &export], camera.as_slice()].concat());
    assert_eq!((&exported["shapes"], &exported["emitters"]), (&3.into(), &3.into()), "{exported:#}");
    assert!(folder.path().join("export/scene.xml").is_file());

    let out = at("view.exr");
    let seen = json(&[&["reference", "rooms", "--json", "--out", &out], camera.as_slice()].concat());
    assert!(seen["mean_radiance"][0].as_f64().unwrap() > 0.0, "{seen:#}");
    // Packed.
    assert!(std::fs::metadata(&out).unwrap().len() > 16 * 12 * 10);
    fails_in_one_line(&["reference", "rooms", "--eye", "nan,2,3", "--out", &out], 2, &["eye"]);
    fails_in_one_line(&["reference", "rooms", "--size", "0x5", "--out", &out], 2, &["--size"]);
}

#[test]
fn a_scene_is_described_and_a_missing_one_is_named() {
    let scene = json(&["scene", SMALL, "--json"]);
    assert!((19_000..=20_000).contains(&scene["triangles"].as_u64().unwrap()), "{scene:#}");
    for key in ["instances", "materials", "textures", "lights", "cameras"] {
        assert!(scene[key].is_u64(), "{key}: {scene:#}");
    }
    for corner in ["min", "max"] {
        assert_eq!(scene["bounds"][corner].as_array().unwrap().len(), 3);
    }
    assert!(scene["effects"].as_array().unwrap().iter().any(|effect| effect == "specular"), "{scene:#}");
    assert_eq!(scene, json(&["scene", SMALL, "--json"]), "a generated scene is the same each time");

    fails_in_one_line(&["scene", "no/such/file.glb"], 1, &["no/such/file.glb"]);
    fails_in_one_line(&["scene", SMALL, "--environment", "no/such/sky.hdr"], 1, &["no/such/sky.hdr"]);
    assert!(!run(&["scene", "terrain:many"]).status.success());
}

#[test]
fn a_view_without_a_service_needs_a_scene_alone() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("view.png");
    let out = out.to_str().unwrap();
    let alone = ["view", "--scene", SMALL, "--size", "64x48", "--out", out, "--json"];
    let seen = json(&alone);
    let default = &json(&["scene", SMALL, "--json"])["default_camera"];
    assert_eq!(
        (&seen["camera"], &seen["search"], &seen["light"]),
        (default, &"direct".into(), &"full".into())
    );
    let picture = std::fs::read(out).unwrap();
    let again = json(&alone);
    assert_eq!(
        (seen["specification_hash"].clone(), picture),
        (again["specification_hash"].clone(), std::fs::read(out).unwrap())
    );
    for (flags, word) in [
        (["--server", "http://127.0.0.1:1"], "--server"),
        (["--search", "splat"], "--search"),
        (["--max-error", "0.1"], "--max-error"),
    ] {
        fails_with(&[&alone[..7], &flags].concat(), 2, &[word]);
    }
    fails_with(&[&alone[..7], &["--time", "3"]].concat(), 1, &["nothing moves"]);
    fails_with(&["view", "--scene", "no/such.glb", "--out", out], 1, &["no/such.glb"]);
}

#[test]
fn images_are_compared() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let gray = |level| image::RgbImage::from_pixel(32, 24, image::Rgb([level; 3]));
    gray(100).save(path("a.png")).unwrap();
    gray(110).save(path("b.png")).unwrap();
    image::RgbImage::new(8, 8).save(path("small.png")).unwrap();

    let same = json(&["compare", &path("a.png"), &path("a.png"), "--json"]);
    assert_eq!(same["flip_mean"], 0.0);
    assert!(same["psnr_db"].is_null(), "equal images have an infinite PSNR, which JSON cannot hold");
    assert_eq!(same["ssim"], 1.0);

    let close = json(&["compare", &path("a.png"), &path("b.png"), "--json"]);
    let psnr = close["psnr_db"].as_f64().unwrap();
    assert!((psnr - 20.0 * (255.0f64 / 10.0).log10()).abs() < 1e-6, "{psnr}");
    assert!(close["flip_mean"].as_f64().unwrap() > 0.0);

    fails_in_one_line(&["compare", &path("a.png"), &path("small.png")], 2, &["32x24", "8x8"]);
    fails_in_one_line(&["compare", &path("a.png"), &path("none.png")], 1, &["none.png"]);
}

#[test]
fn the_self_test_passes_and_reports_its_measurements() {
    let report = json(&["selftest", "--json"]);
    assert_eq!(report["passed"], true, "{report:#}");
    let device = &report["device"];
    assert!(device["adapter"].is_string() && device["max_binding_bytes"].as_u64() > Some(0), "{device:#}");
    assert!(device["triangles_by"].as_array().unwrap().iter().any(|way| way == "raster"), "{device:#}");
    let checks = report["checks"].as_array().unwrap();
    for (word, count) in [("triangles by raster", 2), ("a view from samples by", 8), ("fragment against", 4)]
    {
        let found = checks.iter().filter(|check| check["name"].as_str().unwrap().contains(word)).count();
        assert_eq!(found, count, "{word}: {report:#}");
    }
    // Images equal to the reference to the last bit would be copies, not renderings.
    for check in checks.iter().filter(|check| check["name"].as_str().unwrap().ends_with(": FLIP")) {
        assert!(check["figure"].as_f64() > Some(0.0) && check["at_most"].as_f64() < Some(0.2), "{check:#}");
    }
    assert!(checks.iter().any(|check| check["name"].as_str().unwrap().contains("lost")), "{report:#}");
}

#[test]
fn without_a_driver_the_self_test_fails_and_names_the_package_to_install() {
    let mut command = argus(&["selftest", "--json"]);
    for variable in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        command.env(variable, "/no/such/driver.json");
    }
    let output = command.stdin(Stdio::null()).output().unwrap();
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(
        message.lines().any(|line| line.starts_with("argus:") && line.contains("mesa-vulkan-drivers")),
        "{message}"
    );
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["passed"], &report["device"]), (&false.into(), &serde_json::Value::Null));

    let mut command = argus(&["selftest"]);
    let output = command.env("ARGUS_ADAPTER", "no such adapter").stdin(Stdio::null()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("no such adapter"), "{}", stderr(&output));
}

/// Two requests to stop: a signal, and the end of standard input.
#[cfg(unix)]
#[test]
fn a_service_that_is_asked_to_stop_exits_with_0_and_removes_its_workers_settings() {
    use rustix::process::{Pid, Signal, kill_process};
    for signal in [Some(Signal::INT), Some(Signal::TERM), None] {
        let mut command =
            argus(&["serve", "--scene", SMALL, "--workers", "1", "--listen", "127.0.0.1:0", "--json"]);
        let temporary = tempfile::tempdir().unwrap();
        let files = || {
            let names = temporary.path().read_dir().unwrap().map(|entry| entry.unwrap().file_name());
            names.filter(|name| name.to_string_lossy().ends_with(".toml")).count()
        };
        // The workers join this service, whatever the environment says.
        command.env("TMPDIR", temporary.path()).env("ARGUS_WORKER__COORDINATOR", "http://127.0.0.1:1");
        command.stdout(Stdio::piped());
        let mut service = Process::start(command);
        let mut objects =
            serde_json::Deserializer::from_reader(service.take_stdout()).into_iter::<serde_json::Value>();
        let announced = objects.next().unwrap().unwrap();
        let url = announced["url"].as_str().unwrap();
        let view = ["view", "--server", url, "--size", "32x24"];
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("view.png");
        let seen = json(&[view.as_slice(), &["--json", "--out", out.to_str().unwrap()]].concat());
        assert_eq!((&seen["camera"], files()), (&announced["default_camera"], 1));
        let status = match signal {
            Some(signal) => {
                let pid = Pid::from_raw(i32::try_from(service.pid()).unwrap()).unwrap();
                kill_process(pid, signal).unwrap();
                service.wait()
            }
            None => service.stop(),
        };
        assert_eq!((status.code(), files()), (Some(0), 0), "{signal:?}");
    }
}
