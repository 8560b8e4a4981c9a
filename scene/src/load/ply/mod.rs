//! PLY: ASCII and binary of either byte order.
//!
//! The data is read in one pass without trusting the header's counts: nothing is allocated for an element before its
//! bytes have been read. Elements may come in any order, so faces are kept as they are until all is read.

mod data;
mod elements;

use std::collections::{BTreeMap, BTreeSet, HashMap};

use bytes::Bytes;
use glam::{DAffine3, Vec2, Vec3, Vec4};

use super::geometry::{MissingNormals, RawMesh, about_an_origin};
use super::maps::{Maps, Reading};
use super::parts::{Parts, Warnings};
use super::polygon::triangulate;
use super::scene_files::SceneFiles;
use crate::material::{Filter, Wrap};
use crate::scene::Instance;
use crate::{AlphaMode, Material, TextureRef};
use data::{Element, Values, header};
use elements::{Faces, Vertices, faces, skip, strips, vertices, warn_of_properties};

/// How images of colours are read.
const SRGB: Reading = Reading { srgb: true, wrap: Wrap::Repeat, filter: Filter::Linear };

/// The content of a file.
#[derive(Default)]
struct Content {
    vertices: Vertices,
    faces: Faces,
    /// Triangles of strips.
    strips: Faces,
    /// Images named by comments.
    textures: Vec<String>,
}

/// Names of the images that a file refers to, as they are written.
pub(super) fn textures(bytes: &Bytes) -> BTreeSet<String> {
    // A file without a valid header refers to nothing; the loader says why it has none.
    header(bytes).map(|header| header.textures.into_iter().collect()).unwrap_or_default()
}

/// Reads a PLY file: one mesh and one material for each image that its faces use, and one for faces without an image.
pub(super) fn load(bundle: &SceneFiles, warnings: &mut Warnings) -> Result<Parts, String> {
    let content = parse(bundle.main_bytes(), warnings)?;
    let (origin, positions) = about_an_origin(&content.vertices.positions);
    let meshes = assemble(&content, warnings);
    let file_of = |texture: &Option<usize>| texture.map(|number| bundle.get("", &content.textures[number]));
    let mut files = BTreeMap::new();
    for file in meshes.keys().filter_map(file_of) {
        match file {
            Ok((name, bytes)) => drop(files.insert(name.to_owned(), bytes.clone())),
            Err(reason) => warnings.add(format!("texture {reason}: left out")),
        }
    }
    let mut maps = Maps::decode(files, warnings);
    let mut parts = Parts::default();
    for (texture, Assembled { corners, indices, normals, uvs, colors, blends, .. }) in meshes {
        let file = file_of(&texture).and_then(Result::ok);
        let reference = file.and_then(|(name, _)| maps.plain(name, SRGB)).map(TextureRef::new);
        let white = reference.is_some() || !colors.is_empty();
        let alpha = match reference.map_or(AlphaMode::Opaque, |reference| maps.alpha(reference.texture)) {
            _ if blends => AlphaMode::Blend,
            alpha => alpha,
        };
        let base_color = if white { Vec4::ONE } else { Material::default().base_color };
        let material = parts.materials.len() as u32;
        parts.materials.push(Material {
            base_color,
            base_color_texture: reference,
            alpha,
            ..Material::default()
        });
        let raw = RawMesh {
            origin,
            positions: corners.iter().map(|&vertex| positions[vertex as usize]).collect(),
            normals,
            uvs,
            colors,
            indices,
            material,
            ..RawMesh::default()
        };
        if let Some(mesh) = raw.finish(MissingNormals::Smooth, None, warnings) {
            let mesh_index = parts.meshes.len() as u32;
            parts.meshes.push(mesh);
            parts.instances.push(Instance {
                mesh: mesh_index,
                node: None,
                world_from_mesh: DAffine3::IDENTITY,
            });
        }
    }
    parts.textures = maps.textures;
    Ok(parts)
}

fn parse(bytes: &Bytes, warnings: &mut Warnings) -> Result<Content, String> {
    let header = header(bytes)?;
    let mut values = Values { rest: &bytes[header.start..], encoding: header.encoding };
    let mut content = Content { textures: header.textures, ..Content::default() };
    for element in &header.elements {
        if element.properties.is_empty() || element.count == 0 {
            continue;
        }
        match element.name.as_str() {
            "vertex" => {
                warn_of_properties(element, "its vertices", warnings);
                vertices(element, &mut values, &mut content.vertices)?;
            }
            "face" => {
                warn_of_properties(element, "its faces", warnings);
                faces(element, &mut values, &mut content.faces)?;
            }
            "tristrips" => strips(element, &mut values, &mut content.strips)?,
            _ => {
                warn_of_element(element, warnings);
                skip(element, &mut values)?;
            }
        }
    }
    let Content { vertices, faces, strips, .. } = &content;
    if faces.corners.is_empty() && strips.corners.is_empty() && !vertices.positions.is_empty() {
        warnings.add(format!("{} points without faces: points are not drawn", vertices.positions.len()));
    }
    Ok(content)
}

/// Warns of an element that the picture lacks.
fn warn_of_element(element: &Element, warnings: &mut Warnings) {
    let (count, name) = (element.count, element.name.as_str());
    match name {
        // A viewpoint is chosen for every file.
        "camera" => {}
        "edge" => warnings.add(format!("{count} edges (element edge) are not drawn")),
        "material" => warnings.add(format!("{count} materials (element material) are not shown")),
        "range_grid" => warnings.add("a grid of ranges (element range_grid) is not made into triangles"),
        _ => warnings.add(format!("{count} of the element {name:?}, which is not known, are left out")),
    }
}

/// A mesh whose corners are numbers of vertices.
#[derive(Default)]
struct Assembled {
    corners: Vec<u32>,
    indices: Vec<u32>,
    /// For each corner, or empty; so are the next two.
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    colors: Vec<Vec4>,
    /// Whether some colours are partly transparent.
    blends: bool,
    /// The corner of each vertex, or `u32::MAX`: enough where faces say nothing of their corners.
    by_vertex: Vec<u32>,
    by_corner: HashMap<Corner, u32>,
}

/// A corner that faces share: its vertex, and the bits of what the face says of it.
type Corner = (u32, [u32; 4], [u32; 2], [u32; 3]);

/// Makes the meshes, by the images they show. Faces that agree on all that they say of a vertex share it.
fn assemble(content: &Content, warnings: &mut Warnings) -> BTreeMap<Option<usize>, Assembled> {
    let Content { vertices, faces, strips, textures } = content;
    let count = vertices.positions.len();
    let has_vertex_colors = !vertices.colors.is_empty();
    if has_vertex_colors && !faces.colors.is_empty() {
        warnings.add("colours of its faces are not shown, since its vertices have colours");
    }
    let (mut colors, blends) = match has_vertex_colors {
        true => vertices.colors.linear(warnings),
        false => faces.colors.linear(warnings),
    };
    let face_colors = if has_vertex_colors { Vec::new() } else { std::mem::take(&mut colors) };
    let face_normals = if vertices.normals.is_empty() { &faces.normals[..] } else { &[] };
    let has_colors = !colors.is_empty() || !face_colors.is_empty();
    let has_normals = !vertices.normals.is_empty() || !face_normals.is_empty();
    let has_uvs = !vertices.uvs.is_empty() || !faces.uvs.is_empty();
    if !textures.is_empty() && !has_uvs {
        warnings.add("its textures are not shown: it has no texture coordinates");
    }
    let are_shared =
        face_colors.is_empty() && face_normals.is_empty() && faces.uvs.is_empty() && textures.len() <= 1;
    let mut meshes: BTreeMap<Option<usize>, Assembled> = BTreeMap::new();
    let (mut bad, mut absent) = (faces.bad, 0usize);
    let mut outline = Vec::new();
    for (polygons, is_strip) in [(faces, false), (strips, true)] {
        let mut first = 0;
        for (face, &corners) in polygons.corners.iter().enumerate() {
            let range = first..first + corners as usize;
            first = range.end;
            let indices = &polygons.indices[range.clone()];
            if indices.iter().any(|&vertex| vertex as usize >= count) {
                bad += 1;
                continue;
            }
            let says = |column: &[Vec2]| {
                if is_strip { None } else { column.get(range.clone()).map(<[Vec2]>::to_vec) }
            };
            let corner_uvs = says(&faces.uvs).filter(|uvs| uvs.iter().all(|uv| uv.is_finite()));
            let number = match polygons.textures.get(face) {
                Some(&number) => number,
                None => vertices.textures.get(indices[0] as usize).copied().unwrap_or(0),
            };
            let placed = corner_uvs.is_some() || !vertices.uvs.is_empty();
            let texture = usize::try_from(number).ok().filter(|_| placed).and_then(|number| {
                absent += usize::from(number >= textures.len() && !textures.is_empty());
                (number < textures.len()).then_some(number)
            });
            let mesh = meshes.entry(texture).or_default();
            mesh.blends = blends;
            if are_shared && mesh.by_vertex.is_empty() {
                mesh.by_vertex = vec![u32::MAX; count];
            }
            let color = face_colors.get(face).copied().filter(|_| !is_strip);
            let normal = face_normals.get(face).copied().filter(|_| !is_strip);
            outline.clear();
            outline.extend(indices.iter().map(|&vertex| vertices.positions[vertex as usize]));
            triangulate(&outline, |triangle| {
                for k in triangle {
                    let vertex = indices[k];
                    let uv = corner_uvs.as_ref().map(|uvs| uvs[k]);
                    let next = mesh.corners.len() as u32;
                    let known = if are_shared {
                        &mut mesh.by_vertex[vertex as usize]
                    } else {
                        let corner = (
                            vertex,
                            color.map_or([0; 4], |color| color.to_array().map(f32::to_bits)),
                            uv.map_or([0; 2], |uv| uv.to_array().map(f32::to_bits)),
                            normal.map_or([0; 3], |normal| normal.to_array().map(f32::to_bits)),
                        );
                        mesh.by_corner.entry(corner).or_insert(u32::MAX)
                    };
                    if *known < next {
                        mesh.indices.push(*known);
                        continue;
                    }
                    *known = next;
                    mesh.indices.push(next);
                    mesh.corners.push(vertex);
                    let at = vertex as usize;
                    if has_colors {
                        mesh.colors.push(color.or(colors.get(at).copied()).unwrap_or(Vec4::ONE));
                    }
                    if has_normals {
                        mesh.normals.push(normal.or(vertices.normals.get(at).copied()).unwrap_or(Vec3::ZERO));
                    }
                    if has_uvs {
                        mesh.uvs.push(uv.or(vertices.uvs.get(at).copied()).unwrap_or(Vec2::ZERO));
                    }
                }
            });
        }
    }
    if bad > 0 {
        warnings
            .add(format!("{bad} faces with fewer than three corners or vertices that do not exist: dropped"));
    }
    if absent > 0 {
        warnings.add(format!("{absent} faces with a number of a texture that does not exist: shown without"));
    }
    meshes
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

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
            assert_eq!(content.vertices.positions.len(), 4);
            assert_eq!(content.vertices.positions[2], DVec3::new(1.0, 1.0, 0.0));
            let meshes = assemble(&content, &mut Warnings::default());
            assert_eq!(meshes[&None].indices, [0, 1, 2, 0, 2, 3, 0, 1, 2]);
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
        assert!(read(nothing.as_bytes()).unwrap().vertices.positions.is_empty());
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
        let mut warnings = Warnings::default();
        assert_eq!(assemble(&content, &mut warnings)[&None].indices.len(), 3);
        assert!(warnings.into_lines()[0].starts_with("3 faces with fewer than three corners"));
    }
}
