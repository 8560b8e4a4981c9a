//! Trees of eight children a node, and triangles in blocks of eight, both as structures of arrays.

use argus_shaders::layout::sampler::Child;
use glam::Vec3;

use crate::bvh::{Hierarchy, Triangle, flags};
use crate::packets::lanes::LANES;
use crate::wide::Wide;

/// Pending references that a traversal has room for, 8 bytes each. Deeper trees are refused: more than 73 levels, where
/// those of buildings have about ten.
pub(super) const STACK: usize = 512;

/// Which faces of single-sided triangles rays pass. Rays hit both faces of all other triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CullMode {
    /// None: a wall keeps light out from either side. Glass lets light pass and is not hit, nor are its clear parts.
    None,
    /// Back faces, as views do.
    Back,
}

/// Bit of a reference to a leaf: a block of triangles, or a placed object.
pub(super) const LEAF: u32 = 1 << 31;

/// Reference of an unused place of a node, whose box no ray meets.
pub(super) const UNUSED: u32 = u32::MAX;

/// A node: the boxes of eight children, and what is in them.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// For each axis the smallest and the largest coordinates.
    pub(super) planes: [[[f32; LANES]; 2]; 3],
    /// For each child the index of a node, or that of a leaf with [`LEAF`].
    pub(super) children: [u32; LANES],
}

impl Node {
    /// No children. Each box is empty: its smallest coordinates are above its largest ones.
    pub(super) fn unused() -> Self {
        Self { planes: [[[f32::MAX; LANES], [f32::MIN; LANES]]; 3], children: [UNUSED; LANES] }
    }

    pub(super) fn set_box(&mut self, lane: usize, min: [f32; 3], max: [f32; 3]) {
        for axis in 0..3 {
            self.planes[axis][0][lane] = min[axis];
            self.planes[axis][1][lane] = max[axis];
        }
    }

    /// The box around all children.
    pub(super) fn around(&self) -> ([f32; 3], [f32; 3]) {
        let least = |axis: usize| self.planes[axis][0].iter().copied().fold(f32::MAX, f32::min);
        let most = |axis: usize| self.planes[axis][1].iter().copied().fold(f32::MIN, f32::max);
        ([least(0), least(1), least(2)], [most(0), most(1), most(2)])
    }
}

/// Up to eight triangles of a leaf. Unused places hold triangles without an area, which no ray hits.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Block {
    /// For each corner and axis the coordinates, in the object's space.
    pub(super) corners: [[[f32; LANES]; 3]; 3],
    /// Bits of the triangles whose back faces are hit.
    pub(super) back: u32,
    /// Bits of the triangles with an alpha test.
    pub(super) cutout: u32,
    /// Bits of the triangles whose second and third corner are exchanged.
    pub(super) mirrored: u32,
}

/// Instance ([`crate::bvh::OF_OBJECT`] where the placed object says it) and primitive of each triangle of a block.
pub(super) type Ids = [[u32; 2]; LANES];

/// An object's tree.
#[derive(Debug, Clone, Copy)]
pub(super) struct Root {
    /// Index of its node, or of its only block with [`LEAF`].
    pub(super) reference: u32,
    /// Box around its triangles.
    pub(super) min: Vec3,
    pub(super) max: Vec3,
}

/// The trees of all objects.
#[derive(Clone)]
pub(super) struct Trees {
    pub(super) nodes: Vec<Node>,
    pub(super) blocks: Vec<Block>,
    /// One entry a block.
    pub(super) ids: Vec<Ids>,
    /// One entry an object.
    pub(super) roots: Vec<Root>,
    /// Roots only: collapses top trees.
    wide: Wide,
}

impl Trees {
    /// Collapses the trees of a hierarchy. `None` if they are too large, or too deep for the stack of a traversal.
    pub(super) fn new(hierarchy: &Hierarchy, faces: CullMode) -> Option<Self> {
        let mut wide = Wide::new(hierarchy)?;
        if !fits(wide.levels) {
            return None;
        }
        let (children, triangles) = (std::mem::take(&mut wide.children), std::mem::take(&mut wide.triangles));
        let (mut nodes, mut blocks, mut ids) = (Vec::new(), Vec::new(), Vec::new());
        let mut take = |first: usize, count: usize| {
            let some = triangles.get(first..first + count).unwrap_or_default();
            let (block, block_ids) = block(some, faces);
            blocks.push(block);
            ids.push(block_ids);
            blocks.len() as u32 - 1
        };
        let mut roots = Vec::with_capacity(wide.roots.len());
        for root in &wide.roots {
            let reference = push(&children, root, &mut nodes, &mut take);
            roots.push(Root { reference, min: Vec3::from_array(root.min), max: Vec3::from_array(root.max) });
        }
        Some(Self { nodes, blocks, ids, roots, wide })
    }

    /// The top tree over placed objects: nodes, whose boxes depend on the eye and are not set, and the reference of the
    /// root. Nodes follow their parents. `None` if the tree is too deep.
    pub(super) fn top(&self, hierarchy: &Hierarchy) -> Option<(Vec<Node>, u32)> {
        let Some(first) = hierarchy.placed.first() else { return Some((Vec::new(), UNUSED)) };
        let (children, levels) = self.wide.top(hierarchy, first.origin);
        if !fits(levels) {
            return None;
        }
        let mut nodes = Vec::new();
        let root = push(&children, &children[0], &mut nodes, &mut |first, _| first as u32);
        Some((nodes, root))
    }
}

/// Whether a traversal's stack holds what a tree can leave pending: all children but one at each level.
fn fits(levels: u32) -> bool {
    (LANES - 1) * levels as usize <= STACK
}

/// Takes in what a child of a wide tree refers to. `leaf` is given the first item and the number of items of each leaf,
/// and returns the index of the leaf. Returns the reference.
fn push(
    children: &[Child],
    child: &Child,
    nodes: &mut Vec<Node>,
    leaf: &mut impl FnMut(usize, usize) -> u32,
) -> u32 {
    let (first, count) = ((child.reference & ((1 << 28) - 1)) as usize, (child.reference >> 29) as usize + 1);
    if child.reference >> 28 & 1 == 1 {
        return LEAF | leaf(first, count);
    }
    let at = nodes.len();
    nodes.push(Node::unused());
    for (lane, below) in children[first..first + count].iter().enumerate() {
        let reference = push(children, below, nodes, leaf);
        nodes[at].set_box(lane, below.min, below.max);
        nodes[at].children[lane] = reference;
    }
    at as u32
}

fn block(triangles: &[Triangle], faces: CullMode) -> (Block, Ids) {
    let mut block = Block { corners: [[[0.0; LANES]; 3]; 3], back: 0, cutout: 0, mirrored: 0 };
    let mut ids = [[0; 2]; LANES];
    // Glass lets light pass: its places stay unused.
    let is_met = |triangle: &Triangle| faces == CullMode::Back || triangle.flags & flags::GLASS == 0;
    for (lane, triangle) in triangles.iter().take(LANES).enumerate().filter(|(_, triangle)| is_met(triangle))
    {
        for (corner, position) in [triangle.a, triangle.b, triangle.c].into_iter().enumerate() {
            for (axis, coordinate) in position.into_iter().enumerate() {
                block.corners[corner][axis][lane] = coordinate;
            }
        }
        let bit = |is_set: bool| u32::from(is_set) << lane;
        block.back |= bit(faces == CullMode::None || triangle.flags & flags::ONE_SIDED == 0);
        let of_light = if faces == CullMode::None { flags::GLASS_IN_PARTS } else { 0 };
        block.cutout |= bit(triangle.flags & (flags::CUTOUT | of_light) != 0);
        block.mirrored |= bit(triangle.flags & flags::MIRRORED != 0);
        ids[lane] = [triangle.instance, triangle.primitive];
    }
    (block, ids)
}
