//! The eye, and the objects whose reflections it sees.

use argus_scene::{Camera, Instance, Mesh, Scene};
use glam::DVec3;

use argus_sampler::plug::MappedReflector;

/// The viewer whose pixels set the density of points, or all viewers within a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eye {
    /// Metres, world space: the viewpoint, or the middle of the box of viewpoints.
    pub position: DVec3,
    /// Half the size of the box of viewpoints, metres; zero for one viewpoint. Densities are those that the nearest
    /// viewpoint needs.
    pub half_size: DVec3,
    /// Pixels of an image plane at unit distance, on a length of 1: half the height over the tangent of half the field of
    /// view.
    pub pixels: f64,
    /// Rows of pixels.
    pub height: u32,
    /// Distances below this count as this, metres, above 0.
    pub near: f64,
}

impl Eye {
    /// The eye of a view of `width` × `height` pixels. The camera must have passed [`Camera::validate`].
    pub fn of(camera: &Camera, width: u32, height: u32, near: f64) -> Self {
        let half = camera.tan_half_fov(width, height).y;
        let pixels = f64::from(height) * 0.5 / half;
        Self { position: camera.eye, half_size: DVec3::ZERO, pixels, height, near }
    }

    /// Diameter of a sphere in pixels; infinite within it.
    pub fn diameter(&self, center: DVec3, radius: f64) -> f64 {
        let outside = self.distance(center).powi(2) - radius * radius;
        if outside > 0.0 { 2.0 * self.pixels * radius / outside.sqrt() } else { f64::INFINITY }
    }

    /// Distance of a point from the nearest viewpoint, metres.
    pub(super) fn distance(&self, point: DVec3) -> f64 {
        ((point - self.position).abs() - self.half_size).max(DVec3::ZERO).length()
    }
}

/// Largest side of a map's face, as in the paper (section 4.2).
pub const LARGEST_SIDE: u32 = 512;
/// Sides are multiples of this, so that a map rarely changes its size (section 3.5).
const SIDE_STEP: u32 = 32;
/// The share of a reflector's edges that may be less curved than its curvature says.
const PERCENTILE: f64 = 0.1;
/// Most triangles of a mesh whose edges are examined.
const EXAMINED: usize = 4096;

/// An instance at its pose as a reflector that `eye` sees, with a map of at most `largest` texels a side. `None` for an
/// instance without an extent.
pub fn curved_reflector(
    scene: &Scene,
    index: u32,
    instance: &Instance,
    eye: &Eye,
    largest: u32,
) -> Option<MappedReflector> {
    let center = scene.reflector(index, instance)?.center;
    let mesh = scene.meshes.get(instance.mesh as usize)?;
    let radius = mesh
        .indices
        .iter()
        .filter_map(|&vertex| position(mesh, instance, vertex))
        .map(|position| (position - center).length())
        .fold(0.0, f64::max);
    let curvature = curvature(mesh, instance);
    let side = map_side(eye, center, radius, largest);
    (radius > 0.0 && radius.is_finite()).then_some(MappedReflector {
        instance: index,
        center,
        radius,
        curvature,
        side,
        front: None,
    })
}

fn position(mesh: &Mesh, instance: &Instance, vertex: u32) -> Option<DVec3> {
    let position = mesh.positions.get(vertex as usize)?.as_dvec3();
    Some(instance.world_from_mesh.transform_point3(mesh.origin + position))
}

/// Texels on an edge of the map of a reflector: the diameter of its bounding sphere in the eye's pixels, rounded up to a
/// multiple of 32; at most `largest` and half the view's height (section 3.5), at least 32. The paper's hysteresis
/// would make a frame depend on those before, and is left out.
pub fn map_side(eye: &Eye, center: DVec3, radius: f64, largest: u32) -> u32 {
    let most = largest.min(eye.height / 2) / SIDE_STEP * SIDE_STEP;
    let most = most.max(SIDE_STEP);
    let steps = eye.diameter(center, radius) / f64::from(SIDE_STEP);
    let rounded = steps.ceil().min(f64::from(most / SIDE_STEP));
    (rounded as u32 * SIDE_STEP).clamp(SIDE_STEP, most)
}

/// The curvature that nine tenths of a mesh's edges have at least: |Δn| / |Δp| of an edge whose normals diverge, and 0 of one
/// whose normals converge, where a reflection is enlarged. 1/metres, world space.
fn curvature(mesh: &Mesh, instance: &Instance) -> f64 {
    let matrix = instance.world_from_mesh.matrix3;
    let normals_from_mesh = matrix.inverse().transpose();
    let step = mesh.triangles().div_ceil(EXAMINED).max(1);
    let mut found = Vec::new();
    for corners in mesh.indices.as_chunks::<3>().0.iter().step_by(step) {
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let [a, b] = [corners[from] as usize, corners[to] as usize];
            let ends = [a, b].map(|vertex| {
                let normal = mesh.normals.get(vertex)?.as_dvec3();
                Some((
                    matrix * mesh.positions.get(vertex)?.as_dvec3(),
                    (normals_from_mesh * normal).normalize(),
                ))
            });
            let [Some((p, m)), Some((q, n))] = ends else { continue };
            let (along, turn) = (q - p, n - m);
            let curvature = if turn.dot(along) > 0.0 { turn.length() / along.length() } else { 0.0 };
            if curvature.is_finite() {
                found.push(curvature);
            }
        }
    }
    let at = (found.len() as f64 * PERCENTILE) as usize;
    if found.is_empty() {
        return 0.0;
    }
    *found.select_nth_unstable_by(at, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use argus_scene::procedural::{rooms, with_balls};
    use glam::{DAffine3, Vec3};

    use super::*;

    fn eye() -> Eye {
        Eye { position: DVec3::ZERO, half_size: DVec3::ZERO, pixels: 1000.0, height: 1080, near: 1e-3 }
    }

    #[test]
    fn a_balls_curvature_is_the_inverse_of_its_radius_and_a_walls_is_zero() {
        let scene = with_balls(rooms(20), 3).unwrap();
        let ball = *scene.instances.last().unwrap();
        let index = scene.instances.len() as u32 - 1;
        let found = curved_reflector(&scene, index, &ball, &eye(), LARGEST_SIDE).unwrap();
        let radius = ball.world_from_mesh.matrix3.x_axis.x;
        assert!((found.radius / radius - 1.0).abs() < 1e-6, "{found:?}");
        assert!((found.curvature * radius - 1.0).abs() < 0.01, "{found:?}");
        assert!((found.center - ball.world_from_mesh.translation).length() < 1e-6 * radius);
        let wall = curved_reflector(&scene, 0, &scene.instances[0], &eye(), LARGEST_SIDE).unwrap();
        assert_eq!(wall.curvature, 0.0);
    }

    #[test]
    fn a_hollow_bowl_counts_as_planar() {
        let mut scene = with_balls(rooms(20), 1).unwrap();
        scene.meshes.last_mut().unwrap().normals.iter_mut().for_each(|normal| *normal = -*normal);
        let index = scene.instances.len() as u32 - 1;
        let ball = scene.instances[index as usize];
        assert_eq!(curved_reflector(&scene, index, &ball, &eye(), 512).unwrap().curvature, 0.0);
    }

    #[test]
    fn a_reflector_shrunk_to_nothing_has_no_map() {
        let mut scene = with_balls(rooms(20), 1).unwrap();
        let index = scene.instances.len() as u32 - 1;
        let ball = &mut scene.instances[index as usize];
        ball.world_from_mesh = DAffine3::from_scale(DVec3::ZERO);
        let ball = *ball;
        assert_eq!(curved_reflector(&scene, index, &ball, &eye(), 512), None);
        scene.meshes.last_mut().unwrap().positions.fill(Vec3::NAN);
        assert_eq!(curved_reflector(&scene, index, &ball, &eye(), 512), None);
    }

    #[test]
    fn a_map_has_as_many_texels_as_its_reflector_has_pixels_within_limits() {
        let side = |distance: f64, largest| map_side(&eye(), DVec3::X * distance, 0.5, largest);
        // 2 · 1000 · 0.5 / 10 is 100 pixels.
        assert_eq!(side(10.0, 512), 128);
        assert_eq!(side(1e6, 512), 32);
        assert_eq!(side(0.6, 512), 512, "close");
        assert_eq!(side(0.6, 2000), 512, "half of 1080, and a multiple of 32");
        assert_eq!([side(0.5, 512), side(0.0, 512)], [512, 512], "the eye is within the sphere");
        let small = Eye { height: 48, ..eye() };
        assert_eq!(map_side(&small, DVec3::X, 0.9, 512), 32);
    }
}
