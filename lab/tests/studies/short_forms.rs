//! The studies of reconstruction, of many views and of the service in their short forms: their rows and files.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use crate::support::{json, run, stderr};
use serde_json::Value;

pub(crate) fn rows(study: &Value) -> &Vec<Value> {
    let rows = study["rows"].as_array().unwrap();
    assert!(!rows.is_empty(), "{study:#}");
    rows
}

pub(crate) fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("{key}: {row:#}"))
}

#[test]
fn the_warp_study_has_every_search_its_figures_and_its_plot() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let begin = Instant::now();
    let study = json(&["study", "views", "warp", "--quick", "--json", "--out", out]);
    assert!(begin.elapsed() < Duration::from_secs(30), "the short form is short");
    for row in rows(&study) {
        for key in ["view_ms", "per_direct", "per_fetch", "flip", "psnr_db", "ssim"] {
            assert!(number(row, key) > 0.0, "{key}: {row:#}");
        }
        for key in ["unresolved_fraction", "wrong_surface_fraction"] {
            assert!((0.0..=1.0).contains(&number(row, key)), "{key}: {row:#}");
        }
        for key in ["steps", "samples"] {
            assert!(row[key].is_null() || row[key].is_u64(), "{key}: {row:#}");
        }
    }
    let of = |search: &str| rows(&study).iter().filter(|row| row["search"] == search).collect::<Vec<_>>();
    assert_eq!(of("direct").len(), 3, "one, four and sixteen samples a pixel");
    // More samples per pixel come closer to the reference.
    let errors: Vec<f64> = of("direct").iter().map(|row| number(row, "flip")).collect();
    assert!(errors[0] > errors[1] && errors[1] > errors[2], "{errors:?}");
    for search in ["splat", "linear"] {
        assert_eq!(of(search).len(), 2, "{search}: one and four sub-pixels");
    }
    // Close to the reference, but not equal: an equal image would not be reconstructed.
    assert!(of("splat").iter().all(|row| number(row, "flip") > 0.001 && number(row, "flip") < 0.15));
    let plot = std::fs::read_to_string(folder.path().join("warp-pareto.svg")).unwrap();
    assert!(plot.starts_with("<svg") && plot.contains("Pareto front") && plot.contains("splat"));
    let csv = std::fs::read_to_string(folder.path().join("warp.csv")).unwrap();
    assert_eq!(csv.lines().count(), rows(&study).len() + 1);
}

#[test]
fn the_history_study_has_both_starts_and_shows_where_the_previous_frame_helps() {
    let study = json(&["study", "views", "reprojection", "--quick", "--json"]);
    let of = |seed: &str| rows(&study).iter().filter(|row| row["seed"] == seed).collect::<Vec<_>>();
    let searches: Vec<&Value> = of("samples").into_iter().map(|row| &row["search"]).collect();
    assert_eq!(searches, ["splat", "seeded"]);
    for row in rows(&study) {
        for key in ["view_ms", "per_seeded", "flip", "psnr_db", "ssim"] {
            assert!(number(row, key) > 0.0, "{key}: {row:#}");
        }
        for key in ["unresolved_fraction", "wrong_surface_fraction", "used_fraction"] {
            assert!((0.0..=1.0).contains(&number(row, key)), "{key}: {row:#}");
        }
    }
    let fresh = of("samples")[1];
    let after = |motion: &str| of("history").into_iter().find(|row| row["motion"] == motion).unwrap();
    assert_eq!(
        (number(after("none"), "used_fraction"), number(after("turn 2°"), "used_fraction")),
        (1.0, 1.0)
    );
    // If the previous frame showed something else, it is ignored, and the view equals that from samples.
    let left = after("turn 90°");
    assert_eq!((number(left, "used_fraction"), number(left, "flip")), (0.0, number(fresh, "flip")));
    // The previous frame changes only the start of the search, even after many frames.
    for row in of("history") {
        assert!(number(row, "flip") < 1.2 * number(fresh, "flip"), "{row:#}");
    }
    assert!(of("history").last().unwrap()["motion"].as_str().unwrap().starts_with("4 frames"));
    let verdict = study["notes"][1].as_str().unwrap();
    assert!(verdict.starts_with("Beginning from history"), "{verdict}");
}

#[test]
fn the_omni_maps_study_compares_triangles_and_maps() {
    let study = json(&["study", "method", "omni-maps", "--quick", "--json"]);
    let of = |way: &str| rows(&study).iter().filter(|row| row["way"] == way).collect::<Vec<_>>();
    assert_eq!(of("raster").len(), 1);
    assert_eq!(of("megaviews").len(), 2, "two sizes of maps");
    let truest = number(of("raster")[0], "flip");
    assert!(number(of("megaviews")[0], "ready_ms") > 0.0, "the octree is built and its leaves are shaded");
    for row in of("megaviews") {
        assert!(number(row, "sample_ms") > 0.0, "{row:#}");
        assert!(number(row, "flip") > truest && number(row, "flip") < 0.5, "{row:#}");
    }
}

#[test]
fn the_break_even_study_gives_the_number_of_views_from_which_samples_are_cheaper() {
    let study = json(&["study", "load", "break-even", "--quick", "--json"]);
    for row in rows(&study) {
        let views = number(row, "views");
        let expected = views * number(row, "direct_view_ms");
        assert!((number(row, "direct_total_ms") / expected - 1.0).abs() < 1e-9, "{row:#}");
        assert!(number(row, "warped_total_ms") > number(row, "samples_ms"));
    }
    let ways = rows(&study).iter().map(|row| row["visibility"].as_str().unwrap());
    let ways: std::collections::BTreeSet<&str> = ways.collect();
    assert!(ways.contains("raster") && ways.contains("cpu"), "{ways:?}");
    assert_eq!(study["notes"].as_array().unwrap().len(), ways.len());
}

#[test]
fn the_megaviews_study_tests_fewer_pairs_than_manylods_and_marks_extrapolated_rows() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = json(&["study", "method", "megaviews", "--quick", "--json", "--out", out]);
    let of = |method: &str, placement: &str, views: u64| {
        let found = rows(&study)
            .iter()
            .find(|row| row["method"] == method && row["placement"] == placement && row["views"] == views);
        found.unwrap_or_else(|| panic!("{method} {placement} {views}: {study:#}"))
    };
    for placement in ["single-bounce", "four-bounce", "random"] {
        let [shared, alone] = ["megaviews", "manylods"].map(|method| of(method, placement, 256));
        assert!(
            number(shared, "pairs_processed") <= number(alone, "pairs_processed"),
            "{shared:#} {alone:#}"
        );
        assert!(number(shared, "views_per_node") > 1.0 || shared["fell_back"] == true, "{shared:#}");
        assert_eq!(number(alone, "views_per_node"), 1.0);
        // Pairs are tested before they are queued.
        assert!(number(shared, "pairs_peak") <= 0.3 * number(shared, "pairs_peak_untested"), "{shared:#}");
        for row in [shared, alone] {
            assert_eq!(row["extrapolated"], false);
            assert_eq!((number(row, "frame_waits"), number(row, "octree_waits")), (1.0, 3.0), "{row:#}");
            assert!(number(&row["bytes"], "maps") > 0.0 && number(row, "frame_ms") > 0.0);
            assert!(row["stages_ms"].as_object().unwrap().contains_key("divide scene"), "{row:#}");
        }
        // Leaves descend the view octree one by one, and share no less.
        let flat = of("flat-scene", placement, 256);
        assert!(number(flat, "pairs_processed") > 0.0 && number(flat, "views_per_node") > 1.0, "{flat:#}");
        assert_eq!(flat["fell_back"], false);
        assert!(!flat["stages_ms"].as_object().unwrap().contains_key("divide scene"), "{flat:#}");
        // Exact maps of low resolution have errors too, but smaller ones.
        let exact = of("raster", placement, 256);
        assert_eq!(exact["extrapolated"], true, "of 96 views");
        assert!(number(exact, "wrong_shadow_fraction") < number(alone, "wrong_shadow_fraction"));
    }
    let plot = std::fs::read_to_string(folder.path().join("megaviews-views-four-bounce.svg")).unwrap();
    assert!(plot.contains("megaviews") && plot.contains("raster"));
}

#[test]
fn the_megaviews_study_counts_pairs_that_occlusion_culls_at_equal_maps() {
    let arguments =
        ["study", "method", "megaviews", "--quick", "--json", "--views", "256", "--placement", "random"];
    let compared = ["--method", "megaviews,manylods", "--occlusion", "off,on,known"];
    let study = json(&[&arguments[..], &compared].concat());
    for method in ["megaviews", "manylods"] {
        let of = |occlusion: &str| {
            let is = |row: &&Value| {
                row["method"] == method && row["occlusion"] == occlusion && row["views"] == 256
            };
            rows(&study).iter().find(is).unwrap_or_else(|| panic!("{method} {occlusion}: {study:#}"))
        };
        let [off, on, known] =
            ["off", "on", "known"].map(|occlusion| number(of(occlusion), "pairs_rendered"));
        assert!(known < on && on < off, "{method}: {off} pairs, {on} with occlusion, {known} at best");
        let wrong = ["off", "on"].map(|occlusion| number(of(occlusion), "wrong_shadow_fraction"));
        assert_eq!(wrong[0], wrong[1], "the same maps");
    }
}

#[test]
fn the_megaviews_study_gives_accuracy_and_memory_for_every_texel_format() {
    let arguments =
        ["study", "method", "megaviews", "--quick", "--json", "--views", "256", "--placement", "four-bounce"];
    let texels = ["node-64", "node-32", "range-32", "range-16"];
    let study =
        json(&[&arguments[..], &["--method", "megaviews,manylods", "--texel", &texels.join(",")]].concat());
    for method in ["megaviews", "manylods"] {
        let of = |texel: &str| {
            let is = |row: &&Value| row["method"] == method && row["texel"] == texel && row["views"] == 256;
            rows(&study).iter().find(is).unwrap_or_else(|| panic!("{method} {texel}: {study:#}"))
        };
        let bytes = texels.map(|texel| number(&of(texel)["bytes"], "maps"));
        assert_eq!(bytes, [8.0, 4.0, 4.0, 2.0].map(|texel| texel / 8.0 * bytes[0]));
        let [wide, packed, whole, half] = texels.map(|texel| number(of(texel), "range_error"));
        assert!(wide == 0.0 && whole == 0.0, "{study:#}");
        for error in [packed, half] {
            assert!(error > 0.0 && error < 2e-3, "{method}: {error}");
        }
        for texel in texels {
            let [shadows, exact] =
                [texel, "range-32"].map(|texel| number(of(texel), "wrong_shadow_fraction"));
            assert!((shadows - exact).abs() < 0.05, "{texel}: {shadows} {exact}");
        }
    }
}

#[test]
fn the_overload_study_refuses_excess_load_and_loses_no_view() {
    let study = json(&["study", "load", "overload", "--quick", "--json"]);
    let rows = rows(&study);
    for row in rows {
        assert_eq!(row["failed"], 0, "{row:#}");
        assert!(number(row, "answered") > 0.0 && number(row, "per_peak") <= 1.0, "{row:#}");
        assert_eq!(row["sent"], number(row, "answered") as u64 + number(row, "rejected") as u64, "{row:#}");
    }
    // Capacity is noise in so short a time; only its presence and the ratio of the loads are tested.
    let [half, twice] = &rows[..] else { panic!("two loads: {study:#}") };
    assert_eq!((number(half, "load"), number(twice, "load")), (0.5, 2.0));
    assert!((number(twice, "asked_per_sec") / number(half, "asked_per_sec") - 4.0).abs() < 1e-9);
    assert!(study["notes"][0].as_str().unwrap().contains("Capacity"), "{study:#}");
}

/// The service study with short phases. What must hold does not depend on whether the service has settled.
const SHORT_SERVICE: [&str; 9] =
    ["study", "load", "service", "--quick", "--json", "--seconds", "1", "--settle-secs", "1"];

#[test]
fn the_service_study_compares_the_default_with_forced_methods_cold_and_warm() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = json(&[&SHORT_SERVICE[..], &["--out", out]].concat());
    assert_eq!(rows(&study).len(), 6, "{study:#}");
    for (i, row) in rows(&study).iter().enumerate() {
        assert_eq!(row["mode"], ["default", "direct", "warp"][i / 2], "{row:#}");
        assert_eq!(row["phase"], ["cold", "warm"][i % 2], "{row:#}");
        // Two clients, five views a second, one second; the number answered in time depends on the machine.
        assert_eq!(row["sent"], 10, "{row:#}");
        assert_eq!(number(row, "answered") + number(row, "failed"), 10.0, "{row:#}");
        assert!(number(row, "answered") > 0.0 && number(row, "failed") >= number(row, "rejected"), "{row:#}");
        assert!(number(row, "p99_ms") >= number(row, "p50_ms") && number(row, "p50_ms") > 0.0, "{row:#}");
        assert_eq!(row["first_view_ms"].is_null(), row["phase"] == "warm", "{row:#}");
        assert_eq!(row["settled"].is_null(), row["phase"] == "cold", "{row:#}");
        assert!(number(row, "judged") > 0.0 && number(row, "flip") > 0.0, "{row:#}");
        assert!(number(row, "worst_tile_flip") > number(row, "flip"), "{row:#}");
        assert!(number(row, "excess_tile") >= number(row, "excess_flip"), "{row:#}");
        let ways = row["ways"].as_object().unwrap();
        assert!((ways.values().filter_map(Value::as_f64).sum::<f64>() - 1.0).abs() < 1e-9, "{row:#}");
        // Only views without a forced method are planned.
        let is_planned = row["mode"] == "default";
        assert_eq!(row["planning_us"].as_f64().is_some_and(|us| us > 0.0), is_planned, "{row:#}");
        assert!(is_planned || row["time_predicted"].is_null(), "{row:#}");
        assert_eq!(number(row, "regret_views") > 0.0, is_planned && row["phase"] == "warm", "{row:#}");
    }
    let of = |mode: &str| rows(&study).iter().filter(|row| row["mode"] == mode).collect::<Vec<_>>();
    for direct in of("direct") {
        assert_eq!(direct["ways"]["direct"], 1.0, "{direct:#}");
        // Direct views have equal error, except along edges with another visibility backend.
        assert!(number(direct, "excess_flip").abs() < 0.002, "{direct:#}");
        assert_eq!(number(direct, "samples_rendered"), 0.0, "{direct:#}");
    }
    for warp in of("warp") {
        assert!(warp["ways"]["direct"].is_null(), "{warp:#}");
        assert!(number(warp, "samples_rendered") > 0.0 && number(warp, "samples_mib") > 0.0, "{warp:#}");
        // From samples: close to the reference, but not equal to a direct view.
        assert!(number(warp, "excess_flip").abs() > 1e-4 && number(warp, "flip") < 0.3, "{warp:#}");
    }
    let plot = std::fs::read_to_string(folder.path().join("service-error-against-latency.svg")).unwrap();
    assert!(plot.contains("default, warm") && plot.contains("direct, cold"));
    let csv = std::fs::read_to_string(folder.path().join("service.csv")).unwrap();
    assert_eq!(csv.lines().count(), 7);
}

#[test]
fn the_service_study_compares_frames_of_a_moving_scene_at_their_own_time_and_gives_the_spread_of_runs() {
    let moving = ["--scene", "mirrors:6", "--walk", "stand", "--mode", "direct", "--runs", "2"];
    let study = json(&[&SHORT_SERVICE[..], &moving].concat());
    assert_eq!(rows(&study).len(), 2, "cold and warm: {study:#}");
    for row in rows(&study) {
        // A reference of another time would show every ball elsewhere.
        assert!(number(row, "judged") > 0.0 && number(row, "excess_flip").abs() < 0.002, "{row:#}");
        assert!(number(row, "excess_tile").abs() < 0.05, "{row:#}");
        let [least, most] = [0, 1].map(|i| row["spread"]["p50_ms"][i].as_f64().unwrap());
        assert!((least..=most).contains(&number(row, "p50_ms")), "{row:#}");
    }
}

#[test]
fn the_cluster_study_measures_and_simulates_the_same_ticks_and_splits_them_into_parts() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = json(&["study", "load", "cluster", "--quick", "--json", "--out", out]);
    for row in rows(&study) {
        assert_eq!(row["kind"], "measured");
        for key in ["tick_ms", "simulated_ms", "predicted_ms", "efficiency", "bound", "speedup_by_costs"] {
            assert!(number(row, key) > 0.0, "{key}: {row:#}");
        }
        for key in ["passes_ms", "rest_ms", "encode_ms", "relay_ms"] {
            assert!(number(row, key) >= 0.0, "{key}: {row:#}");
        }
        assert!(number(row, "encode_ms") > 0.0 && number(row, "relay_ms") > 0.0, "{row:#}");
        let agreement = number(row, "tick_ms") / number(row, "simulated_ms") - 1.0;
        assert!((number(row, "agreement_fraction") - agreement.abs()).abs() < 1e-9, "{row:#}");
        if row["processes"] == 1 {
            assert_eq!(number(row, "speedup_over_alone"), 1.0, "{row:#}");
        }
        assert!(number(row, "speedup_over_alone") > 0.0 && row["passed"].is_null(), "{row:#}");
    }
    let calibrating = rows(&study).iter().filter(|row| row["calibrates"] == true);
    let calibrating: Vec<_> = calibrating.map(|row| row["way"].as_str().unwrap()).collect();
    assert_eq!(calibrating, ["naive", "proposed"]);
    let ways: std::collections::BTreeSet<&str> =
        rows(&study).iter().map(|row| row["way"].as_str().unwrap()).collect();
    assert_eq!(ways.len(), 4, "{ways:?}");
    let proposed = |key: &str| {
        let of = |row: &&Value| row["way"] == "proposed" && row["processes"] == 2;
        rows(&study).iter().filter(of).map(|row| number(row, key)).fold(0.0, f64::max)
    };
    assert!(proposed("sampling_ms") > 0.0, "samples are rendered anew each tick");
    assert!(proposed("sampling_rest_ms") < proposed("sampling_ms"));
    assert!(proposed("record_ms") > 0.0 && proposed("unpack_ms") > 0.0);
    for row in rows(&study).iter().filter(|row| row["way"] == "proposed, still scene") {
        assert_eq!(number(row, "sampling_ms"), 0.0);
    }
    let plot = std::fs::read_to_string(folder.path().join("cluster-efficiency.svg")).unwrap();
    assert!(plot.contains("bound of whole K"));
}

#[test]
fn the_simulated_cluster_gives_the_bound_and_the_papers_figures_beside_its_efficiency() {
    let study = json(&["study", "load", "cluster", "--simulate", "--quick", "--json"]);
    let of = |processes: u64, way: &str, cores: u64| {
        let is = |row: &&Value| {
            row["processes"] == processes
                && row["way"] == way
                && row["views"] == 1000
                && row["trouble"].is_null()
                && row["cores"] == cores
        };
        let found = rows(&study).iter().find(is);
        found.unwrap_or_else(|| panic!("{processes} {way}: {study:#}"))
    };
    let eleven = of(11, "proposed", 2);
    assert_eq!(number(eleven, "paper_efficiency"), 0.829);
    assert!(number(eleven, "efficiency") <= number(eleven, "bound") * 1.02, "{eleven:#}");
    assert!(number(eleven, "efficiency") > 5.0 * number(of(11, "naive", 2), "efficiency"), "{eleven:#}");
    assert!(number(of(11, "proposed, samplers compose", 2), "tick_ms") < number(eleven, "tick_ms"));
    assert!(number(eleven, "core_us_per_view") > 0.0);
    let one_core = of(11, "proposed", 1);
    assert!(number(one_core, "efficiency") < number(eleven, "efficiency"), "{one_core:#} {eleven:#}");
    for processes in [2, 11] {
        for trouble in ["none", "stragglers", "losses", "waves"] {
            let is = |row: &&Value| row["processes"] == processes && row["trouble"] == trouble;
            let row = rows(&study).iter().find(is).unwrap_or_else(|| panic!("{trouble}: {study:#}"));
            assert_eq!((&row["lost"], &row["passed"]), (&0.into(), &true.into()), "{row:#}");
            assert!(number(row, "p99_ms") >= number(row, "p50_ms") && number(row, "p50_ms") > 0.0, "{row:#}");
            assert_eq!(number(row, "processes_lost") > 0.0, trouble == "losses", "{row:#}");
        }
    }
}

/// Runs a short soak with chaos and further flags; returns its row, and checks that no frame is lost or wrong.
fn soak_with_chaos(more: &[&str]) -> Value {
    let chaos = [
        "study",
        "load",
        "soak",
        "--quick",
        "--json",
        "--chaos",
        "--chaos-every",
        "0.7",
        "--minutes",
        "0.15",
    ];
    let study = json(&[&chaos, more].concat());
    let row = rows(&study)[0].clone();
    assert_eq!((number(&row, "lost"), number(&row, "frames_wrong")), (0.0, 0.0), "{row:#}");
    assert!(number(&row, "answered") > 0.0 && number(&row, "coordinator_mb") > 1.0, "{row:#}");
    assert!(number(&row, "frames_checked") > 0.0, "{row:#}");
    assert!(number(&row, "kills") > 0.0 && number(&row, "pauses") > 0.0, "{row:#}");
    assert!(number(&row, "worst_gap_secs") > 0.0, "{row:#}");
    assert_eq!(
        (&row["bar_lost"], &row["bar_wrong"], &row["passed"]),
        (&true.into(), &true.into(), &true.into())
    );
    let accounted = ["answered", "superseded", "rejected", "lost"].map(|key| number(&row, key));
    assert_eq!(accounted.iter().sum::<f64>(), number(&row, "sent"), "{row:#}");
    row
}

#[test]
fn a_short_soak_with_chaos_has_no_lost_and_no_wrong_frame() {
    let row = soak_with_chaos(&[]);
    assert_eq!((number(&row, "redirected"), &row["bar_redirected"]), (0.0, &Value::Null), "{row:#}");
}

#[test]
fn a_short_soak_of_redirected_sessions_has_no_lost_and_no_wrong_frame() {
    let row = soak_with_chaos(&["--redirect"]);
    assert!(number(&row, "redirected") > 0.0, "{row:#}");
    assert!(number(&row, "redirected") <= number(&row, "answered"), "{row:#}");
}

#[test]
fn the_capacity_study_measures_the_coordinators_relay_and_the_reassignment_of_lost_views() {
    let study = json(&["study", "load", "capacity", "--quick", "--json"]);
    let row = &rows(&study)[0];
    assert!(number(row, "relayed_per_sec") > 0.0 && number(row, "us_per_frame") > 0.0, "{row:#}");
    assert_eq!(number(row, "connections"), number(row, "sessions"), "{row:#}");
    assert!(number(row, "camera_every_secs") > 0.0, "{row:#}");
    assert!(number(row, "assigned_after_break_ms") < 1000.0, "{row:#}");
    // A hanging worker is suspected after a while, not before.
    let hang = number(row, "assigned_after_hang_ms");
    assert!((500.0..5000.0).contains(&hang), "{row:#}");
    assert!(number(row, "resident_mb") < 500.0, "{row:#}");
}

#[test]
fn the_manylods_study_finds_the_same_cuts_with_fewer_operations_and_compares_maps_of_equal_time() {
    let PaperPage { manylods: study, manylods_plot: plot, .. } = paper_page();
    let of = |part: &str| rows(study).iter().filter(|row| row["part"] == part).collect::<Vec<_>>();
    let [balls, octree] = of("hierarchy")[..] else { panic!("a tree of balls and an octree: {study:#}") };
    assert!(number(balls, "update_ms") < number(balls, "build_ms") && number(octree, "build_ms") > 0.0);
    // Larger thresholds give smaller cuts.
    for pair in of("threshold").chunks(2) {
        let [fine, coarse] = pair else { panic!("two thresholds: {study:#}") };
        assert!(number(fine, "nodes") > number(coarse, "nodes"));
        assert!((0.0..1.0).contains(&number(fine, "wrong_shadow_fraction")));
    }
    let methods: Vec<&str> = of("equal-time").iter().map(|row| row["method"].as_str().unwrap()).collect();
    assert_eq!(methods, ["manylods", "manylods", "imperfect", "raster, as long", "raster, as many"]);
    assert!(of("equal-time").iter().all(|row| (0.0..1.0).contains(&number(row, "wrong_shadow_fraction"))));
    // Views over two trees, the scene over one, at two speeds, by three methods.
    assert_eq!(of("animation").len(), 18);
    for row in of("animation") {
        match row["method"].as_str().unwrap() {
            "basic" => assert_eq!(number(row, "fewer_visits"), 1.0),
            "incremental" => {
                assert_eq!(number(row, "differing_fraction"), 0.0, "{row:#}");
                assert!(
                    number(row, "fewer_operations") > 10.0 && number(row, "fewer_visits") > 4.0,
                    "{row:#}"
                );
            }
            _ => assert!(number(row, "differing_fraction") < 0.1, "{row:#}"),
        }
    }
    assert!(plot.contains("incremental") && plot.contains("lazy"));
}

#[test]
fn each_study_prints_one_object_with_its_rows() {
    let baseline = json(&["study", "views", "baseline", "--quick", "--json"]);
    let methods: Vec<_> = baseline["rows"].as_array().unwrap().iter().map(|row| &row["method"]).collect();
    assert!(methods.len() >= 3, "{baseline:#}");
    for row in baseline["rows"].as_array().unwrap() {
        assert!(row["view_ms"].as_f64().unwrap() > 0.0 && row["flip"].as_f64().unwrap() > 0.0, "{row:#}");
    }
    let burst = json(&["study", "load", "burst", "--quick", "--json"]);
    // As a batch, from samples with two divisions of the work, and directly with two visibility backends.
    assert_eq!(burst["rows"].as_array().unwrap().len(), 5, "{burst:#}");
    for study in [&baseline, &burst] {
        assert!(study["scene"].is_string() && study["machine"]["cores"].is_u64(), "{study:#}");
    }
    for row in burst["rows"].as_array().unwrap() {
        assert!(row["total_secs"].as_f64().unwrap() > 0.0, "{row:#}");
    }
}

/// The page of a paper, and what its studies wrote beside it.
pub(crate) struct PaperPage {
    text: String,
    manylods: Value,
    manylods_plot: String,
    pub(crate) probes: Value,
}

/// The page of ManyLoDs, made once for all tests that read it or its studies' rows.
pub(crate) fn paper_page() -> &'static PaperPage {
    static PAGE: OnceLock<PaperPage> = OnceLock::new();
    PAGE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().to_str().unwrap();
        let made = run(&["study", "paper", "manylods", "--quick", "--out", out]);
        assert!(made.status.success(), "{}", stderr(&made));
        let read = |file: &str| std::fs::read_to_string(folder.path().join(file)).unwrap();
        let study = |file: &str| serde_json::from_str(&read(file)).unwrap();
        PaperPage {
            text: read("README.md"),
            manylods: study("method-manylods/manylods.json"),
            manylods_plot: read("method-manylods/manylods-frames.svg"),
            probes: study("method-probes/probes.json"),
        }
    })
}

#[test]
fn a_papers_figures_are_on_one_page() {
    let page = &paper_page().text;
    for part in ["## Table 2", "| part | tree |", "method-probes/probes-flip.svg", "Not made: figure 6."] {
        assert!(page.contains(part), "{part}:\n{page}");
    }
}
