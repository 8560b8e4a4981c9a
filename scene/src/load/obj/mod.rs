//! Wavefront OBJ with MTL materials.
//!
//! The parser is our own: files in the wild need more tolerance than the format's definition. Libraries refuse a whole file
//! for one invalid number or face, and lack smoothing groups and continued lines. Coordinates are read as `f64`, since the
//! mesh chooses its origin afterwards.

mod faces;
mod mtl;
mod text;

use std::collections::{BTreeSet, HashMap};

use bytes::Bytes;
use glam::{DVec2, DVec3, Vec3, Vec4};

use super::bundle::{Bundle, relative};
use super::geometry::{MissingNormals, RawMesh, about_an_origin};
use super::images::Textures;
use super::{Parts, Warnings};
use crate::scene::Instance;
use crate::{Material, Mesh};
use faces::Groups;
use text::{lines, numbers};

/// The content of a file.
#[derive(Default)]
struct Content {
    positions: Vec<DVec3>,
    /// Empty, or as many as positions.
    colors: Vec<Vec4>,
    uvs: Vec<DVec2>,
    normals: Vec<Vec3>,
    groups: Groups,
}

/// Candidate names of material libraries, for each `mtllib` line: the whole line, then its words.
pub(super) fn libraries(bytes: &[u8]) -> Vec<Vec<String>> {
    let mut libraries = Vec::new();
    lines(bytes, |keyword, rest| {
        if keyword == b"mtllib" {
            let rest = String::from_utf8_lossy(rest).trim().to_owned();
            let mut names = vec![rest.clone()];
            // A backslash keeps a space within a word.
            let kept = rest.replace("\\ ", "\0");
            names.extend(kept.split_whitespace().map(|word| word.replace('\0', " ")));
            libraries.push(names);
        }
    });
    libraries
}

/// The texture files named by a material library, relative to the scene's folder.
pub(super) fn textures(library: &str, bytes: &[u8]) -> BTreeSet<String> {
    mtl::textures(library, bytes)
}

/// Reads an OBJ file and its libraries.
pub(super) fn load(bundle: &Bundle, warnings: &mut Warnings) -> Result<Parts, String> {
    let bytes = bundle.main_bytes();
    let mut images = Textures::default();
    let library = read_libraries(bundle, &mut images, warnings);
    let mut content = Content::default();
    read(bytes, &mut content, warnings)?;

    let mut parts = Parts::default();
    let mut mapped = Vec::new();
    let mut missing_material = None;
    for name in content.groups.materials() {
        let found = name.as_ref().and_then(|name| library.get(name));
        if let (Some(name), None) = (&name, found) {
            warnings.add(format!("material {name:?} is not defined: shown in grey"));
        }
        let index = match (found, missing_material) {
            (Some(material), _) => {
                parts.materials.push(material.clone());
                parts.materials.len() - 1
            }
            (None, Some(index)) => index,
            (None, None) => {
                parts.materials.push(Material::default());
                missing_material = Some(parts.materials.len() - 1);
                parts.materials.len() - 1
            }
        };
        mapped.push(index as u32);
    }
    parts.textures = images.decode(&mut parts.materials, warnings);
    mtl::cut_out(&mut parts.materials, &parts.textures);
    let (origin, positions) = about_an_origin(&content.positions);
    for (group, material) in content.groups.into_meshes().into_iter().zip(mapped) {
        let name = group.material.clone().unwrap_or_default();
        let normal_map = parts.materials[material as usize].normal_texture;
        let mut raw = RawMesh { name, origin, material, ..RawMesh::default() };
        for corner in &group.corners {
            raw.positions.push(positions[corner.position as usize]);
            raw.normals.push(corner.normal.map_or(Vec3::ZERO, |n| content.normals[n as usize]));
            if group.has_uvs {
                // In OBJ, v points up the image; in the vocabulary it points down.
                let uv = corner.uv.map_or(DVec2::ZERO, |t| content.uvs[t as usize]);
                raw.uvs.push(DVec2::new(uv.x, 1.0 - uv.y).as_vec2());
            }
            if !content.colors.is_empty() {
                raw.colors.push(content.colors[corner.position as usize]);
            }
        }
        raw.indices = group.indices;
        // Normals without a direction are averaged over the triangles that share the vertex: those of one
        // smoothing group, or of one face where there is none.
        let finished: Option<Mesh> = raw.finish(MissingNormals::Smooth, normal_map, warnings);
        if let Some(mesh) = finished {
            parts.meshes.push(mesh);
        }
    }
    parts.instances = (0..parts.meshes.len() as u32)
        .map(|mesh| Instance { mesh, node: None, world_from_mesh: glam::DAffine3::IDENTITY })
        .collect();
    Ok(parts)
}

fn read_libraries(
    bundle: &Bundle,
    images: &mut Textures,
    warnings: &mut Warnings,
) -> HashMap<String, Material> {
    let mut library = HashMap::new();
    for candidates in libraries(bundle.main_bytes()) {
        let found = |name: &String| relative("", name).ok().filter(|name| bundle.files.contains_key(name));
        // The whole line is a name with spaces; if no such file exists, each word is a name.
        let names: Vec<String> = match candidates.first().and_then(found) {
            Some(whole) => vec![whole],
            None => candidates.iter().skip(1).filter_map(found).collect(),
        };
        if names.is_empty() {
            let line = candidates.first().map_or("", String::as_str);
            warnings.add(format!("material library {line:?} cannot be read"));
        }
        for name in names {
            // The first definition of a material counts, in the order of libraries.
            for (material, value) in mtl::read(&name, &bundle.files[&name], bundle, images, warnings) {
                library.entry(material).or_insert(value);
            }
        }
    }
    library
}

fn read(bytes: &Bytes, content: &mut Content, warnings: &mut Warnings) -> Result<(), String> {
    let (mut bad_faces, mut drawn_otherwise) = (0usize, 0usize);
    lines(bytes, |keyword, rest| match keyword {
        b"v" => {
            let (n, count) = numbers::<8>(rest);
            content.positions.push(DVec3::new(n[0], n[1], n[2]));
            // x y z r g b; with a weight in fourth place only where a seventh number follows.
            let color = match count {
                6 => Some([n[3], n[4], n[5]]),
                7.. => Some([n[4], n[5], n[6]]),
                _ => None,
            };
            if color.is_some() || !content.colors.is_empty() {
                content.colors.resize(content.positions.len() - 1, Vec4::ONE);
                let [r, g, b] = color.unwrap_or([1.0; 3]);
                content.colors.push(Vec4::new(r as f32, g as f32, b as f32, 1.0));
            }
        }
        b"vt" => {
            let (n, count) = numbers::<3>(rest);
            content.uvs.push(DVec2::new(n[0], if count > 1 { n[1] } else { 0.0 }));
        }
        b"vn" => {
            let (n, _) = numbers::<3>(rest);
            content.normals.push(DVec3::new(n[0], n[1], n[2]).as_vec3());
        }
        b"f" | b"fo" => {
            let Content { positions, uvs, normals, groups, .. } = &mut *content;
            bad_faces += usize::from(!groups.add_face(rest, positions, uvs.len(), normals.len()));
        }
        b"usemtl" => content.groups.use_material(String::from_utf8_lossy(rest).trim()),
        b"s" => content.groups.smooth(rest),
        b"p" | b"l" | b"curv" | b"surf" => drawn_otherwise += 1,
        _ => {}
    });
    if bad_faces > 0 {
        warnings.add(format!(
            "{bad_faces} faces with fewer than three corners or vertices that do not exist: dropped"
        ));
    }
    if drawn_otherwise > 0 {
        warnings.add(format!("{drawn_otherwise} points, lines, curves or surfaces are not drawn"));
    }
    if content.positions.is_empty() && !bytes.is_ascii() {
        return Err("is no OBJ file: it has no vertices".to_owned());
    }
    Ok(())
}
