//! Reads each primitive once, in parallel, and places it wherever a node uses it.

use std::collections::{BTreeMap, HashMap};

use glam::{DAffine3, Vec2, Vec3, Vec4};
use gltf::json;
use json::accessor::Type;
use json::mesh::{Mode, Semantic};
use json::validation::Checked;
use rayon::prelude::*;

use super::accessor::Reader;
use super::lookup::{Budget, get, name};
use super::nodes::Hierarchy;
use super::skin::{self, Moved, Skins};
use crate::deformation::flattening;
use crate::load::geometry::{MissingNormals, RawMesh};
use crate::load::images::{label, named};
use crate::load::parts::{Parts, Warnings};
use crate::material::TextureUse;
use crate::scene::Instance;
use crate::{Material, Mesh};

/// Largest number of bytes that a vertex and an index take while a primitive is read.
const VERTEX_BYTES: u64 = 2 * 76;
const INDEX_BYTES: u64 = 4 + 76;

/// A primitive to be read, for all nodes that place it alike, or for one that moves its vertices.
struct Wanted {
    /// Index of the mesh in the document.
    mesh: usize,
    /// Index of the primitive in the mesh.
    k: usize,
    moved: Option<Moved>,
}

/// For each material of the document whether a drawn mesh has it.
pub(super) fn used_materials(root: &json::Root, hierarchy: &Hierarchy) -> Vec<bool> {
    let mut used = vec![false; root.materials.len()];
    let meshes =
        hierarchy.in_document.iter().filter_map(|&node| root.meshes.get(root.nodes[node].mesh?.value()));
    for material in meshes.flat_map(|mesh| &mesh.primitives).filter_map(|primitive| primitive.material) {
        if let Some(used) = used.get_mut(material.value()) {
            *used = true;
        }
    }
    used
}

/// Reads every drawn primitive into `parts.meshes` and places it in `parts.instances`. `sets` are those of
/// [`super::material::Materials`].
pub(super) fn place(
    reader: &Reader,
    hierarchy: &Hierarchy,
    sets: &[[Option<u32>; 2]],
    parts: &mut Parts,
    budget: &mut Budget,
    warnings: &mut Warnings,
) -> Result<(), String> {
    let root = reader.root;
    // For each drawn mesh of the document, and each node that moves its vertices, the range of its primitives in `wanted`.
    let mut primitives_of: HashMap<(usize, Option<u32>), std::ops::Range<usize>> = HashMap::new();
    let mut wanted: Vec<Wanted> = Vec::new();
    let mut placed = Vec::new();
    let flattening = flattening(&hierarchy.nodes, &parts.animations);
    let mut skins = Skins::new(reader, hierarchy);
    for (node, &at) in (0u32..).zip(&hierarchy.in_document) {
        let Some(index) = root.nodes[at].mesh else { continue };
        let mesh = get(&root.meshes, index, "mesh")?;
        let joints = match root.nodes[at].skin {
            Some(skin) => skins.joints(skin, budget, warnings)?,
            None => None,
        };
        let flattens = flattening[node as usize];
        let has_targets = mesh.primitives.iter().any(|p| p.targets.as_ref().is_some_and(|t| !t.is_empty()));
        let weights = root.nodes[at].weights.clone();
        let moves = joints.is_some() || has_targets || flattens;
        let moved = moves.then_some(Moved { node, joints, flattens, weights });
        let range = primitives_of.entry((index.value(), moves.then_some(node))).or_insert_with(|| {
            let first = wanted.len();
            wanted.extend((0..mesh.primitives.len()).map(|k| {
                let primitive = &mesh.primitives[k];
                let is_skinned = primitive.attributes.contains_key(&Checked::Valid(Semantic::Joints(0)));
                let mut moved = moved.clone();
                if let Some(Moved { joints: joints @ Some(_), .. }) = &mut moved
                    && !is_skinned
                {
                    *joints = None;
                    warnings.add(format!("node {at}: a primitive has no joints: its node places it"));
                }
                Wanted { mesh: index.value(), k, moved }
            }));
            first..wanted.len()
        });
        budget.take(range.len(), 256)?;
        placed.push((node, range.clone()));
    }
    for Wanted { mesh, k, moved } in &wanted {
        let primitive = &root.meshes[*mesh].primitives[*k];
        let vertices = match primitive.attributes.get(&Checked::Valid(Semantic::Positions)) {
            Some(&index) => reader.count(index)?,
            None => 0,
        };
        let indices = primitive.indices.map_or(Ok(vertices), |index| reader.count(index))?;
        budget.take(vertices, VERTEX_BYTES)?;
        // A strip or a fan has almost three times as many corners as indices.
        let corners = if primitive.mode == Checked::Valid(Mode::Triangles) { 1 } else { 3 };
        budget.take(indices, corners * INDEX_BYTES)?;
        if let Some(moved) = moved {
            // Without normals each corner has a vertex.
            skin::reserve(primitive, moved, vertices.max(indices.saturating_mul(corners as usize)), budget)?;
        }
    }
    let default_material = default_material(root, &wanted, parts);
    let chosen = with_what_meshes_lack(root, &wanted, sets, default_material, parts, warnings);
    let materials = &parts.materials;
    let read: Vec<(Result<Option<Mesh>, String>, Warnings)> = wanted
        .par_iter()
        .zip(&chosen)
        .map(|(Wanted { mesh, k, moved }, &(material, sets))| {
            let mut warnings = Warnings::default();
            let json = &root.meshes[*mesh];
            let primitive = &json.primitives[*k];
            let read = read(reader, primitive, name(&json.name), (material, sets), materials, &mut warnings);
            let read = read.and_then(|found| {
                let Some((mut mesh, sources)) = found else { return Ok(None) };
                if let Some(moved) = moved {
                    let parts = (&mut mesh, &sources[..]);
                    skin::deform(reader, primitive, moved, &json.weights, parts, &mut warnings)?;
                    skin::keep_front(&mut mesh, hierarchy);
                }
                Ok(Some(mesh))
            });
            (read.map_err(|reason| format!("mesh {mesh}, primitive {k}: {reason}")), warnings)
        })
        .collect();
    let mut index_of = Vec::with_capacity(read.len());
    for (mesh, lines) in read {
        lines.into_lines().iter().for_each(|line| warnings.add(line));
        index_of.push(mesh?.map(|mesh| {
            parts.meshes.push(mesh);
            parts.meshes.len() as u32 - 1
        }));
    }
    for (node, range) in placed {
        for &mesh in index_of[range].iter().flatten() {
            let deformation = parts.meshes[mesh as usize].deformation.as_ref();
            // Its joints place a skinned mesh, and its node does not (glTF 2.0, section 3.7.3.3).
            let skinned = deformation.is_some_and(|deformation| deformation.skin.is_some());
            let (node, world_from_mesh) = match skinned {
                true => (None, DAffine3::IDENTITY),
                false => (Some(node), hierarchy.world_from_node[node as usize]),
            };
            if world_from_mesh.is_finite() {
                parts.instances.push(Instance { mesh, node, world_from_mesh });
            } else {
                let at = node.map_or(0, |node| hierarchy.in_document[node as usize]);
                warnings.add(format!("node {at}: its place in the world is not finite: left out"));
            }
        }
    }
    Ok(())
}

/// The index of the default material, which is added if a primitive names none.
fn default_material(root: &json::Root, wanted: &[Wanted], parts: &mut Parts) -> u32 {
    let index = parts.materials.len() as u32;
    if wanted.iter().any(|wanted| root.meshes[wanted.mesh].primitives[wanted.k].material.is_none()) {
        parts.materials.push(Material::default());
    }
    index
}

/// For each wanted primitive its material, and the sets of texture coordinates to read. A mesh that lacks a set gets a
/// material of its own, which has lost the textures of that set.
fn with_what_meshes_lack(
    root: &json::Root,
    wanted: &[Wanted],
    sets: &[[Option<u32>; 2]],
    default_material: u32,
    parts: &mut Parts,
    warnings: &mut Warnings,
) -> Vec<(u32, [Option<u32>; 2])> {
    let mut variants: BTreeMap<(u32, [bool; 2]), u32> = BTreeMap::new();
    let mut chosen = Vec::with_capacity(wanted.len());
    for &Wanted { mesh, k, .. } in wanted {
        let primitive = &root.meshes[mesh].primitives[k];
        let material = primitive.material.map_or(default_material, |m| m.value() as u32);
        let sets = sets.get(material as usize).copied().unwrap_or_default();
        let has = |set: u32| primitive.attributes.contains_key(&Checked::Valid(Semantic::TexCoords(set)));
        let lacks = sets.map(|set| set.is_some_and(|set| !has(set)));
        let Some(of_all) = parts.materials.get(material as usize).filter(|_| lacks != [false; 2]) else {
            chosen.push((material, sets));
            continue;
        };
        let mut variant = of_all.clone();
        let known = variants.entry((material, lacks)).or_insert_with(|| {
            let is_lost = |of: &TextureUse| of_all.texture(*of).is_some_and(|t| lacks[usize::from(t.uv_set)]);
            let lost: Vec<TextureUse> = TextureUse::ALL.into_iter().filter(is_lost).collect();
            lost.iter().for_each(|&of| variant.lose(of));
            let ways: Vec<&str> = lost.iter().map(|of| of.lost()).collect();
            let (mesh, of) = (name(&root.meshes[mesh].name), named(&[label(material as usize, of_all)]));
            warnings
                .add(format!("mesh {mesh:?} lacks texture coordinates: its {of} shown {}", ways.join(", ")));
            parts.materials.len() as u32
        });
        chosen.push((*known, sets));
        if *known as usize == parts.materials.len() {
            parts.materials.push(variant);
        }
    }
    chosen
}

/// Reads one primitive, and for each vertex its index in the file; `None` if it has no triangles.
fn read(
    reader: &Reader,
    primitive: &json::mesh::Primitive,
    name: String,
    (material, sets): (u32, [Option<u32>; 2]),
    materials: &[Material],
    warnings: &mut Warnings,
) -> Result<Option<(Mesh, Vec<u32>)>, String> {
    let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
    let Checked::Valid(mode) = primitive.mode else { return Err("unknown mode".to_owned()) };
    if matches!(mode, Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
        warnings.add(format!("mesh {name:?}: points and lines are not drawn"));
        return Ok(None);
    }
    let Some(positions) = attribute(Semantic::Positions) else {
        warnings.add(format!("mesh {name:?}: a primitive without positions is not drawn"));
        return Ok(None);
    };
    let surface =
        materials.get(material as usize).ok_or_else(|| format!("material {material} does not exist"))?;
    let mut raw = RawMesh { name, material, ..RawMesh::default() };
    raw.positions = reader.floats::<3>(positions, &[Type::Vec3])?.into_iter().map(Vec3::from).collect();
    let indices = match primitive.indices {
        Some(index) => reader.integers(index)?,
        None => (0..u32::try_from(raw.positions.len()).map_err(|_| "too many vertices")?).collect(),
    };
    raw.indices = triangles(mode, indices);
    if let Some(index) = attribute(Semantic::Normals) {
        raw.normals = reader.floats::<3>(index, &[Type::Vec3])?.into_iter().map(Vec3::from).collect();
    }
    if let (Some(index), true) =
        (attribute(Semantic::Tangents), surface.normal_texture.is_some() && !raw.normals.is_empty())
    {
        raw.tangents = reader.floats::<4>(index, &[Type::Vec4])?.into_iter().map(Vec4::from).collect();
    }
    for (set, uvs) in sets.into_iter().zip([&mut raw.uvs, &mut raw.uvs2]) {
        if let Some(index) = set.and_then(|set| attribute(Semantic::TexCoords(set))) {
            *uvs = reader.floats::<2>(index, &[Type::Vec2])?.into_iter().map(Vec2::from).collect();
        }
    }
    if let Some(index) = attribute(Semantic::Colors(0)) {
        raw.colors = reader.colors(index)?;
    }
    Ok(raw.finish_with_sources(MissingNormals::Flat, surface.normal_texture, warnings))
}

/// Triangle lists are kept; strips and fans are unrolled, with every second triangle of a strip reversed.
fn triangles(mode: Mode, indices: Vec<u32>) -> Vec<u32> {
    match mode {
        Mode::TriangleStrip => {
            let turned =
                |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
            indices.windows(3).enumerate().flat_map(turned).collect()
        }
        Mode::TriangleFan => {
            let Some((&first, rest)) = indices.split_first() else { return Vec::new() };
            rest.windows(2).flat_map(|w| [first, w[0], w[1]]).collect()
        }
        _ => indices,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_winding() {
        assert_eq!(triangles(Mode::TriangleStrip, vec![0, 1, 2, 3, 4]), [0, 1, 2, 2, 1, 3, 2, 3, 4]);
        assert_eq!(triangles(Mode::TriangleFan, vec![7, 1, 2, 3]), [7, 1, 2, 7, 2, 3]);
        assert!(triangles(Mode::TriangleStrip, vec![0, 1]).is_empty());
        assert!(triangles(Mode::TriangleFan, Vec::new()).is_empty());
    }
}
