//! Single rays with arbitrary origins, for light paths and shadow maps.
//!
//! Boxes are f32, as for packets. Everything else is f64 relative to the object, so results do not depend on the distance
//! from the world's origin.

use glam::{DVec3, Vec3};

use super::PacketTracer;
use crate::bvh::{Node, OF_OBJECT, Triangle, flags};

/// The nearest surface along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Index into [`argus_scene::Scene::instances`].
    pub instance: u32,
    /// Index of the triangle in its mesh.
    pub primitive: u32,
    /// Distance in units of the direction.
    pub t: f64,
    /// Weights of the mesh's second and third corner.
    pub weights: [f64; 2],
    /// Whether the front face (counter-clockwise) is hit.
    pub front: bool,
}

/// A ray in an object's space, prepared for box tests.
struct Ray {
    origin: DVec3,
    direction: DVec3,
    inverse: DVec3,
}

/// Slack for rounding of a ray's exit from a box. Boxes hold exact f32 corners; the test is f64.
const SLACK: f64 = 1.0 + 1e-12;

impl PacketTracer {
    /// The nearest hit at 0 < t < `most`. Rays pass through transparent parts of cut-outs and through the back of
    /// single-sided triangles, and meet transparent surfaces as often as their alpha says. `None` for a ray that is not
    /// finite or has no direction.
    pub fn nearest(&self, origin: DVec3, direction: DVec3, most: f64) -> Option<Hit> {
        self.first(origin, direction, most, |hit| {
            let [beta, gamma] = hit.weights.map(|weight| weight as f32);
            !self.cutouts.let_through([hit.instance, hit.primitive], beta, gamma)
        })
    }

    /// The share of what is behind a hit that it hides.
    pub(crate) fn coverage(&self, hit: &Hit) -> f32 {
        let [beta, gamma] = hit.weights.map(|weight| weight as f32);
        self.cutouts.coverage([hit.instance, hit.primitive], beta, gamma)
    }

    /// The nearest hit like [`Self::nearest`], where `stops` says which hits of triangles with alpha count. It is asked for
    /// each such triangle before the nearest hit so far, in no order.
    pub(crate) fn first(
        &self,
        origin: DVec3,
        direction: DVec3,
        most: f64,
        mut stops: impl FnMut(&Hit) -> bool,
    ) -> Option<Hit> {
        if !(origin.is_finite() && direction.is_finite() && direction != DVec3::ZERO) {
            return None;
        }
        let mut nearest = None;
        let inverse = safe_inverse(direction);
        self.hierarchy.visit_top(origin, inverse, |placed| {
            let limit = nearest.map_or(most, |hit: Hit| hit.t);
            let m = placed.object_from_world;
            let (origin, direction) = (m * (origin - placed.origin), m * direction);
            let ray = Ray { origin, direction, inverse: safe_inverse(direction) };
            let root = self.hierarchy.objects[placed.object as usize].root;
            if let Some(hit) = self.first_in(&ray, root, placed.instance, limit, &mut stops) {
                nearest = Some(hit);
            }
            nearest.map_or(most, |hit| hit.t)
        });
        nearest
    }

    fn first_in(
        &self,
        ray: &Ray,
        root: u32,
        instance: u32,
        most: f64,
        stops: &mut impl FnMut(&Hit) -> bool,
    ) -> Option<Hit> {
        let nodes = &self.hierarchy.nodes;
        let (mut nearest, mut limit) = (None, most);
        // Deep enough for four billion triangles in a tree three times as deep as a balanced one.
        let mut stack = [(0u32, 0.0f64); 96];
        let mut held = 0;
        let mut at = root;
        ray.enters(&nodes[root as usize], limit)?;
        loop {
            let node = &nodes[at as usize];
            if node.count > 0 {
                let range = node.first as usize..(node.first + node.count) as usize;
                for triangle in &self.hierarchy.triangles[range] {
                    if let Some(hit) = meet(ray, triangle, instance, limit, stops) {
                        limit = hit.t;
                        nearest = Some(hit);
                    }
                }
            } else {
                let (a, b) = (node.first, node.first + 1);
                let into = |child: u32| ray.enters(&nodes[child as usize], limit);
                match (into(a), into(b)) {
                    (Some(x), Some(y)) => {
                        let (near, far) = if x <= y { (a, (b, y)) } else { (b, (a, x)) };
                        if let Some(slot) = stack.get_mut(held) {
                            *slot = far;
                            held += 1;
                        }
                        at = near;
                        continue;
                    }
                    (Some(_), None) => {
                        at = a;
                        continue;
                    }
                    (None, Some(_)) => {
                        at = b;
                        continue;
                    }
                    (None, None) => (),
                }
            }
            loop {
                if held == 0 {
                    return nearest;
                }
                held -= 1;
                let (next, t) = stack[held];
                if t < limit {
                    at = next;
                    break;
                }
            }
        }
    }
}

/// Möller and Trumbore's test ("Fast, Minimum Storage Ray/Triangle Intersection", 1997), in f64.
fn meet(
    ray: &Ray,
    triangle: &Triangle,
    instance: u32,
    most: f64,
    stops: &mut impl FnMut(&Hit) -> bool,
) -> Option<Hit> {
    let [a, b, c] = [triangle.a, triangle.b, triangle.c].map(|p| Vec3::from_array(p).as_dvec3());
    let (e1, e2, from_a) = (b - a, c - a, ray.origin - a);
    let p = ray.direction.cross(e2);
    let determinant = e1.dot(p);
    let one_sided = triangle.flags & flags::ONE_SIDED != 0;
    if determinant == 0.0 || (one_sided && determinant < 0.0) {
        return None;
    }
    let inverse = determinant.recip();
    let beta = from_a.dot(p) * inverse;
    let q = from_a.cross(e1);
    let gamma = ray.direction.dot(q) * inverse;
    let t = e2.dot(q) * inverse;
    // NaN fails.
    if !(beta >= 0.0 && gamma >= 0.0 && beta + gamma <= 1.0 && t > 0.0 && t < most) {
        return None;
    }
    // Corners of a mirrored triangle are stored exchanged, so that its front face matches the mesh's.
    let mirrored = triangle.flags & flags::MIRRORED != 0;
    let weights = if mirrored { [gamma, beta] } else { [beta, gamma] };
    let instance = if triangle.instance == OF_OBJECT { instance } else { triangle.instance };
    let hit = Hit { instance, primitive: triangle.primitive, t, weights, front: determinant > 0.0 };
    (triangle.flags & flags::CUTOUT == 0 || stops(&hit)).then_some(hit)
}

impl Ray {
    /// Where the ray enters a box, if before `most`.
    #[inline(always)]
    fn enters(&self, node: &Node, most: f64) -> Option<f64> {
        let (mut from, mut to) = (0.0f64, most);
        for axis in 0..3 {
            let a = (f64::from(node.min[axis]) - self.origin[axis]) * self.inverse[axis];
            let b = (f64::from(node.max[axis]) - self.origin[axis]) * self.inverse[axis];
            from = from.max(a.min(b));
            to = to.min(a.max(b) * SLACK);
        }
        (from <= to).then_some(from)
    }
}

/// Inverse of a direction, finite in all components.
pub(crate) fn safe_inverse(direction: DVec3) -> DVec3 {
    let least = direction.abs().max_element() * 1e-30;
    let held = |x: f64| if x.abs() < least { least.copysign(x) } else { x };
    DVec3::new(held(direction.x), held(direction.y), held(direction.z)).recip()
}
