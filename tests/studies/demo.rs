//! The demo, and the studies without a folder of results, in their short forms.

use crate::support::{SMALL, json};

#[test]
fn the_demo_leaves_every_image_a_contact_sheet_and_its_figures() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let figures =
        json(&["demo", "--scene", SMALL, "--views", "3", "--size", "96x72", "--out", out, "--json"]);
    assert_eq!(figures["views"], 3, "{figures:#}");
    for key in ["view_ms", "direct_ms", "sample_ms", "total_ms", "naive_ms", "samples"] {
        assert!(figures[key].as_f64().is_some_and(|figure| figure > 0.0), "{key}: {figures:#}");
    }
    // Close to the reference, but not equal: an equal image would not be reconstructed.
    let flip = figures["flip"]["mean"].as_f64().unwrap();
    assert!(flip > 0.001 && flip < 0.15, "{figures:#}");
    for i in 0..3 {
        for kind in ["view", "direct", "flip"] {
            let picture = image::open(folder.path().join(format!("{kind}-{i:02}.png"))).unwrap();
            assert_eq!((picture.width(), picture.height()), (96, 72));
        }
    }
    let sheet = image::open(folder.path().join("contact-sheet.png")).unwrap();
    assert!(sheet.width() > 3 * 96 && sheet.height() > 72);
}

#[test]
fn each_study_prints_one_object_with_its_rows() {
    let baseline = json(&["study", "baseline", "--quick", "--json"]);
    let methods: Vec<_> = baseline["rows"].as_array().unwrap().iter().map(|row| &row["method"]).collect();
    assert!(methods.len() >= 3, "{baseline:#}");
    for row in baseline["rows"].as_array().unwrap() {
        assert!(row["view_ms"].as_f64().unwrap() > 0.0 && row["flip"].as_f64().unwrap() > 0.0, "{row:#}");
    }
    let burst = json(&["study", "burst", "--quick", "--json"]);
    // As a batch, from samples with two divisions of the work, and directly with two visibility backends.
    assert_eq!(burst["rows"].as_array().unwrap().len(), 5, "{burst:#}");
    for study in [&baseline, &burst] {
        assert!(study["scene"].is_string() && study["machine"]["cores"].is_u64(), "{study:#}");
    }
    for row in burst["rows"].as_array().unwrap() {
        assert!(row["total_secs"].as_f64().unwrap() > 0.0, "{row:#}");
    }
}
