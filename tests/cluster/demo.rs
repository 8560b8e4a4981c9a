//! The demo, in its short form.

use crate::support::{SMALL, json};

#[test]
fn the_demo_answers_a_crowd_and_leaves_images_a_contact_sheet_and_its_curve() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let arguments = ["demo", "--scene", SMALL, "--quick", "--views", "3", "--out", out, "--json"];
    let figures = json(&arguments);
    assert_eq!(figures["viewers"], 3, "{figures:#}");
    for key in ["carried_per_sec", "asked_per_sec"] {
        assert!(figures[key].as_f64().is_some_and(|figure| figure > 0.0), "{key}: {figures:#}");
    }
    for (load, seconds) in [("default", 2), ("direct", 1)] {
        let load = &figures[load];
        assert_eq!(load["failed"], 0, "{figures:#}");
        let by_second = load["by_second"].as_array().unwrap();
        assert_eq!(by_second.len(), seconds, "{figures:#}");
        let answered = by_second.iter().map(|row| row["answered"].as_u64().unwrap()).sum::<u64>();
        assert_eq!(load["answered"].as_u64(), Some(answered), "{figures:#}");
    }
    let flip = figures["default"]["flip"].as_f64().unwrap();
    assert!(flip > 0.001 && flip < 0.3, "{figures:#}");
    for i in 0..3 {
        for kind in ["view", "reference", "flip"] {
            let picture = image::open(folder.path().join(format!("{kind}-{i:02}.png"))).unwrap();
            assert_eq!((picture.width(), picture.height()), (96, 72));
        }
    }
    let sheet = image::open(folder.path().join("contact-sheet.png")).unwrap();
    assert!(sheet.width() > 3 * 96 && sheet.height() > 72);
    assert!(image::open(folder.path().join("latency.png")).is_ok());
    assert!(std::fs::read_to_string(folder.path().join("latency.svg")).unwrap().contains("p99"));
}
