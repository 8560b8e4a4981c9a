//! Gives a file's point and spot lights the radius of a bulb. No format tells it, and it decides how soft shadows are.
//!
//! A bulb of 3 cm hangs about 3 m above what it lights. So its radius is that share of the distance to the nearest surface.
//! A fixed number of metres would not do: in a file of millimetres it is a point, and in one of kilometres it holds the whole
//! scene. Nor would a share of the scene's size: the lamps of a town are no larger than those of a room.

use glam::DVec3;

use crate::{Bounds, Instance, Light, Scene, closest_on_triangle};

/// Radius of a bulb, in distances to the nearest surface.
const SHARE: f64 = 0.01;
/// Triangles that are tested, about, over all lights. Of more, every n-th of each mesh is.
const MOST_TESTED: usize = 1 << 24;

/// Sets the radius of each point and spot light; 0 in a scene without surfaces. For a scene at rest.
pub(super) fn measure(scene: &mut Scene) {
    let mut lights = std::mem::take(&mut scene.lighting.lights);
    let lamps = lights.iter().filter(|light| !matches!(light, Light::Directional { .. })).count();
    if lamps > 0 {
        let surfaces = Surfaces::new(scene, lamps);
        for light in &mut lights {
            if let Light::Point { position, radius, .. } | Light::Spot { position, radius, .. } = light {
                *radius = surfaces.distance(*position).map_or(0.0, |distance| SHARE * distance);
            }
        }
    }
    scene.lighting.lights = lights;
}

/// The surfaces that light falls on: all but backdrops.
struct Surfaces<'a> {
    scene: &'a Scene,
    /// Each instance with its box.
    placed: Vec<(Bounds, Instance)>,
    /// Number of triangles of a mesh of which one is tested.
    step: usize,
}

impl<'a> Surfaces<'a> {
    fn new(scene: &'a Scene, lamps: usize) -> Self {
        let mesh = |instance: &Instance| &scene.meshes[instance.mesh as usize];
        let is_lit = |instance: &&Instance| !scene.materials[mesh(instance).material as usize].backdrop;
        let lit: Vec<Instance> = scene.instances.iter().filter(is_lit).copied().collect();
        let triangles: usize = lit.iter().map(|instance| mesh(instance).triangles()).sum();
        let bounds = |instance: &Instance| {
            let mut bounds = Bounds::EMPTY;
            mesh(instance).positions.iter().for_each(|p| bounds.extend(in_world(scene, instance, p)));
            bounds
        };
        let placed = lit.iter().map(|instance| (bounds(instance), *instance));
        let placed = placed.filter(|(bounds, _)| !bounds.is_empty()).collect();
        Self { scene, placed, step: triangles.saturating_mul(lamps).div_ceil(MOST_TESTED).max(1) }
    }

    /// Distance of a point from the nearest surface, metres.
    fn distance(&self, point: DVec3) -> Option<f64> {
        let to_box = |bounds: &Bounds| point.distance(point.clamp(bounds.min, bounds.max));
        let mut order: Vec<(f64, &Instance)> =
            self.placed.iter().map(|(bounds, instance)| (to_box(bounds), instance)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut nearest = f64::INFINITY;
        for (to_box, instance) in order {
            if to_box >= nearest {
                break;
            }
            nearest = nearest.min(self.distance_to(instance, point));
        }
        nearest.is_finite().then_some(nearest)
    }

    fn distance_to(&self, instance: &Instance, point: DVec3) -> f64 {
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let corner = |&index: &u32| in_world(self.scene, instance, &mesh.positions[index as usize]);
        let triangles = mesh.indices.as_chunks::<3>().0.iter().step_by(self.step);
        let distances = triangles
            .map(|three| closest_on_triangle(point, three.each_ref().map(corner)).distance(point))
            .filter(|distance| distance.is_finite());
        distances.fold(f64::INFINITY, f64::min)
    }
}

fn in_world(scene: &Scene, instance: &Instance, position: &glam::Vec3) -> DVec3 {
    let mesh = &scene.meshes[instance.mesh as usize];
    instance.world_from_mesh.transform_point3(mesh.origin + position.as_dvec3())
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, Vec3};

    use super::*;
    use crate::{Lighting, Material, Mesh, Sky};

    /// A floor of a million square units at height 0, a light above it, and all of that in a unit.
    fn radius(height: f64, unit: f64) -> f64 {
        let floor = Mesh {
            positions: [
                [-500.0, 0.0, -500.0],
                [-500.0, 0.0, 500.0],
                [500.0, 0.0, 500.0],
                [500.0, 0.0, -500.0],
            ]
            .map(Vec3::from)
            .to_vec(),
            indices: vec![0, 1, 2, 0, 2, 3],
            ..Mesh::default()
        };
        let position = DVec3::new(7.0, height, 3.0) * unit;
        let lights =
            vec![Light::sun(), Light::Point { position, intensity: Vec3::ONE, range: None, radius: 5.0 }];
        let world_from_mesh = DAffine3::from_scale(DVec3::splat(unit));
        let mut scene = Scene {
            meshes: vec![floor],
            materials: vec![Material::default()],
            instances: vec![Instance { mesh: 0, node: None, world_from_mesh }],
            lighting: Lighting { lights, sky: Sky::BLACK, exposure: 1.0 },
            ..Scene::default()
        };
        measure(&mut scene);
        assert_eq!(scene.lighting.lights[0], Light::sun());
        let Light::Point { radius, .. } = scene.lighting.lights[1] else { unreachable!() };
        radius
    }

    #[test]
    fn a_lamp_is_as_large_as_its_height_asks_for_in_any_unit() {
        for unit in [1e-3, 1.0, 1e3] {
            assert!((radius(3.0, unit) / unit - 0.03).abs() < 1e-6, "{unit}");
        }
        assert_eq!(radius(0.0, 1.0), 0.0, "it lies in the floor");
    }

    #[test]
    fn a_lamp_in_a_scene_without_surfaces_has_no_extent() {
        let light = Light::Point { position: DVec3::Y, intensity: Vec3::ONE, range: None, radius: 5.0 };
        let lighting = Lighting { lights: vec![light], sky: Sky::BLACK, exposure: 1.0 };
        let mut scene = Scene { lighting, ..Scene::default() };
        measure(&mut scene);
        assert_eq!(
            scene.lighting.lights,
            [Light::Point { position: DVec3::Y, intensity: Vec3::ONE, range: None, radius: 0.0 }]
        );
    }
}
