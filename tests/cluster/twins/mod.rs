//! Twins: two files that say the same in different ways are shown alike.
//!
//! Each kind is one that programs in use write. The tests make both files, show both as a user would, and compare.

mod files;

use std::path::{Path, PathBuf};

use argus_scene::metrics::flip_mean;
use image::{RgbImage, Rgba, RgbaImage};
use serde_json::json;

use self::files::{Attribute, Glb, Ply, WHOLE, cube, ground, png, squares, upright};
use crate::support::{Coordinator, json as run_json, run, say, stderr};

/// Largest mean FLIP of twins.
const ALIKE: f64 = 0.03;
/// Colours of faces.
const COLORS: [[u8; 3]; 6] =
    [[200, 40, 30], [40, 170, 60], [50, 70, 200], [210, 190, 40], [180, 180, 180], [90, 60, 40]];

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
fn shown(file: &Path, [eye, target]: [&str; 2]) -> Result<RgbImage, String> {
    let out = file.with_extension("view.png");
    let view = ["view", "--scene", text(file), "--eye", eye, "--target", target, "--size", "160x120"];
    let output = run(&[&view[..], &["--out", text(&out)]].concat());
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

fn whole(name: &'static str) -> (&'static str, Attribute) {
    (name, Attribute::Uv(WHOLE.to_vec()))
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

const KINDS: [fn(&Path) -> Twins; 4] = [face_colours, masks, paths, ply_headers];

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
        let alone = shown(file, [eye, target]).unwrap();
        let coordinator = Coordinator::start(text(file), &[]);
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
