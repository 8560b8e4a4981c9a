//! Small things in wide scenes: views from samples show them, or say that they do not.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::Value;

use crate::support::{Coordinator, Process, json};

/// Viewpoints around the box: its eye and target.
const VIEWS: [[&str; 2]; 2] = [["5,3.5,5", "0,0.8,0"], ["-3,1.2,4", "1,0.7,0"]];

/// An OBJ file of a ground, a box of 2 m and a thin pole on it, and a speck at a distance.
fn write_scene(file: &Path, ground: f64, speck: Option<f64>) {
    let mut text = String::new();
    let mut vertices = 0;
    let mut block = |[x0, y0, z0]: [f64; 3], [x1, y1, z1]: [f64; 3]| {
        for i in 0..8 {
            let pick = |bit: i32, low: f64, high: f64| if i >> bit & 1 == 1 { high } else { low };
            writeln!(text, "v {} {} {}", pick(0, x0, x1), pick(1, y0, y1), pick(2, z0, z1)).unwrap();
        }
        for quad in [[1, 5, 7, 3], [2, 4, 8, 6], [1, 2, 6, 5], [3, 7, 8, 4], [1, 3, 4, 2], [5, 6, 8, 7]] {
            let [a, b, c, d] = quad.map(|corner| corner + vertices);
            writeln!(text, "f {a} {b} {c} {d}").unwrap();
        }
        vertices += 8;
    };
    block([-1.0, 0.0, -1.0], [1.0, 2.0, 1.0]);
    block([2.0, 0.0, 0.0], [2.3, 0.8, 0.3]);
    for (x, z) in [(-ground, -ground), (-ground, ground), (ground, ground), (ground, -ground)] {
        writeln!(text, "v {x} 0 {z}").unwrap();
    }
    writeln!(text, "f -4 -3 -2 -1").unwrap();
    if let Some(z) = speck {
        writeln!(text, "v 0 0 {z}\nv 0.01 0 {z}\nv 0 0.01 {z}\nf -3 -2 -1").unwrap();
    }
    std::fs::write(file, text).unwrap();
}

/// A service of a scene, and the folder for its images.
struct Served {
    coordinator: Coordinator,
    _worker: Process,
    folder: tempfile::TempDir,
}

impl Served {
    fn start(ground: f64, speck: Option<f64>, more: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.obj");
        write_scene(&file, ground, speck);
        let direct = ["--indirect", "off", "--exposure", "1"];
        let coordinator = Coordinator::start(file.to_str().unwrap(), &[&direct, more].concat());
        let worker = coordinator.worker(&[]);
        coordinator.wait_for_workers(1);
        Self { coordinator, _worker: worker, folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn view(&self, [eye, target]: [&str; 2], out: &str, more: &[&str]) -> Value {
        let place = format!("--eye={eye}");
        let towards = format!("--target={target}");
        let view = ["view", "--server", &self.coordinator.url, &place, &towards, "--size", "160x120"];
        json(&[&view, more, &["--json", "--out", &self.path(out)]].concat())
    }
}

fn flip(a: &str, b: &str) -> f64 {
    json(&["compare", a, b, "--json"])["flip_mean"].as_f64().unwrap()
}

#[test]
fn a_stray_triangle_or_a_wide_ground_leaves_views_from_samples_as_they_are() {
    let twin = Served::start(4.0, None, &[]);
    let stray = Served::start(4.0, Some(1e3), &[]);
    let wide = Served::start(500.0, None, &[]);
    for view in VIEWS {
        for served in [&twin, &stray, &wide] {
            let from_samples = served.view(view, "samples.png", &["--search", "splat"]);
            assert!(from_samples["unresolved_fraction"].as_f64().unwrap() < 0.02, "{from_samples:#}");
            served.view(view, "direct.png", &["--direct"]);
        }
        let strayed = flip(&stray.path("samples.png"), &twin.path("samples.png"));
        assert!(strayed <= 0.001, "{view:?}: {strayed}");
        let [own, widened] = [&twin, &wide].map(|at| flip(&at.path("samples.png"), &at.path("direct.png")));
        assert!(widened <= own + 0.02, "{view:?}: {widened}, {own} on a small ground");
    }
}

#[test]
fn views_from_samples_that_are_too_coarse_say_so() {
    let served = Served::start(500.0, None, &["--rig", "cell", "--face", "8"]);
    let bounded = ["--search", "splat", "--max-error", "0.05"];
    let coarse = served.view(VIEWS[1], "coarse.png", &bounded);
    let traced = served.view(VIEWS[1], "traced.png", &[&bounded[..], &["--holes", "trace"]].concat());
    served.view(VIEWS[1], "direct.png", &["--direct"]);
    let [missed, kept] =
        ["coarse.png", "traced.png"].map(|name| flip(&served.path(name), &served.path("direct.png")));
    assert!(missed > 0.05 && kept < 0.6 * missed, "{missed} {kept}");
    assert!(coarse["unresolved_fraction"].as_f64().unwrap() > 0.3, "{coarse:#}");
    assert!(coarse["predicted"]["error"].as_f64().unwrap() > 0.05, "{coarse:#}");
    assert_eq!(traced["unresolved_fraction"], 0.0, "{traced:#}");
}
