//! PLY: ASCII and binary of either byte order.
//!
//! The data is read in one pass without trusting the header's counts: nothing is allocated for an element before its
//! bytes have been read.

mod data;

use bytes::Bytes;
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};

use super::bundle::Bundle;
use super::geometry::{MissingNormals, RawMesh, about_an_origin};
use super::polygon::triangulate;
use super::{Parts, Warnings};
use crate::Material;
use crate::scene::Instance;
use crate::tone::linear_from_srgb;
use data::{Element, Values, header};

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
    if let Some(mesh) = raw.finish(MissingNormals::Smooth, None, warnings) {
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
        // Scanners and paint programs write display values.
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
