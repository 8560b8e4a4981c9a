//! Whether a place is clear of a scene's triangles, and whether one place sees another.
//!
//! A binary tree of boxes over the triangles, split at the median. Answers do not depend on the tree: a box is left out
//! only where it cannot hold a triangle that counts. Uses no operation that differs between machines.

use glam::{DVec3, Vec3};

use crate::closest::closest_on_triangle;
use crate::{Instance, Scene};

/// Most triangles of a leaf.
const LEAF: usize = 8;

/// The triangles of a scene at a pose, for questions about free space.
pub(super) struct Clearance {
    /// Corners relative to this point, metres, so that f32 is precise far from the world's origin.
    center: DVec3,
    triangles: Vec<[Vec3; 3]>,
    nodes: Vec<Node>,
}

/// A box and what is in it.
struct Node {
    min: Vec3,
    max: Vec3,
    /// First triangle of a leaf, or the first of two children, which are adjacent.
    first: u32,
    /// Number of triangles; 0 for an inner node.
    count: u32,
}

impl Clearance {
    /// The triangles of `placed`, about `center`, which should be the middle of the scene. Triangles with a corner that is
    /// not finite are left out.
    pub(super) fn new(scene: &Scene, placed: &[Instance], center: DVec3) -> Self {
        let mut triangles = Vec::with_capacity(scene.triangles());
        for instance in placed {
            let mesh = &scene.meshes[instance.mesh as usize];
            for corners in mesh.indices.as_chunks::<3>().0 {
                let corner = |i: u32| {
                    let position = mesh.positions.get(i as usize).copied().unwrap_or(Vec3::NAN);
                    let placed = instance.world_from_mesh.transform_point3(mesh.origin + position.as_dvec3());
                    (placed - center).as_vec3()
                };
                let corners = corners.map(corner);
                if corners.iter().all(|corner| corner.is_finite()) {
                    triangles.push(corners);
                }
            }
        }
        let nodes = build(&mut triangles);
        Self { center, triangles, nodes }
    }

    /// Whether a triangle is nearer to `point` than `distance` (metres).
    pub(super) fn is_near(&self, point: DVec3, distance: f64) -> bool {
        let point = point - self.center;
        let squared = distance * distance;
        self.any(
            |node| {
                let (min, max) = (node.min.as_dvec3(), node.max.as_dvec3());
                (point - point.clamp(min, max)).length_squared() < squared
            },
            |corners| (closest_on_triangle(point, corners) - point).length_squared() < squared,
        )
    }

    /// Whether a triangle lies between two points, from either side.
    pub(super) fn is_blocked(&self, from: DVec3, to: DVec3) -> bool {
        let (from, way) = (from - self.center, to - from);
        self.any(|node| crosses_box(from, way, node), |corners| crosses(from, way, corners))
    }

    /// Whether `test` holds for any triangle of the boxes that `enter` lets in.
    fn any(&self, enter: impl Fn(&Node) -> bool, test: impl Fn([DVec3; 3]) -> bool) -> bool {
        let mut pending = vec![0u32];
        while let Some(index) = pending.pop() {
            let Some(node) = self.nodes.get(index as usize).filter(|node| enter(node)) else { continue };
            if node.count == 0 {
                pending.extend([node.first, node.first + 1]);
                continue;
            }
            let triangles = &self.triangles[node.first as usize..(node.first + node.count) as usize];
            if triangles.iter().any(|corners| test(corners.map(|corner| corner.as_dvec3()))) {
                return true;
            }
        }
        false
    }
}

/// Orders triangles by a tree, and returns its nodes, the root first; none for no triangles.
fn build(triangles: &mut [[Vec3; 3]]) -> Vec<Node> {
    let mut nodes = Vec::new();
    if triangles.is_empty() {
        return nodes;
    }
    let unbuilt = || Node { min: Vec3::ZERO, max: Vec3::ZERO, first: 0, count: 0 };
    nodes.push(unbuilt());
    let mut pending = vec![(0usize, 0..triangles.len())];
    while let Some((index, range)) = pending.pop() {
        let here = &mut triangles[range.clone()];
        let corners = || here.iter().flatten();
        let min = corners().fold(Vec3::INFINITY, |min, corner| min.min(*corner));
        let max = corners().fold(Vec3::NEG_INFINITY, |max, corner| max.max(*corner));
        let (first, count) = if here.len() <= LEAF {
            (range.start, here.len())
        } else {
            let axis = (max - min).max_position();
            let middle = here.len() / 2;
            let key = |corners: &[Vec3; 3]| corners[0][axis] + corners[1][axis] + corners[2][axis];
            here.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
            let first = nodes.len();
            nodes.extend([unbuilt(), unbuilt()]);
            let middle = range.start + middle;
            pending.extend([(first, range.start..middle), (first + 1, middle..range.end)]);
            (first, 0)
        };
        nodes[index] = Node { min, max, first: first as u32, count: count as u32 };
    }
    nodes
}

/// Whether the segment from `from` along `way` meets a node's box, which is widened a little against rounding.
fn crosses_box(from: DVec3, way: DVec3, node: &Node) -> bool {
    let slack = 1e-9 * (from.abs() + way.abs()).max_element();
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for axis in 0..3 {
        let (low, high) = (f64::from(node.min[axis]) - slack, f64::from(node.max[axis]) + slack);
        if way[axis] == 0.0 {
            if from[axis] < low || from[axis] > high {
                return false;
            }
            continue;
        }
        let (a, b) = ((low - from[axis]) / way[axis], (high - from[axis]) / way[axis]);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    enter <= leave + 1e-9
}

/// Whether a segment crosses a triangle (Möller and Trumbore, 1997).
fn crosses(from: DVec3, way: DVec3, [a, b, c]: [DVec3; 3]) -> bool {
    let (e1, e2, from_a) = (b - a, c - a, from - a);
    let p = way.cross(e2);
    let inverse = e1.dot(p).recip();
    let beta = from_a.dot(p) * inverse;
    let q = from_a.cross(e1);
    let gamma = way.dot(q) * inverse;
    let t = e2.dot(q) * inverse;
    // A segment within the triangle's plane gives NaN or infinity, which fails.
    beta >= 0.0 && gamma >= 0.0 && beta + gamma <= 1.0 && (0.0..=1.0).contains(&t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::procedural::mirrors;

    #[test]
    fn answers_equal_those_of_testing_every_triangle() {
        let scene = mirrors(9);
        let clearance = Clearance::new(&scene, &scene.instances, DVec3::ZERO);
        let whole = |corners: &[Vec3; 3]| corners.map(|corner| corner.as_dvec3());
        let mut random = super::super::noise::Random::new(3);
        let mut counts = [0; 2];
        for _ in 0..300 {
            let mut place =
                || DVec3::new(random.range(-4.0, 4.0), random.range(0.0, 5.0), random.range(-4.0, 4.0));
            let (from, to) = (place(), place());
            let is_near = clearance
                .triangles
                .iter()
                .any(|corners| (closest_on_triangle(from, whole(corners)) - from).length_squared() < 0.25);
            let is_blocked =
                clearance.triangles.iter().any(|corners| crosses(from, to - from, whole(corners)));
            assert_eq!(clearance.is_near(from, 0.5), is_near);
            assert_eq!(clearance.is_blocked(from, to), is_blocked);
            counts[0] += usize::from(is_near);
            counts[1] += usize::from(is_blocked);
        }
        assert!(counts.iter().all(|count| (30..290).contains(count)), "both answers occur: {counts:?}");
    }
}
