//! Packets of rays with a common origin, and their traversal of a tree.
//!
//! A ray's result does not depend on its packet. Every box that the ray's own slab test hits is visited while it begins
//! no farther than the nearest hit so far. A hit counts only inside the leaf's box, if the ray hits that box. Of equally
//! near hits the lower ids win. Boxes nest and rounding is monotonic, so a ray that hits a leaf hits all its ancestors.
//! Tests of the whole packet only skip work.
//!
//! All rays start at the eye, so a triangle is prepared once a packet. Edge functions are the volumes of direction and
//! two corners, three dot products a ray (as in Benthin's and Wald's packet tracers). Products of edges are Plücker
//! coordinates, so both triangles at an edge compute the same bits with opposite signs, and no ray passes between them.

use std::ops::Range;

use super::cutouts::Cutouts;
use super::lanes::{LANES, Lanes, Mask};
use crate::bvh::{Node, Triangle, flags};

/// Slack for rounding of a ray's exit from a box: three operations of at most 2⁻²⁴ each, at both ends.
const SLACK: f32 = 1.0 + 1.0 / (1 << 20) as f32;

/// Smallest component of a direction, as a share of the largest, so that its inverse is finite.
const FLATTEST: f32 = 1e-20;

/// Three coordinates of eight rays.
pub(super) type Directions<L> = [L; 3];

/// The nearest hits of a packet of `V` vectors of rays.
pub(super) struct Nearest<L, const V: usize> {
    /// Distance in units of the direction.
    pub(super) t: [L; V],
    /// Instance + 1 and primitive of each ray; 0 without a hit.
    pub(super) ids: [[[u32; 2]; LANES]; V],
}

impl<L: Lanes, const V: usize> Nearest<L, V> {
    #[inline(always)]
    pub(super) fn none() -> Self {
        Self { t: [L::splat(f32::MAX); V], ids: [[[0; 2]; LANES]; V] }
    }

    /// The farthest hit.
    #[inline(always)]
    fn farthest(&self) -> f32 {
        let mut all = self.t[0];
        for t in self.t {
            all = all.max(t);
        }
        most(all)
    }
}

/// Directions of a packet in a tree's space, prepared for traversal.
pub(super) struct Packet<L, const V: usize> {
    eye: [f32; 3],
    direction: [Directions<L>; V],
    inverse: [Directions<L>; V],
    /// Axis along which boxes are ordered.
    middle: [f32; 3],
    /// Bounds of the inverse along each axis; both 0 where signs differ.
    least: [f32; 3],
    most: [f32; 3],
    /// Added to the packet's exit from a slab; infinite where signs differ.
    beyond: [f32; 3],
    /// Whether the packet goes along the negative axis; arbitrary where signs differ.
    negative: [bool; 3],
}

/// Rays of a packet that hit a box, and where they enter it.
pub(super) struct Entry<L: Lanes, const V: usize> {
    at: [L; V],
    mask: [L::Mask; V],
}

/// Visitor of a tree's leaves.
pub(super) trait Leaves<L: Lanes, const V: usize> {
    /// Visits a leaf: its range of items, and the rays that hit its box.
    fn visit(
        &mut self,
        packet: &Packet<L, V>,
        items: Range<usize>,
        entry: &Entry<L, V>,
        nearest: &mut Nearest<L, V>,
    );
}

impl<L: Lanes, const V: usize> Packet<L, V> {
    /// A packet of finite directions; `eye` is in the tree's space.
    #[inline(always)]
    pub(super) fn new(eye: [f32; 3], direction: &[Directions<L>; V]) -> Self {
        let middle = direction[V / 2];
        let mut packet = Self {
            eye,
            direction: *direction,
            inverse: *direction,
            middle: [middle[0], middle[1], middle[2]].map(|x| x.to_array()[LANES / 2]),
            least: [0.0; 3],
            most: [0.0; 3],
            beyond: [0.0; 3],
            negative: [false; 3],
        };
        let zero = L::splat(0.0);
        for axis in 0..3 {
            let (mut lower, mut upper) = (L::splat(f32::MAX), L::splat(-f32::MAX));
            for (inverse, d) in packet.inverse.iter_mut().zip(direction) {
                let size = |x: L| x.max(zero - x);
                let longest = size(d[0]).max(size(d[1])).max(size(d[2]));
                let held = size(d[axis]).max(longest * L::splat(FLATTEST)).max(L::splat(f32::MIN_POSITIVE));
                let held = held.replaced(d[axis].lt(zero), zero - held);
                inverse[axis] = L::splat(1.0).div(held);
                lower = lower.min(inverse[axis]);
                upper = upper.max(inverse[axis]);
            }
            let (lower, upper) = (least(lower), most(upper));
            packet.negative[axis] = upper < 0.0;
            if (lower > 0.0) == (upper > 0.0) {
                (packet.least[axis], packet.most[axis]) = (lower, upper);
            } else {
                packet.beyond[axis] = f32::INFINITY;
            }
        }
        packet
    }

    /// Visits the leaves that rays may hit between `near` and their nearest hit, roughly by distance.
    #[inline(always)]
    pub(super) fn walk(
        &self,
        nodes: &[Node],
        root: u32,
        near: f32,
        nearest: &mut Nearest<L, V>,
        stack: &mut Vec<u32>,
        leaves: &mut impl Leaves<L, V>,
    ) {
        let bottom = stack.len();
        stack.push(root);
        let mut farthest = nearest.farthest();
        while stack.len() > bottom {
            let Some(node) = stack.pop().and_then(|index| nodes.get(index as usize)) else { break };
            let (min, max) = (difference(node.min, self.eye), difference(node.max, self.eye));
            if !self.may_meet(min, max, near, farthest) {
                continue;
            }
            if node.count == 0 {
                let mut v = 0;
                while v < V && !self.enter(v, min, max, near, nearest.t[v]).1.any() {
                    v += 1;
                }
                if v < V {
                    let (first, second) = (node.first, node.first + 1);
                    let order = self.order(&nodes[first as usize], &nodes[second as usize]);
                    let (nearer, farther) = if order { (first, second) } else { (second, first) };
                    stack.push(farther);
                    stack.push(nearer);
                }
                continue;
            }
            let mut entry = Entry { at: nearest.t, mask: [L::Mask::none(); V] };
            let mut meets = false;
            for v in 0..V {
                (entry.at[v], entry.mask[v]) = self.enter(v, min, max, near, nearest.t[v]);
                meets |= entry.mask[v].any();
            }
            if meets {
                let first = node.first as usize;
                leaves.visit(self, first..first + node.count as usize, &entry, nearest);
                farthest = nearest.farthest();
            }
        }
        stack.truncate(bottom);
    }

    /// Whether any ray may hit a box relative to the eye. Never false for a hit.
    #[inline(always)]
    fn may_meet(&self, min: [f32; 3], max: [f32; 3], near: f32, farthest: f32) -> bool {
        let (mut enter, mut leave) = (near, farthest);
        for axis in 0..3 {
            let (a, b) = if self.negative[axis] { (max[axis], min[axis]) } else { (min[axis], max[axis]) };
            let in_at = lesser(a * self.least[axis], a * self.most[axis]);
            let out_at = greater(b * self.least[axis], b * self.most[axis]) + self.beyond[axis];
            enter = greater(enter, in_at);
            leave = lesser(leave, out_at * SLACK);
        }
        enter <= leave
    }

    /// Where rays of a vector enter a box relative to the eye, and which of them hit it before their nearest hit.
    #[inline(always)]
    fn enter(&self, v: usize, min: [f32; 3], max: [f32; 3], near: f32, limit: L) -> (L, L::Mask) {
        let [x, y, z] = self.inverse[v];
        let (x0, x1) = (x * L::splat(min[0]), x * L::splat(max[0]));
        let (y0, y1) = (y * L::splat(min[1]), y * L::splat(max[1]));
        let (z0, z1) = (z * L::splat(min[2]), z * L::splat(max[2]));
        let enter = x0.min(x1).max(y0.min(y1)).max(z0.min(z1).max(L::splat(near)));
        let leave = x0.max(x1).min(y0.max(y1)).min(z0.max(z1)) * L::splat(SLACK);
        (enter, enter.le(leave.min(limit)))
    }

    /// Whether the first of two boxes comes first along the packet.
    #[inline(always)]
    fn order(&self, first: &Node, second: &Node) -> bool {
        let mut along = 0.0;
        for axis in 0..3 {
            let apart = (first.min[axis] - second.min[axis]) + (first.max[axis] - second.max[axis]);
            along += apart * self.middle[axis];
        }
        along <= 0.0
    }

    /// Intersects a triangle of a leaf.
    #[inline(always)]
    pub(super) fn meet(
        &self,
        triangle: &Triangle,
        ids: [u32; 2],
        near: f32,
        entry: &Entry<L, V>,
        nearest: &mut Nearest<L, V>,
        cutouts: &Cutouts,
    ) {
        let a = difference(triangle.a, self.eye);
        let b = difference(triangle.b, self.eye);
        let c = difference(triangle.c, self.eye);
        let edge_a = cross(sum(b, c), difference(c, b));
        let edge_b = cross(sum(c, a), difference(a, c));
        let edge_c = cross(sum(a, b), difference(b, a));
        let normal = cross(difference(b, a), difference(c, a));
        let height = L::splat(normal[0] * a[0] + normal[1] * a[1] + normal[2] * a[2]);
        let one_sided = triangle.flags & flags::ONE_SIDED != 0;
        let zero = L::splat(0.0);
        for v in 0..V {
            if !entry.mask[v].any() {
                continue;
            }
            let d = self.direction[v];
            let (wa, wb, wc) = (dot(d, edge_a), dot(d, edge_b), dot(d, edge_c));
            // From the front, volumes are negative.
            let mut inside = wa.max(wb).max(wc).le(zero);
            if !one_sided {
                inside = inside.or(zero.le(wa.min(wb).min(wc)));
            }
            let inside = inside.and(entry.mask[v]);
            if !inside.any() {
                continue;
            }
            let t = height.div(dot(d, normal));
            // Infinite or NaN for a plane seen edge-on, which is not hit.
            let crossed = t.lt(L::splat(f32::MAX)).and(L::splat(near).le(t));
            // Inside the leaf's box, so that culling by distance is exact.
            let t = t.max(entry.at[v]);
            let mut closer = inside.and(crossed).and(t.le(nearest.t[v]));
            if !closer.any() {
                continue;
            }
            if triangle.flags & flags::CUTOUT != 0 {
                let weights = [wa, wb, wc].map(|w| w.to_array());
                closer = closer.without(L::Mask::from_bits(seen_through(
                    closer.bits(),
                    weights,
                    triangle,
                    ids,
                    cutouts,
                )));
            }
            let ties = closer.and(t.eq(nearest.t[v])).bits();
            if ties != 0 {
                let mut kept = 0;
                for lane in 0..LANES {
                    // Without a hit the distance is the maximum, so there is no tie.
                    kept |= u32::from(ties >> lane & 1 == 1 && nearest.ids[v][lane] <= ids) << lane;
                }
                closer = closer.without(L::Mask::from_bits(kept));
            }
            nearest.t[v] = nearest.t[v].replaced(closer, t);
            let mut bits = closer.bits();
            while bits != 0 {
                nearest.ids[v][bits.trailing_zeros() as usize % LANES] = ids;
                bits &= bits - 1;
            }
        }
    }
}

/// Which rays that hit a cut-out or a blended surface see through it, by the volumes at its edges. What a transparent surface
/// hides in part is found apart: `layers.rs`.
#[inline(never)]
fn seen_through(
    rays: u32,
    volumes: [[f32; LANES]; 3],
    triangle: &Triangle,
    ids: [u32; 2],
    cutouts: &Cutouts,
) -> u32 {
    let mut through = 0;
    for lane in (0..LANES).filter(|lane| rays >> lane & 1 == 1) {
        let [a, b, c] = volumes.map(|w| w[lane]);
        let whole = a + b + c;
        let (mut beta, mut gamma) = (b / whole, c / whole);
        if triangle.flags & flags::MIRRORED != 0 {
            (beta, gamma) = (gamma, beta);
        }
        through |= u32::from(cutouts.coverage([ids[0] - 1, ids[1]], beta, gamma) < cutouts.least) << lane;
    }
    through
}

#[inline(always)]
fn least<L: Lanes>(lanes: L) -> f32 {
    let lanes = lanes.to_array();
    let mut least = lanes[0];
    for x in lanes {
        least = lesser(x, least);
    }
    least
}

#[inline(always)]
fn most<L: Lanes>(lanes: L) -> f32 {
    let lanes = lanes.to_array();
    let mut most = lanes[0];
    for x in lanes {
        most = greater(x, most);
    }
    most
}

#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn sum(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn difference(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot<L: Lanes>(d: Directions<L>, v: [f32; 3]) -> L {
    d[0] * L::splat(v[0]) + d[1] * L::splat(v[1]) + d[2] * L::splat(v[2])
}
