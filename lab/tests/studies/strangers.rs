//! Files of kinds that strangers bring: each is shown neither dark nor washed out, without a flag.

use std::path::Path;

use serde_json::{Value, json};

use crate::files::{Glb, cube};
use crate::support::run;

const GREY: [f32; 3] = [0.5; 3];
/// The pose of a light that shines straight down.
const DOWN: [f64; 4] = [-std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2];

/// A file in the making.
struct Stage(Glb);

impl Stage {
    fn new() -> Self {
        let mut glb = Glb::new();
        glb.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
        Self(glb)
    }

    /// A box by the middle of its lower side, and its size.
    fn block(mut self, place: [f64; 3], size: [f64; 3], color: [f32; 3]) -> Self {
        let material = self.0.matt(color);
        self.0.json["materials"][material]["doubleSided"] = true.into();
        let mesh = self.0.quads(&cube(0.5), &[], material);
        self.0.place(mesh, json!({ "translation": place, "scale": size }));
        self
    }

    /// Lights of this definition at these places.
    fn lights(mut self, light: &Value, places: &[[f64; 3]]) -> Self {
        self.0.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [light] } });
        for place in places {
            let node = json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } },
                "translation": place, "rotation": DOWN });
            let node = self.0.push("nodes", node);
            self.0.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(node.into());
        }
        self
    }

    /// Floor, ceiling and walls of thick boxes. In the wall at +x is a window of a fifth of its height, if there is one.
    fn room(self, [width, height, depth]: [f64; 3], has_window: bool, color: [f32; 3]) -> Self {
        let (x, z) = (0.5 * width + 0.1, 0.5 * depth + 0.1);
        let wall = |stage: Self, low: f64, high: f64| {
            stage.block([x, low * height, 0.0], [0.2, (high - low) * height, depth], color)
        };
        let stage = self
            .block([0.0, -0.2, 0.0], [width + 0.4, 0.2, depth + 0.4], color)
            .block([0.0, height, 0.0], [width + 0.4, 0.2, depth + 0.4], color)
            .block([-x, 0.0, 0.0], [0.2, height, depth], color)
            .block([0.0, 0.0, -z], [width, height, 0.2], color)
            .block([0.0, 0.0, z], [width, height, 0.2], color);
        if has_window { wall(wall(stage, 0.0, 0.5), 0.7, 1.0) } else { wall(stage, 0.0, 1.0) }
    }

    fn furniture(self) -> Self {
        self.block([-1.5, 0.0, -1.0], [1.8, 0.8, 1.0], [0.5, 0.3, 0.2])
            .block([1.0, 0.0, 0.8], [0.6, 0.6, 0.6], [0.2, 0.3, 0.6])
            .block([2.0, 0.0, -1.8], [0.6, 2.0, 0.6], [0.6, 0.6, 0.5])
    }

    fn street(self) -> Self {
        let houses = (-4..=4).flat_map(|row| [-10.0, 10.0].map(|z| (f64::from(row) * 11.0, z)));
        let ground = self.block([0.0, -0.2, 0.0], [100.0, 0.2, 24.0], [0.1; 3]);
        houses.fold(ground, |stage, (x, z)| stage.block([x, 0.0, z], [9.0, 8.0, 8.0], [0.4, 0.35, 0.3]))
    }

    fn write(self, folder: &Path, name: &str) {
        self.0.write(&folder.join(format!("{name}.glb")));
    }
}

fn write_all(folder: &Path) {
    let bulb = |intensity: f64| json!({ "type": "point", "intensity": intensity });
    let spot =
        json!({ "type": "spot", "intensity": 200, "spot": { "innerConeAngle": 0.3, "outerConeAngle": 0.5 } });
    let new = Stage::new;
    new().room([8.0, 3.0, 6.0], true, [0.7; 3]).furniture().write(folder, "room with a window");
    let lamp_at_an_end = new().room([20.0, 3.0, 5.0], false, GREY).furniture();
    lamp_at_an_end.lights(&bulb(100.0), &[[9.0, 2.5, 0.0]]).write(folder, "lamp at one end");
    let floor = new().block([0.0, -0.2, 0.0], [100.0, 0.2, 100.0], GREY).furniture();
    floor.lights(&spot, &[[0.0, 6.0, 0.0]]).write(folder, "spot on a large floor");
    let lamps = [[-33.0, 5.0, 5.0], [0.0, 5.0, -5.0], [33.0, 5.0, 5.0]];
    new().street().lights(&bulb(300.0), &lamps).write(folder, "street at night");
    let car = new().block([0.0, 0.3, 0.0], [4.4, 0.8, 1.8], [0.005; 3]);
    car.block([-0.2, 1.1, 0.0], [2.4, 0.7, 1.6], [0.005; 3]).write(folder, "black car");
    let walls = [-25.0, 25.0];
    let ground = new().block([0.0, -1.0, 0.0], [200.0, 1.0, 80.0], [0.5, 0.35, 0.25]);
    let canyon = walls
        .into_iter()
        .fold(ground, |stage, z| stage.block([0.0, 0.0, z], [200.0, 60.0, 44.0], [0.5, 0.35, 0.25]));
    canyon.block([-40.0, 0.0, 0.5], [2.4, 1.4, 1.6], GREY).write(folder, "deep canyon");
}

/// The bars are those of `argus-lab study views scenes`: at most a quarter is nearly black, at most 8% white, and the mean in between.
#[test]
fn files_that_strangers_bring_are_neither_dark_nor_washed_out() {
    let folder = tempfile::tempdir().unwrap();
    write_all(folder.path());
    let study = [
        "study",
        "views",
        "scenes",
        "--scenes",
        folder.path().to_str().unwrap(),
        "--size",
        "160x100",
        "--json",
    ];
    // It fails if a picture is out of bounds, and says which.
    let report: Value = serde_json::from_slice(&run(&study).stdout).unwrap();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 6);
    let wrong: Vec<&Value> = rows.iter().filter(|row| row["passed"] != true).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}
