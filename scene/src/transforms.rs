//! Transforms that clients set of nodes, in place of those of the file.
//!
//! A state of these transforms has a number, its *revision*; revision 0 is the file as it is. What a revision shows never
//! changes, so a scene at a time and a revision is a pure value. [`Scene::with_transforms`] makes it. A node whose transform
//! was set is a *mover*: no animation moves it any more. Its children hang from it as before.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{DAffine3, DMat3};

use crate::animation::Rest;
use crate::pose::place_light;
use crate::scene::MovedScene;
use crate::{InvalidField, Scene};

/// Most nodes that have a transform of their own at the same time, and so most nodes of a request.
pub const MOST_MOVERS: usize = 16_384;

/// A matrix counts as singular if its determinant is at most this share of the product of its columns' lengths.
const SINGULAR: f64 = 1e-9;

/// Greatest magnitude of a number of a matrix: beyond it squares of distances overflow in f32.
const MOST: f64 = 1e15;

/// Checks the transform of a node.
///
/// # Errors
/// A number is not finite or too large, or the matrix has no inverse.
pub fn check_transform(field: &'static str, node: &str, transform: &DAffine3) -> Result<(), InvalidField> {
    let numbers = transform.to_cols_array();
    let wrong = |reason: String| Err(InvalidField::new(field, format!("node {node}: {reason}")));
    if let Some(at) = numbers.iter().position(|x| !x.is_finite() || x.abs() > MOST) {
        let (row, column) = (at % 3, at / 3);
        let found = numbers[at];
        return wrong(format!(
            "row {row}, column {column} of its matrix is {found}; it must be finite and at most {MOST:e}"
        ));
    }
    if is_singular(&transform.matrix3) {
        return wrong(
            "its matrix is singular: it flattens the node, so that it has no inverse. Give three columns that do not \
             lie in a plane; to hide a node, move it away"
                .to_owned(),
        );
    }
    Ok(())
}

/// Whether a linear map has no inverse of use.
fn is_singular(matrix: &DMat3) -> bool {
    let lengths = matrix.x_axis.length() * matrix.y_axis.length() * matrix.z_axis.length();
    // Written so that NaN is singular.
    !(matrix.determinant().abs() > SINGULAR * lengths && lengths.recip().is_finite())
}

impl Scene {
    /// Whether time or clients move anything that the scene shows.
    pub fn may_move(&self) -> bool {
        self.by_request.is_some() || self.is_animated()
    }

    /// The scene at time zero with the transforms of a revision. `movers` are further nodes that clients may move. `None` if
    /// the revision is not known here. Meshes have the shapes of the file: [`Self::posed`] makes those that joints give them.
    pub fn with_transforms(self: &Arc<Self>, revision: u64, movers: &BTreeSet<u32>) -> Option<Arc<Self>> {
        let base = self.by_request.as_ref().map_or(self, |moved| &moved.base);
        let transforms = base.revisions.get(revision)?;
        let movers: BTreeSet<u32> =
            movers.iter().copied().chain(transforms.parent_from_node.keys().copied()).collect();
        if movers.is_empty() {
            return Some(Arc::clone(base));
        }
        let mut scene = Self::clone(base);
        // An animation that is in the way of another one stays so, even if a client moves the node that both move.
        let silent: Vec<*const _> =
            base.not_playing().into_iter().map(|(one, _)| std::ptr::from_ref(one)).collect();
        scene.animations = base
            .animations
            .iter()
            .filter(|animation| !silent.contains(&std::ptr::from_ref(*animation)))
            .cloned()
            .collect();
        for (&node, transform) in &transforms.parent_from_node {
            if let Some(node) = scene.nodes.get_mut(node as usize) {
                node.rest = Rest::Matrix(*transform);
            }
        }
        scene.place_moved(&movers);
        scene.by_request = Some(Arc::new(MovedScene { base: Arc::clone(base), movers }));
        Some(Arc::new(scene))
    }

    /// The lights at a time in seconds and a revision; those of the file if the revision is not known here.
    pub fn lighting_at(&self, time_secs: f64, revision: u64) -> crate::Lighting {
        let Some(transforms) = self.revisions.get(revision).filter(|set| !set.parent_from_node.is_empty())
        else {
            return self.at(time_secs).lighting;
        };
        // Triangles and textures light nothing here, and are not copied.
        let mut scene = Self {
            nodes: self.nodes.clone(),
            animations: self.animations.clone(),
            lighting: self.lighting.clone(),
            ..Self::default()
        };
        for (&node, transform) in &transforms.parent_from_node {
            if let Some(node) = scene.nodes.get_mut(node as usize) {
                node.rest = Rest::Matrix(*transform);
            }
        }
        scene.place_moved(&transforms.parent_from_node.keys().copied().collect());
        scene.at(time_secs).lighting
    }

    /// Places what hangs from movers, at time zero.
    fn place_moved(&mut self, movers: &BTreeSet<u32>) {
        let moved = self.hanging_from(movers.iter().copied());
        let world_from_node = self.world_from_nodes(&self.drivers(), 0.0);
        let instances = self.instances.iter().map(|instance| match instance.node {
            Some(node) if moved.get(node as usize).is_some_and(|moved| *moved) => {
                let world_from_mesh = self.placed(instance, &world_from_node[node as usize]);
                crate::Instance { world_from_mesh, ..*instance }
            }
            _ => *instance,
        });
        self.instances = instances.collect();
        let lights = &mut self.lighting.lights;
        for ((node, world_from_node), _) in
            self.nodes.iter().zip(&world_from_node).zip(&moved).filter(|(_, moved)| **moved)
        {
            for &light in &node.lights {
                if let Some(light) = lights.get_mut(light as usize) {
                    place_light(light, world_from_node);
                }
            }
        }
    }

    /// The transform from a node's parent to the world at time zero, with the transforms of a state. `None` if an animation
    /// moves the parent, so that there is no one transform.
    pub fn world_from_parent(&self, node: u32, transforms: &BTreeMap<u32, DAffine3>) -> Option<DAffine3> {
        let drivers = self.drivers();
        let mut at = self.nodes.get(node as usize)?.parent;
        let mut world_from_parent = DAffine3::IDENTITY;
        while let Some(index) = at {
            let node = self.nodes.get(index as usize)?;
            let parent_from_node = match transforms.get(&index) {
                Some(set) => *set,
                None if drivers.get(&index).is_some_and(|driven| driven[..3].iter().any(Option::is_some)) => {
                    return None;
                }
                None => node.rest.parent_from_node(),
            };
            world_from_parent = parent_from_node * world_from_parent;
            at = node.parent;
        }
        Some(world_from_parent)
    }
}

#[cfg(test)]
mod tests;
