//! Requests with an error bound or a deadline, from calibration to the frame, each part in its own process.

use std::path::Path;

use crate::support::{Coordinator, SMALL, argus, json, run, stderr};
use serde_json::Value;

/// Calibrates a model of the small scene from few, small views: its predictions are crude.
fn calibrate(cache: &Path) -> String {
    let mut study = argus(&["study", "views", "bounds", "--scene", SMALL, "--size", "64x48", "--json"]);
    let output =
        study.args(["--calibration", "32", "--views", "2"]).env("ARGUS_CACHE", cache).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 3, "a row a bound: {report:#}");
    for key in ["within_share", "median_ms", "cheapest_ms", "ratio", "direct_share", "traced_share"] {
        assert!(rows.iter().all(|row| row[key].is_f64()), "{key}: {report:#}");
    }
    let models = std::fs::read_dir(cache.join("models")).unwrap();
    let models: Vec<_> = models.map(|entry| entry.unwrap().path()).collect();
    assert_eq!(models.len(), 1, "{models:?}");
    dear_triangles(&models[0]);
    models[0].to_str().unwrap().to_owned()
}

/// Makes direct views twenty seconds more expensive in the model than they are, far beyond any measurement. Such a small
/// view may be traced faster than it is reconstructed, and the cheapest plan must not depend on the test's machine.
fn dear_triangles(path: &Path) {
    let mut model: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    for calibrated in model["settings"].as_array_mut().unwrap() {
        if calibrated["setting"].get("direct").is_some() {
            let fixed_ms = calibrated["cost"]["fixed_ms"].as_f64().unwrap();
            calibrated["cost"]["fixed_ms"] = (fixed_ms + 20_000.0).into();
        }
    }
    std::fs::write(path, model.to_string()).unwrap();
}

#[test]
fn a_tight_error_bound_is_met_by_rays_and_a_loose_one_by_a_warp() {
    let folder = tempfile::tempdir().unwrap();
    let model = calibrate(folder.path());
    // The model was calibrated without effects of light.
    let plain = ["--model", &model, "--effects", "none", "--exposure", "0"];
    let coordinator = Coordinator::start(SMALL, &plain);
    let _workers = coordinator.workers(2);
    coordinator.wait_for_workers(2);
    let out = folder.path().join("view.png");
    let camera = ["--eye", "60,40,60", "--target", "0,5,0", "--size", "64x48"];
    let view = |more: &[&str]| {
        let mut arguments =
            vec!["view", "--server", &coordinator.url, "--json", "--out", out.to_str().unwrap()];
        arguments.extend(camera);
        arguments.extend(more);
        json(&arguments)
    };
    let number =
        |report: &Value, key: &str| report[key].as_f64().unwrap_or_else(|| panic!("{key}: {report:#}"));

    let loose = view(&["--max-error", "0.9", "--verify"]);
    // The search depends on what these few views show and cost.
    let is_warped = |report: &Value| report["search"] != "direct" && report["served"]["traced"] == 0;
    assert!(is_warped(&loose), "{loose:#}");
    let predicted = &loose["predicted"];
    assert!(number(predicted, "error") <= 0.9 && number(predicted, "ms") > 0.0, "{loose:#}");
    assert!(number(&loose, "measured_ms") > 0.0);

    let tight = view(&["--max-error", "0.0001", "--verify"]);
    let exact = tight["search"] == "direct" || tight["served"]["traced"].as_u64() > Some(0);
    assert!(exact, "{tight:#}");
    assert!(number(&tight["predicted"], "error") > 1e-4, "what cannot be kept is said: {tight:#}");
    assert!(number(&tight, "true_error") < number(&loose, "true_error"), "{tight:#} {loose:#}");

    let soon = view(&["--preset", "interactive", "--search", "splat"]);
    assert!(is_warped(&soon), "{soon:#}");
    assert!(soon["true_error"].is_null() && soon["predicted"]["ms"].is_f64());
    let late = view(&["--deadline-ms", "100000"]);
    assert_eq!(late["search"], "direct", "with all the time in the world: {late:#}");

    let mut wrong = vec!["view", "--server", &coordinator.url, "--out", out.to_str().unwrap()];
    wrong.extend(camera);
    wrong.extend(["--max-error", "0"]);
    let refused = run(&wrong);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("max_error"), "{}", stderr(&refused));
}
