//! Skins and morph targets: what moves the vertices of a primitive.

use std::sync::Arc;

use glam::{DAffine3, DMat4, Vec3};
use gltf::json;
use json::accessor::Type;
use json::mesh::Semantic;
use json::validation::Checked;

use super::accessor::Reader;
use super::lookup::{Budget, get};
use super::nodes::Hierarchy;
use crate::Mesh;
use crate::deformation::{Deformation, Joint, MorphTarget, Shape, Skin};
use crate::load::normals::pick;
use crate::load::parts::Warnings;

/// Bytes of a vertex: its rest shape, and an influence or a displacement of each kind while and after it is read.
const REST_BYTES: u64 = 40;
const SET_BYTES: u64 = 2 * 32 + 32;
const TARGET_BYTES: u64 = 2 * 36;

/// What moves the vertices of a node's mesh.
#[derive(Clone)]
pub(super) struct Moved {
    /// Index into the hierarchy.
    pub(super) node: u32,
    /// The joints of its skin.
    pub(super) joints: Option<Arc<Vec<Joint>>>,
    /// Whether the node's transform may be flat.
    pub(super) flattens: bool,
    /// The node's own weights of targets.
    pub(super) weights: Option<Vec<f32>>,
}

/// The joints of all skins that nodes use. A skin that cannot be used is `None`, with a warning.
pub(super) struct Skins<'a> {
    reader: &'a Reader<'a>,
    hierarchy: &'a Hierarchy,
    read: Vec<Option<Option<Arc<Vec<Joint>>>>>,
}

impl<'a> Skins<'a> {
    pub(super) fn new(reader: &'a Reader<'a>, hierarchy: &'a Hierarchy) -> Self {
        Self { reader, hierarchy, read: vec![None; reader.root.skins.len()] }
    }

    /// The joints of a skin, read once.
    ///
    /// # Errors
    /// The skin or one of its joints does not exist, or its matrices cannot be read.
    pub(super) fn joints(
        &mut self,
        index: json::Index<json::Skin>,
        budget: &mut Budget,
        warnings: &mut Warnings,
    ) -> Result<Option<Arc<Vec<Joint>>>, String> {
        let skin = get(&self.reader.root.skins, index, "skin")?;
        if let Some(read) = &self.read[index.value()] {
            return Ok(read.clone());
        }
        budget.take(skin.joints.len(), 256)?;
        let mut add = |line: &str| warnings.add(format!("skin {}: {line}", index.value()));
        let matrices: Vec<[f32; 16]> = match skin.inverse_bind_matrices {
            Some(matrices) => {
                budget.take(self.reader.count(matrices)?, 128)?;
                self.reader.floats(matrices, &[Type::Mat4])?
            }
            None => Vec::new(),
        };
        if skin.inverse_bind_matrices.is_some() && matrices.len() < skin.joints.len() {
            add("it has fewer inverse bind matrices than joints: the identity stands for the missing ones");
        }
        let mut joints = Vec::with_capacity(skin.joints.len());
        for (number, joint) in skin.joints.iter().enumerate() {
            get(&self.reader.root.nodes, *joint, "node")?;
            let Some(node) = self.hierarchy.index_of[joint.value()] else {
                add("a joint is not in the scene: meshes are drawn in their own pose");
                self.read[index.value()] = Some(None);
                return Ok(None);
            };
            let matrix =
                matrices.get(number).map(|m| DAffine3::from_mat4(DMat4::from_cols_array(&m.map(f64::from))));
            let joint_from_mesh = matrix.filter(DAffine3::is_finite).unwrap_or_else(|| {
                if matrix.is_some() {
                    add("an inverse bind matrix is not finite: the identity stands for it");
                }
                DAffine3::IDENTITY
            });
            joints.push(Joint { node, joint_from_mesh });
        }
        let joints = (!joints.is_empty()).then(|| Arc::new(joints));
        self.read[index.value()] = Some(joints.clone());
        Ok(joints)
    }
}

/// The accessors of joints and weights, set by set.
fn sets(primitive: &json::mesh::Primitive) -> impl Iterator<Item = [json::Index<json::Accessor>; 2]> + '_ {
    let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
    (0..).map_while(move |set| Some([attribute(Semantic::Joints(set))?, attribute(Semantic::Weights(set))?]))
}

/// Reserves the memory of what moves a primitive of so many vertices.
pub(super) fn reserve(
    primitive: &json::mesh::Primitive,
    moved: &Moved,
    vertices: usize,
    budget: &mut Budget,
) -> Result<(), String> {
    let sets = if moved.joints.is_some() { sets(primitive).count() as u64 } else { 0 };
    let targets = primitive.targets.as_ref().map_or(0, Vec::len) as u64;
    budget.take(vertices, REST_BYTES + sets * SET_BYTES + targets.saturating_mul(TARGET_BYTES))
}

/// Sets how a mesh moves. `sources` has for each of its vertices the index in the file; `own_weights` are those of the
/// document's mesh.
pub(super) fn deform(
    reader: &Reader,
    primitive: &json::mesh::Primitive,
    moved: &Moved,
    own_weights: &Option<Vec<f32>>,
    (mesh, sources): (&mut Mesh, &[u32]),
    warnings: &mut Warnings,
) -> Result<(), String> {
    let has_normals = primitive.attributes.contains_key(&Checked::Valid(Semantic::Normals));
    let mut targets = Vec::new();
    for target in primitive.targets.iter().flatten() {
        let mut read = |index: Option<json::Index<json::Accessor>>| -> Result<Vec<Vec3>, String> {
            let Some(index) = index else { return Ok(Vec::new()) };
            let values = reader.floats::<3>(index, &[Type::Vec3])?;
            if sources.iter().any(|&source| source as usize >= values.len()) {
                warnings.add(format!("mesh {:?}: a morph target has too few values: ignored", mesh.name));
                return Ok(Vec::new());
            }
            let mut values: Vec<Vec3> = values.into_iter().map(Vec3::from).collect();
            pick(&mut values, sources);
            values.iter_mut().for_each(|value| *value = if value.is_finite() { *value } else { Vec3::ZERO });
            Ok(values)
        };
        let (positions, normals, tangents) =
            (read(target.positions)?, read(target.normals)?, read(target.tangents)?);
        targets.push(MorphTarget { positions, normals, tangents });
    }
    let mut weights = moved.weights.clone().or_else(|| own_weights.clone()).unwrap_or_default();
    weights.resize(targets.len(), 0.0);
    let skin = match &moved.joints {
        Some(joints) => Some(skin(reader, primitive, joints, (mesh, sources), warnings)?),
        None => None,
    };
    if skin.is_none() && targets.is_empty() && !moved.flattens {
        return Ok(());
    }
    let rest = Shape {
        origin: mesh.origin,
        positions: mesh.positions.clone(),
        normals: mesh.normals.clone(),
        tangents: mesh.tangents.clone(),
    };
    let (node, flattens, flat_normals) = (moved.node, moved.flattens, !has_normals);
    mesh.deformation =
        Some(Arc::new(Deformation { rest, node, targets, weights, skin, flattens, flat_normals }));
    Ok(())
}

/// The influences of joints on a mesh's vertices.
fn skin(
    reader: &Reader,
    primitive: &json::mesh::Primitive,
    joints: &Arc<Vec<Joint>>,
    (mesh, sources): (&Mesh, &[u32]),
    warnings: &mut Warnings,
) -> Result<Skin, String> {
    let mut all: Vec<[Vec<[f32; 4]>; 2]> = Vec::new();
    for [numbers, weights] in sets(primitive) {
        all.push([reader.floats::<4>(numbers, &[Type::Vec4])?, reader.floats::<4>(weights, &[Type::Vec4])?]);
    }
    let (mut first, mut influences) = (Vec::with_capacity(sources.len() + 1), Vec::new());
    let (mut outside, mut without) = (false, false);
    for &source in sources {
        let begin = influences.len();
        first.push(begin as u32);
        for [numbers, weights] in &all {
            let of_vertex = numbers.get(source as usize).zip(weights.get(source as usize));
            for (&number, &weight) in
                of_vertex.into_iter().flat_map(|(numbers, weights)| numbers.iter().zip(weights))
            {
                if !(weight > 0.0 && weight.is_finite()) {
                    continue;
                }
                if (number as usize) < joints.len() {
                    influences.push((number as u16, weight));
                } else {
                    outside = true;
                }
            }
        }
        let of_vertex = &mut influences[begin..];
        let most = of_vertex.iter().map(|&(_, weight)| weight).fold(0.0, f32::max);
        // Divided by the largest first, since the sum of large weights is infinite.
        let sum: f32 = of_vertex.iter().map(|&(_, weight)| weight / most).sum();
        of_vertex.iter_mut().for_each(|(_, weight)| *weight = *weight / most / sum);
        without |= of_vertex.is_empty();
    }
    first.push(influences.len() as u32);
    for (happens, line) in [
        (outside, "vertices name joints that its skin does not have: their weights are ignored"),
        (without, "vertices without a joint stay in the mesh's own pose"),
    ] {
        if happens {
            warnings.add(format!("mesh {:?}: {line}", mesh.name));
        }
    }
    Ok(Skin { joints: Arc::clone(joints), first, influences })
}

/// Reverses the triangles of a mesh that most of its joints mirror, so that fronts stay fronts.
pub(super) fn keep_front(mesh: &mut Mesh, hierarchy: &Hierarchy) {
    let Some(skin) = mesh.deformation.as_ref().and_then(|deformation| deformation.skin.as_ref()) else {
        return;
    };
    let is_mirrored: Vec<bool> = skin
        .joints
        .iter()
        .map(|joint| {
            let world = hierarchy.world_from_node[joint.node as usize] * joint.joint_from_mesh;
            world.matrix3.determinant() < 0.0
        })
        .collect();
    let mirrored = skin.influences.iter().filter(|(joint, _)| is_mirrored[usize::from(*joint)]).count();
    if 2 * mirrored > skin.influences.len() {
        mesh.indices.as_chunks_mut::<3>().0.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
}
