//! The studies of light and of reflections in their short forms: their rows and files.

use serde_json::Value;

use crate::short_forms::{number, paper_page, rows};
use crate::support::json;

#[test]
fn the_rays_study_measures_every_kind_of_rays_with_the_wide_tree() {
    let study = json(&["study", "device", "rays", "--quick", "--json"]);
    for kind in ["primary", "sun", "point", "sky", "bounce"] {
        let of = |row: &&Value| row["rays"] == kind && row["tracer"] == "wide";
        let wide: Vec<&Value> = rows(&study).iter().filter(of).collect();
        assert!(!wide.is_empty(), "{kind}: {study:#}");
        for row in wide {
            assert!(number(row, "millions_per_sec") > 0.0 && number(row, "count") > 0.0, "{row:#}");
            assert!((0.0..=1.0).contains(&number(row, "hit_fraction")), "{row:#}");
        }
    }
    assert!(rows(&study).iter().any(|row| row["tracer"] == "packets"));
}

#[test]
fn the_reflections_study_compares_maps_with_the_sky_and_with_brute_force() {
    let study = &paper_page().probes;
    let sky = &rows(study)[0];
    assert_eq!(number(sky, "maps"), 0.0);
    assert_eq!(
        rows(study).len(),
        8,
        "as given, another resolution, other levels, points and rays at both resolutions"
    );
    for row in &rows(study)[1..] {
        assert_eq!(number(row, "maps"), 4.0);
        assert!(
            ["maps_ms", "ready_ms", "brute_force_ms", "view_ms"].iter().all(|key| number(row, key) > 0.0)
        );
        // Few samples leave holes, which maps do not fill.
        for (flip, share) in [("flip", 1.0), ("direct_flip", 0.8)] {
            assert!(number(row, flip) < share * number(sky, flip), "{flip}: {row:#}, the sky alone: {sky:#}");
        }
    }
}

#[test]
fn the_epr_study_compares_points_with_maps_and_rays_and_leaves_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = json(&["study", "method", "eye-points", "--quick", "--json", "--out", out]);
    for pose in ["distant", "close"] {
        let of = |way: &str| {
            let is = |row: &&Value| row["way"] == way && row["pose"] == pose;
            rows(&study).iter().find(is).unwrap_or_else(|| panic!("{pose} {way}: {study:#}"))
        };
        let (points, planar, ivir) = (of("points"), of("points, planar"), of("iVIR"));
        assert!(number(points, "points") <= number(planar, "points"));
        assert!(number(points, "points") < number(ivir, "points"));
        assert!(number(points, "shades") < number(ivir, "shades"), "only what the eye sees is shaded");
        assert!(number(points, "shades") < number(of("MVR, adaptive"), "shades"));
        let device = of("points, device");
        for key in ["points", "shades", "right", "flip"] {
            let ratio = number(device, key) / number(points, key);
            assert!((0.95..1.05).contains(&ratio), "{key}: {device:#} {points:#}");
        }
        for row in [points, planar, ivir, device, of("MVR, adaptive"), of("traced maps")] {
            assert_eq!(number(row, "holes"), 0.0, "{row:#}");
            assert!(number(row, "other_triangle") < 2e-3, "{row:#}");
            assert!(number(row, "right") > 0.3 && number(row, "flip") < 0.2, "{row:#}");
        }
        let rays = of("rays");
        assert!(number(rays, "right") > 0.98 && number(rays, "flip") < 0.01, "{rays:#}");
        assert!(number(rays, "flip") < number(points, "flip"));
    }
    for file in [
        "eye-points-3-distant-truth.png",
        "eye-points-3-close-points-0.5.png",
        "eye-points.md",
        "eye-points-flip.svg",
    ] {
        assert!(folder.path().join(file).is_file(), "{file}");
    }
}

#[test]
fn the_equal_error_study_gives_each_ways_time_for_the_error_of_views_from_samples() {
    let study = json(&["study", "light", "equal-error", "--quick", "--json"]);
    for row in rows(&study) {
        assert!(number(row, "view_ms") > 0.0 && (0.0..=1.0).contains(&number(row, "flip")), "{row:#}");
        assert!(number(row, "error") > 0.0 && number(row, "energy") > 0.0, "{row:#}");
    }
    let of = |way: &str| rows(&study).iter().filter(|row| row["way"] == way).collect::<Vec<_>>();
    assert_eq!((of("samples").len(), of("direct").len(), of("paths").len()), (2, 2, 2));
    let slowest = of("paths").iter().map(|row| number(row, "view_ms")).fold(0.0, f64::max);
    for row in of("samples") {
        assert!(number(row, "excess_tile") >= number(row, "excess_flip"), "{row:#}");
        assert!(row["paths_ms"].is_null() || number(row, "paths_ms") <= slowest, "{row:#}");
        assert!(row["mitsuba_ms"].is_null(), "{row:#}");
    }
    // Frames cost nothing beforehand, samples do.
    assert_eq!(number(of("samples")[0], "samples_ms"), 0.0);
    assert!(number(of("samples")[1], "samples_ms") > 0.0);
}

#[test]
fn the_radiosity_study_varies_each_setting_and_light_brings_images_closer_to_path_tracing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = json(&[
        "study",
        "method",
        "virtual-lights",
        "--quick",
        "--json",
        "--out",
        out,
        "--light",
        "point:0,60,0",
    ]);
    let differs = |name: &str| rows(&study).iter().filter(|row| row["differs"] == name).count();
    for name in [
        "as given",
        "VPLs",
        "resolution",
        "source",
        "octree levels",
        "samples",
        "filter",
        "clamp",
        "culling",
        "points",
    ] {
        assert!(differs(name) > 0, "{name}: {study:#}");
    }
    for row in rows(&study) {
        for key in ["flip", "flip_by_vpls"] {
            assert!((0.0..1.0).contains(&number(row, key)), "{key}: {row:#}");
        }
        assert!(number(row, "gather_ms") >= 0.0, "{row:#}");
        if row["way"] == "points" {
            assert!(number(row, "receivers") > 0.0 && number(row, "light_ms") > 0.0, "{row:#}");
            continue;
        }
        assert!(number(row, "trace_ms") >= 0.0 && number(row, "vpls") > 0.0, "{row:#}");
        let culled = number(row, "culled_fraction");
        assert!(if row["cull"] == true { (0.0..1.0).contains(&culled) } else { culled == 0.0 }, "{row:#}");
    }
    let note = study["notes"][0].as_str().unwrap();
    assert!(note.contains("path-traced"), "{note}");
    let plot = std::fs::read_to_string(folder.path().join("virtual-lights-pareto.svg")).unwrap();
    assert!(plot.starts_with("<svg"));
}

#[test]
fn an_invalid_light_is_refused_with_the_valid_form() {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_argus-lab"))
        .args(["study", "method", "megaviews", "--light", "spot:0,1:0,0,0"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("spot:X,Y,Z:DX,DY,DZ:HALF_DEG"), "{message}");
}

#[test]
fn the_particles_study_shows_that_maps_come_closer_to_ray_traced_shadows() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = json(&["study", "method", "particles", "--quick", "--json", "--out", out, "--images", out]);
    for count in [256, 1024] {
        let of = |method: &str| {
            let found = rows(&study).iter().find(|row| row["particles"] == count && row["method"] == method);
            found.unwrap_or_else(|| panic!("{count} {method}: {study:#}"))
        };
        let without = of("no shadows");
        for method in ["megaviews", "manylods", "manylods, incremental", "exact maps"] {
            assert!(number(of(method), "frame_ms") > 0.0);
            let wrong = number(of(method), "wrong_shadow_fraction");
            assert!(wrong < number(without, "wrong_shadow_fraction"), "{method}: {study:#}");
            assert!(number(of(method), "flip") < number(without, "flip"), "{method}: {study:#}");
        }
        // The same cuts give the same maps.
        let off = number(of("manylods"), "flip") - number(of("manylods, incremental"), "flip");
        assert!(off.abs() < 1e-3, "{off}");
    }
    assert!(folder.path().join("particles-256-megaviews.png").is_file());
    assert!(std::fs::read_to_string(folder.path().join("particles-time.svg")).unwrap().starts_with("<svg"));
}

#[test]
fn the_shadows_study_judges_every_effect_against_the_reference_with_that_effect() {
    let study = json(&["study", "light", "shadows", "--quick", "--json"]);
    let of = |name: &str| rows(&study).iter().find(|row| row["effects"] == name).unwrap();
    assert!(number(of("none"), "light_ms") == 0.0 && number(of("none"), "flip") < 0.02);
    for name in ["hard shadows", "soft shadows", "sky visibility, 4 rays", "all"] {
        assert!(number(of(name), "light_ms") > 0.0 && number(of(name), "sample_light_ms") > 0.0, "{name}");
        assert!(number(of(name), "flip") < 0.06, "{name}: {:#}", of(name));
    }
}

#[test]
fn the_effects_study_judges_changes_beside_their_bounds_and_prints_predicted_and_measured_costs() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = json(&["study", "light", "effects", "--quick", "--json", "--out", out]);
    let of = |scene: &str, name: &str| {
        let found = rows(&study).iter().find(|row| row["scene"] == scene && row["row"] == name);
        found.unwrap_or_else(|| panic!("{scene} {name}: {study:#}"))
    };
    assert_eq!(rows(&study).len(), 3 * 7);
    for row in rows(&study) {
        assert!(number(row, "view_ms") > 0.0 && number(row, "sample_ms") > 0.0, "{row:#}");
        assert_ne!(row["passed"], false, "{row:#}");
        let is_auto = row["row"] == "auto";
        assert!(!is_auto || (row["passed"].is_null() && row["changed_bytes"] == 0), "{row:#}");
    }
    // The ball calls for nothing: all effects are judged beyond `auto`.
    for name in ["all", "auto with shadows", "auto with sky-visibility"] {
        let row = of("matt", name);
        assert_eq!(row["within"], true, "{row:#}");
        assert!(number(row, "bound_bytes") >= 1.0 && number(row, "share") > 0.0, "{row:#}");
    }
    assert!(number(of("matt", "auto with sky-visibility"), "saved_ms") > 0.0);
    // The room's lamp is on, and moves pixels.
    let lamp = of("room", "auto without emitters");
    assert_eq!((&lamp["moves"], &lamp["within"]), (&true.into(), &Value::Null), "{lamp:#}");
    assert!(number(lamp, "measured_ms") > 0.0 && number(lamp, "predicted_ms") > 0.0, "{lamp:#}");
    assert!(number(lamp, "changed_bytes") > 10.0 && number(lamp, "flip") > 0.0, "{lamp:#}");
    assert_eq!(of("terrain:3000", "auto")["effects"], "shadows,soft-shadows,sky-visibility");
    assert!(folder.path().join("effects-room-auto-0.png").is_file());
    assert!(folder.path().join("effects-room-none-0-flip.png").is_file());
    assert!(folder.path().join("effects.csv").is_file());
}
