//! Elements, properties and comments of PLY.

use argus_scene::{AlphaMode, Scene};
use glam::{Vec2, Vec3, Vec4};

use super::{Expect, check, corners, load, png, same};
use Expect::{NotApplicable, Shown, Warned};

/// A file in text: what its header says of vertices and faces after their positions and indices, other elements, and rows.
struct File {
    comments: &'static str,
    vertex: &'static str,
    face: &'static str,
    others: &'static str,
    /// Added to each of the four vertices.
    vertices: [&'static str; 4],
    /// Added to each of the two triangles.
    faces: [&'static str; 2],
    /// Rows of the other elements.
    rows: &'static str,
}

const PLAIN: File =
    File { comments: "", vertex: "", face: "", others: "", vertices: [""; 4], faces: [""; 2], rows: "" };
const POSITIONS: [&str; 4] = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"];
const INDICES: [&str; 2] = ["3 0 1 2", "3 0 2 3"];

impl File {
    fn text(&self) -> String {
        let properties =
            |names: &str| names.lines().map(|line| format!("property {line}\n")).collect::<String>();
        let rows = |base: &[&str], added: &[&str]| {
            base.iter().zip(added).map(|(base, added)| format!("{base} {added}\n")).collect::<String>()
        };
        format!(
            "ply\nformat ascii 1.0\n{}element vertex 4\nproperty float x\nproperty float y\nproperty float z\n{}\
             element face 2\nproperty list uchar int vertex_indices\n{}{}end_header\n{}{}{}",
            self.comments,
            properties(self.vertex),
            properties(self.face),
            self.others,
            rows(&POSITIONS, &self.vertices),
            rows(&INDICES, &self.faces),
            self.rows,
        )
    }

    fn load(&self) -> Scene {
        load_text(&self.text())
    }
}

fn load_text(text: &str) -> Scene {
    let red = png(2, 2, |_, _| [255, 0, 0, 255]);
    let green = png(2, 2, |_, _| [0, 255, 0, 255]);
    load(&[("a.ply", text.as_bytes()), ("red.png", &red), ("the green.png", &green)])
}

const RGB: &str = "uchar red\nuchar green\nuchar blue";
const RED: &str = "255 0 0";
const GREEN: &str = "0 255 0";

fn is_textured(scene: &Scene) -> bool {
    let material = &scene.materials[0];
    material.base_color_texture.is_some()
        && material.base_color == Vec4::ONE
        && scene.meshes[0].uvs[1] == Vec2::new(1.0, 0.75)
}

/// Vertices with texture coordinates under these names, and a picture.
const fn placed(vertex: &'static str) -> File {
    File {
        comments: "comment TextureFile red.png\n",
        vertex,
        vertices: ["0 0", "1 0.25", "1 1", "0 1"],
        ..PLAIN
    }
}

const fn vertex(property: &'static str, value: &'static str) -> File {
    File { vertex: property, vertices: [value; 4], ..PLAIN }
}

const fn face(property: &'static str, value: &'static str) -> File {
    File { face: property, faces: [value; 2], ..PLAIN }
}

const fn element(others: &'static str, rows: &'static str) -> File {
    File { others, rows, ..PLAIN }
}

const FIELDS: &[(&str, File, Expect)] = &[
    ("comment", File { comments: "comment\ncomment by hand\n", ..PLAIN }, NotApplicable),
    ("obj_info", File { comments: "obj_info num_cols 2\nobj_info\n", ..PLAIN }, NotApplicable),
    (
        "vertex normals",
        vertex("float nx\nfloat ny\nfloat nz", "1 0 0"),
        Shown(|s| s.meshes[0].normals[0] == Vec3::X),
    ),
    ("vertex colours", vertex(RGB, RED), Shown(|s| s.meshes[0].colors == [Vec4::new(1., 0., 0., 1.); 4])),
    (
        "colours in floats",
        vertex("float r\nfloat g\nfloat b", "1 0 0"),
        Shown(|s| s.meshes[0].colors == [Vec4::new(1., 0., 0., 1.); 4]),
    ),
    (
        "bytes in floats",
        vertex("float red\nfloat green\nfloat blue", "255 0 0"),
        Shown(|s| s.meshes[0].colors == [Vec4::new(1., 0., 0., 1.); 4]),
    ),
    (
        "bytes in integers",
        vertex("int diffuse_red\nint diffuse_green\nint diffuse_blue", "255 0 0"),
        Shown(|s| s.meshes[0].colors == [Vec4::new(1., 0., 0., 1.); 4]),
    ),
    (
        "alpha",
        vertex("uchar red\nuchar green\nuchar blue\nuchar alpha", "255 0 0 51"),
        Shown(|s| s.materials[0].alpha == AlphaMode::Blend && (s.meshes[0].colors[0].w - 0.2).abs() < 1e-6),
    ),
    (
        "full alpha",
        vertex("uchar red\nuchar green\nuchar blue\nuchar alpha", "255 0 0 255"),
        Shown(|s| s.materials[0].alpha == AlphaMode::Opaque),
    ),
    ("s t", placed("float s\nfloat t"), Shown(is_textured)),
    ("u v", placed("float u\nfloat v"), Shown(is_textured)),
    ("texture_u texture_v", placed("float texture_u\nfloat texture_v"), Shown(is_textured)),
    ("texture_s texture_t", placed("double texture_s\ndouble texture_t"), Shown(is_textured)),
    (
        "face colours",
        File { face: RGB, faces: [RED, GREEN], ..PLAIN },
        Shown(|s| {
            let colors = &s.meshes[0].colors;
            colors.len() == 6
                && colors[0] == Vec4::new(1., 0., 0., 1.)
                && colors[5] == Vec4::new(0., 1., 0., 1.)
        }),
    ),
    (
        "equal face colours",
        File { face: RGB, faces: [RED, RED], ..PLAIN },
        Shown(|s| s.meshes[0].colors == [Vec4::new(1., 0., 0., 1.); 4]),
    ),
    (
        "face normals",
        face("float nx\nfloat ny\nfloat nz", "1 0 0"),
        Shown(|s| s.meshes[0].normals[0] == Vec3::X),
    ),
    (
        "texcoord and texnumber",
        File {
            comments: "comment TextureFile red.png\ncomment TextureFile the green.png\n",
            face: "list uchar float texcoord\nint texnumber",
            faces: ["6 0 0 1 0.25 1 1 0", "6 0 0 1 1 0 1 1"],
            ..PLAIN
        },
        Shown(|s| {
            is_textured(s)
                && s.textures.len() == 2
                && s.textures[1].rgba[..2] == [0, 255]
                && s.meshes.len() == 2
        }),
    ),
    (
        "texcoord without a picture",
        face("list uchar float texcoord", "6 0 0 1 0 1 1"),
        Shown(|s| s.meshes[0].uvs.len() == 5 && s.materials[0].base_color_texture.is_none()),
    ),
    (
        "a picture without coordinates",
        File { comments: "comment TextureFile red.png\n", ..PLAIN },
        Warned("no texture coordinates"),
    ),
    (
        "a lost picture",
        File { comments: "comment TextureFile none.png\n", ..PLAIN },
        Warned("no texture coordinates"),
    ),
    (
        "tristrips",
        element("element tristrips 1\nproperty list int int vertex_indices\n", "4 0 1 3 2\n"),
        Shown(|s| s.triangles() == 4),
    ),
    (
        "tristrips with restarts",
        element("element tristrips 1\nproperty list int int vertex_indices\n", "8 0 1 3 -1 1 2 3 -1\n"),
        Shown(|s| s.triangles() == 4),
    ),
    (
        "edges",
        element("element edge 1\nproperty int vertex1\nproperty int vertex2\n", "0 1\n"),
        Warned("edge"),
    ),
    ("materials", element("element material 1\nproperty uchar diffuse_red\n", "1\n"), Warned("material")),
    (
        "range_grid",
        element("element range_grid 1\nproperty list uchar int vertex_indices\n", "1 0\n"),
        Warned("range_grid"),
    ),
    ("camera", element("element camera 1\nproperty float view_px\n", "1\n"), NotApplicable),
    ("another element", element("element dust 1\nproperty float x\n", "1\n"), Warned("dust")),
    ("material_index", face("int material_index", "0"), Warned("materials of its faces")),
    (
        "ambient",
        vertex("uchar ambient_red\nuchar ambient_green\nuchar ambient_blue", "1 2 3"),
        Warned("ambient colours"),
    ),
    ("specular", vertex("uchar specular_red", "1"), Warned("specular colours")),
    ("splats", vertex("float f_dc_0\nfloat f_dc_1\nfloat f_rest_0", "1 2 3"), Warned("Gaussian splats")),
    (
        "confidence",
        vertex("float confidence\nfloat intensity\nfloat quality\nfloat scalar_Z", "1 1 1 1"),
        NotApplicable,
    ),
    ("flags", face("int flags\nfloat quality", "1 1"), NotApplicable),
    ("another property", vertex("float wetness", "1"), Warned("wetness")),
];

#[test]
fn every_field_of_ply_is_shown_or_warned_of_or_changes_nothing() {
    let without = PLAIN.load();
    for (what, file, expect) in FIELDS {
        check(what, expect, &file.load(), &without);
    }
}

/// Two triangles of a red and a green face, as vertices of their own.
const TWIN: &str = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\n\
    property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n1 0 0 255 0 0\n1 1 0 255 0 0\n\
    0 0 0 0 255 0\n1 1 0 0 255 0\n0 1 0 0 255 0\n3 0 1 2\n3 3 4 5\n";

#[test]
fn colours_of_faces_look_like_those_of_vertices() {
    let faces = File { face: RGB, faces: [RED, GREEN], ..PLAIN }.load();
    assert!(same(&faces, &load_text(TWIN)));
    assert_eq!(faces.materials[0].base_color, Vec4::ONE, "the colours are the surface's own");
}

#[test]
fn headers_and_orders_of_every_kind_are_the_same_mesh() {
    let twin = load_text(TWIN);
    let header = "element vertex 6\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n\
        property uchar green\nproperty uchar blue\n";
    let faces_header = "element face 2\nproperty list uchar int vertex_indices\n";
    let (rows, faces) = TWIN
        .split_once("end_header\n")
        .unwrap()
        .1
        .split_at(TWIN.split_once("end_header\n").unwrap().1.find("3 0 1 2").unwrap());
    let faces_first = format!("ply\nformat ascii 1.0\n{faces_header}{header}end_header\n{faces}{rows}");
    let latin = TWIN.replace("element vertex", "comment aufgenommen in M@nchen\nelement vertex");
    let latin: Vec<u8> = latin.bytes().map(|byte| if byte == b'@' { 0xfc } else { byte }).collect();
    let mark = "\u{feff}";
    for (what, bytes) in [
        ("faces first", faces_first.into_bytes()),
        ("Latin-1", latin),
        ("CR", TWIN.replace('\n', "\r").into_bytes()),
        ("CRLF", TWIN.replace('\n', "\r\n").into_bytes()),
        ("a mark before the header", format!("{mark}{TWIN}").into_bytes()),
        ("a mark before the data", TWIN.replace("end_header\n", &format!("end_header\n{mark}")).into_bytes()),
        ("vertex_index", TWIN.replace("vertex_indices", "vertex_index").into_bytes()),
    ] {
        let scene = load(&[("a.ply", &bytes)]);
        assert!(scene.warnings.is_empty(), "{what}: {:?}", scene.warnings);
        assert_eq!(corners(&scene), corners(&twin), "{what}");
    }
}

#[test]
fn binary_data_that_begins_with_a_line_feed_is_read_after_every_line_end() {
    for line_end in ["\n", "\r", "\r\n"] {
        let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty uchar x\nproperty uchar y\n\
            property uchar z\nelement face 1\nproperty list uchar uchar vertex_indices\nend_header\n";
        let mut bytes = header.replace('\n', line_end).into_bytes();
        bytes.extend([10, 0, 0, 0, 10, 0, 0, 0, 10, 3, 0, 1, 2]);
        let scene = load(&[("a.ply", &bytes)]);
        assert_eq!(
            (scene.triangles(), scene.bounds().max.x),
            (1, 10.0),
            "{line_end:?}: {:?}",
            scene.warnings
        );
    }
}

#[test]
fn points_are_said_not_to_be_drawn() {
    let points = TWIN.split("element face").next().unwrap().to_owned()
        + "end_header\n"
        + TWIN.split_once("end_header\n").unwrap().1;
    let scene = load_text(&points);
    assert!(
        scene.warnings.iter().any(|line| line.contains("6 points without faces")),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn a_lost_texture_leaves_a_grey_surface_and_a_number_out_of_range_is_told() {
    let lost = File { comments: "comment TextureFile none.png\n", ..placed("float s\nfloat t") }.load();
    assert_eq!((lost.materials[0].base_color.x, lost.warnings.len()), (0.8, 1), "{:?}", lost.warnings);
    assert!(lost.warnings[0].contains("none.png"));
    let wild = File { face: "int texnumber", faces: ["0", "7"], ..placed("float s\nfloat t") }.load();
    assert!(
        wild.warnings.len() == 1 && wild.warnings[0].contains("1 faces with a number"),
        "{:?}",
        wild.warnings
    );
}

#[test]
fn alpha_that_is_zero_everywhere_was_never_set() {
    let scene = vertex("uchar red\nuchar green\nuchar blue\nuchar alpha", "255 0 0 0").load();
    assert_eq!((scene.materials[0].alpha, scene.meshes[0].colors[0].w), (AlphaMode::Opaque, 1.0));
    assert!(scene.warnings.len() == 1 && scene.warnings[0].contains("alpha"), "{:?}", scene.warnings);
}
