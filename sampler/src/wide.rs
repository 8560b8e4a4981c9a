//! Wide BVHs (8 children per node) in the layout of the compute tracer.
//!
//! Eight lanes of a packet (`shaders/sampler/trace.wgsl`) test the children of a node in parallel, and then the triangles of
//! a leaf. So nodes have up to eight adjacent children, and leaves up to eight triangles. The binary trees of [`crate::bvh`]
//! are collapsed: the child with the largest surface area is replaced by its children, until there are eight (Wald, Benthin
//! and Boulos, "Getting Rid of Packets", 2008, section 2.2).

use std::ops::Range;

use argus_shaders::layout::sampler::Child;
use glam::DVec3;

use crate::bvh::{Hierarchy, Node, Triangle, flags};

/// Most children of a node, and most triangles of a leaf.
const WIDTH: u32 = 8;

/// Bit of [`Child::kinds`]: opaque triangles.
const OPAQUE: u32 = 1;
/// Bit of [`Child::kinds`]: alpha-tested triangles.
const CUTOUT: u32 = 2;

/// Limit of the index in a reference, which has 28 bits.
const MAX_INDEX: usize = 1 << 28;

/// Encodes a [`Child::reference`] to `count` children or triangles, starting at index `first`.
fn reference(first: usize, count: usize, leaf: bool) -> u32 {
    (count as u32 - 1) << 29 | u32::from(leaf) << 28 | first as u32
}

/// The wide trees of all objects.
#[derive(Clone, Default)]
pub(crate) struct Wide {
    /// Children of all nodes of all trees.
    pub(crate) children: Vec<Child>,
    /// Triangles of all trees, leaf by leaf.
    pub(crate) triangles: Vec<Triangle>,
    /// Root of each object, in the form of a child.
    pub(crate) roots: Vec<Child>,
    /// Levels of inner nodes of the deepest tree.
    pub(crate) levels: u32,
}

impl Wide {
    /// Converts all objects of a hierarchy. `None` if references cannot index their triangles or nodes.
    pub(crate) fn new(hierarchy: &Hierarchy) -> Option<Self> {
        if hierarchy.triangles.len().max(hierarchy.nodes.len()) > MAX_INDEX {
            return None;
        }
        let mut wide = Self::default();
        let kind = |t: &Triangle| if t.flags & flags::CUTOUT == 0 { OPAQUE } else { CUTOUT };
        let kinds = |range: Range<usize>| hierarchy.triangles[range].iter().fold(0, |all, t| all | kind(t));
        let mut subtrees = vec![Subtree::default(); hierarchy.nodes.len()];
        for object in &hierarchy.objects {
            summarize(&hierarchy.nodes, object.root, &kinds, &mut subtrees);
            let mut tree = Tree::new(&hierarchy.nodes, &subtrees, WIDTH, &mut wide.children);
            let triangles = &mut wide.triangles;
            let root = tree.convert(object.root, 0, &mut |range| {
                triangles.extend_from_slice(&hierarchy.triangles[range]);
                triangles.len()
            });
            wide.levels = wide.levels.max(tree.levels);
            wide.roots.push(root);
        }
        Some(wide)
    }

    /// The tree over placed objects relative to an eye, its root first; and its levels.
    pub(crate) fn top(&self, hierarchy: &Hierarchy, eye: DVec3) -> (Vec<Child>, u32) {
        let nodes = hierarchy.top_about(eye);
        let nothing = Child { min: [0.0; 3], reference: 0, max: [0.0; 3], kinds: 0 };
        let mut children = vec![nothing];
        if nodes.is_empty() {
            return (children, 0);
        }
        let kinds = |range: Range<usize>| {
            let kind = |at: usize| self.roots[hierarchy.placed[at].object as usize].kinds;
            range.fold(0, |all, at| all | kind(at))
        };
        let mut subtrees = vec![Subtree::default(); nodes.len()];
        summarize(&nodes, 0, &kinds, &mut subtrees);
        let mut tree = Tree::new(&nodes, &subtrees, 1, &mut children);
        // Placed objects keep their order, one per leaf.
        let root = tree.convert(0, 0, &mut |range| range.end);
        let levels = tree.levels;
        children[0] = root;
        (children, levels)
    }
}

/// Content of a subtree of a binary tree.
#[derive(Clone, Copy, Default)]
struct Subtree {
    /// Number of triangles or placed objects.
    items: u32,
    /// Bits [`OPAQUE`] and [`CUTOUT`] of its items.
    kinds: u32,
}

/// Computes the content of each subtree, from the leaves up. Returns that of `node`.
fn summarize(
    nodes: &[Node],
    node: u32,
    kinds: &impl Fn(Range<usize>) -> u32,
    subtrees: &mut [Subtree],
) -> Subtree {
    let Node { count, first, .. } = nodes[node as usize];
    let sum = if count > 0 {
        Subtree { items: count, kinds: kinds(first as usize..(first + count) as usize) }
    } else {
        let [a, b] = [first, first + 1].map(|child| summarize(nodes, child, kinds, subtrees));
        Subtree { items: a.items + b.items, kinds: a.kinds | b.kinds }
    };
    subtrees[node as usize] = sum;
    sum
}

/// Collapses a binary tree into a wide one.
struct Tree<'a> {
    nodes: &'a [Node],
    subtrees: &'a [Subtree],
    /// Most items of a leaf.
    leaf_size: u32,
    children: &'a mut Vec<Child>,
    levels: u32,
}

impl<'a> Tree<'a> {
    fn new(nodes: &'a [Node], subtrees: &'a [Subtree], leaf_size: u32, children: &'a mut Vec<Child>) -> Self {
        Self { nodes, subtrees, leaf_size, children, levels: 0 }
    }

    /// Converts the subtree of a node that is `level` levels below the root. `append` is called with the range of items of
    /// each binary leaf in turn. It appends them to the wide tree's items, and returns their number so far.
    fn convert(&mut self, node: u32, level: u32, append: &mut impl FnMut(Range<usize>) -> usize) -> Child {
        let Node { min, max, .. } = self.nodes[node as usize];
        let Subtree { items, kinds } = self.subtrees[node as usize];
        if self.is_leaf(node) {
            let end = self.append_items(node, append);
            let reference = reference(end - items as usize, items as usize, true);
            return Child { min, reference, max, kinds };
        }
        self.levels = self.levels.max(level + 1);
        let members = self.wide_children(node);
        let first = self.children.len();
        self.children.resize(first + members.len(), Child { min, reference: 0, max, kinds });
        for (i, &member) in members.iter().enumerate() {
            self.children[first + i] = self.convert(member, level + 1, append);
        }
        Child { min, reference: reference(first, members.len(), false), max, kinds }
    }

    /// Whether a node becomes a leaf of the wide tree.
    fn is_leaf(&self, node: u32) -> bool {
        self.nodes[node as usize].count > 0 || self.subtrees[node as usize].items <= self.leaf_size
    }

    /// Appends the items of a subtree. Returns the number of the wide tree's items so far.
    fn append_items(&self, node: u32, append: &mut impl FnMut(Range<usize>) -> usize) -> usize {
        let Node { count, first, .. } = self.nodes[node as usize];
        if count > 0 {
            return append(first as usize..(first + count) as usize);
        }
        self.append_items(first, append);
        self.append_items(first + 1, append)
    }

    /// The children of an inner node in the wide tree, at most [`WIDTH`] descendants.
    fn wide_children(&self, node: u32) -> Vec<u32> {
        let first = self.nodes[node as usize].first;
        let mut members = vec![first, first + 1];
        while members.len() < WIDTH as usize {
            let inner = |&at: &usize| !self.is_leaf(members[at]);
            let surface = |at: usize| self.surface(members[at]);
            let largest = |&a: &usize, &b: &usize| surface(a).total_cmp(&surface(b));
            let Some(at) = (0..members.len()).filter(inner).max_by(largest) else { break };
            let first = self.nodes[members[at] as usize].first;
            members[at] = first;
            members.push(first + 1);
        }
        members
    }

    /// Half the surface area of a node's box.
    fn surface(&self, node: u32) -> f32 {
        let Node { min, max, .. } = self.nodes[node as usize];
        let [x, y, z] = [0, 1, 2].map(|axis| max[axis] - min[axis]);
        x * y + y * z + z * x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain, the deepest binary tree: each inner node has a leaf of `leaf_size` items and the rest.
    fn chain(leaves: u32, leaf_size: u32) -> Vec<Node> {
        let at = |min: f32, max: f32, count, first| Node { min: [min; 3], count, max: [max; 3], first };
        let mut nodes = vec![at(0.0, leaves as f32, 0, 1)];
        for i in 0..leaves - 1 {
            let next = nodes.len() as u32 + 2;
            nodes.push(at(i as f32, i as f32 + 1.0, leaf_size, i * leaf_size));
            let last = i + 2 == leaves;
            let (count, first) = if last { (leaf_size, (i + 1) * leaf_size) } else { (0, next) };
            nodes.push(at(i as f32 + 1.0, leaves as f32, count, first));
        }
        nodes
    }

    #[test]
    fn a_wide_tree_holds_every_item_once_inside_its_boxes_and_joins_small_leaves() {
        for (leaves, leaf_size) in [(2, 8), (40, 3), (100, 8), (3, 1)] {
            let nodes = chain(leaves, leaf_size);
            let mut subtrees = vec![Subtree::default(); nodes.len()];
            summarize(&nodes, 0, &|_| OPAQUE, &mut subtrees);
            let mut children = Vec::new();
            let mut order: Vec<usize> = Vec::new();
            let mut tree = Tree::new(&nodes, &subtrees, WIDTH, &mut children);
            let root = tree.convert(0, 0, &mut |range| {
                order.extend(range);
                order.len()
            });
            let levels = tree.levels;
            assert!(levels <= leaves.div_ceil(7) + 1, "{levels} levels of {leaves}");
            let mut seen = vec![0; (leaves * leaf_size) as usize];
            let mut pending = vec![(root, 0)];
            while let Some((child, level)) = pending.pop() {
                let (first, count) =
                    ((child.reference & (MAX_INDEX as u32 - 1)) as usize, child.reference >> 29);
                let range = first..first + count as usize + 1;
                if child.reference >> 28 & 1 == 1 {
                    for &item in &order[range] {
                        seen[item] += 1;
                        let place = (item as u32 / leaf_size) as f32;
                        assert!(child.min[0] <= place && place + 1.0 <= child.max[0]);
                    }
                } else {
                    assert!(level < levels);
                    pending.extend(children[range].iter().map(|&child| (child, level + 1)));
                }
            }
            assert!(seen.iter().all(|&n| n == 1));
        }
    }
}
