//! PLY: ASCII and binary of either byte order.
//!
//! Read in one pass over the bytes, without trusting the header's counts: nothing is allocated for an
//! element before its bytes have been seen.

use bytes::Bytes;
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};

use super::bundle::Bundle;
use super::geometry::{MissingNormals, RawMesh, about_an_origin};
use super::polygon::triangulate;
use super::{Parts, Warnings};
use crate::Material;
use crate::scene::Instance;
use crate::tone::linear_from_srgb;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(word: &str) -> Result<Self, String> {
        Ok(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return Err(format!("unknown type {word:?} in its header")),
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Largest value of an integer type, by which colours are divided; 1 for floats.
    fn unit(self) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32767.0,
            Self::U16 => 65535.0,
            Self::I32 => f64::from(i32::MAX),
            Self::U32 => f64::from(u32::MAX),
            Self::F32 | Self::F64 => 1.0,
        }
    }
}

#[derive(Debug)]
struct Property {
    name: String,
    scalar: Scalar,
    /// The type of the count, where the property is a list.
    list: Option<Scalar>,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl Element {
    fn find(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| p.list.is_none() && names.contains(&p.name.as_str()))
    }
}

/// The header, and where the data begins.
fn header(bytes: &[u8]) -> Result<(Encoding, Vec<Element>, usize), String> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut at = 0;
    loop {
        let rest = bytes.get(at..).filter(|rest| !rest.is_empty()).ok_or("its header does not end")?;
        let end = rest.iter().position(|&b| b == b'\n' || b == b'\r').ok_or("its header does not end")?;
        let line = std::str::from_utf8(&rest[..end]).map_err(|_| "its header is not text")?;
        at += end + if rest[end..].starts_with(b"\r\n") { 2 } else { 1 };
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["end_header"] => break,
            ["format", kind, _] => {
                encoding = Some(match *kind {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    other => return Err(format!("unknown format {other:?}")),
                });
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| format!("element {name:?} has no count"))?;
                elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
            }
            ["property", "list", count, scalar, name] => {
                let (list, scalar) = (Some(Scalar::parse(count)?), Scalar::parse(scalar)?);
                let element = elements.last_mut().ok_or("a property before any element")?;
                element.properties.push(Property { name: (*name).to_owned(), scalar, list });
            }
            ["property", scalar, name] => {
                let scalar = Scalar::parse(scalar)?;
                let element = elements.last_mut().ok_or("a property before any element")?;
                element.properties.push(Property { name: (*name).to_owned(), scalar, list: None });
            }
            ["ply"] | ["comment" | "obj_info", ..] | [] => {}
            _ => return Err(format!("{:?} in its header", super::error::one_line(line))),
        }
    }
    Ok((encoding.ok_or("its header names no format")?, elements, at))
}

/// The values of a file's data, one after the other.
struct Values<'a> {
    rest: &'a [u8],
    encoding: Encoding,
}

impl Values<'_> {
    fn next(&mut self, scalar: Scalar) -> Result<f64, String> {
        let cut_short = || "the file is cut short".to_owned();
        if self.encoding == Encoding::Ascii {
            let start = self.rest.iter().position(|b| !b.is_ascii_whitespace()).ok_or_else(cut_short)?;
            let rest = &self.rest[start..];
            let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
            self.rest = &rest[end..];
            let word = std::str::from_utf8(&rest[..end]).ok();
            return word.and_then(|word| word.parse().ok()).ok_or_else(|| {
                format!("{:?} is no number", super::error::one_line(&String::from_utf8_lossy(&rest[..end])))
            });
        }
        let size = scalar.size();
        if self.rest.len() < size {
            return Err(cut_short());
        }
        let (value, rest) = self.rest.split_at(size);
        self.rest = rest;
        let mut bytes = [0; 8];
        bytes[..size].copy_from_slice(value);
        if self.encoding == Encoding::Big {
            bytes[..size].reverse();
        }
        let [a, b, c, d, ..] = bytes;
        Ok(match scalar {
            Scalar::I8 => f64::from(a as i8),
            Scalar::U8 => f64::from(a),
            Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
            Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
            Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Scalar::F64 => f64::from_le_bytes(bytes),
        })
    }

    /// A whole property: its value, or the last of a list's, whose values go to `list`.
    fn property(&mut self, property: &Property, list: &mut Vec<f64>) -> Result<f64, String> {
        let Some(count_type) = property.list else { return self.next(property.scalar) };
        let count = self.next(count_type)?;
        if !(count >= 0.0) || count.fract() != 0.0 {
            return Err(format!("a list of {count} values"));
        }
        list.clear();
        let mut left = count as u64;
        while left > 0 {
            list.push(self.next(property.scalar)?);
            left -= 1;
        }
        Ok(count)
    }
}

#[derive(Default)]
struct Content {
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    colors: Vec<Vec4>,
    indices: Vec<u32>,
    bad_faces: usize,
}

/// Reads a PLY file: one mesh, one grey material.
pub(super) fn load(bundle: &Bundle, warnings: &mut Warnings) -> Result<Parts, String> {
    let content = parse(bundle.main_bytes(), warnings)?;
    if content.bad_faces > 0 {
        let count = content.bad_faces;
        warnings.add(format!(
            "{count} faces with fewer than three corners or vertices that do not exist: dropped"
        ));
    }
    let (origin, positions) = about_an_origin(&content.positions);
    let raw = RawMesh {
        origin,
        positions,
        normals: content.normals,
        uvs: content.uvs,
        colors: content.colors,
        indices: content.indices,
        ..RawMesh::default()
    };
    let mut parts = Parts { materials: vec![Material::default()], ..Parts::default() };
    if let Some(mesh) = raw.finish(MissingNormals::Smooth, false, warnings) {
        parts.meshes.push(mesh);
        parts.instances.push(Instance { mesh: 0, node: None, world_from_mesh: DAffine3::IDENTITY });
    }
    Ok(parts)
}

fn parse(bytes: &Bytes, warnings: &mut Warnings) -> Result<Content, String> {
    let (encoding, elements, start) = header(bytes)?;
    let mut values = Values { rest: &bytes[start..], encoding };
    let mut content = Content::default();
    for element in &elements {
        if element.properties.is_empty() {
            continue;
        }
        match element.name.as_str() {
            "vertex" => vertices(element, &mut values, &mut content)?,
            "face" => faces(element, &mut values, &mut content)?,
            name => {
                if name == "tristrips" {
                    warnings.add("triangle strips are not supported: left out");
                }
                skip(element, &mut values)?;
            }
        }
    }
    Ok(content)
}

fn skip(element: &Element, values: &mut Values) -> Result<(), String> {
    let mut list = Vec::new();
    for _ in 0..element.count {
        for property in &element.properties {
            values.property(property, &mut list)?;
        }
    }
    Ok(())
}

fn vertices(element: &Element, values: &mut Values, content: &mut Content) -> Result<(), String> {
    let find = |names: &[&str]| element.find(names);
    let all = |indices: [Option<usize>; 3]| match indices {
        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
        _ => None,
    };
    let position =
        all([find(&["x"]), find(&["y"]), find(&["z"])]).ok_or("its vertices have no x, y and z")?;
    let normal = all([find(&["nx"]), find(&["ny"]), find(&["nz"])]);
    let color = all([
        find(&["red", "r", "diffuse_red"]),
        find(&["green", "g", "diffuse_green"]),
        find(&["blue", "b", "diffuse_blue"]),
    ]);
    let alpha = find(&["alpha", "a"]);
    let uv = find(&["s", "u", "texture_u"]).zip(find(&["t", "v", "texture_v"]));
    let mut row = vec![0.0; element.properties.len()];
    let mut list = Vec::new();
    for _ in 0..element.count {
        for (value, property) in row.iter_mut().zip(&element.properties) {
            *value = values.property(property, &mut list)?;
        }
        let vector = |[x, y, z]: [usize; 3]| DVec3::new(row[x], row[y], row[z]);
        content.positions.push(vector(position));
        content.normals.extend(normal.map(|normal| vector(normal).as_vec3()));
        content.uvs.extend(uv.map(|(u, v)| Vec2::new(row[u] as f32, 1.0 - row[v] as f32)));
        let unit = |i: usize| (row[i] / element.properties[i].scalar.unit()) as f32;
        // Scanners and painters write what they see on a screen.
        content.colors.extend(color.map(|rgb| {
            let [r, g, b] = rgb.map(|i| linear_from_srgb(unit(i).clamp(0.0, 1.0)));
            Vec4::new(r, g, b, alpha.map_or(1.0, unit))
        }));
    }
    Ok(())
}

fn faces(element: &Element, values: &mut Values, content: &mut Content) -> Result<(), String> {
    let names = ["vertex_indices", "vertex_index"];
    let indices =
        element.properties.iter().position(|p| p.list.is_some() && names.contains(&p.name.as_str()));
    let indices = indices.ok_or("its faces have no list of vertex_indices")?;
    let (mut list, mut face, mut outline) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..element.count {
        for (i, property) in element.properties.iter().enumerate() {
            values.property(property, if i == indices { &mut face } else { &mut list })?;
        }
        let count = content.positions.len();
        let valid = |&i: &f64| i >= 0.0 && i < count as f64 && i.fract() == 0.0;
        if face.len() < 3 || !face.iter().all(valid) {
            content.bad_faces += 1;
            continue;
        }
        outline.clear();
        outline.extend(face.iter().map(|&i| content.positions[i as usize]));
        let corners = &mut content.indices;
        triangulate(&outline, |triangle| corners.extend(triangle.map(|k| face[k] as u32)));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Result<Content, String> {
        parse(&Bytes::copy_from_slice(bytes), &mut Warnings::default())
    }

    const HEADER: &str = "comment made by hand\nelement vertex 4\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar confidence\nelement face 2\nproperty list uchar int vertex_indices\n\
        property list uchar float other\nend_header\n";

    #[test]
    fn ascii_and_both_byte_orders_give_the_same_mesh() {
        let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let ascii = format!(
            "ply\nformat ascii 1.0\n{HEADER}0 0 0 1\n1 0 0 2\n1 1 0 3\n0 1 0 4\n4 0 1 2 3 1 .5\n3 0 1 2 0\n"
        );
        let binary = |little: bool| {
            let kind = if little { "binary_little_endian" } else { "binary_big_endian" };
            let mut bytes = format!("ply\nformat {kind} 1.0\n{HEADER}").into_bytes();
            let word = |bits: u32| if little { bits.to_le_bytes() } else { bits.to_be_bytes() };
            for corner in corners {
                corner.iter().for_each(|x| bytes.extend(word(x.to_bits())));
                bytes.push(7);
            }
            for (face, others) in [(&[0u32, 1, 2, 3][..], 1u8), (&[0, 1, 2], 0)] {
                bytes.push(face.len() as u8);
                face.iter().for_each(|&i| bytes.extend(word(i)));
                bytes.push(others);
                (0..others).for_each(|_| bytes.extend(word(0.5f32.to_bits())));
            }
            bytes
        };
        for bytes in [ascii.into_bytes(), binary(true), binary(false)] {
            let content = read(&bytes).unwrap();
            assert_eq!(content.positions.len(), 4);
            assert_eq!(content.positions[2], DVec3::new(1.0, 1.0, 0.0));
            assert_eq!(content.indices, [0, 1, 2, 0, 2, 3, 0, 1, 2]);
        }
    }

    #[test]
    fn counts_that_the_file_cannot_hold_cost_nothing() {
        let huge = "ply\nformat binary_little_endian 1.0\nelement vertex 18446744073709551615\nproperty float x\n\
            property float y\nproperty float z\nend_header\n1234";
        assert!(read(huge.as_bytes()).err().unwrap().contains("cut short"));
        let list = "ply\nformat ascii 1.0\nelement face 1\nproperty list uint int vertex_indices\nend_header\n4e9 1 2";
        assert!(read(list.as_bytes()).err().unwrap().contains("cut short"));
        let nothing = "ply\nformat ascii 1.0\nelement dust 18446744073709551615\nend_header\n";
        assert!(read(nothing.as_bytes()).unwrap().positions.is_empty());
    }

    #[test]
    fn broken_headers_are_named() {
        for (text, reason) in [
            ("ply\n", "does not end"),
            ("ply\nend_header\n", "no format"),
            ("ply\nformat ascii 1.0\nproperty float x\nend_header\n", "before any element"),
            ("ply\nformat ascii 1.0\nelement vertex x\nend_header\n", "no count"),
            ("ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\nend_header\n1\n", "unknown type"),
            ("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "no x, y and z"),
            ("ply\nformat middle 1.0\nend_header\n", "unknown format"),
        ] {
            let error = read(text.as_bytes()).err().unwrap();
            assert!(error.contains(reason), "{text:?}: {error}");
        }
    }

    #[test]
    fn faces_with_bad_indices_are_counted_and_dropped() {
        let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
            element face 4\nproperty list int int vertex_index\nend_header\n\
            0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 3\n3 0 1 -1\n2 0 1\n";
        let content = read(text.as_bytes()).unwrap();
        assert_eq!((content.indices.len(), content.bad_faces), (3, 3));
    }
}
