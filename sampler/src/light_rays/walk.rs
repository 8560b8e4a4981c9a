//! One ray against eight boxes, and against eight triangles.
//!
//! The test of triangles is that of Woop, Benthin and Wald ("Watertight Ray/Triangle Intersection", 2013): corners are
//! sheared into the ray's frame, where edge functions are differences of two products. Such a difference has the right
//! sign or is zero, because rounding is monotonic and nothing is fused. Zero counts as inside. So a ray that passes
//! between triangles of an object which share corners always hits one of them.
//!
//! Rounding moves corners in that frame by a share of their distance. Boxes are widened by more than that.

use std::mem::MaybeUninit;

use glam::Vec3;

use super::tree::{Block, LEAF, Node, STACK};
use crate::packets::lanes::{LANES, Lanes, Mask};

/// Slack for rounding of a ray's exit from a box: three operations of at most 2⁻²⁴ each, at both ends.
const SLACK: f32 = 1.0 + 1.0 / (1 << 20) as f32;
/// Largest movement of a corner in the ray's frame, as a share of its distance: five roundings of 2⁻²⁴, rounded up.
const MOVED: f32 = 8.0 / (1 << 24) as f32;
/// Added to [`MOVED`], as a share of the origin's coordinates, so that widening changes them.
const LAST_PLACE: f32 = 4.0 / (1 << 24) as f32;

/// A ray, prepared for the boxes of a tree.
pub(super) struct Slabs<L> {
    /// Origin for planes through which the ray enters boxes, and for those through which it leaves.
    near: [L; 3],
    far: [L; 3],
    inverse: [L; 3],
    /// For each axis, which plane of a box is entered: 0 for the smallest coordinate, 1 for the largest.
    entered: [usize; 3],
}

impl<L: Lanes> Slabs<L> {
    /// A finite ray in the space of a tree with the given box.
    #[inline(always)]
    pub(super) fn new(origin: Vec3, direction: Vec3, [min, max]: [Vec3; 2]) -> Self {
        let reach = (min - origin).abs().max((max - origin).abs()).max_element();
        let slack = reach * MOVED + origin.abs().max_element() * LAST_PLACE;
        let mut slabs = Self {
            near: [L::splat(0.0); 3],
            far: [L::splat(0.0); 3],
            inverse: [L::splat(0.0); 3],
            entered: [0; 3],
        };
        for axis in 0..3 {
            let negative = direction[axis].is_sign_negative();
            let slack = if negative { -slack } else { slack };
            // Finite for a direction of zero, so that no product is NaN.
            let inverse = direction[axis].recip().clamp(f32::MIN, f32::MAX);
            slabs.near[axis] = L::splat(origin[axis] + slack);
            slabs.far[axis] = L::splat(origin[axis] - slack);
            slabs.inverse[axis] = L::splat(inverse);
            slabs.entered[axis] = usize::from(negative);
        }
        slabs
    }

    /// Bits of a node's boxes that the ray may hit before `limit`, and where it enters them: at least +0.
    #[inline(always)]
    fn enter(&self, node: &Node, limit: f32) -> (u32, L) {
        let zero = L::splat(0.0);
        let enter = self.into(node, 0).max(self.into(node, 1)).max(self.into(node, 2)).max(zero);
        let leave = self.out_of(node, 0).min(self.out_of(node, 1)).min(self.out_of(node, 2));
        let leave = leave * L::splat(SLACK);
        (enter.le(leave.min(L::splat(limit))).bits(), enter)
    }

    /// Where the ray passes the planes of one axis through which it enters.
    #[inline(always)]
    fn into(&self, node: &Node, axis: usize) -> L {
        let planes = L::from_array(node.planes[axis][self.entered[axis] & 1]);
        (planes - self.near[axis]) * self.inverse[axis]
    }

    /// Where the ray passes the planes of one axis through which it leaves.
    #[inline(always)]
    fn out_of(&self, node: &Node, axis: usize) -> L {
        let planes = L::from_array(node.planes[axis][self.entered[axis] & 1 ^ 1]);
        (planes - self.far[axis]) * self.inverse[axis]
    }
}

/// Visitor of a tree's leaves.
pub(super) trait Leaves {
    /// Visits a leaf. Returns how far along the ray anything is still of interest; negative to end the traversal.
    fn visit(&mut self, leaf: u32, limit: f32) -> f32;
}

/// References that are pending, each below the bits of where the ray enters it, which is not negative.
struct Stack {
    entries: [MaybeUninit<u64>; STACK],
    /// The entries below are set.
    held: usize,
}

impl Stack {
    #[inline(always)]
    fn new() -> Self {
        Self { entries: [const { MaybeUninit::uninit() }; STACK], held: 0 }
    }

    #[inline(always)]
    fn get(&self, at: usize) -> u64 {
        debug_assert!(at < self.held);
        // SAFETY: callers ask for entries below `held`, which `push` has set.
        unsafe { self.entries[at].assume_init() }
    }

    #[inline(always)]
    fn push(&mut self, entry: u64) {
        self.entries[self.held] = MaybeUninit::new(entry);
        self.held += 1;
    }

    /// Pushes an entry below those since `bottom` that are nearer.
    #[inline(always)]
    fn insert(&mut self, entry: u64, bottom: usize) {
        self.push(entry);
        let mut at = self.held - 1;
        while at > bottom && self.get(at - 1) < entry {
            self.entries[at] = self.entries[at - 1];
            at -= 1;
        }
        self.entries[at] = MaybeUninit::new(entry);
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<u64> {
        if self.held == 0 {
            return None;
        }
        let entry = self.get(self.held - 1);
        self.held -= 1;
        Some(entry)
    }
}

/// Visits the leaves that a ray may hit before `limit`, the nearest first if `ORDERED`. Returns the last limit.
#[inline(always)]
pub(super) fn walk<L: Lanes, const ORDERED: bool>(
    nodes: &[Node],
    root: u32,
    slabs: &Slabs<L>,
    mut limit: f32,
    leaves: &mut impl Leaves,
) -> f32 {
    let mut stack = Stack::new();
    let mut at = root;
    loop {
        if at & LEAF != 0 {
            limit = leaves.visit(at & !LEAF, limit);
            if limit < 0.0 {
                return limit;
            }
        } else if let Some(node) = nodes.get(at as usize) {
            let (mut hit, enter) = slabs.enter(node, limit);
            if hit != 0 {
                let enter = if ORDERED { enter.to_array() } else { [0.0; LANES] };
                let mut nearest = entry(node, &enter, hit);
                hit &= hit - 1;
                let bottom = stack.held;
                while hit != 0 {
                    let other = entry(node, &enter, hit);
                    hit &= hit - 1;
                    if ORDERED {
                        stack.insert(nearest.max(other), bottom);
                        nearest = nearest.min(other);
                    } else {
                        stack.push(other);
                    }
                }
                at = nearest as u32;
                continue;
            }
        }
        loop {
            let Some(entry) = stack.pop() else { return limit };
            if !ORDERED || f32::from_bits((entry >> 32) as u32) <= limit {
                at = entry as u32;
                break;
            }
        }
    }
}

/// Entry for the first of some children.
#[inline(always)]
fn entry(node: &Node, enter: &[f32; LANES], children: u32) -> u64 {
    let lane = children.trailing_zeros() as usize % LANES;
    u64::from(enter[lane].to_bits()) << 32 | u64::from(node.children[lane])
}

/// A ray, prepared for triangles.
pub(super) struct Shear {
    origin: [f32; 3],
    /// The third axis is that along which the ray is longest. Exchanging the others keeps the winding.
    axes: [usize; 3],
    shear: [f32; 2],
    inverse: f32,
}

/// Which triangles of a block a ray hits, and where.
pub(super) struct Met<L> {
    /// Bits of the triangles.
    pub(super) hit: u32,
    /// Distance in units of the direction.
    pub(super) t: L,
    /// Twice the areas of the sheared triangle, and of its parts opposite the second and third corner.
    pub(super) area: L,
    pub(super) parts: [L; 2],
}

impl Shear {
    /// A finite ray with a direction.
    #[inline(always)]
    pub(super) fn new(origin: Vec3, direction: Vec3) -> Self {
        let size = direction.abs();
        let along = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let (mut first, mut second) = ((along + 1) % 3, (along + 2) % 3);
        if direction[along] < 0.0 {
            (first, second) = (second, first);
        }
        Self {
            origin: origin.to_array(),
            axes: [first, second, along],
            shear: [direction[first] / direction[along], direction[second] / direction[along]],
            inverse: direction[along].recip(),
        }
    }

    /// Intersects the triangles of a block between 0 and `limit`.
    #[inline(always)]
    pub(super) fn meet<L: Lanes>(&self, block: &Block, limit: f32) -> Option<Met<L>> {
        let [a, b, c] = &block.corners;
        let (a, b, c) = (self.sheared::<L>(a), self.sheared::<L>(b), self.sheared::<L>(c));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let zero = L::splat(0.0);
        let front = zero.le(u.min(v).min(w)).bits();
        let back = u.max(v).max(w).le(zero).bits();
        let inside = front | back & block.back;
        if inside == 0 {
            return None;
        }
        let area = u + v + w;
        let along = u * a[2] + v * b[2] + w * c[2];
        // NaN or infinite for a triangle that is seen edge-on, which is not hit.
        let t = along.div(area) * L::splat(self.inverse);
        let hit = inside & zero.lt(t).and(t.lt(L::splat(limit))).bits();
        if hit == 0 { None } else { Some(Met { hit, t, area, parts: [v, w] }) }
    }

    /// A corner in the ray's frame.
    #[inline(always)]
    fn sheared<L: Lanes>(&self, corner: &[[f32; LANES]; 3]) -> [L; 3] {
        let x = self.about_origin::<L>(corner, 0);
        let y = self.about_origin::<L>(corner, 1);
        let z = self.about_origin::<L>(corner, 2);
        [x - L::splat(self.shear[0]) * z, y - L::splat(self.shear[1]) * z, z]
    }
    #[inline(always)]
    fn about_origin<L: Lanes>(&self, corner: &[[f32; LANES]; 3], which: usize) -> L {
        let axis = self.axes[which];
        L::from_array(corner[axis]) - L::splat(self.origin[axis])
    }
}
