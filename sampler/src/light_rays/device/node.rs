//! Nodes of eight children in 80 bytes: `shaders/shared/scattered/trees.wgsl`.

use super::collapse::{Binary, Bounds, WIDTH};

/// Words of a node.
const WORDS: usize = 20;
/// Word of a record that is a placed object.
const OF_PLACED: u32 = u32::MAX;
/// Byte of a place whose child is a node, without the place's number.
const IS_NODE: u32 = 0x38;
/// Smallest and largest biased exponent of a step.
const EXPONENTS: [i32; 2] = [1, 254];

/// A node in the program's layout.
pub(super) type Record = [u32; WORDS];

/// What leaves of a tree become.
pub(super) enum LeafUse<'a> {
    /// Triangles, whose indices are appended.
    Triangles(&'a mut Vec<u32>),
    /// Records of placed objects, one a leaf.
    Objects,
}

/// Appends a tree to `nodes`. Returns the index of its root and its number of levels.
pub(super) fn append(tree: &Binary, nodes: &mut Vec<Record>, leaves: &mut LeafUse<'_>) -> (u32, u32) {
    let root = nodes.len();
    nodes.push(empty());
    let levels = write(tree, 0, root, nodes, leaves);
    (root as u32, levels)
}

/// A node without children.
pub(super) fn empty() -> Record {
    [0; WORDS]
}

/// Writes a node and appends what is below it. Returns the number of its levels.
fn write(tree: &Binary, from: u32, to: usize, nodes: &mut Vec<Record>, leaves: &mut LeafUse<'_>) -> u32 {
    let around = tree.bounds(from);
    let places = placed(tree, &tree.children(from), &around);
    let mut record = Frame::new(&around).record(&places.map(|child| child.map(|child| tree.bounds(child))));
    let first_node = nodes.len();
    let mut below = Vec::new();
    record[4] = first_node as u32;
    record[5] = if let LeafUse::Triangles(order) = leaves { order.len() as u32 } else { 0 };
    for (place, child) in places.into_iter().enumerate() {
        let Some(child) = child else { continue };
        let byte = match (tree.items(child), &mut *leaves) {
            (Some(items), LeafUse::Triangles(order)) => {
                let offset = order.len() as u32 - record[5];
                order.extend_from_slice(items);
                ((1 << items.len()) - 1) << 5 | offset
            }
            (items, _) => {
                record[3] |= 1 << (24 + place);
                below.push((child, items.map(|items| items[0])));
                IS_NODE | place as u32
            }
        };
        record[6 + place / 4] |= byte << (place % 4 * 8);
    }
    nodes[to] = record;
    nodes.resize(first_node + below.len(), empty());
    let mut levels = 0;
    for (at, (child, object)) in (first_node..).zip(below) {
        if let Some(object) = object {
            nodes[at][3] = OF_PLACED;
            nodes[at][4] = object;
        } else {
            levels = levels.max(write(tree, child, at, nodes, leaves));
        }
    }
    levels + 1
}

/// Gives each child the place on its side of the node: bit a of a place's number stands for the upper half along axis a. The
/// pair of child and place that agree most is taken first.
fn placed(tree: &Binary, children: &[u32], around: &Bounds) -> [Option<u32>; WIDTH] {
    let mut places = [None; WIDTH];
    let mut left: Vec<(u32, [f32; 3])> = children
        .iter()
        .map(|&child| {
            let bounds = tree.bounds(child);
            (child, [0, 1, 2].map(|axis| bounds.middle(axis) - around.middle(axis)))
        })
        .collect();
    let gain = |side: &[f32; 3], place: usize| -> f32 {
        (0..3).map(|axis| if place >> axis & 1 == 1 { side[axis] } else { -side[axis] }).sum()
    };
    while !left.is_empty() {
        let free: Vec<usize> = (0..WIDTH).filter(|&place| places[place].is_none()).collect();
        let pairs = (0..left.len()).flat_map(|child| free.iter().map(move |&place| (child, place)));
        let of = |&(child, place): &(usize, usize)| gain(&left[child].1, place);
        let Some((child, place)) = pairs.max_by(|a, b| of(a).total_cmp(&of(b))) else { break };
        places[place] = Some(left.swap_remove(child).0);
    }
    places
}

/// Coordinates of a node's places: its least corner, and biased exponents of steps.
struct Frame {
    least: [f32; 3],
    exponents: [i32; 3],
}

impl Frame {
    fn new(around: &Bounds) -> Self {
        let exponent = |axis: usize| {
            let step = (f64::from(around.max[axis]) - f64::from(around.min[axis])) / 255.0;
            let near = if step > 0.0 { step.log2().ceil() as i32 + 127 } else { EXPONENTS[0] };
            // The logarithm may be rounded downwards.
            (near + i32::from(power(near) < step)).clamp(EXPONENTS[0], EXPONENTS[1])
        };
        Self { least: around.min, exponents: [0, 1, 2].map(exponent) }
    }

    /// A node's record with the boxes of its places, rounded outwards.
    fn record(&self, places: &[Option<Bounds>; WIDTH]) -> Record {
        let mut record = empty();
        for axis in 0..3 {
            record[axis] = self.least[axis].to_bits();
            record[3] |= (self.exponents[axis] as u32) << (8 * axis);
            let steps = |x: f32| (f64::from(x) - f64::from(self.least[axis])) / power(self.exponents[axis]);
            for (place, bounds) in places.iter().enumerate() {
                let Some(Bounds { min, max }) = bounds else { continue };
                let (word, shift) = (2 * axis + place / 4, place % 4 * 8);
                record[8 + word] |= (steps(min[axis]).floor().clamp(0.0, 255.0) as u32) << shift;
                record[14 + word] |= (steps(max[axis]).ceil().clamp(0.0, 255.0) as u32) << shift;
            }
        }
        record
    }
}

/// 2^(exponent - 127).
fn power(exponent: i32) -> f64 {
    2f64.powi(exponent - 127)
}
