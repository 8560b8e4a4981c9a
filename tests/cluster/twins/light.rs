//! What changes little of a scene changes little of its light: its unit, its winding, a sky dome around it.

use std::path::{Path, PathBuf};

use argus_scene::metrics::flip_mean;
use image::RgbImage;
use serde_json::{Value, json};

use super::files::{Glb, cube, ground};
use super::{UNCHANGED, shown};
use crate::support::say;

/// Units of files, metres.
const UNITS: [(&str, f64); 2] = [("mm", 1e3), ("km", 1e-3)];
/// Half of the floor's side. It fills the view, so that no sky is compared.
const FLOOR: f32 = 12.0;
/// Boxes on the floor: middle, size and colour.
const BOXES: [([f64; 2], [f64; 3], [f32; 3]); 5] = [
    ([0.0, 0.0], [1.6, 1.6, 1.6], [0.6, 0.2, 0.1]),
    ([2.0, 1.5], [0.8, 0.6, 0.8], [0.15, 0.25, 0.6]),
    ([-2.0, 0.6], [0.3, 2.4, 1.8], [0.6, 0.5, 0.35]),
    ([0.5, 2.4], [1.8, 0.4, 0.6], [0.6, 0.5, 0.35]),
    ([-1.0, 2.6], [0.5, 0.8, 0.5], [0.15, 0.25, 0.6]),
];

/// A yard in a file.
#[derive(Clone, Copy)]
struct Yard {
    /// Units in a metre.
    unit: f64,
    /// Whether its triangles are wound the other way.
    is_turned: bool,
}

const YARD: Yard = Yard { unit: 1.0, is_turned: false };

impl Yard {
    /// Writes it, and what `more` adds.
    fn write(self, path: PathBuf, more: impl FnOnce(&mut Glb)) -> PathBuf {
        let mut glb = Glb::new();
        // Turned, the backs of single-sided surfaces would rightly be culled.
        let matt = |glb: &mut Glb, color: [f32; 3]| {
            let material = glb.matt(color);
            glb.json["materials"][material]["doubleSided"] = true.into();
            material
        };
        let grey = matt(&mut glb, [0.5; 3]);
        let floor = glb.quads(&self.wound(vec![ground(FLOOR)]), &[], grey);
        glb.place(floor, json!({ "scale": [self.unit, self.unit, self.unit] }));
        for ([x, z], size, color) in BOXES {
            let material = matt(&mut glb, color);
            let mesh = glb.quads(&self.wound(cube(0.5)), &[], material);
            let place = [x, 0.0, z].map(|at| at * self.unit);
            glb.place(mesh, json!({ "translation": place, "scale": size.map(|side| side * self.unit) }));
        }
        more(&mut glb);
        glb.write(&path);
        path
    }

    fn wound(self, mut quads: Vec<[[f32; 3]; 4]>) -> Vec<[[f32; 3]; 4]> {
        if self.is_turned {
            quads.iter_mut().for_each(|quad| quad.reverse());
        }
        quads
    }

    /// Shows a file of it.
    fn shown(self, file: &Path) -> RgbImage {
        let at = |place: [f64; 3]| place.map(|at| (at * self.unit).to_string()).join(",");
        let (eye, target) = (at([2.5, 5.5, 4.2]), at([0.0, 0.3, 0.5]));
        shown(file, [&eye, &target]).unwrap()
    }
}

/// Adds an unlit box around the scene, which shows its fronts inward.
fn dome(glb: &mut Glb, double_sided: bool) {
    glb.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    let unlit = json!({
        "pbrMetallicRoughness": { "baseColorFactor": [0.3, 0.5, 0.8, 1] }, "doubleSided": double_sided,
        "extensions": { "KHR_materials_unlit": {} },
    });
    let material = glb.push("materials", unlit);
    let mut quads = cube(40.0);
    quads.push(ground(40.0));
    quads.iter_mut().for_each(|quad| quad.reverse());
    // The quad below shows its front upward.
    quads.last_mut().unwrap().reverse();
    let mesh = glb.quads(&quads, &[], material);
    glb.place(mesh, json!({ "translation": [0, -30, 0] }));
}

/// Adds a point light and a spot light of these intensities.
fn lamps(glb: &mut Glb, unit: f64, strength: f64) {
    glb.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let spot = json!({ "innerConeAngle": 0.5, "outerConeAngle": 0.9 });
    glb.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point", "intensity": 40.0 * strength },
        { "type": "spot", "intensity": 60.0 * strength, "color": [1, 0.8, 0.5], "spot": spot },
    ] } });
    let mut hang = |light: u32, place: [f64; 3], more: Value| {
        let mut node = json!({
            "extensions": { "KHR_lights_punctual": { "light": light } }, "translation": place.map(|at| at * unit) });
        node.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let node = glb.push("nodes", node);
        glb.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(node.into());
    };
    hang(0, [1.5, 3.5, 2.0], json!({}));
    // Straight down.
    hang(
        1,
        [-2.0, 4.0, 2.0],
        json!({ "rotation": [-std::f64::consts::FRAC_1_SQRT_2, 0, 0, std::f64::consts::FRAC_1_SQRT_2] }),
    );
}

/// Panics if pictures differ from the first.
fn assert_alike(plain: &RgbImage, pictures: &[(String, RgbImage)]) {
    let flips: Vec<(&str, f64)> =
        pictures.iter().map(|(name, picture)| (name.as_str(), flip_mean(plain, picture).unwrap())).collect();
    say(&format!("FLIP {flips:?}"));
    let wrong: Vec<_> = flips.iter().filter(|(_, flip)| !(*flip <= UNCHANGED)).collect();
    assert!(wrong.is_empty(), "not as their twin: {wrong:?}");
}

#[test]
fn a_turned_winding_a_sky_dome_and_the_unit_of_a_file_do_not_change_its_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(format!("{name}.glb"));
    let plain = YARD.shown(&YARD.write(path("plain"), |_| {}));
    let turned = Yard { is_turned: true, ..YARD };
    let mut pictures = vec![("turned".to_owned(), turned.shown(&turned.write(path("turned"), |_| {})))];
    for double_sided in [false, true] {
        let name = format!("dome, double-sided: {double_sided}");
        let file = YARD.write(path(&name), |glb| dome(glb, double_sided));
        pictures.push((name, YARD.shown(&file)));
    }
    for (name, unit) in UNITS {
        let yard = Yard { unit, ..YARD };
        pictures.push((name.to_owned(), yard.shown(&yard.write(path(name), |_| {}))));
    }
    assert_alike(&plain, &pictures);
}

#[test]
fn lamps_light_a_file_of_any_unit_alike() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(format!("{name}.glb"));
    let dark = YARD.shown(&YARD.write(path("dark"), |_| {}));
    let plain = YARD.shown(&YARD.write(path("plain"), |glb| lamps(glb, 1.0, 1.0)));
    let difference = flip_mean(&dark, &plain).unwrap();
    assert!(difference > 0.1, "the lamps change nothing: {difference}");
    let mut pictures = Vec::new();
    for (name, unit) in UNITS {
        let yard = Yard { unit, ..YARD };
        // Programs that scale a file scale its intensities, or leave them.
        for (kind, strength) in [("scaled", unit * unit), ("left", 1.0)] {
            let name = format!("{name}, intensities {kind}");
            let file = yard.write(path(&name), |glb| lamps(glb, unit, strength));
            pictures.push((name, yard.shown(&file)));
        }
    }
    assert_alike(&plain, &pictures);
}
