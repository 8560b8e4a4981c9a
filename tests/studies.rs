//! The studies of the reconstruction, each in its short form: their rows, and the files that they leave.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod support;

use std::time::{Duration, Instant};

use serde_json::Value;
use support::json;

fn rows(study: &Value) -> &Vec<Value> {
    let rows = study["rows"].as_array().unwrap();
    assert!(!rows.is_empty(), "{study:#}");
    rows
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("{key}: {row:#}"))
}

#[test]
fn the_warp_study_has_every_search_its_figures_and_its_plot() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let begin = Instant::now();
    let study = json(&["study", "warp", "--quick", "--json", "--out", out]);
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
    // More samples a pixel come closer to the reference.
    let errors: Vec<f64> = of("direct").iter().map(|row| number(row, "flip")).collect();
    assert!(errors[0] > errors[1] && errors[1] > errors[2], "{errors:?}");
    for search in ["splat", "linear"] {
        assert_eq!(of(search).len(), 2, "{search}: one and four sub-pixels");
    }
    // Close to the truth, and not equal to it: that would mean that nothing was reconstructed.
    assert!(of("splat").iter().all(|row| number(row, "flip") > 0.001 && number(row, "flip") < 0.15));
    let plot = std::fs::read_to_string(folder.path().join("warp-pareto.svg")).unwrap();
    assert!(plot.starts_with("<svg") && plot.contains("Pareto front") && plot.contains("splat"));
    let csv = std::fs::read_to_string(folder.path().join("warp.csv")).unwrap();
    assert_eq!(csv.lines().count(), rows(&study).len() + 1);
}

#[test]
fn the_cells_study_goes_from_the_sample_camera_to_where_samples_serve_worst() {
    let study = json(&["study", "cells", "--quick", "--json"]);
    for pair in rows(&study).chunks(2) {
        let [at, away] = pair else { panic!("two places for each spacing: {study:#}") };
        assert_eq!(number(at, "distance_m"), 0.0);
        assert!(number(away, "distance_m") > 0.0);
        assert!(number(at, "flip") <= number(away, "flip") + 0.01, "{at:#} {away:#}");
    }
    let spacing = |row: &Value| number(row, "spacing_m");
    assert!(spacing(&rows(&study)[0]) < spacing(rows(&study).last().unwrap()));
}

#[test]
fn the_break_even_study_says_from_how_many_views_samples_pay() {
    let study = json(&["study", "break-even", "--quick", "--json"]);
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
fn the_radiosity_study_departs_in_each_knob_and_light_brings_images_closer_to_the_path_traced_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = json(&["study", "radiosity", "--quick", "--json", "--out", out, "--light", "point:0,60,0"]);
    let differs = |name: &str| rows(&study).iter().filter(|row| row["differs"] == name).count();
    for name in
        ["as given", "VPLs", "resolution", "source", "octree levels", "samples", "filter", "clamp", "culling"]
    {
        assert!(differs(name) > 0, "{name}: {study:#}");
    }
    for row in rows(&study) {
        for key in ["flip", "flip_by_vpls"] {
            assert!((0.0..1.0).contains(&number(row, key)), "{key}: {row:#}");
        }
        assert!(
            number(row, "trace_ms") >= 0.0 && number(row, "gather_ms") >= 0.0 && number(row, "vpls") > 0.0
        );
        let culled = number(row, "culled_fraction");
        assert!(if row["cull"] == true { (0.0..1.0).contains(&culled) } else { culled == 0.0 }, "{row:#}");
    }
    let note = study["notes"][0].as_str().unwrap();
    assert!(note.contains("path-traced"), "{note}");
    let plot = std::fs::read_to_string(folder.path().join("radiosity-pareto.svg")).unwrap();
    assert!(plot.starts_with("<svg"));
}

#[test]
fn the_megaviews_study_counts_fewer_pairs_than_manylods_and_says_what_it_extrapolates() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = json(&["study", "megaviews", "--quick", "--json", "--out", out]);
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
            assert!(number(&row["bytes"], "maps") > 0.0 && number(row, "frame_ms") > 0.0);
            assert!(row["stages_ms"].as_object().unwrap().contains_key("divide scene"), "{row:#}");
        }
        // Exact maps of low resolution err too, and less.
        let exact = of("raster", placement, 256);
        assert_eq!(exact["extrapolated"], true, "of 96 views");
        assert!(number(exact, "wrong_shadow_fraction") < number(alone, "wrong_shadow_fraction"));
    }
    let plot = std::fs::read_to_string(folder.path().join("megaviews-views-four-bounce.svg")).unwrap();
    assert!(plot.contains("megaviews") && plot.contains("raster"));
}

#[test]
fn a_light_that_is_none_is_refused_with_what_it_should_be() {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_argus"))
        .args(["study", "megaviews", "--light", "spot:0,1:0,0,0"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("spot:X,Y,Z:DX,DY,DZ:HALF_DEG"), "{message}");
}
