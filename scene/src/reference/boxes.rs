//! Hierarchies of boxes that never lose a surface.
//!
//! A [`BoxTree`] is an obvhs BVH2 in f32 about the middle of its boxes, scaled to unit size, so that it neither
//! overflows nor underflows. Rays come in f64. Before rounding, their origin moves to the entry into the tree's box,
//! so no f32 is larger than the tree, at any distance of the eye or the world's origin. The remaining error is
//! bounded: rounding of the origin, the direction times the length travelled, and the slab test are each a few units
//! of 2⁻²⁴ of the tree's size, and obvhs replaces direction components below 2⁻²³ by that. Boxes are padded by
//! [`PADDING`], 2⁻¹⁸ of the size, which exceeds the sum of these errors.

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::fast_stack;
use obvhs::ploc::PlocBuilder;
use obvhs::ray::{Ray, RayHit};

use crate::Bounds;

/// Padding of each box, as a share of the longest edge of the box around all of them.
const PADDING: f64 = 1.0 / (1 << 18) as f64;

/// A hierarchy over boxes; a box is known by its position in the list passed to [`Self::new`].
pub(super) struct BoxTree {
    bvh: Bvh2,
    /// Middle of all boxes: the origin of the f32 coordinates.
    center: DVec3,
    /// Half edges of the padded box around all boxes.
    half: DVec3,
    /// Padding of every box, metres.
    padding: f64,
    /// Factor from metres to the f32 coordinates.
    scale: f64,
}

impl BoxTree {
    /// A tree over boxes that are neither empty nor infinite, at most `a_leaf` (1 to 255) per leaf: few where a visit is
    /// expensive.
    pub(super) fn new(boxes: &[Bounds], a_leaf: u32) -> Self {
        let mut all = Bounds::EMPTY;
        for b in boxes {
            all.extend(b.min);
            all.extend(b.max);
        }
        let center = all.center();
        // At least 2^-500, so that a tree that is a single point has a size to be scaled by.
        let extent = all.size().max_element().max(2.0_f64.powi(-500));
        let padding = extent * PADDING;
        let scale = extent.recip();
        let grown: Vec<Aabb> = boxes
            .iter()
            .map(|b| {
                let point = |p: DVec3| Vec3A::from(((p - center) * scale).as_vec3());
                Aabb::new(point(b.min - padding), point(b.max + padding))
            })
            .collect();
        // Twice the padding: at least as large as the rounded boxes inside.
        let half = all.size() * 0.5 + 2.0 * padding;
        Self { bvh: build(&grown, a_leaf), center, half, padding, scale }
    }

    /// The index of the box at each position of [`Self::visit`], in the list passed to [`Self::new`].
    pub(super) fn order(&self) -> &[u32] {
        &self.bvh.primitive_indices
    }

    /// Calls `leaf` with the positions in [`Self::order`] of boxes that the ray may meet before `limit`, roughly from
    /// near to far. `leaf` returns a new limit in units of `direction`, like t. `direction` must be finite and not
    /// zero.
    pub(super) fn visit(
        &self,
        origin: DVec3,
        direction: DVec3,
        limit: f64,
        mut leaf: impl FnMut(usize) -> f64,
    ) {
        // Scaled first: a strongly scaling instance makes directions whose squares would underflow.
        let most = direction.abs().max_element();
        let length = (direction / most).length() * most;
        let unit = direction / length;
        let from_center = origin - self.center;
        let Some(entry) = entry(from_center, unit, self.half) else { return };
        // Boxes a little beyond the limit are visited too: the f32 ray may enter them late by a padding.
        let rounded =
            |limit: f64| (((limit * length - entry + 2.0 * self.padding) * self.scale) as f32).next_up();
        let start = ((from_center + unit * entry) * self.scale).as_vec3();
        let reach = rounded(limit);
        if !start.is_finite() || !(reach > 0.0) {
            return;
        }
        let ray = Ray::new(start.into(), unit.as_vec3().into(), 0.0, reach);
        let mut leaves = |node: &Bvh2Node, ray: &mut Ray, _: &mut RayHit| {
            for position in node.first_index..node.first_index + node.prim_count {
                ray.tmax = ray.tmax.min(rounded(leaf(position as usize)));
            }
            true
        };
        fast_stack!(u32, (64, 256), self.bvh.max_depth, stack, {
            self.bvh.ray_traverse_dynamic(&mut stack, ray, &mut RayHit::none(), &mut leaves);
        });
    }
}

/// The distance at which a ray enters the box of half edge lengths `half` around zero; 0 if it starts inside.
fn entry(origin: DVec3, unit: DVec3, half: DVec3) -> Option<f64> {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        if unit[axis] == 0.0 {
            if origin[axis].abs() > half[axis] {
                return None;
            }
            continue;
        }
        let (a, b) = ((-half[axis] - origin[axis]) / unit[axis], (half[axis] - origin[axis]) / unit[axis]);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter <= leave).then_some(enter)
}

/// Obvhs' "medium" build, step by step: its helper function also validates the tree under debug assertions, which
/// takes longer than the build.
fn build(boxes: &[Aabb], a_leaf: u32) -> Bvh2 {
    let params = BvhBuildParams::medium_build();
    let mut bvh = PlocBuilder::with_capacity(boxes.len()).build(
        params.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        params.sort_precision,
        params.search_depth_threshold,
    );
    let mut optimizer = ReinsertionOptimizer::default();
    let ratio = params.reinsertion_batch_ratio;
    optimizer.run(&mut bvh, ratio, None);
    collapse(&mut bvh, a_leaf, params.collapse_traversal_cost);
    optimizer.run(&mut bvh, ratio * params.post_collapse_reinsertion_batch_ratio_multiplier, None);
    // Reinsertion can deepen the tree beyond the builder's figure, which sizes the traversal's stack.
    bvh.max_depth = depth(&bvh) + 1;
    bvh
}

/// Edges from the root to the deepest leaf.
fn depth(bvh: &Bvh2) -> usize {
    let mut deepest = 0;
    let mut pending = vec![(0, 0)];
    while let Some((index, depth)) = pending.pop() {
        deepest = deepest.max(depth);
        if let Some(node) = bvh.nodes.get(index as usize).filter(|node| !node.is_leaf()) {
            pending.extend([(node.first_index, depth + 1), (node.first_index + 1, depth + 1)]);
        }
    }
    deepest
}
