//! Moves nodes of the scene by request: checks the request, and sets all of its transforms or none.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use argus_proto::convert::{affine, space_is_world};
use argus_proto::{Fault, v1};
use argus_scene::transforms::{MOST_MOVERS, check_transform};
use argus_scene::{InvalidField, Scene, Transforms};
use glam::DAffine3;

use super::movers::Movers;
use super::node_names::NodeNames;
use super::shared_core::SharedCore;
use crate::core::{Client, Core};

/// Most nodes of a request.
const MOST_NODES: usize = 2048;

/// Most setters of an answer.
const MOST_SETTERS: usize = 1024;

/// A node that a request sets.
struct Set {
    node: u32,
    /// `None`: the file's transform again.
    matrix: Option<DAffine3>,
    is_in_world: bool,
}

/// Answers a request.
///
/// # Errors
/// The invalid field; [`Fault::Conflict`] if another client was first; the errors of [`SharedCore::move_nodes`].
pub(super) fn set_transforms(
    shared: &SharedCore,
    names: &NodeNames,
    client: Client,
    request: &v1::SetTransformsRequest,
) -> Result<v1::SetTransformsResponse, Fault> {
    let sets = checked(names, request)?;
    let scene = shared.source.scene();
    let (mut answer, stale) = shared.move_nodes(|movers| {
        let present = movers.present();
        if let Some(expected) = request.expected_revision.filter(|expected| *expected != present.revision) {
            return Err(Fault::Conflict(format!(
                "expected_revision: the transforms are at revision {} now, not at {expected}: another client was first; \
                 read what it set, and send the request again with that revision",
                present.revision
            )));
        }
        let moved = match sets.is_empty() {
            true => None,
            false => {
                let transforms = merged(scene, names, present, &sets)?;
                Some(movers.set(transforms, sets.iter().map(|set| set.node), &client))
            }
        };
        Ok((answer(movers, request), moved))
    })?;
    answer.stale_samples = stale;
    if !sets.is_empty() {
        answer.pages_to_check = shared.read(Core::cell_pages);
    }
    Ok(answer)
}

/// The nodes that a request sets.
///
/// # Errors
/// The invalid field.
fn checked(names: &NodeNames, request: &v1::SetTransformsRequest) -> Result<Vec<Set>, InvalidField> {
    let count = request.nodes.len();
    if count > MOST_NODES {
        let reason = format!("must be at most {MOST_NODES}, not {count}; send the rest in further requests");
        return Err(InvalidField::new("nodes", reason));
    }
    let mut seen = BTreeSet::new();
    let mut sets = Vec::with_capacity(count);
    for wire in &request.nodes {
        let node = names.find(wire.node.as_ref())?;
        let shown = || names.shown(node);
        if !seen.insert(node) {
            return Err(InvalidField::new("nodes", format!("node {} is there twice; set it once", shown())));
        }
        let wrong = |reason: String| InvalidField::new("nodes.matrix", format!("node {}: {reason}", shown()));
        let matrix = match wire.matrix.is_empty() {
            true => None,
            false => Some(affine(&wire.matrix).map_err(wrong)?),
        };
        if let Some(matrix) = &matrix {
            check_transform("nodes.matrix", &shown(), matrix)?;
        }
        sets.push(Set { node, matrix, is_in_world: space_is_world(wire.space, "nodes.space")? });
    }
    // Parents first, so that what is given in world space is divided by parents that were set already.
    sets.sort_by_key(|set| set.node);
    Ok(sets)
}

/// The present transforms with those that a request sets.
///
/// # Errors
/// Too many nodes would have transforms of their own, or a node in world space hangs from one without an inverse.
fn merged(
    scene: &Scene,
    names: &NodeNames,
    present: &Transforms,
    sets: &[Set],
) -> Result<BTreeMap<u32, DAffine3>, InvalidField> {
    let mut transforms = present.parent_from_node.clone();
    for set in sets {
        let Some(matrix) = set.matrix else {
            transforms.remove(&set.node);
            continue;
        };
        let parent_from_node = match set.is_in_world {
            false => matrix,
            true => {
                let wrong = |reason: &str| {
                    InvalidField::new("nodes.space", format!("node {}: {reason}", names.shown(set.node)))
                };
                let world_from_parent = scene.world_from_parent(set.node, &transforms).ok_or_else(|| {
                    wrong("an animation moves a node above it; give its matrix in the space of its parent")
                })?;
                let parent_from_node = world_from_parent.inverse() * matrix;
                check_transform("nodes.space", &names.shown(set.node), &parent_from_node).map_err(|_| {
                    wrong("the nodes above it flatten it; give its matrix in the space of its parent")
                })?;
                parent_from_node
            }
        };
        transforms.insert(set.node, parent_from_node);
    }
    if transforms.len() > MOST_MOVERS {
        let reason = format!(
            "{} nodes would have transforms of their own, and {MOST_MOVERS} may; give some of them the file's again, by \
             an empty matrix",
            transforms.len()
        );
        return Err(InvalidField::new("nodes", reason));
    }
    Ok(transforms)
}

/// What the state is, without what became stale.
fn answer(movers: &Movers, request: &v1::SetTransformsRequest) -> v1::SetTransformsResponse {
    let present: &Arc<Transforms> = movers.present();
    let setters = movers.setters(request.first_setter).take(MOST_SETTERS);
    let setter = |(node, by): (u32, &super::movers::Setter)| v1::NodeSetter {
        node,
        revision: by.revision,
        client: by.client.to_string(),
    };
    v1::SetTransformsResponse {
        revision: present.revision,
        movers: u32::try_from(present.parent_from_node.len()).unwrap_or(u32::MAX),
        setters: if request.list_setters { setters.map(setter).collect() } else { Vec::new() },
        ..v1::SetTransformsResponse::default()
    }
}
