//! Reads the elements of a PLY file. Faces may come before their vertices, so that nothing is looked up here.

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::data::{Element, Property, Values};
use crate::load::parts::Warnings;
use crate::tone::linear_from_srgb;

/// Names of texture coordinates, in pairs.
const UVS: [[&str; 2]; 8] = [
    ["u", "v"],
    ["s", "t"],
    ["texture_u", "texture_v"],
    ["texture_s", "texture_t"],
    ["tex_u", "tex_v"],
    ["tu", "tv"],
    ["u0", "v0"],
    ["s0", "t0"],
];
/// Names of a face's list of texture coordinates, two for each corner.
const CORNER_UVS: [&str; 3] = ["texcoord", "texcoords", "uv"];
/// Names of the number of an image.
const TEXTURE: [&str; 3] = ["texnumber", "texture_number", "texture_index"];
/// Names of the lists of a face's or a strip's vertices.
const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Properties that are measured or computed, and do not change the picture.
const NOT_VISIBLE: [&str; 16] = [
    "confidence",
    "intensity",
    "quality",
    "flags",
    "curvature",
    "label",
    "class",
    "classification",
    "segment",
    "group",
    "radius",
    "value",
    "timestamp",
    "time",
    "id",
    "error",
];
/// Beginnings of names of such properties.
const NOT_VISIBLE_PREFIXES: [&str; 3] = ["scalar_", "quality_", "principal_"];
/// Beginnings of names of properties that change how a surface looks, and are not shown.
const NOT_SHOWN: [(&str, &str); 8] = [
    ("ambient", "ambient colours"),
    ("specular", "specular colours"),
    ("emissive", "emission"),
    ("diffuse_coeff", "diffuse coefficients"),
    ("diffuse_power", "diffuse coefficients"),
    ("material", "materials"),
    ("f_dc_", "Gaussian splats"),
    ("f_rest_", "Gaussian splats"),
];

/// Colours as written, and what is needed to scale them.
#[derive(Default)]
pub(super) struct Colors {
    values: Vec<Vec4>,
    has_alpha: bool,
    color: Range,
    alpha: Range,
}

#[derive(Default, Clone, Copy)]
struct Range {
    is_float: bool,
    most: f32,
}

impl Range {
    /// The value of white. Integers go to the largest value of as many bits as they need; floats to 1, but some programs
    /// write bytes as floats.
    fn unit(self) -> f32 {
        match self.most {
            most if self.is_float && most <= 1.5 => 1.0,
            ..=255.0 => 255.0,
            ..=65535.0 => 65535.0,
            most => most,
        }
    }
}

impl Colors {
    pub(super) fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Linear colours: scanners and paint programs write display values. The second value says whether some are partly
    /// transparent; alpha that is zero everywhere was never set.
    pub(super) fn linear(&self, warnings: &mut Warnings) -> (Vec<Vec4>, bool) {
        let (color, alpha) = (self.color.unit(), self.alpha.unit());
        let unset = self.has_alpha && self.alpha.most <= 0.0;
        if unset {
            warnings.add("the alpha of all of its colours is zero: shown opaque");
        }
        let linear = |value: &Vec4| {
            let [r, g, b] =
                [value.x, value.y, value.z].map(|x| linear_from_srgb((x / color).clamp(0.0, 1.0)));
            let opaque = unset || !self.has_alpha || !value.w.is_finite();
            Vec4::new(r, g, b, if opaque { 1.0 } else { (value.w / alpha).clamp(0.0, 1.0) })
        };
        let colors: Vec<Vec4> = self.values.iter().map(linear).collect();
        let blends = colors.iter().any(|color| color.w < 0.999);
        (colors, blends)
    }
}

/// Reads colours from rows of an element.
struct ColorReader {
    rgb: [usize; 3],
    alpha: Option<usize>,
}

impl ColorReader {
    fn of(element: &Element, colors: &mut Colors) -> Option<Self> {
        let rgb = element.find_three([
            &["red", "r", "diffuse_red", "diffuse_r"],
            &["green", "g", "diffuse_green", "diffuse_g"],
            &["blue", "b", "diffuse_blue", "diffuse_b"],
        ])?;
        let alpha = element.find(&["alpha", "a", "diffuse_alpha"]);
        let is_float = |i: usize| element.properties[i].scalar.is_float();
        colors.has_alpha = alpha.is_some();
        colors.color.is_float = rgb.into_iter().any(is_float);
        colors.alpha.is_float = alpha.is_some_and(is_float);
        Some(Self { rgb, alpha })
    }

    fn read(&self, row: &[f64], element: &Element, colors: &mut Colors) {
        // A signed byte holds an unsigned one.
        let value = |i: usize| match row[i] {
            x if x < 0.0 && !element.properties[i].scalar.is_float() && x >= -128.0 => x as f32 + 256.0,
            x => x as f32,
        };
        let [r, g, b] = self.rgb.map(value);
        let a = self.alpha.map_or(1.0, value);
        for x in [r, g, b] {
            colors.color.most = colors.color.most.max(x);
        }
        colors.alpha.most = colors.alpha.most.max(a);
        colors.values.push(Vec4::new(r, g, b, a));
    }
}

/// Vertices by column.
#[derive(Default)]
pub(super) struct Vertices {
    pub(super) positions: Vec<DVec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) uvs: Vec<Vec2>,
    pub(super) colors: Colors,
    /// Numbers of images.
    pub(super) textures: Vec<i32>,
}

/// Polygons by column. Every column but the first two is empty, or has a value for each face.
#[derive(Default)]
pub(super) struct Faces {
    /// Numbers of corners, at least three.
    pub(super) corners: Vec<u32>,
    /// Vertices of all corners; `u32::MAX` for one that no file can have.
    pub(super) indices: Vec<u32>,
    pub(super) normals: Vec<Vec3>,
    pub(super) colors: Colors,
    pub(super) textures: Vec<i32>,
    /// Texture coordinates of all corners, or empty; NaN where a face has none.
    pub(super) uvs: Vec<Vec2>,
    pub(super) bad: usize,
}

/// The vertex of an index as it is written.
fn index(value: f64) -> u32 {
    let valid = value >= 0.0 && value < f64::from(u32::MAX) && value.fract() == 0.0;
    if valid { value as u32 } else { u32::MAX }
}

fn vector(row: &[f64], columns: [usize; 3]) -> DVec3 {
    DVec3::from(columns.map(|i| row[i]))
}

/// In PLY, v points up the image; in the vocabulary it points down.
fn uv(u: f64, v: f64) -> Vec2 {
    Vec2::new(u as f32, 1.0 - v as f32)
}

pub(super) fn vertices(element: &Element, values: &mut Values, to: &mut Vertices) -> Result<(), String> {
    let position = element.find_three([&["x"], &["y"], &["z"]]).ok_or("its vertices have no x, y and z")?;
    let normal = element.find_three([&["nx", "normal_x"], &["ny", "normal_y"], &["nz", "normal_z"]]);
    let uvs = UVS.iter().find_map(|[u, v]| element.find(&[u]).zip(element.find(&[v])));
    let color = ColorReader::of(element, &mut to.colors);
    let texture = element.find(&TEXTURE);
    let (mut row, mut list) = (vec![0.0; element.properties.len()], Vec::new());
    for _ in 0..element.count {
        for (value, property) in row.iter_mut().zip(&element.properties) {
            *value = values.property(property, &mut list)?;
        }
        to.positions.push(vector(&row, position));
        to.normals.extend(normal.map(|normal| vector(&row, normal).as_vec3()));
        to.uvs.extend(uvs.map(|(u, v)| uv(row[u], row[v])));
        to.textures.extend(texture.map(|i| row[i] as i32));
        if let Some(color) = &color {
            color.read(&row, element, &mut to.colors);
        }
    }
    Ok(())
}

pub(super) fn faces(element: &Element, values: &mut Values, to: &mut Faces) -> Result<(), String> {
    let unnamed = || {
        let is_list = |p: &Property| p.list.is_some() && !p.scalar.is_float();
        element.properties.iter().position(is_list)
    };
    let indices = element.find_list(&INDICES).or_else(unnamed);
    let indices = indices.ok_or("its faces have no list of vertex_indices")?;
    let corner_uvs = element.find_list(&CORNER_UVS);
    let normal = element.find_three([&["nx", "normal_x"], &["ny", "normal_y"], &["nz", "normal_z"]]);
    let color = ColorReader::of(element, &mut to.colors);
    let texture = element.find(&TEXTURE);
    let mut row = vec![0.0; element.properties.len()];
    let (mut list, mut face, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..element.count {
        for (i, (value, property)) in row.iter_mut().zip(&element.properties).enumerate() {
            let into = if i == indices {
                &mut face
            } else if Some(i) == corner_uvs {
                &mut uvs
            } else {
                &mut list
            };
            *value = values.property(property, into)?;
        }
        if face.len() < 3 || face.len() > u32::MAX as usize {
            to.bad += 1;
            continue;
        }
        to.corners.push(face.len() as u32);
        to.indices.extend(face.iter().map(|&value| index(value)));
        to.normals.extend(normal.map(|normal| vector(&row, normal).as_vec3()));
        to.textures.extend(texture.map(|i| row[i] as i32));
        if let Some(color) = &color {
            color.read(&row, element, &mut to.colors);
        }
        if corner_uvs.is_some() {
            let mut pairs = uvs.chunks_exact(2).map(|pair| uv(pair[0], pair[1]));
            to.uvs.extend(face.iter().map(|_| pairs.next().unwrap_or(Vec2::NAN)));
        }
    }
    Ok(())
}

/// Reads triangle strips as faces. A negative index begins a new strip; every second triangle is turned over.
pub(super) fn strips(element: &Element, values: &mut Values, to: &mut Faces) -> Result<(), String> {
    let indices = element.find_list(&INDICES).ok_or("its tristrips have no list of vertex_indices")?;
    let (mut list, mut strip) = (Vec::new(), Vec::new());
    for _ in 0..element.count {
        for (i, property) in element.properties.iter().enumerate() {
            values.property(property, if i == indices { &mut strip } else { &mut list })?;
        }
        for part in strip.split(|&value| value < 0.0) {
            for (i, corners) in part.windows(3).enumerate() {
                let [a, b, c] = [corners[0], corners[1], corners[2]].map(index);
                // A vertex that is repeated joins two strips.
                if a != b && b != c && c != a {
                    to.corners.push(3);
                    to.indices.extend(if i % 2 == 0 { [a, b, c] } else { [b, a, c] });
                }
            }
        }
    }
    Ok(())
}

/// Reads past an element.
pub(super) fn skip(element: &Element, values: &mut Values) -> Result<(), String> {
    let mut list = Vec::new();
    for _ in 0..element.count {
        for property in &element.properties {
            values.property(property, &mut list)?;
        }
    }
    Ok(())
}

/// Warns of properties that the picture lacks. `of` says whose they are.
pub(super) fn warn_of_properties(element: &Element, of: &str, warnings: &mut Warnings) {
    let is_read = |name: &str, is_list: bool| {
        let uvs = UVS.iter().flatten().any(|uv| *uv == name);
        let lists = INDICES.contains(&name) || CORNER_UVS.contains(&name);
        let scalars = ["x", "y", "z", "nx", "ny", "nz", "normal_x", "normal_y", "normal_z"].contains(&name);
        let colors = ["red", "green", "blue", "alpha", "r", "g", "b", "a"];
        let diffuse = name.strip_prefix("diffuse_").unwrap_or(name);
        if is_list { lists } else { uvs || scalars || colors.contains(&diffuse) || TEXTURE.contains(&name) }
    };
    let mut lacking: Vec<&str> = Vec::new();
    let mut unknown: Vec<&str> = Vec::new();
    for property in &element.properties {
        let name = property.name.as_str();
        let known = NOT_SHOWN.iter().find(|(prefix, _)| name.starts_with(prefix));
        match known {
            Some((_, what)) if !lacking.contains(what) => lacking.push(what),
            Some(_) => {}
            None if is_read(name, property.list.is_some())
                || NOT_VISIBLE.contains(&name)
                || NOT_VISIBLE_PREFIXES.iter().any(|prefix| name.starts_with(prefix)) => {}
            None => unknown.push(name),
        }
    }
    for what in lacking {
        warnings.add(format!("{what} of {of} are not shown"));
    }
    if !unknown.is_empty() {
        warnings.add(format!("properties of {of} that are not known are not shown: {}", unknown.join(", ")));
    }
}
