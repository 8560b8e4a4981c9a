//! The shapes of a scene's meshes at a time.

use std::sync::Arc;

use glam::DAffine3;

use super::Drivers;
#[cfg(feature = "loaders")]
use super::Pose;
use crate::deformation::{Deformation, Shape};
use crate::{Mesh, Scene};

impl Scene {
    /// For each mesh, whether time or clients change its shape.
    pub fn deforming_meshes(&self) -> Vec<bool> {
        self.deforming(self.by_request.iter().flat_map(|moved| moved.movers.iter().copied()))
    }

    /// Whether time or clients change the shape of a mesh.
    pub fn deforms(&self) -> bool {
        self.deforming_meshes().contains(&true)
    }

    /// Whether time alone changes the shape of a mesh.
    pub(super) fn deforms_by_time(&self) -> bool {
        self.deforming([]).contains(&true)
    }

    /// For each mesh, whether time or nodes that something else moves change its shape.
    fn deforming(&self, movers: impl IntoIterator<Item = u32>) -> Vec<bool> {
        if self.meshes.iter().all(|mesh| mesh.deformation.is_none()) {
            return vec![false; self.meshes.len()];
        }
        let drivers = self.drivers();
        let moved = [self.moved(&drivers), self.hanging_from(movers)];
        let moves = |node: u32| moved.iter().any(|moved| moved.get(node as usize) == Some(&true));
        let lasts = |node: u32| {
            drivers.get(&node).and_then(|driven| driven[3]).is_some_and(|(by, _)| by.length_secs() > 0.0)
        };
        let deforms = |mesh: &Mesh| {
            mesh.deformation.as_ref().is_some_and(|deformation| {
                lasts(deformation.node)
                    || (deformation.flattens && moves(deformation.node))
                    || deformation.skin.iter().flat_map(|skin| &*skin.joints).any(|joint| moves(joint.node))
            })
        };
        self.meshes.iter().map(deforms).collect()
    }

    /// The scene with its meshes in their shapes of a time in seconds: itself, unless it deforms. [`Self::at`] has the
    /// transforms of that time; those of the result are at time zero.
    pub fn posed(self: &Arc<Self>, time_secs: f64) -> Arc<Self> {
        self.reshaped(time_secs).map_or_else(|| Arc::clone(self), Arc::new)
    }

    /// The scene with its meshes in their shapes of a time in seconds; `None` if it does not deform.
    pub(crate) fn reshaped(&self, time_secs: f64) -> Option<Self> {
        let deforming = self.deforming_meshes();
        deforming.contains(&true).then(|| {
            let mut scene = self.clone();
            scene.shape(time_secs, &deforming);
            scene
        })
    }

    /// Sets what depends on time to time zero: instances, lights and shapes.
    #[cfg(feature = "loaders")]
    pub(crate) fn begin(&mut self) {
        let drivers = self.drivers();
        let world = self.world_from_nodes(&drivers, 0.0);
        let place = |instance: &crate::Instance| match instance.node {
            Some(node) => {
                crate::Instance { world_from_mesh: self.placed(instance, &world[node as usize]), ..*instance }
            }
            None => *instance,
        };
        self.instances = self.instances.iter().map(place).collect();
        let Pose { lighting, .. } = self.at(0.0);
        self.lighting = lighting;
        let all = vec![true; self.meshes.len()];
        self.shape(0.0, &all);
    }

    /// Sets the shapes of some meshes to those of a time.
    fn shape(&mut self, time_secs: f64, some: &[bool]) {
        let drivers = self.drivers();
        let world = self.world_from_nodes(&drivers, time_secs);
        let shape = |(at, mesh): (usize, &Mesh)| {
            let deformation = mesh.deformation.as_ref().filter(|_| some[at])?;
            let weights = self.weights_at(&drivers, deformation, time_secs);
            Some((at, deformation.shape(&mesh.indices, &world, &weights)))
        };
        let shapes: Vec<(usize, Shape)> = self.meshes.iter().enumerate().filter_map(shape).collect();
        for (at, Shape { origin, positions, normals, tangents }) in shapes {
            let mesh = &mut self.meshes[at];
            (mesh.origin, mesh.positions, mesh.normals, mesh.tangents) =
                (origin, positions, normals, tangents);
        }
    }

    /// The weights of a mesh's targets at a time.
    fn weights_at(&self, drivers: &Drivers<'_>, deformation: &Deformation, time_secs: f64) -> Vec<f32> {
        let driver = drivers.get(&deformation.node).and_then(|driven| driven[3]);
        let driven = driver.and_then(|(animation, channel)| channel.weights_at(animation.phase(time_secs)));
        let usable = |weights: &Vec<f32>| weights.len() == deformation.targets.len();
        driven.filter(usable).unwrap_or_else(|| deformation.weights.clone())
    }

    /// The transform of an instance whose node is at `world_from_node`.
    pub(crate) fn placed(&self, instance: &crate::Instance, world_from_node: &DAffine3) -> DAffine3 {
        let deformation = self.meshes.get(instance.mesh as usize).and_then(|mesh| mesh.deformation.as_ref());
        match deformation.is_some_and(|deformation| deformation.is_in_world(world_from_node)) {
            true => DAffine3::IDENTITY,
            false => *world_from_node,
        }
    }
}
