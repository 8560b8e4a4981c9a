//! The hierarchy as the compute tracer reads it: eight children to a node, side by side.
//!
//! A packet's lanes (`shaders/sampler/trace.wgsl`) test the children of a node together, and then the triangles of a
//! leaf, so a node is as wide, and a leaf as full, as eight lanes ask for. Wide nodes are made from the binary ones of
//! [`crate::bvh`] by opening the child with the largest surface until there are eight (Wald, Benthin, Boulos:
//! "Getting Rid of Packets", 2008, section 2.2).

use std::ops::Range;

use argus_shaders::layout::sampler::Child;
use glam::DVec3;

use crate::bvh::{Hierarchy, Node, Triangle, flags};

/// Children of a node, and triangles of a leaf.
const WIDTH: u32 = 8;

/// Kinds of triangles that are in a tree: [`Child::kinds`].
const OPAQUE: u32 = 1;
const CUTOUT: u32 = 2;

/// Most children and most triangles that a reference counts.
const MOST: usize = 1 << 28;

/// [`Child::reference`] to `count` nodes or triangles from `first` on.
fn reference(first: usize, count: usize, leaf: bool) -> u32 {
    (count as u32 - 1) << 29 | u32::from(leaf) << 28 | first as u32
}

/// Trees of triangles.
#[derive(Default)]
pub(crate) struct Wide {
    /// Of all trees' nodes.
    pub(crate) children: Vec<Child>,
    /// Leaf by leaf.
    pub(crate) triangles: Vec<Triangle>,
    /// Each object's root, described as a node describes its children.
    pub(crate) roots: Vec<Child>,
    /// Levels of nodes of the deepest tree.
    pub(crate) levels: u32,
}

impl Wide {
    /// Of all objects of a hierarchy. `None` if they are more than can be referred to.
    pub(crate) fn new(hierarchy: &Hierarchy) -> Option<Self> {
        if hierarchy.triangles.len().max(hierarchy.nodes.len()) > MOST {
            return None;
        }
        let mut wide = Self::default();
        let kind = |t: &Triangle| if t.flags & flags::CUTOUT == 0 { OPAQUE } else { CUTOUT };
        let kinds = |range: Range<usize>| hierarchy.triangles[range].iter().fold(0, |all, t| all | kind(t));
        let mut below = vec![Below::default(); hierarchy.nodes.len()];
        for object in &hierarchy.objects {
            sum_up(&hierarchy.nodes, object.root, &kinds, &mut below);
            let mut tree = Tree::new(&hierarchy.nodes, &below, WIDTH, &mut wide.children);
            let triangles = &mut wide.triangles;
            let root = tree.take_in(object.root, 0, &mut |range| {
                triangles.extend_from_slice(&hierarchy.triangles[range]);
                triangles.len()
            });
            wide.levels = wide.levels.max(tree.levels);
            wide.roots.push(root);
        }
        Some(wide)
    }

    /// The tree over placed objects about an eye, its root first, and its levels.
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
        let mut below = vec![Below::default(); nodes.len()];
        sum_up(&nodes, 0, &kinds, &mut below);
        let mut tree = Tree::new(&nodes, &below, 1, &mut children);
        // Placed objects stay in their order, one to a leaf.
        let root = tree.take_in(0, 0, &mut |range| range.end);
        let levels = tree.levels;
        children[0] = root;
        (children, levels)
    }
}

/// What is below a node of a binary tree.
#[derive(Clone, Copy, Default)]
struct Below {
    items: u32,
    kinds: u32,
}

/// Counts items and joins their kinds from the leaves up.
fn sum_up(nodes: &[Node], node: u32, kinds: &impl Fn(Range<usize>) -> u32, below: &mut [Below]) -> Below {
    let Node { count, first, .. } = nodes[node as usize];
    let sum = if count > 0 {
        Below { items: count, kinds: kinds(first as usize..(first + count) as usize) }
    } else {
        let [a, b] = [first, first + 1].map(|child| sum_up(nodes, child, kinds, below));
        Below { items: a.items + b.items, kinds: a.kinds | b.kinds }
    };
    below[node as usize] = sum;
    sum
}

/// A binary tree that becomes a wide one.
struct Tree<'a> {
    nodes: &'a [Node],
    below: &'a [Below],
    /// Most items of a leaf.
    a_leaf: u32,
    children: &'a mut Vec<Child>,
    levels: u32,
}

impl<'a> Tree<'a> {
    fn new(nodes: &'a [Node], below: &'a [Below], a_leaf: u32, children: &'a mut Vec<Child>) -> Self {
        Self { nodes, below, a_leaf, children, levels: 0 }
    }

    /// Takes in what is below a node, `level` nodes under the root, and describes it. `take` is given the items of
    /// one binary leaf after another, and returns where the last of them ends.
    fn take_in(&mut self, node: u32, level: u32, take: &mut impl FnMut(Range<usize>) -> usize) -> Child {
        let Node { min, max, .. } = self.nodes[node as usize];
        let Below { items, kinds } = self.below[node as usize];
        if self.is_leaf(node) {
            let end = self.take_leaves(node, take);
            let reference = reference(end - items as usize, items as usize, true);
            return Child { min, reference, max, kinds };
        }
        self.levels = self.levels.max(level + 1);
        let members = self.opened(node);
        let first = self.children.len();
        self.children.resize(first + members.len(), Child { min, reference: 0, max, kinds });
        for (i, &member) in members.iter().enumerate() {
            self.children[first + i] = self.take_in(member, level + 1, take);
        }
        Child { min, reference: reference(first, members.len(), false), max, kinds }
    }

    fn is_leaf(&self, node: u32) -> bool {
        self.nodes[node as usize].count > 0 || self.below[node as usize].items <= self.a_leaf
    }

    fn take_leaves(&self, node: u32, take: &mut impl FnMut(Range<usize>) -> usize) -> usize {
        let Node { count, first, .. } = self.nodes[node as usize];
        if count > 0 {
            return take(first as usize..(first + count) as usize);
        }
        self.take_leaves(first, take);
        self.take_leaves(first + 1, take)
    }

    /// Up to [`WIDTH`] nodes that cover what an inner node covers.
    fn opened(&self, node: u32) -> Vec<u32> {
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

    fn surface(&self, node: u32) -> f32 {
        let Node { min, max, .. } = self.nodes[node as usize];
        let [x, y, z] = [0, 1, 2].map(|axis| max[axis] - min[axis]);
        x * y + y * z + z * x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain, which is as deep as a binary tree can be: each inner node has a leaf of `a_leaf` and the rest.
    fn chain(leaves: u32, a_leaf: u32) -> Vec<Node> {
        let at = |min: f32, max: f32, count, first| Node { min: [min; 3], count, max: [max; 3], first };
        let mut nodes = vec![at(0.0, leaves as f32, 0, 1)];
        for i in 0..leaves - 1 {
            let next = nodes.len() as u32 + 2;
            nodes.push(at(i as f32, i as f32 + 1.0, a_leaf, i * a_leaf));
            let last = i + 2 == leaves;
            let (count, first) = if last { (a_leaf, (i + 1) * a_leaf) } else { (0, next) };
            nodes.push(at(i as f32 + 1.0, leaves as f32, count, first));
        }
        nodes
    }

    #[test]
    fn a_wide_tree_holds_every_item_once_inside_its_boxes_and_joins_small_leaves() {
        for (leaves, a_leaf) in [(2, 8), (40, 3), (100, 8), (3, 1)] {
            let nodes = chain(leaves, a_leaf);
            let mut below = vec![Below::default(); nodes.len()];
            sum_up(&nodes, 0, &|_| OPAQUE, &mut below);
            let mut children = Vec::new();
            let mut order: Vec<usize> = Vec::new();
            let mut tree = Tree::new(&nodes, &below, WIDTH, &mut children);
            let root = tree.take_in(0, 0, &mut |range| {
                order.extend(range);
                order.len()
            });
            let levels = tree.levels;
            assert!(levels <= leaves.div_ceil(7) + 1, "{levels} levels of {leaves}");
            let mut seen = vec![0; (leaves * a_leaf) as usize];
            let mut pending = vec![(root, 0)];
            while let Some((child, level)) = pending.pop() {
                let (first, count) = ((child.reference & (MOST as u32 - 1)) as usize, child.reference >> 29);
                let range = first..first + count as usize + 1;
                if child.reference >> 28 & 1 == 1 {
                    for &item in &order[range] {
                        seen[item] += 1;
                        let place = (item as u32 / a_leaf) as f32;
                        assert!(child.min[0] <= place && place + 1.0 <= child.max[0]);
                    }
                } else {
                    assert!(level < levels);
                    pending.extend(children[range].iter().map(|&below| (below, level + 1)));
                }
            }
            assert!(seen.iter().all(|&n| n == 1));
        }
    }
}
