//! Where the instances of a scene are, by which it is known later what moved.

use std::collections::BTreeMap;

use argus_scene::Mesh;
use glam::{DMat3, DVec3, Vec3};

use super::paths::Leaves;
use crate::resident::DrawClass;
use crate::surfaces::Surfaces;

/// The visible instances of a scene that moves, at one pose. Boxes are metres about the centre of the scene's leaf sides.
pub(super) struct Pose(BTreeMap<u32, Posed>);

/// An instance at a pose.
struct Posed {
    place: Place,
    /// Box of its triangles; `None` if none is finite.
    around: Option<[Vec3; 2]>,
}

/// What the surfaces of an instance are a function of.
#[derive(PartialEq)]
struct Place {
    mesh: u32,
    class: DrawClass,
    world_from_mesh: DMat3,
    origin: DVec3,
    /// A hash of the mesh's shape, if it deforms.
    shape: Option<blake3::Hash>,
}

impl Pose {
    /// The pose of surfaces, whose triangles leaf sides hold.
    pub(super) fn new(surfaces: &Surfaces, leaves: &Leaves) -> Self {
        let posed = |(instance, triangles): (u32, &[[Vec3; 3]])| {
            let placement = surfaces.placement(instance)?;
            let mesh = &surfaces.scene().meshes[placement.mesh as usize];
            let place = Place {
                mesh: placement.mesh,
                class: placement.class,
                world_from_mesh: placement.world_from_mesh,
                origin: placement.origin,
                shape: mesh.deformation.is_some().then(|| shape_of(mesh)),
            };
            Some((instance, Posed { place, around: box_around(triangles) }))
        };
        Self(leaves.instances().filter_map(posed).collect())
    }

    /// Boxes of all instances that are not as they were in an earlier pose: where they were, and where they are.
    pub(super) fn boxes_of_moved(&self, before: &Self) -> Vec<[Vec3; 2]> {
        let (Self(now), Self(before)) = (self, before);
        let differs = |instance: &u32| match (now.get(instance), before.get(instance)) {
            (Some(now), Some(before)) => now.place != before.place,
            _ => true,
        };
        let changed = now.keys().chain(before.keys()).filter(|instance| differs(instance));
        changed
            .flat_map(|instance| [now.get(instance), before.get(instance)])
            .filter_map(|posed| posed?.around)
            .collect()
    }
}

fn shape_of(mesh: &Mesh) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(bytemuck::bytes_of(&mesh.origin.to_array()));
    hasher.update(bytemuck::cast_slice(&mesh.positions)).update(bytemuck::cast_slice(&mesh.normals));
    hasher.finalize()
}

/// The box of the triangles that are finite.
fn box_around(triangles: &[[Vec3; 3]]) -> Option<[Vec3; 2]> {
    let finite = triangles.iter().filter(|triangle| triangle.iter().all(|corner| corner.is_finite()));
    finite.flatten().fold(None, |around, corner| {
        let [low, high] = around.unwrap_or([*corner; 2]);
        Some([low.min(*corner), high.max(*corner)])
    })
}
