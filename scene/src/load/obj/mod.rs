//! Wavefront OBJ with MTL materials.
//!
//! The parser is our own: files in the wild need more tolerance than the format's definition. Libraries refuse a whole file
//! for one invalid number or face, and lack smoothing groups and continued lines. Coordinates are read as `f64`, since the
//! mesh chooses its origin afterwards.

mod compose;
mod faces;
mod mtl;
mod surface;
mod text;

use std::collections::{BTreeMap, BTreeSet, HashMap};

use bytes::Bytes;
use glam::{DVec2, DVec3, Vec3, Vec4};

use super::geometry::{MissingNormals, RawMesh, about_an_origin};
use super::parts::{Parts, Warnings, text_of};
use super::scene_files::{SceneFiles, folder_of};
use crate::scene::Instance;
use crate::tone::linear_from_srgb;
use crate::{Material, Mesh};
use faces::Groups;
use surface::Defined;
use text::{lines, numbers};

/// The content of a file.
#[derive(Default)]
struct Content {
    positions: Vec<DVec3>,
    /// As written; empty, or as many as positions.
    colors: Vec<Vec3>,
    uvs: Vec<DVec2>,
    normals: Vec<Vec3>,
    groups: Groups,
}

/// Candidate names of material libraries, for each `mtllib` line: the whole line, then its words.
pub(super) fn libraries(bytes: &[u8]) -> Vec<Vec<String>> {
    let mut libraries = Vec::new();
    lines(bytes, |keyword, rest| {
        if keyword == b"mtllib" {
            let rest = text_of(rest).trim().to_owned();
            let mut names = vec![rest.clone()];
            // A backslash keeps a space within a word.
            let kept = rest.replace("\\ ", "\0");
            names.extend(kept.split_whitespace().map(|word| word.replace('\0', " ")));
            libraries.push(names);
        }
    });
    libraries
}

/// The texture files named by a material library, as they are written.
pub(super) fn textures(bytes: &[u8]) -> BTreeSet<String> {
    mtl::textures(bytes)
}

/// Reads an OBJ file and its libraries.
pub(super) fn load(bundle: &SceneFiles, warnings: &mut Warnings) -> Result<Parts, String> {
    let library = read_libraries(bundle, warnings);
    let mut content = Content::default();
    read(bundle.main_bytes(), &mut content, warnings)?;
    let colors = vertex_colors(&content);
    let (origin, positions) = about_an_origin(&content.positions);
    let groups = content.groups.into_meshes();
    let used: Vec<&Defined> =
        groups.iter().filter_map(|group| library.get(group.material.as_ref()?)).collect();
    let mut maps = surface::decode(&used, bundle, warnings);

    let mut parts = Parts::default();
    let mut undefined = None;
    for group in groups {
        let name = group.material.clone().unwrap_or_default();
        let defined = group.material.as_ref().and_then(|name| library.get(name));
        if !name.is_empty() && defined.is_none() {
            warnings.add(format!("material {name:?} is not defined: shown in grey"));
        }
        let next = parts.materials.len() as u32;
        let material = match defined {
            Some(defined) => {
                let material = if group.has_uvs || defined.phong.maps.is_empty() {
                    surface::convert(defined, bundle, &mut maps, warnings)
                } else {
                    warnings.add(format!("material {name:?}: its textures need coordinates: shown without"));
                    surface::convert(&defined.without_maps(), bundle, &mut maps, warnings)
                };
                parts.materials.push(material);
                next
            }
            None => *undefined.get_or_insert_with(|| {
                let plain = if colors.is_empty() { Material::default().base_color } else { Vec4::ONE };
                parts.materials.push(Material { base_color: plain, ..Material::default() });
                next
            }),
        };
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
            if !colors.is_empty() {
                raw.colors.push(colors[corner.position as usize]);
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
    parts.textures = maps.textures;
    parts.instances = (0..parts.meshes.len() as u32)
        .map(|mesh| Instance { mesh, node: None, world_from_mesh: glam::DAffine3::IDENTITY })
        .collect();
    Ok(parts)
}

/// Linear colours of vertices: programs write display values, from 0 to 1 or to 255.
fn vertex_colors(content: &Content) -> Vec<Vec4> {
    let most = content.colors.iter().fold(0.0f32, |most, color| most.max(color.max_element()));
    let unit = if most > 1.5 { 255.0 } else { 1.0 };
    let linear = |value: f32| linear_from_srgb((value / unit).clamp(0.0, 1.0));
    content.colors.iter().map(|color| Vec3::from(color.to_array().map(linear)).extend(1.0)).collect()
}

/// The materials of a bundle's libraries, by name. The first definition of a material counts, in the order of libraries.
fn read_libraries(bundle: &SceneFiles, warnings: &mut Warnings) -> HashMap<String, Defined> {
    let mut library = HashMap::new();
    for (line, names) in &bundle.libraries {
        if names.is_empty() {
            warnings.add(format!("material library {line:?} cannot be read"));
        }
        for name in names {
            for phong in mtl::parse(&bundle.files[name]) {
                let folder = folder_of(name).to_owned();
                library.entry(phong.name.clone()).or_insert(Defined { folder, phong });
            }
        }
    }
    library
}

/// What the picture lacks of statements that are not drawn.
fn unshown(keyword: &[u8], rest: &[u8]) -> Option<&'static str> {
    let is_off = rest.eq_ignore_ascii_case(b"off") || rest.is_empty();
    Some(match keyword {
        b"p" => "p (points)",
        b"l" => "l (lines)",
        b"curv" => "curv (curves)",
        b"surf" | b"bzp" | b"bsp" | b"cdp" => "surf, bzp, bsp or cdp (curved surfaces)",
        b"cdc" => "cdc (curves)",
        b"usemap" if !is_off => "usemap (textures apart from materials)",
        b"shadow_obj" if !is_off => "shadow_obj (shadows of another object)",
        b"trace_obj" if !is_off => "trace_obj (reflections of another object)",
        b"bevel" if !is_off => "bevel (normals that are bent at edges)",
        b"c_interp" if !is_off => "c_interp (colours blended between vertices)",
        b"d_interp" if !is_off => "d_interp (opacities blended between vertices)",
        b"call" => "call (another file's statements)",
        b"csh" => "csh (commands)",
        // Names and groups; parts of curves and surfaces, and how finely to cut them; levels of detail; a file of textures
        // that usemap would choose from.
        b"g" | b"o" | b"mg" | b"lod" | b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"curv2"
        | b"parm" | b"trim" | b"hole" | b"scrv" | b"sp" | b"end" | b"con" | b"ctech" | b"stech" | b"res"
        | b"maplib" | b"usemap" | b"shadow_obj" | b"trace_obj" | b"bevel" | b"c_interp" | b"d_interp"
        | b"mtllib" => {
            return None;
        }
        _ => "a statement that is not known",
    })
}

fn read(bytes: &Bytes, content: &mut Content, warnings: &mut Warnings) -> Result<(), String> {
    let mut bad_faces = 0usize;
    let mut lacking: BTreeMap<&'static str, (usize, String)> = BTreeMap::new();
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
                content.colors.resize(content.positions.len() - 1, Vec3::ONE);
                content.colors.push(Vec3::from(color.unwrap_or([1.0; 3]).map(|value| value as f32)));
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
        b"usemtl" => content.groups.use_material(text_of(rest).trim()),
        b"s" => content.groups.smooth(rest),
        _ => {
            if let Some(what) = unshown(keyword, rest) {
                let first = || text_of(keyword).chars().take(32).collect();
                lacking.entry(what).or_insert_with(|| (0, first())).0 += 1;
            }
        }
    });
    if bad_faces > 0 {
        warnings.add(format!(
            "{bad_faces} faces with fewer than three corners or vertices that do not exist: dropped"
        ));
    }
    for (what, (count, first)) in lacking {
        let times = if count > 1 { format!(", {count} times") } else { String::new() };
        let example = if what.starts_with(&first) { String::new() } else { format!(": {first}") };
        warnings.add(format!("{what}{example} is not shown{times}"));
    }
    if content.positions.is_empty() && !bytes.is_ascii() {
        return Err("is no OBJ file: it has no vertices".to_owned());
    }
    Ok(())
}
