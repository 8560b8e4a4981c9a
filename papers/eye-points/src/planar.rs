//! Planar mirrors: a mirrored camera in place of a map from the reflector's middle.
//!
//! All rays that a plane reflects into the eye come from one point, the eye's mirror image. A map from there shows exactly
//! what the eye sees in the mirror, without parallax; it must leave out what is behind the plane.

use argus_scene::{Instance, Scene};
use glam::DVec3;

use argus_sampler::plug::{HalfSpace, MappedReflector};

use super::Eye;

/// Largest side of a mirrored camera's map.
pub const LARGEST_MIRROR_SIDE: u32 = 2048;
/// Sides are multiples of this.
const SIDE_STEP: u32 = 32;
/// Vertices that are off the plane by more than this share of the mirror's extent make it a curved reflector.
const FLAT: f64 = 1e-6;

/// An instance at its pose as a planar mirror: its map is seen from the mirror image of `eye`, with texels no wider than
/// the eye's pixels. `None` for an instance that is not flat, and where the eye lies in its plane.
pub fn planar_reflector(
    scene: &Scene,
    index: u32,
    instance: &Instance,
    eye: &Eye,
) -> Option<MappedReflector> {
    let front = plane_of(scene, instance, eye.position)?;
    // No texel is wider than that in the middle of a face.
    let steps = (2.0 * eye.pixels / f64::from(SIDE_STEP)).ceil().max(1.0);
    let side = (steps * f64::from(SIDE_STEP)).min(f64::from(LARGEST_MIRROR_SIDE)) as u32;
    let center = front.mirrored(eye.position);
    Some(MappedReflector { instance: index, center, radius: 0.0, curvature: 0.0, side, front: Some(front) })
}

/// The half-space in front of a flat instance that holds `eye`.
fn plane_of(scene: &Scene, instance: &Instance, eye: DVec3) -> Option<HalfSpace> {
    let mesh = scene.meshes.get(instance.mesh as usize)?;
    let at = |vertex: &u32| {
        let position = mesh.positions.get(*vertex as usize)?.as_dvec3();
        Some(instance.world_from_mesh.transform_point3(mesh.origin + position))
    };
    let places: Vec<DVec3> = mesh.indices.iter().map(at).collect::<Option<_>>()?;
    let largest = places.as_chunks::<3>().0.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a));
    let area = largest.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?;
    let normal = area.try_normalize()?;
    let point = *places.first()?;
    let extent = places.iter().map(|place| (*place - point).length()).fold(0.0, f64::max);
    let off = places.iter().map(|place| (*place - point).dot(normal).abs()).fold(0.0, f64::max);
    let distance = (eye - point).dot(normal);
    let seen = off <= FLAT * extent && distance.abs() > FLAT * extent;
    seen.then_some(HalfSpace { point, normal: normal * distance.signum() })
}
