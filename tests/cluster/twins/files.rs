//! Small scene files that tests make: glTF binaries from parts, and text files.

use std::fmt::Write as _;
use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, Rgba, RgbaImage};
use serde_json::{Value, json};

/// Numbers of glTF component types.
const FLOAT: u32 = 5126;
const UNSIGNED: u32 = 5125;

/// A glTF file in the making.
pub(super) struct Glb {
    pub(super) json: Value,
    bytes: Vec<u8>,
}

impl Glb {
    pub(super) fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [] }], "nodes": [], "meshes": [],
            "materials": [], "accessors": [], "bufferViews": [], "images": [], "samplers": [], "textures": [],
        });
        Self { json, bytes: Vec::new() }
    }

    /// Appends to a list of the file; returns the index.
    pub(super) fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json[list].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let begin = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.push("bufferViews", json!({ "buffer": 0, "byteOffset": begin, "byteLength": bytes.len() }))
    }

    fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let bound = |pick: fn(f32, f32) -> f32, from: f32| -> Vec<f32> {
            (0..N).map(|axis| values.iter().map(|value| value[axis]).fold(from, pick)).collect()
        };
        let (min, max) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
        let kind = format!("VEC{N}");
        self.push(
            "accessors",
            json!({
                "bufferView": view, "componentType": FLOAT, "count": values.len(), "type": kind, "min": min, "max": max
            }),
        )
    }

    /// Adds quads of one mesh, each of four corners counter-clockwise, with attributes by corner.
    pub(super) fn quads(
        &mut self,
        quads: &[[[f32; 3]; 4]],
        more: &[(&str, Attribute)],
        material: usize,
    ) -> usize {
        let positions = self.floats(quads.as_flattened());
        let indices: Vec<u8> = (0..quads.len() as u32)
            .flat_map(|quad| [0, 1, 2, 0, 2, 3].map(|corner| 4 * quad + corner))
            .flat_map(u32::to_le_bytes)
            .collect();
        let view = self.view(&indices);
        let count = indices.len() / 4;
        let indices = self.push(
            "accessors",
            json!({ "bufferView": view, "componentType": UNSIGNED, "count": count, "type": "SCALAR" }),
        );
        let mut attributes = json!({ "POSITION": positions });
        for (name, attribute) in more {
            attributes[*name] = match attribute {
                Attribute::Uv(values) => self.floats(values),
                Attribute::Color(values) => self.floats(values),
            }
            .into();
        }
        let primitive = json!({ "attributes": attributes, "indices": indices, "material": material });
        self.push("meshes", json!({ "primitives": [primitive] }))
    }

    /// Adds a node to the scene, with these properties.
    pub(super) fn place(&mut self, mesh: usize, more: Value) {
        let mut node = json!({ "mesh": mesh });
        node.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let node = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(node.into());
    }

    /// Adds a matt material of one colour.
    pub(super) fn matt(&mut self, color: [f32; 3]) -> usize {
        let [r, g, b] = color;
        let factors = json!({ "baseColorFactor": [r, g, b, 1], "metallicFactor": 0, "roughnessFactor": 1 });
        self.push("materials", json!({ "pbrMetallicRoughness": factors }))
    }

    /// Adds a texture of an image, read by a sampler with these properties.
    pub(super) fn texture(&mut self, image: &RgbaImage, sampler: Value) -> usize {
        let view = self.view(&png(image));
        let source = self.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
        let sampler = self.push("samplers", sampler);
        self.push("textures", json!({ "source": source, "sampler": sampler }))
    }

    /// Writes the file. Lists that are empty are left out, as the format demands.
    pub(super) fn write(mut self, path: &Path) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.json["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        self.json
            .as_object_mut()
            .unwrap()
            .retain(|_, value| value.as_array().is_none_or(|list| !list.is_empty()));
        let mut json = self.json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut file = b"glTF".to_vec();
        let length = 12 + 8 + json.len() + 8 + self.bytes.len();
        for word in [2, length as u32, json.len() as u32, 0x4e4f_534a] {
            file.extend(word.to_le_bytes());
        }
        file.extend(json);
        for word in [self.bytes.len() as u32, 0x004e_4942] {
            file.extend(word.to_le_bytes());
        }
        file.extend(self.bytes);
        std::fs::write(path, file).unwrap();
    }
}

/// Values of each corner of each quad.
pub(super) enum Attribute {
    Uv(Vec<[f32; 2]>),
    Color(Vec<[f32; 4]>),
}

/// The corners of a quad on a texture whose v points down.
pub(super) const WHOLE: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

/// An upright quad that faces +z.
pub(super) fn upright([left, bottom]: [f32; 2], [width, height]: [f32; 2], z: f32) -> [[f32; 3]; 4] {
    let (right, top) = (left + width, bottom + height);
    [[left, bottom, z], [right, bottom, z], [right, top, z], [left, top, z]]
}

/// A level quad that faces up.
pub(super) fn ground(half: f32) -> [[f32; 3]; 4] {
    [[-half, 0.0, half], [half, 0.0, half], [half, 0.0, -half], [-half, 0.0, -half]]
}

/// The sides and the top of a box that stands on y = 0.
pub(super) fn cube(half: f32) -> Vec<[[f32; 3]; 4]> {
    let side = upright([-half, 0.0], [2.0 * half, 2.0 * half], half);
    let turned = |turn: fn([f32; 3]) -> [f32; 3]| side.map(turn);
    vec![
        side,
        turned(|[x, y, z]| [z, y, -x]),
        turned(|[x, y, z]| [-x, y, -z]),
        turned(|[x, y, z]| [-z, y, x]),
        ground(half).map(|[x, _, z]| [x, 2.0 * half, z]),
    ]
}

/// A PNG file.
pub(super) fn png(image: &RgbaImage) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// An image of squares in these colours, row by row.
pub(super) fn squares(colors: &[[u8; 4]], columns: u32, side: u32) -> RgbaImage {
    let rows = colors.len() as u32 / columns;
    RgbaImage::from_fn(columns * side, rows * side, |x, y| {
        Rgba(colors[(y / side * columns + x / side) as usize])
    })
}

/// The vertices and faces of quads in ASCII PLY, a colour for each.
pub(super) struct Ply {
    pub(super) vertices: String,
    pub(super) faces: String,
    pub(super) count: [usize; 2],
}

impl Ply {
    /// `at` says whether vertices or faces have the colours; `None`: neither.
    pub(super) fn new(quads: &[[[f32; 3]; 4]], colors: &[[u8; 3]], at: Option<&str>) -> Self {
        let (mut vertices, mut faces) = (String::new(), String::new());
        for (number, quad) in quads.iter().enumerate() {
            let [r, g, b] = colors[number % colors.len()];
            let color = format!(" {r} {g} {b}");
            let of = |element| if at == Some(element) { color.as_str() } else { "" };
            for [x, y, z] in quad {
                writeln!(vertices, "{x} {y} {z}{}", of("vertex")).unwrap();
            }
            let first = 4 * number;
            writeln!(faces, "4 {first} {} {} {}{}", first + 1, first + 2, first + 3, of("face")).unwrap();
        }
        Self { vertices, faces, count: [4 * quads.len(), quads.len()] }
    }

    /// The lines of the header that declare vertices and faces.
    pub(super) fn elements(&self, at: Option<&str>) -> [String; 2] {
        let color = |element| match at == Some(element) {
            true => "property uchar red\nproperty uchar green\nproperty uchar blue\n",
            false => "",
        };
        let [vertices, faces] = self.count;
        [
            format!(
                "element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n{}",
                color("vertex")
            ),
            format!("element face {faces}\nproperty list uchar int vertex_indices\n{}", color("face")),
        ]
    }
}
