//! The measurement campaign for a machine with a GPU: its script, and its output without a device.
#![cfg(unix)]
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

#[path = "../../tests/support/mod.rs"]
mod support;

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;
use support::{argus, json, stderr};

fn script(arguments: &[&str]) -> Output {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scripts/gpu-campaign");
    Command::new(script).args(arguments).stdin(Stdio::null()).output().unwrap()
}

#[test]
fn a_missing_program_is_refused_with_the_command_that_builds_it() {
    let output = script(&["--quick", "--binary", "/no/such/argus-lab"]);
    assert_eq!(output.status.code(), Some(2));
    let message = stderr(&output);
    assert!(message.contains("/no/such/argus-lab") && message.contains("cargo build --release"), "{message}");
}

#[test]
fn a_program_that_does_not_start_is_refused_with_its_own_error() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("argus-lab");
    fs::write(&program, "#!/bin/sh\necho 'GLIBC_9.99 not found' >&2\nexit 127\n").unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let output = script(&["--binary", program.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("GLIBC_9.99 not found"), "{}", stderr(&output));
}

#[test]
fn the_script_passes_its_arguments_on_and_refuses_unknown_ones() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("argus-lab");
    fs::write(&program, "#!/bin/sh\necho \"$@\"\n").unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let program = program.to_str().unwrap();
    let output = script(&["--minutes", "5", "--out", "a b", "--quick", "--beside", "c", "--binary", program]);
    assert!(output.status.success(), "{}", stderr(&output));
    let said = String::from_utf8(output.stdout).unwrap();
    assert_eq!(said.trim(), "study campaign --minutes 5 --out a b --quick --beside c");
    for arguments in [&["--fast"][..], &["--minutes"]] {
        assert_eq!(script(arguments).status.code(), Some(2), "{arguments:?}");
    }
    let help = String::from_utf8(script(&["--help"]).stdout).unwrap();
    assert!(help.contains("--minutes N") && !help.contains("set -euo"), "{help}");
}

#[test]
fn a_campaign_without_a_driver_reports_that_and_skips_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("results");
    let mut command = argus(&["study", "campaign", "--quick", "--out", out.to_str().unwrap()]);
    for variable in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        command.env(variable, "/no/such/driver.json");
    }
    let output = command.stdin(Stdio::null()).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("1 of"), "{}", stderr(&output));
    let page = fs::read_to_string(out.join("results.md")).unwrap();
    assert!(page.contains("| selftest | FAILED: argus:") && page.contains("mesa-vulkan-drivers"), "{page}");
    assert!(page.contains("| parts | left out: no device opens"), "{page}");
    let steps: Value = serde_json::from_str(&fs::read_to_string(out.join("steps.json")).unwrap()).unwrap();
    assert!(steps["steps"].as_array().unwrap().iter().skip(1).all(|step| step["state"] == "skipped"));
}

#[test]
fn the_device_study_measures_both_programs_of_each_search_and_names_missing_figures() {
    let study = json(&["study", "device", "parts", "--quick", "--json"]);
    let rows = study["rows"].as_array().unwrap();
    let of = |measure: &str| rows.iter().filter(|row| row["measure"] == measure).collect::<Vec<_>>();
    for search in ["splat", "linear", "seeded", "pyramid"] {
        let rows = of(&format!("warp, {search}"));
        assert_eq!(rows.len(), 3, "fragment, compute, the better one: {study:#}");
        assert!(rows.iter().all(|row| row["figure"].as_f64() > Some(0.0)), "{rows:#?}");
        assert!(rows[2]["note"].as_str().unwrap().contains("kept by default"), "{rows:#?}");
    }
    for word in [32, 64] {
        let within = format!("{word} bits, 15 MB");
        let row = of("scattered atomics").into_iter().find(|row| row["variant"] == within.as_str()).unwrap();
        assert!(row["figure"].as_f64() > Some(0.0), "{row:#}");
    }
    assert_eq!(of("coherent rays").len(), 3);
    let on_device = of("scattered rays").into_iter().find(|row| row["variant"] == "on the device").unwrap();
    assert!(on_device["figure"].as_f64() > Some(0.0) && on_device["target"].is_string(), "{on_device:#}");
    let of_points =
        of("scattered rays").into_iter().filter(|row| row["variant"].to_string().contains("visible points"));
    assert!(of_points.count() >= 4, "{study:#}");
    assert_eq!((of("readback").len(), of("encoding").len()), (3, 4));
    // A row without a figure has a reason.
    for row in rows.iter().filter(|row| row["figure"].is_null()) {
        assert!(!row["note"].as_str().unwrap().is_empty(), "{row:#}");
    }
}

#[test]
fn the_throughput_study_counts_views_on_the_device_and_read_back() {
    let study = json(&["study", "device", "throughput", "--quick", "--json"]);
    for row in study["rows"].as_array().unwrap() {
        for key in ["device_views_per_sec", "read_back_views_per_sec", "flip"] {
            assert!(row[key].as_f64() > Some(0.0), "{key}: {row:#}");
        }
        assert!(row["read_back_views_per_sec"].as_f64() <= row["device_views_per_sec"].as_f64(), "{row:#}");
    }
}
