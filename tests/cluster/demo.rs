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
        assert!(by_second.iter().all(|row| row["kinds"]["from frames"].is_u64()), "{figures:#}");
        assert_eq!(by_second.len(), seconds, "{figures:#}");
        let answered = by_second.iter().map(|row| row["answered"].as_u64().unwrap()).sum::<u64>();
        assert_eq!(load["answered"].as_u64(), Some(answered), "{figures:#}");
    }
    let default = &figures["default"];
    let flip = default["flip"].as_f64().unwrap();
    assert!(flip > 0.001 && flip < 0.3, "{figures:#}");
    assert_eq!(default["judged"], 8, "{figures:#}");
    let judged = default["by_second"].as_array().unwrap().iter().map(|row| row["judged"].as_u64().unwrap());
    assert!(judged.clone().all(|count| count > 0) && judged.sum::<u64>() == 8, "{figures:#}");
    let excess = default["excess"].as_f64().unwrap();
    assert!((flip - default["flip_direct"].as_f64().unwrap() - excess).abs() < 1e-9, "{figures:#}");
    for i in 0..8 {
        for kind in ["view", "reference", "flip"] {
            let picture = image::open(folder.path().join(format!("{kind}-{i:02}.png"))).unwrap();
            assert_eq!((picture.width(), picture.height()), (96, 72));
        }
    }
    let sheet = image::open(folder.path().join("contact-sheet.png")).unwrap();
    assert!(sheet.width() > 8 * 96 && sheet.height() > 4 * 72);
    assert!(image::open(folder.path().join("latency.png")).is_ok());
    assert!(std::fs::read_to_string(folder.path().join("latency.svg")).unwrap().contains("p99"));
}

#[test]
fn a_second_run_with_equal_rates_needs_no_new_references() {
    let folder = tempfile::tempdir().unwrap();
    let (out, kept) = (folder.path().join("out"), folder.path().join("kept"));
    let run = || {
        let rates =
            ["--walk", "roam", "--rate", "4,8", "--seconds", "1", "--judged", "4", "--no-direct", "--quick"];
        let mut arguments = vec!["demo", "--scene", SMALL, "--out", out.to_str().unwrap(), "--json"];
        arguments.extend(rates);
        arguments.extend(["--references", kept.to_str().unwrap()]);
        let figures = json(&arguments);
        assert!(figures["direct"].is_null() && figures["more"].as_array().unwrap().len() == 1, "{figures:#}");
        let scenes = std::fs::read_dir(&kept).unwrap().map(|scene| scene.unwrap().path());
        let mut files: Vec<_> = scenes
            .flat_map(|scene| std::fs::read_dir(scene).unwrap())
            .map(|file| file.unwrap().path())
            .collect();
        files.retain(|file| file.extension().is_some_and(|kind| kind == "png"));
        files.len()
    };
    let (first, second) = (run(), run());
    assert!(first >= 16, "{first} references of eight views");
    // Sources of the contact sheet may differ.
    assert!(second <= first + 8, "{first}, then {second} references");
}

#[test]
fn a_crowd_of_three_times_what_triangles_carry_is_served_from_samples_and_looks_as_good() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let load = [
        "--times",
        "3",
        "--seconds",
        "10",
        "--views",
        "8",
        "--size",
        "96x72",
        "--judged",
        "40",
        "--no-direct",
    ];
    let mut arguments = vec!["demo", "--scene", SMALL, "--out", out, "--json"];
    arguments.extend(load);
    let figures = json(&arguments);
    let default = &figures["default"];
    let kinds = default["by_second"].as_array().unwrap().iter().map(|row| &row["kinds"]);
    let warped: u64 = kinds
        .flat_map(|kinds| ["from frames", "from samples"].map(|kind| kinds[kind].as_u64().unwrap()))
        .sum();
    assert!(warped > 0 && default["samples"].as_u64().unwrap() > 0, "{figures:#}");
    // The bar of the first seconds; it falls to less than half of it later.
    let excess = default["excess"].as_f64().unwrap();
    assert!(excess <= 0.04, "{figures:#}");
}
