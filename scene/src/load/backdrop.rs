//! Finds backdrops: unlit surfaces around the rest of a scene, such as sky domes.

use glam::DVec3;

use crate::{Bounds, Scene};

/// Share of the rest's vertices that a backdrop's box holds.
const AROUND: f64 = 0.9;
/// Least share of its longest side that each side of a backdrop's box has: a card or a floor is none.
const THICKNESS: f64 = 0.2;
/// Vertices that are tested, about.
const MOST_TESTED: usize = 4096;

/// Marks the materials of backdrops.
pub(super) fn mark(scene: &mut Scene) {
    if !scene.materials.iter().any(|material| material.unlit) {
        return;
    }
    let mut boxes = vec![Bounds::EMPTY; scene.materials.len()];
    let mut rest: Vec<DVec3> = Vec::new();
    let vertices: usize = scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].positions.len()).sum();
    let step = vertices.div_ceil(MOST_TESTED).max(1);
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh as usize];
        let at = |position: &glam::Vec3| {
            instance.world_from_mesh.transform_point3(mesh.origin + position.as_dvec3())
        };
        match scene.materials[mesh.material as usize].unlit {
            true => mesh.positions.iter().for_each(|p| boxes[mesh.material as usize].extend(at(p))),
            false => rest.extend(mesh.positions.iter().step_by(step).map(at)),
        }
    }
    for (material, around) in scene.materials.iter_mut().zip(&boxes) {
        let size = around.size();
        let held = rest.iter().filter(|point| around.contains(**point)).count();
        material.backdrop = material.unlit
            && size.min_element() > THICKNESS * size.max_element()
            && held as f64 >= AROUND * rest.len().max(1) as f64;
    }
}
