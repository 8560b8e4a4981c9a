//! Collapses a binary tree into one of eight children a node, at the least expected cost of rays.
//!
//! For each binary node the cost is found of representing its subtree by one to seven roots, from the leaves up (Ylitie,
//! Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", 2017, section 3.1).

use crate::bvh::Node;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Most triangles of a leaf.
pub(super) const LEAF: usize = 3;
/// Cost of testing a triangle, in units of that of testing a node's boxes.
const TRIANGLE_COST: f32 = 0.4;

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub(super) min: [f32; 3],
    pub(super) max: [f32; 3],
}

impl Bounds {
    /// A point.
    pub(super) const NOTHING: Self = Self { min: [0.0; 3], max: [0.0; 3] };

    /// The box around both.
    pub(super) fn with(self, other: Self) -> Self {
        let pick =
            |f: fn(f32, f32) -> f32, a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|axis| f(a[axis], b[axis]));
        Self { min: pick(f32::min, self.min, other.min), max: pick(f32::max, self.max, other.max) }
    }

    /// Half its surface area.
    pub(super) fn surface(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|axis| self.max[axis] - self.min[axis]);
        x * y + y * z + z * x
    }

    /// Its middle along an axis.
    pub(super) fn middle(&self, axis: usize) -> f32 {
        self.min[axis] * 0.5 + self.max[axis] * 0.5
    }

    pub(super) fn longest_axis(&self) -> usize {
        let length = |axis: &usize| self.max[*axis] - self.min[*axis];
        (0..3).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(0)
    }
}

/// A binary tree with at most [`LEAF`] items a leaf, and how it is to be collapsed.
pub(super) struct Binary {
    nodes: Vec<BinaryNode>,
    /// Items, leaf by leaf.
    order: Vec<u32>,
}

struct BinaryNode {
    bounds: Bounds,
    /// Children; `None` for a leaf.
    children: Option<[u32; 2]>,
    /// Range of its items in [`Binary::order`].
    first: u32,
    count: u32,
    /// Whether its subtree becomes one leaf.
    joins: bool,
    /// How many of some number of roots are below its first child; 0 if one root less is as good.
    left: [u8; WIDTH + 1],
}

/// Costs of representing a subtree by one to seven roots.
type Costs = [f32; WIDTH];

impl Binary {
    /// The tree of triangles or other items below `root`. `bounds_of`: box of an item. `most`: most items of a leaf.
    pub(super) fn new(nodes: &[Node], root: u32, most: usize, bounds_of: &impl Fn(u32) -> Bounds) -> Self {
        let mut tree = Self { nodes: Vec::new(), order: Vec::new() };
        tree.take(nodes, root, most, bounds_of);
        tree.plan(0, most);
        tree
    }

    /// Box of a node.
    pub(super) fn bounds(&self, at: u32) -> Bounds {
        self.nodes[at as usize].bounds
    }

    /// Items of a node that becomes a leaf; `None` for one that becomes a node.
    pub(super) fn items(&self, at: u32) -> Option<&[u32]> {
        let node = &self.nodes[at as usize];
        node.joins.then(|| &self.order[node.first as usize..(node.first + node.count) as usize])
    }

    /// The children of a node in the wide tree, one to eight. A leaf is its own child: it is the root.
    pub(super) fn children(&self, at: u32) -> Vec<u32> {
        let mut found = Vec::with_capacity(WIDTH);
        let node = &self.nodes[at as usize];
        match node.children {
            Some([a, b]) if !node.joins => {
                let left = usize::from(node.left[WIDTH]);
                self.roots(a, left, &mut found);
                self.roots(b, WIDTH - left, &mut found);
            }
            _ => found.push(at),
        }
        found
    }

    /// Appends at most `count` nodes that represent a subtree.
    fn roots(&self, at: u32, count: usize, found: &mut Vec<u32>) {
        let node = &self.nodes[at as usize];
        let Some([a, b]) = node.children.filter(|_| count > 1) else { return found.push(at) };
        match usize::from(node.left[count]) {
            0 => self.roots(at, count - 1, found),
            left => {
                self.roots(a, left, found);
                self.roots(b, count - left, found);
            }
        }
    }

    /// Appends a subtree. Returns its index.
    fn take(&mut self, nodes: &[Node], at: u32, most: usize, bounds_of: &impl Fn(u32) -> Bounds) -> u32 {
        let Node { min, max, count, first } = nodes[at as usize];
        if count > 0 {
            let mut items: Vec<u32> = (first..first + count).collect();
            return self.take_items(&mut items, most, bounds_of);
        }
        let index = self.push(Bounds { min, max });
        let children = [first, first + 1].map(|child| self.take(nodes, child, most, bounds_of));
        self.close(index, children)
    }

    /// Appends items as a subtree, which is split in the middle where it has more than `most`.
    fn take_items(&mut self, items: &mut [u32], most: usize, bounds_of: &impl Fn(u32) -> Bounds) -> u32 {
        let around =
            items.iter().map(|&item| bounds_of(item)).reduce(Bounds::with).unwrap_or(Bounds::NOTHING);
        let index = self.push(around);
        if items.len() <= most {
            self.order.extend_from_slice(items);
            self.nodes[index as usize].count = items.len() as u32;
            return index;
        }
        let axis = around.longest_axis();
        items.sort_by(|&a, &b| bounds_of(a).middle(axis).total_cmp(&bounds_of(b).middle(axis)));
        // Whole leaves first, so that few have one item.
        let (a, b) = items.split_at_mut((items.len() / 2).next_multiple_of(most).min(items.len() - 1));
        let children = [self.take_items(a, most, bounds_of), self.take_items(b, most, bounds_of)];
        self.close(index, children)
    }

    fn push(&mut self, bounds: Bounds) -> u32 {
        let first = self.order.len() as u32;
        let left = [0; WIDTH + 1];
        self.nodes.push(BinaryNode { bounds, children: None, first, count: 0, joins: false, left });
        self.nodes.len() as u32 - 1
    }

    fn close(&mut self, index: u32, children: [u32; 2]) -> u32 {
        let end = self.order.len() as u32;
        let node = &mut self.nodes[index as usize];
        (node.children, node.count) = (Some(children), end - node.first);
        index
    }

    /// Decides how a subtree is collapsed. Returns its costs.
    fn plan(&mut self, at: u32, most: usize) -> Costs {
        let node = &self.nodes[at as usize];
        let surface = node.bounds.surface();
        let as_leaf = surface * node.count as f32 * TRIANGLE_COST;
        let fits = node.count as usize <= most;
        let Some(children) = node.children else {
            self.nodes[at as usize].joins = true;
            return [as_leaf; WIDTH];
        };
        let [a, b] = children.map(|child| self.plan(child, most));
        let mut left = [0u8; WIDTH + 1];
        let mut shared = [f32::INFINITY; WIDTH + 1];
        for roots in 2..=WIDTH {
            for of_a in 1..roots {
                let cost = a[of_a] + b[roots - of_a];
                if cost < shared[roots] {
                    (shared[roots], left[roots]) = (cost, of_a as u8);
                }
            }
        }
        let as_node = surface + shared[WIDTH];
        let joins = fits && as_leaf <= as_node;
        let mut costs = [f32::INFINITY; WIDTH];
        costs[1] = if joins { as_leaf } else { as_node };
        for roots in 2..WIDTH {
            costs[roots] = shared[roots];
            if costs[roots - 1] <= shared[roots] {
                (costs[roots], left[roots]) = (costs[roots - 1], 0);
            }
        }
        let node = &mut self.nodes[at as usize];
        (node.joins, node.left) = (joins, left);
        costs
    }
}
