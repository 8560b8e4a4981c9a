//! Reads the hierarchy, flattened parents first, and its lights and cameras.

use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};
use gltf::json;
use json::validation::Checked;

use super::lookup::{Budget, get, name};
use crate::animation::{Animation, Node, Parts, Rest};
use crate::load::parts::Warnings;
use crate::scene::NamedCamera;
use crate::{Camera, Light};

/// The nodes of the default scene.
pub(super) struct Hierarchy {
    /// Parents before children.
    pub(super) nodes: Vec<Node>,
    /// For each node, its number in the document.
    pub(super) in_document: Vec<usize>,
    /// For each node of the document, its index in `nodes`.
    pub(super) index_of: Vec<Option<u32>>,
    /// For each node, its transform to the world at rest.
    pub(super) world_from_node: Vec<DAffine3>,
}

impl Hierarchy {
    /// Walks the default scene, or else the first, or all nodes if there is no scene.
    ///
    /// # Errors
    /// A node that is its own ancestor, or that does not exist.
    pub(super) fn new(
        root: &json::Root,
        budget: &mut Budget,
        warnings: &mut Warnings,
    ) -> Result<Self, String> {
        let parents = parents(root, warnings)?;
        let roots = roots(root, &parents, warnings)?;
        let count = root.nodes.len();
        budget.take(count, 512)?;
        let mut hierarchy = Self {
            nodes: Vec::with_capacity(count),
            in_document: Vec::with_capacity(count),
            index_of: vec![None; count],
            world_from_node: Vec::with_capacity(count),
        };
        let mut open: Vec<usize> = roots.into_iter().rev().collect();
        while let Some(at) = open.pop() {
            if hierarchy.index_of[at].is_some() {
                continue;
            }
            let node = &root.nodes[at];
            let parent = parents[at].and_then(|parent| hierarchy.index_of[parent]);
            let rest = local(node).map_err(|reason| format!("node {at}: {reason}"))?;
            let world_from_parent =
                parent.map_or(DAffine3::IDENTITY, |p| hierarchy.world_from_node[p as usize]);
            hierarchy.index_of[at] = Some(hierarchy.nodes.len() as u32);
            hierarchy.nodes.push(Node { name: name(&node.name), parent, rest, lights: Vec::new() });
            hierarchy.in_document.push(at);
            hierarchy.world_from_node.push(world_from_parent * rest.parent_from_node());
            let children = node.children.iter().flatten().map(json::Index::value);
            // A child is visited only from its assigned parent.
            open.extend(children.filter(|&child| parents[child] == Some(at)).rev());
        }
        Ok(hierarchy)
    }
}

/// The parent of every node: the first that lists it.
fn parents(root: &json::Root, warnings: &mut Warnings) -> Result<Vec<Option<usize>>, String> {
    let mut parents = vec![None; root.nodes.len()];
    for (at, node) in root.nodes.iter().enumerate() {
        for child in node.children.iter().flatten() {
            get(&root.nodes, *child, "node")?;
            match &mut parents[child.value()] {
                Some(first) if *first != at => {
                    warnings.add(format!("node {} has two parents: only the first counts", child.value()));
                }
                parent => *parent = Some(at),
            }
        }
    }
    // Follow the chain of parents from every node; each node is visited once on the way up.
    let mut seen_from = vec![usize::MAX; root.nodes.len()];
    for start in 0..root.nodes.len() {
        let mut at = Some(start);
        while let Some(node) = at.filter(|&node| seen_from[node] == usize::MAX) {
            seen_from[node] = start;
            at = parents[node];
        }
        if at.is_some_and(|node| seen_from[node] == start) {
            return Err(format!("node {start} is its own ancestor, or hangs below one that is"));
        }
    }
    Ok(parents)
}

/// The scene's roots. A root that is also a child in the scene, an exporter's error that would draw it twice, is kept
/// as a child only.
fn roots(
    root: &json::Root,
    parents: &[Option<usize>],
    warnings: &mut Warnings,
) -> Result<Vec<usize>, String> {
    let scene = match root.scene {
        Some(index) => Some(get(&root.scenes, index, "scene")?),
        None => root.scenes.first(),
    };
    let Some(scene) = scene else {
        return Ok((0..parents.len()).filter(|&at| parents[at].is_none()).collect());
    };
    let mut listed = vec![false; parents.len()];
    for index in &scene.nodes {
        get(&root.nodes, *index, "node")?;
        listed[index.value()] = true;
    }
    // Whether a node or any above it is listed, found from the top down.
    let mut below_listed: Vec<Option<bool>> = vec![None; parents.len()];
    let mut roots = Vec::new();
    for index in scene.nodes.iter().map(json::Index::value) {
        let mut chain = Vec::new();
        let mut at = parents[index];
        while let Some(node) = at.filter(|&node| below_listed[node].is_none()) {
            chain.push(node);
            at = parents[node];
        }
        let mut below = at.is_some_and(|node| below_listed[node] == Some(true));
        for node in chain.into_iter().rev() {
            below |= listed[node];
            below_listed[node] = Some(below);
        }
        let hangs = parents[index].is_some_and(|parent| below_listed[parent] == Some(true));
        if hangs {
            warnings
                .add(format!("node {index} is a root and another node's child: drawn once, as the child"));
        } else {
            roots.push(index);
        }
    }
    Ok(roots)
}

/// A node's own transform.
fn local(node: &json::Node) -> Result<Rest, String> {
    let rest = match node.matrix {
        Some(matrix) => Rest::Matrix(DAffine3::from_mat4(DMat4::from_cols_array(&matrix.map(f64::from)))),
        None => {
            let vector = |v: Option<[f32; 3]>, default| v.map_or(default, |v| Vec3::from(v).as_dvec3());
            let rotation = node.rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q.0.map(f64::from)));
            let length = rotation.length();
            let rotation = if length > 0.0 { rotation / length } else { DQuat::IDENTITY };
            let translation = vector(node.translation, DVec3::ZERO);
            Rest::Parts(Parts { translation, rotation, scale: vector(node.scale, DVec3::ONE) })
        }
    };
    let finite = rest.parent_from_node().is_finite();
    if finite { Ok(rest) } else { Err("its transform is not finite".to_owned()) }
}

/// Reads the lights of the scene (KHR_lights_punctual), and records them in their nodes.
pub(super) fn lights(root: &json::Root, hierarchy: &mut Hierarchy, warnings: &mut Warnings) -> Vec<Light> {
    let mut lights = Vec::new();
    let Hierarchy { nodes, in_document, world_from_node, .. } = hierarchy;
    for ((at, world_from_node), node) in in_document.iter().zip(world_from_node).zip(nodes) {
        let extension = root.nodes[*at].extensions.as_ref();
        let Some(reference) = extension.and_then(|e| e.khr_lights_punctual.as_ref()) else { continue };
        match root.get(reference.light).and_then(|light| read_light(light, world_from_node)) {
            Some(light) => {
                node.lights.push(lights.len() as u32);
                lights.push(light);
            }
            None => warnings.add(format!("node {at}: its light cannot be read: left out")),
        }
    }
    lights
}

/// glTF's lights have no extent: a directional one is taken for the sun. Others get theirs from the whole scene
/// ([`super::super::bulbs`]).
fn read_light(
    light: &json::extensions::scene::khr_lights_punctual::Light,
    world_from_node: &DAffine3,
) -> Option<Light> {
    use json::extensions::scene::khr_lights_punctual::Type;
    let radiant = Vec3::from(light.color) * light.intensity;
    let position = world_from_node.translation;
    let direction = world_from_node.transform_vector3(DVec3::NEG_Z).try_normalize()?;
    let range = light.range.map(f64::from).filter(|&range| range > 0.0 && range.is_finite());
    if !radiant.is_finite() || !(radiant.min_element() >= 0.0) || !position.is_finite() {
        return None;
    }
    match light.type_ {
        Checked::Valid(Type::Directional) => {
            let angular_radius = Light::SUN_RADIUS;
            Some(Light::Directional { direction, irradiance: radiant, angular_radius })
        }
        Checked::Valid(Type::Point) => {
            Some(Light::Point { position, intensity: radiant, range, radius: 0.0 })
        }
        Checked::Valid(Type::Spot) => {
            let spot = light.spot.as_ref()?;
            let outer_cone = f64::from(spot.outer_cone_angle).clamp(1e-3, std::f64::consts::FRAC_PI_2);
            let inner_cone = f64::from(spot.inner_cone_angle).clamp(0.0, outer_cone - 1e-4);
            let intensity = radiant;
            Some(Light::Spot { position, direction, intensity, range, inner_cone, outer_cone, radius: 0.0 })
        }
        Checked::Invalid => None,
    }
}

/// The perspective cameras of the scene, at rest: recommended viewpoints do not move.
pub(super) fn cameras(
    root: &json::Root,
    hierarchy: &Hierarchy,
    animations: &[Animation],
    warnings: &mut Warnings,
) -> Vec<NamedCamera> {
    let mut cameras = Vec::new();
    let mut moved = vec![false; hierarchy.nodes.len()];
    animations.iter().flat_map(|a| &a.channels).for_each(|channel| moved[channel.node as usize] = true);
    for index in 0..moved.len() {
        moved[index] |= hierarchy.nodes[index].parent.is_some_and(|parent| moved[parent as usize]);
    }
    for ((at, world_from_node), moved) in
        hierarchy.in_document.iter().zip(&hierarchy.world_from_node).zip(moved)
    {
        let node = &root.nodes[*at];
        let Some(index) = node.camera else { continue };
        let Some(camera) = root.cameras.get(index.value()) else {
            warnings.add(format!("node {at}: camera {} does not exist", index.value()));
            continue;
        };
        let Some(perspective) = &camera.perspective else {
            warnings.add(format!("node {at}: orthographic cameras are not supported: left out"));
            continue;
        };
        let eye = world_from_node.translation;
        let forward = world_from_node.transform_vector3(DVec3::NEG_Z).normalize_or(DVec3::NEG_Z);
        let up = world_from_node.transform_vector3(DVec3::Y).normalize_or(DVec3::Y);
        let read = Camera {
            eye,
            target: eye + forward,
            up,
            fov_deg: f64::from(perspective.yfov).to_degrees(),
            lens: None,
        };
        match read.validate() {
            Ok(()) => {
                if moved {
                    warnings.add(format!("node {at}: its camera is recommended at rest, not in motion"));
                }
                let named = node.name.as_ref().or(camera.name.as_ref());
                cameras.push(NamedCamera { name: named.cloned().unwrap_or_default(), camera: read });
            }
            Err(error) => warnings.add(format!("node {at}: {error}: left out")),
        }
    }
    cameras
}
