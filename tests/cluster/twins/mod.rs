//! Twins: two files that say the same in different ways are shown alike.
//!
//! Each kind is one that programs in use write. The tests make both files, show both as a user would, and compare.

mod files;
mod light;

use std::path::{Path, PathBuf};

use argus_scene::metrics::flip_mean;
use image::{RgbImage, Rgba, RgbaImage};
use serde_json::json;

use self::files::{Attribute, Glb, Ply, WHOLE, cube, ground, png, squares, upright};
use crate::support::{Coordinator, json as run_json, run, say, stderr};

/// Largest mean FLIP of twins.
const ALIKE: f64 = 0.03;
/// Largest mean FLIP of a scene and the same with something that changes nothing in view.
const UNCHANGED: f64 = 0.02;
/// Colours of faces.
const COLORS: [[u8; 3]; 6] =
    [[200, 40, 30], [40, 170, 60], [50, 70, 200], [210, 190, 40], [180, 180, 180], [90, 60, 40]];
const LINEAR: i32 = 9729;
const NEAREST: i32 = 9728;

/// Files that are shown alike, and from where.
struct Twins {
    kind: &'static str,
    /// The plain one first.
    files: Vec<PathBuf>,
    camera: [&'static str; 2],
    most: f64,
}

/// Shows a file without a service.
///
/// # Errors
/// What the program says.
fn shown(file: &Path, camera: [&str; 2]) -> Result<RgbImage, String> {
    shown_with(file, camera, &[])
}

/// The same with further flags.
fn shown_with(file: &Path, [eye, target]: [&str; 2], flags: &[&str]) -> Result<RgbImage, String> {
    let out = file.with_extension("view.png");
    let view = ["view", "--scene", text(file), "--eye", eye, "--target", target, "--size", "160x120"];
    let output = run(&[&view[..], flags, &["--out", text(&out)]].concat());
    match output.status.success() {
        true => Ok(image::open(out).unwrap().into_rgb8()),
        false => Err(stderr(&output).lines().last().unwrap_or_default().to_owned()),
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A file of that name with that content.
fn file(folder: &Path, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).unwrap();
    path
}

/// A box on the ground, and what `more` adds.
fn box_scene(path: PathBuf, more: impl FnOnce(&mut Glb)) -> PathBuf {
    let mut glb = Glb::new();
    let [red, grey] = [[0.6, 0.2, 0.1], [0.5, 0.5, 0.5]].map(|color| glb.matt(color));
    let cube = glb.quads(&cube(0.8), &[], red);
    let floor = glb.quads(&[ground(5.0)], &[], grey);
    glb.place(cube, json!({}));
    glb.place(floor, json!({}));
    more(&mut glb);
    glb.write(&path);
    path
}

/// A PLY file: header lines, then the elements.
fn ply(folder: &Path, name: &str, head: &str, body: &[&str]) -> PathBuf {
    let start = format!("ply\nformat ascii 1.0\n{head}end_header\n");
    file(folder, name, start + &body.concat())
}

fn colored_ply(folder: &Path, name: &str, at: Option<&str>) -> PathBuf {
    let quads = [cube(0.8), vec![ground(5.0)]].concat();
    let parts = Ply::new(&quads, &COLORS, at);
    ply(folder, name, &parts.elements(at).concat(), &[&parts.vertices, &parts.faces])
}

fn face_colours(folder: &Path) -> Twins {
    let files = vec![
        colored_ply(folder, "vertices.ply", Some("vertex")),
        colored_ply(folder, "faces.ply", Some("face")),
    ];
    Twins { kind: "colours of PLY faces", files, camera: ["4,3,5", "0,0.8,0"], most: ALIKE }
}

fn ply_headers(folder: &Path) -> Twins {
    let quads = [cube(0.8), vec![ground(5.0)]].concat();
    let at = Some("vertex");
    let parts = Ply::new(&quads, &COLORS, at);
    let [vertices, faces] = parts.elements(at);
    let head = format!("{vertices}{faces}");
    let body = [parts.vertices.as_str(), parts.faces.as_str()];
    let latin = [
        b"ply\nformat ascii 1.0\ncomment gr\xf6\xdfe\n".to_vec(),
        format!("{head}end_header\n").into_bytes(),
    ];
    let crlf = format!("ply\nformat ascii 1.0\n{head}end_header\n{}", body.concat()).replace('\n', "\r\n");
    let files = vec![
        ply(folder, "plain.ply", &head, &body),
        ply(folder, "faces-first.ply", &format!("{faces}{vertices}"), &[body[1], body[0]]),
        ply(folder, "mark.ply", &head, &["\u{feff}", body[0], body[1]]),
        ply(folder, "empty-comment.ply", &format!("comment\n{head}"), &body),
        file(folder, "latin.ply", [latin.concat(), body.concat().into_bytes()].concat()),
        file(folder, "crlf.ply", crlf),
    ];
    Twins { kind: "headers of PLY", files, camera: ["4,3,5", "0,0.8,0"], most: ALIKE }
}

fn unlit_colours(folder: &Path) -> Twins {
    let colors = [[0.8, 0.05, 0.05, 1.0], [0.1, 0.6, 0.1, 1.0], [0.05, 0.1, 0.9, 1.0]];
    let unlit = |color: [f32; 4]| json!({ "pbrMetallicRoughness": { "baseColorFactor": color }, "extensions": { "KHR_materials_unlit": {} } });
    let make = |name: &str, by_vertices: bool| {
        let mut glb = Glb::new();
        glb.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
        for (number, color) in colors.into_iter().enumerate() {
            let material = glb.push("materials", unlit(if by_vertices { [1.0; 4] } else { color }));
            let attribute = [("COLOR_0", Attribute::Color(vec![color; 4]))];
            let quad = upright([number as f32 * 1.2 - 1.7, 0.2], [1.0, 1.6], 0.0);
            let mesh = glb.quads(&[quad], if by_vertices { &attribute[..] } else { &[] }, material);
            glb.place(mesh, json!({}));
        }
        let path = folder.join(name);
        glb.write(&path);
        path
    };
    let files = vec![make("factors.glb", false), make("vertices.glb", true)];
    Twins { kind: "unlit vertex colours", files, camera: ["0,1,6", "0,1,0"], most: ALIKE }
}

/// An upright square with this material in its MTL, in front of a wall.
fn obj(folder: &Path, name: &str, material: &str) -> PathBuf {
    let mtl = format!("newmtl wall\nKd 0.5 0.5 0.5\nnewmtl square\n{material}");
    file(folder, &format!("{name}.mtl"), mtl);
    let text = "v -3 0 -2\nv 3 0 -2\nv 3 3 -2\nv -3 3 -2\nv -1 0 0\nv 1 0 0\nv 1 2 0\nv -1 2 0\n\
                vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl wall\nf 1 2 3 4\nusemtl square\nf 5/1 6/2 7/3 8/4\n";
    file(folder, &format!("{name}.obj"), format!("mtllib {name}.mtl\n{text}"))
}

fn masks(folder: &Path) -> Twins {
    let inside = |x: u32, y: u32| (f64::from(x) - 31.5).hypot(f64::from(y) - 31.5) < 24.0;
    let disc = |color: [u8; 4], outside: [u8; 4]| {
        RgbaImage::from_fn(64, 64, |x, y| Rgba(if inside(x, y) { color } else { outside }))
    };
    let (green, white, black) = ([40, 160, 50, 255], [255; 4], [0, 0, 0, 255]);
    file(folder, "leaf.png", png(&RgbaImage::from_pixel(64, 64, Rgba(green))));
    file(folder, "mask.png", png(&disc(white, black)));
    file(folder, "both.png", png(&disc(green, [40, 160, 50, 0])));
    let files =
        vec![obj(folder, "both", "map_Kd both.png"), obj(folder, "mask", "map_Kd leaf.png\nmap_d mask.png")];
    Twins { kind: "masks of OBJ materials", files, camera: ["0.5,1.5,5", "0,1,0"], most: ALIKE }
}

fn paths(folder: &Path) -> Twins {
    let colors = [[150, 60, 40, 255], [190, 180, 170, 255], [170, 70, 50, 255], [140, 50, 40, 255]];
    file(folder, "brick.png", png(&squares(&colors, 2, 16)));
    let named = [
        ("beside", "brick.png"),
        ("windows", "D:\\work\\textures\\brick.png"),
        ("unix", "/home/somebody/textures/brick.png"),
        ("parent", "../textures/brick.png"),
        ("case", "Brick.PNG"),
    ];
    let files = named.map(|(name, path)| obj(folder, name, &format!("map_Kd {path}"))).to_vec();
    Twins { kind: "paths in OBJ materials", files, camera: ["0,1,4", "0,1,0"], most: ALIKE }
}

/// A textured upright square with this material and these attributes. `material` gets the file to add textures to.
fn square(
    path: PathBuf,
    attributes: &[(&str, Attribute)],
    material: impl FnOnce(&mut Glb) -> serde_json::Value,
) -> PathBuf {
    let mut glb = Glb::new();
    let material = material(&mut glb);
    let material = glb.push("materials", material);
    let mesh = glb.quads(&[upright([-1.0, 0.0], [2.0, 2.0], 0.0)], attributes, material);
    glb.place(mesh, json!({}));
    glb.write(&path);
    path
}

fn whole(name: &'static str) -> (&'static str, Attribute) {
    (name, Attribute::Uv(WHOLE.to_vec()))
}

fn filters(folder: &Path) -> Twins {
    let colors = [[220, 30, 30, 255], [30, 200, 40, 255], [30, 40, 210, 255], [230, 220, 60, 255]];
    let make = |name: &str, side: u32, filter: i32| {
        square(folder.join(name), &[whole("TEXCOORD_0")], |glb| {
            // Repeating, the sides of a small image would blend.
            let sampler = json!({ "magFilter": filter, "minFilter": filter, "wrapS": 33071, "wrapT": 33071 });
            let texture = glb.texture(&squares(&colors, 2, side), sampler);
            json!({ "pbrMetallicRoughness": {
                "baseColorTexture": { "index": texture }, "metallicFactor": 0, "roughnessFactor": 1 } })
        })
    };
    let files = vec![make("upscaled.glb", 128, LINEAR), make("nearest.glb", 1, NEAREST)];
    Twins { kind: "textures that are not filtered", files, camera: ["0,1,3.2", "0,1,0"], most: ALIKE }
}

fn uv_sets(folder: &Path) -> Twins {
    let checks = [[120, 120, 120, 255], [70, 70, 70, 255], [70, 70, 70, 255], [120, 120, 120, 255]];
    let glow = |column: u32| {
        let orange = [255, 120, 20, 255];
        RgbaImage::from_fn(64, 64, move |x, y| {
            Rgba(if x / 16 == column && y / 16 == 1 { orange } else { [0, 0, 0, 255] })
        })
    };
    let mirrored = || Attribute::Uv(WHOLE.map(|[u, v]| [1.0 - u, v]).to_vec());
    let make = |name: &str, set: u32| {
        square(folder.join(name), &[whole("TEXCOORD_0"), ("TEXCOORD_1", mirrored())], |glb| {
            let sampler = || json!({ "magFilter": LINEAR, "minFilter": 9987 });
            let base = glb.texture(&squares(&checks, 2, 32), sampler());
            // The third column from the left is the second from the right.
            let glow = glb.texture(&glow(if set == 0 { 2 } else { 1 }), sampler());
            json!({
                "pbrMetallicRoughness": {
                    "baseColorTexture": { "index": base }, "metallicFactor": 0, "roughnessFactor": 1 },
                "emissiveTexture": { "index": glow, "texCoord": set }, "emissiveFactor": [1, 1, 1],
            })
        })
    };
    let files = vec![make("one-set.glb", 0), make("two-sets.glb", 1)];
    Twins { kind: "a second set of texture coordinates", files, camera: ["0,1,3.2", "0,1,0"], most: ALIKE }
}

fn transmission(folder: &Path) -> Twins {
    let glass = json!({ "pbrMetallicRoughness": {
        "baseColorFactor": [0.9, 0.45, 0.1, 1], "metallicFactor": 0, "roughnessFactor": 0.3 } });
    let scene = |name: &str, panes: &dyn Fn(&mut Glb)| {
        let path = folder.join(name);
        let mut glb = Glb::new();
        glb.json["extensionsUsed"] = json!(["KHR_materials_transmission"]);
        let grey = glb.matt([0.5; 3]);
        let colors = [[0.1, 0.3, 0.7], [0.7, 0.7, 0.1]];
        let behind = colors.map(|color| glb.matt(color));
        let floor = glb.quads(&[ground(4.0)], &[], grey);
        glb.place(floor, json!({}));
        for (number, material) in behind.into_iter().enumerate() {
            let mesh =
                glb.quads(&[upright([number as f32 * 1.5 - 1.5, 0.0], [1.5, 2.5], -1.5)], &[], material);
            glb.place(mesh, json!({}));
        }
        panes(&mut glb);
        glb.write(&path);
        path
    };
    let clear = |glb: &mut Glb, extension: serde_json::Value| {
        let mut material = glass.clone();
        material["extensions"] = json!({ "KHR_materials_transmission": extension });
        glb.push("materials", material)
    };
    let parts = scene("parts.glb", &|glb| {
        let (frame, window) =
            (glb.push("materials", glass.clone()), clear(glb, json!({ "transmissionFactor": 1 })));
        let frames = [
            upright([-1.0, 0.0], [2.0, 0.5], 0.0),
            upright([-1.0, 1.5], [2.0, 0.5], 0.0),
            upright([-1.0, 0.5], [0.5, 1.0], 0.0),
            upright([0.5, 0.5], [0.5, 1.0], 0.0),
        ];
        for (quads, material) in [(&frames[..], frame), (&[upright([-0.5, 0.5], [1.0, 1.0], 0.0)], window)] {
            let mesh = glb.quads(quads, &[], material);
            glb.place(mesh, json!({}));
        }
    });
    let texture = scene("texture.glb", &|glb| {
        let inside = |at: u32| (64..192).contains(&at);
        let mask = RgbaImage::from_fn(256, 256, |x, y| {
            Rgba(if inside(x) && inside(y) { [255; 4] } else { [0, 0, 0, 255] })
        });
        let texture = glb.texture(&mask, json!({}));
        let window =
            clear(glb, json!({ "transmissionFactor": 1, "transmissionTexture": { "index": texture } }));
        let pane = upright([-1.0, 0.0], [2.0, 2.0], 0.0);
        let mesh = glb.quads(&[pane], &[whole("TEXCOORD_0")], window);
        glb.place(mesh, json!({}));
    });
    Twins {
        kind: "textures of transmission",
        files: vec![parts, texture],
        camera: ["0.8,1.8,5", "0,1.2,0"],
        most: ALIKE,
    }
}

fn flat_things(folder: &Path) -> Twins {
    let make = |name: &str, scale: f32| {
        box_scene(folder.join(name), |glb| {
            let blue = glb.matt([0.1, 0.2, 0.7]);
            let mesh = glb.quads(&cube(0.7), &[], blue);
            glb.place(mesh, json!({ "translation": [2.2, 0.0, 1.2], "scale": [1, 1, scale] }));
        })
    };
    let files = vec![make("thin.glb", 1e-4), make("flat.glb", 0.0)];
    Twins { kind: "a scale of zero", files, camera: ["4,3,6", "0.8,0.8,0"], most: ALIKE }
}

fn lamps(folder: &Path) -> Twins {
    let led = |glb: &mut Glb| {
        let green = json!({
            "emissiveFactor": [0, 1, 0.1],
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 3 } }
        });
        glb.json["extensionsUsed"] = json!(["KHR_materials_emissive_strength"]);
        let material = glb.push("materials", green);
        let mesh = glb.quads(&[upright([0.6, 0.1], [0.03, 0.03], 0.81)], &[], material);
        glb.place(mesh, json!({}));
    };
    let dark = |glb: &mut Glb| {
        glb.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
        glb.json["extensions"] =
            json!({ "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 0 }] } });
        let light =
            json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } }, "translation": [0, 3, 0] });
        let node = glb.push("nodes", light);
        glb.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(node.into());
    };
    let files = vec![
        box_scene(folder.join("plain.glb"), |_| {}),
        box_scene(folder.join("led.glb"), led),
        box_scene(folder.join("dark.glb"), dark),
    ];
    Twins { kind: "lamps that light nothing", files, camera: ["4,3,5", "0,0.8,0"], most: UNCHANGED }
}

fn outliers(folder: &Path) -> Twins {
    let make = |name: &str, distance: f32| {
        box_scene(folder.join(name), |glb| {
            let grey = glb.matt([0.5; 3]);
            let mesh = glb.quads(&[upright([0.0, 0.0], [1.0, 1.0], 0.0)], &[], grey);
            glb.place(mesh, json!({ "translation": [distance, 0.0, -distance] }));
        })
    };
    let files =
        vec![box_scene(folder.join("plain.glb"), |_| {}), make("km.glb", 1e3), make("ten-km.glb", 1e4)];
    Twins { kind: "something far away", files, camera: ["4,3,5", "0,0.8,0"], most: UNCHANGED }
}

const KINDS: [fn(&Path) -> Twins; 11] = [
    face_colours,
    unlit_colours,
    masks,
    filters,
    transmission,
    uv_sets,
    paths,
    outliers,
    ply_headers,
    flat_things,
    lamps,
];

#[test]
fn twins_are_shown_alike() {
    let folder = tempfile::tempdir().unwrap();
    let mut wrong = Vec::new();
    for (number, kind) in KINDS.iter().enumerate() {
        let folder = folder.path().join(number.to_string());
        std::fs::create_dir(&folder).unwrap();
        let Twins { kind, files, camera, most } = kind(&folder);
        let plain = shown(&files[0], camera).unwrap();
        for twin in &files[1..] {
            let flip = shown(twin, camera).map(|twin| flip_mean(&plain, &twin).unwrap());
            let name = twin.file_name().unwrap().to_string_lossy().into_owned();
            say(&format!("{kind}, {name}: FLIP {flip:?}"));
            if flip.as_ref().is_ok_and(|flip| *flip <= most) {
                continue;
            }
            wrong.push((kind, name, flip));
        }
    }
    assert!(wrong.is_empty(), "not as their twins: {wrong:?}");
}

/// One file of each format, with files beside it where the format has them.
#[test]
fn a_view_without_a_service_equals_a_direct_view_of_one_in_full_light() {
    let folder = tempfile::tempdir().unwrap();
    let scenes = [transmission, paths, face_colours];
    for (number, kind) in scenes.iter().enumerate() {
        let folder = folder.path().join(number.to_string());
        std::fs::create_dir(&folder).unwrap();
        let Twins { files, camera: [eye, target], .. } = kind(&folder);
        let file = &files[1];
        // A service has light cells, which a single view does not fill.
        let by_rays = ["--indirect", "off"];
        let alone = shown_with(file, [eye, target], &by_rays).unwrap();
        let coordinator = Coordinator::start(text(file), &by_rays);
        let _worker = coordinator.worker(&[]);
        coordinator.wait_for_full_light();
        let out = folder.join("served.png");
        let view =
            ["view", "--server", &coordinator.url, "--eye", eye, "--target", target, "--size", "160x120"];
        run_json(&[&view[..], &["--direct", "--json", "--out", text(&out)]].concat());
        let served = image::open(out).unwrap().into_rgb8();
        assert!(alone == served, "{}: FLIP {}", file.display(), flip_mean(&served, &alone).unwrap());
    }
}
